"""Writing of a report to disk: results.json first; then report.html and the figures, replaced together once
all are written."""

from __future__ import annotations

import os
from pathlib import Path

from ..quantities.units import optional_si
from ..recording.replacing import part_of, replaced_whole
from .circumstances import circumstances
from .document import Document
from .html import report_html
from .results import results_json


def write_report(
    document: Document,
    folder: str | os.PathLike[str],
    *,
    command: str = "",
    elapsed: float | str | None = None,
) -> Path:
    """Write ``report.html``, ``results.json``, ``figures/NAME.svg`` and the document's own files into a
    folder, made if missing.

    results.json is written first, so that the numbers are kept if the rest fails. The other files take their
    names only when all of them are complete on disk: a full disk leaves the previous report. Other files in
    the folder are not touched.

    Args:
        document: the document to write.
        folder: target folder.
        command: the user's command line, which the report states; "" for none.
        elapsed: duration of the work, s; None: not measured.

    Returns:
        The path of report.html.

    Raises:
        DocumentError: a number without a unit.
        OSError: the folder or a file cannot be written.
    """
    made = circumstances(command, optional_si(elapsed, "s", "elapsed"))
    folder = Path(folder)
    numbers = folder / "results.json"
    with replaced_whole(numbers) as temporary:
        folder.mkdir(parents=True, exist_ok=True)
        temporary.write_text(results_json(document, made), encoding="utf-8", newline="\n")
    texts = {f"figures/{picture.name}.svg": _file_of(picture.svg) for picture in document.pictures()}
    texts |= document.files
    texts["report.html"] = report_html(document, made)
    written: dict[Path, Path] = {}
    try:
        for name, text in texts.items():
            written[folder / name] = _written_beside(folder / name, text)
        for target, temporary in written.items():
            os.replace(temporary, target)
    finally:
        for temporary in written.values():
            temporary.unlink(missing_ok=True)
    return folder / "report.html"


def _file_of(svg: str) -> str:
    return f'<?xml version="1.0" encoding="utf-8"?>\n{svg}\n'


def _written_beside(target: Path, text: str) -> Path:
    """Write a complete temporary file in the folder of the target, and return its path.

    The text is on the disk (fsync) at the end. If an error occurs, the temporary file is deleted.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = part_of(target)
    try:
        with temporary.open("w", encoding="utf-8", newline="\n") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    return temporary
