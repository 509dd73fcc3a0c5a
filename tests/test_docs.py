"""The documentation: the tutorial runs, and its pages build without a warning."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from public_names import everything
from tools.site import folder_of, newest

from stickslip import __version__

ROOT = Path(__file__).resolve().parents[1]


def test_the_tutorial_finds_what_it_hides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its cells in order, but for the one that draws in a notebook."""
    text = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    cells = re.findall(r"```\{code-cell\} ipython3\n(.*?)```", text, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for cell in cells:
        if "IPython" not in cell:
            exec(cell, names)
    assert len(cells) == 10
    found = names["document"].numbers["friction"]["parameters_with_all_errors"]
    for name in ("sigma_0", "coulomb_force"):
        true = getattr(names["hidden"].friction, name)
        assert abs(found[name].value - true) < 3.0 * found[name].standard_error
    assert names["document"].failures == ()
    low, high = names["tied"].confidence_intervals()["sigma_1"]
    assert low < names["hidden"].friction.sigma_1 < high
    assert (tmp_path / "tutorial-files" / "campaign.yaml").is_file()


class Page(HTMLParser):
    """Links and anchors of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id":
                self.anchors.add(value or "")
            elif name in ("href", "src") and value:
                self.links.append(value)


def broken_links(texts: dict[Path, str]) -> list[str]:
    """Links to a file or an anchor that is not there."""
    pages = {path: Page(text) for path, text in texts.items()}
    broken = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchors = pages[target].anchors if target in pages else {unquote(parts.fragment)}
            if not target.exists() or (parts.fragment and unquote(parts.fragment) not in anchors):
                broken.append(f"{path.name}: {link}")
    return broken


def test_the_site_builds_without_a_warning_and_needs_no_network(tmp_path: Path) -> None:
    """All but the execution of the pages, which other tests run. The folder of an earlier version stays."""
    site = tmp_path / "site"
    (site / "0.0.9").mkdir(parents=True)
    (site / "0.0.9" / "index.html").write_text("earlier")
    done = subprocess.run(
        [sys.executable, "-m", "tools.site", site, "https://example.org/docs", "-D", "nb_execution_mode=off"],
        capture_output=True,
        text=True,
        timeout=900,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
    )
    assert done.returncode == 0, done.stderr
    name = folder_of(__version__)
    pages = {p.resolve(): p.read_text("utf-8") for p in (site / name).rglob("*.html")}
    for path, text in pages.items():
        loaded = re.findall(r'<(?:script|img|link)[^>]+(?:src|href)="(https?:[^"]+)"', text)
        assert not [one for one in loaded if not one.startswith("https://example.org/docs/")], path.name
    reference = "".join(text for path, text in pages.items() if path.parent.name == "api")
    for public in everything():
        assert f'id="stickslip.{public}"' in reference, public
    top = {(site / "index.html").resolve(): (site / "index.html").read_text("utf-8")}
    assert broken_links(pages | top) == []

    listed = re.findall(
        r"<loc>https://example.org/docs/(\S+)</loc>", (site / name / "sitemap.xml").read_text()
    )
    assert len(listed) > 100
    assert all((site / one).is_file() for one in listed)
    searched = (site / name / "searchindex.js").read_text("utf-8")
    assert all(f'"{word}"' in searched for word in ("file-format", "tutorial", "api/identify"))
    assert f"url={newest([name, '0.0.9'])}/index.html" in next(iter(top.values()))
    assert '<a href="0.0.9/index.html">' in next(iter(top.values()))


def test_a_broken_link_is_found(tmp_path: Path) -> None:
    a, b = tmp_path / "a.html", tmp_path / "b.html"
    a.touch()
    b.touch()
    texts = {a: '<a id="here"></a><a href="#here"></a><a href="b.html#there"></a>', b: "<img src='c.png'>"}
    assert broken_links(texts) == ["a.html: b.html#there", "b.html: c.png"]


def test_the_newest_release_is_shown_first() -> None:
    assert newest(["dev", "0.9.0", "0.10.0", "0.2.1"]) == "0.10.0"
    assert newest(["dev"]) == folder_of("0.2.0.dev0") == folder_of("0.2.0rc1") == "dev"
    assert folder_of("0.2.0") == "0.2.0"
