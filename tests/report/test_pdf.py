"""The report on paper, by Debian's chromium."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from playwright.sync_api import sync_playwright

from stickslip.report import PdfError, write_pdf, write_report

from .sample import sample


@pytest.mark.browser
def test_a_report_becomes_a_pdf_beside_it(tmp_path: Path) -> None:
    page = write_report(sample(), tmp_path)
    made = write_pdf(page)
    assert made == tmp_path / "report.pdf"
    data = made.read_bytes()
    assert data.startswith(b"%PDF-")
    assert re.search(rb"/MediaBox \[0 0 59[45][.\d]* 84[12][.\d]*\]", data), "A4"
    before = {f.name for f in tmp_path.iterdir()}
    write_pdf(page)
    assert {f.name for f in tmp_path.iterdir()} == before


@pytest.mark.browser
def test_paper_cuts_no_figure_and_no_short_table(tmp_path: Path) -> None:
    page = write_report(sample(), tmp_path)
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        tab = browser.new_page()
        tab.goto(page.as_uri())
        tab.emulate_media(media="print")
        inside = tab.eval_on_selector_all(
            "figure, .table, tr", "all => all.map(one => getComputedStyle(one).breakInside)"
        )
        after = tab.eval_on_selector_all("h2, h3", "all => all.map(one => getComputedStyle(one).breakAfter)")
        tallest = tab.eval_on_selector_all(
            ".paper svg", "all => Math.max(...all.map(one => parseFloat(getComputedStyle(one).maxHeight)))"
        )
        browser.close()
    assert set(inside) == {"avoid"}
    assert set(after) == {"avoid"}
    assert tallest < (297 - 18 - 20) / 25.4 * 96  # px: a figure is never taller than a page


def test_a_browser_that_does_not_print_is_told_apart(tmp_path: Path) -> None:
    page = write_report(sample(), tmp_path)
    broken = tmp_path / "chromium"
    broken.write_text("#!/bin/sh\necho no display >&2\nexit 3\n")
    broken.chmod(0o755)
    with pytest.raises(PdfError, match=r"does not print report\.html to PDF: no display"):
        write_pdf(page, str(broken))
    with pytest.raises(PdfError, match="does not print"):
        write_pdf(page, str(tmp_path / "none"))
    assert not (tmp_path / "report.pdf").exists()
