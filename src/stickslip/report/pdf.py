"""Conversion of an HTML file, such as report.html, to PDF by a browser."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from ..recording.replacing import replaced_whole

_BROWSERS = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome", "chrome", "msedge")
_SECONDS = 120.0  # time after which a browser that has not finished is killed, s


class PdfError(ValueError):
    """Error: no PDF can be made; the message says what is missing, or the browser's error."""


def find_browser() -> str:
    """Return the path of the first installed Chromium browser of `_BROWSERS`, which can print to PDF.

    Raises:
        PdfError: no browser is installed.
    """
    for name in _BROWSERS:
        path = shutil.which(name)
        if path:
            return path
    raise PdfError(
        f"a PDF needs a Chromium browser ({', '.join(_BROWSERS)}), and none is found; install one, or print "
        "report.html to PDF in any browser"
    )


def write_pdf(page: Path, browser: str = "") -> Path:
    """Print an HTML file to a PDF in the same folder, and return its path.

    The PDF has the page's name with the ending ".pdf". An existing PDF is replaced as a whole or not at all.

    Args:
        page: the HTML file.
        browser: path of a Chromium browser; by default one that is found.

    Raises:
        PdfError: there is no browser, it fails, or it takes more than `_SECONDS`.
        OSError: the PDF cannot be written.
    """
    browser, target = browser or find_browser(), page.with_suffix(".pdf")
    # Run by root, for example in a container, Chromium does not start with its sandbox. The page needs no
    # sandbox, because this package wrote the page.
    alone = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    with tempfile.TemporaryDirectory() as profile:
        made = Path(profile) / "made.pdf"
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            *alone,
            f"--user-data-dir={profile}",
            "--no-pdf-header-footer",
            f"--print-to-pdf={made}",
            page.resolve().as_uri(),
        ]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_SECONDS)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise PdfError(f"{browser} does not print {page.name} to PDF: {error}") from error
        if done.returncode or not made.exists():
            said = (done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1]
            raise PdfError(f"{browser} does not print {page.name} to PDF: {said}")
        with replaced_whole(target) as temporary:
            shutil.copyfile(made, temporary)
    return target
