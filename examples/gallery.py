"""Make the figures and tables of the gallery, by the code that its pages show.

    python examples/gallery.py [FOLDER [PAGE ...]]

runs the Python block of every page of docs/gallery (or of the pages named) and writes what it makes, `figure`
or `table`: FOLDER/figures/NAME.svg, NAME being that of the page's picture, and FOLDER/gallery/PAGE.md with
the new table. FOLDER is out/gallery if left out; the documentation's own is docs.
"""

from __future__ import annotations

import contextlib
import re
import sys
import tempfile
from pathlib import Path

from stickslip.report.figures.style import svg

PAGES = Path(__file__).resolve().parents[1] / "docs" / "gallery"
CODE = re.compile(r"```python\n(.*?)```", re.DOTALL)
PICTURE = re.compile(r"!\[[^\]]+\]\(\.\./figures/([\w-]+)\.svg\)")
TABLE = re.compile(r"(?<=% table\n).*?(?=% end of table)", re.DOTALL)


def made_by(page: str) -> dict:
    """The names that the code of a page leaves."""
    names: dict = {}
    (code,) = CODE.findall(page)
    exec(compile(code, "<page>", "exec"), names)
    return names


def main(folder: Path, wanted: list[str]) -> None:
    """Run, draw, write."""
    folder = folder.resolve()
    for name in ("figures", "gallery"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work, contextlib.chdir(work):
        for path in sorted(PAGES.glob("*.md")):
            if wanted and path.stem not in wanted:
                continue
            text = path.read_text(encoding="utf-8")
            names = made_by(text)
            for picture in PICTURE.findall(text):
                figure = names["figure"]
                drawn = getattr(figure, "svg", None) or svg(figure)
                (folder / "figures" / f"{picture}.svg").write_text(drawn + "\n", encoding="utf-8")
            if TABLE.search(text):
                text = TABLE.sub(lambda _, table=names["table"]: f"\n{table.strip()}\n\n", text)
                (folder / "gallery" / path.name).write_text(text, encoding="utf-8")
            print(path.stem, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/gallery"), sys.argv[2:])
