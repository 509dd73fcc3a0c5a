"""The gallery of the documentation: a page for each figure, and the code that makes it."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

from stickslip.report.figures import thesis
from stickslip.report.figures.style import svg

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    page.stem: page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs" / "gallery").glob("*.md"))
}
FIGURES = ROOT / "docs" / "figures"


def maker():
    """The module examples/gallery.py."""
    spec = importlib.util.spec_from_file_location("gallery", ROOT / "examples" / "gallery.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_page_shows_its_code_and_what_it_makes() -> None:
    for name, text in PAGES.items():
        codes = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
        assert len(codes) == 1, name
        compile(codes[0], name, "exec")
        assigned = [line.split(" = ")[0] for line in codes[0].splitlines() if " = " in line]
        makes = {target for targets in assigned for target in targets.split(", ")}
        pictures = re.findall(r"!\[[^\]]+\]\(\.\./figures/([\w-]+\.svg)\)", text)
        assert ("figure" in makes and len(pictures) == 1) or ("table" in makes and "\n| law |" in text), name
        for picture in pictures:
            assert 1000 < (FIGURES / picture).stat().st_size < 350_000


def test_the_overview_leads_to_every_page_and_every_figure_is_shown() -> None:
    overview = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^gallery/([\w-]+)$", overview, re.MULTILINE)) == PAGES.keys()
    assert set(re.findall(r"\]\(gallery/([\w-]+)\.md\)", overview)) == PAGES.keys()
    files = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"]
    pages = "".join(page.read_text("utf-8") for page in files)
    assert all(f"figures/{file.name})" in pages for file in FIGURES.glob("*.svg"))


def test_figures_and_assumptions_are_named() -> None:
    text = "".join(PAGES.values())
    named = ("2.1", "2.4", "3.1-3.4", "3.7", "5.1", "5.2", "5.4")
    for figure in (*(f"(fig. {n})" for n in named), "(sec. 3.2)"):
        assert figure in text
    assert text.count("*Assumed:") >= 5
    scale = re.search(r"x = (\d+) µm/s²", PAGES["lugre-parabola"])
    assert scale is not None
    assert float(scale[1]) * 2e-6 == pytest.approx(thesis.PARABOLA)


@pytest.mark.parametrize(
    "name",
    ["static-friction", "elastoplastic", "drive-signals", "there-and-back", "starved-amplifier", "heat"],
)
def test_the_code_makes_the_committed_figure(name: str) -> None:
    figure = svg(maker().made_by(PAGES[name])["figure"])
    (picture,) = re.findall(r"figures/([\w-]+\.svg)\)", PAGES[name])
    committed = (FIGURES / picture).read_text(encoding="utf-8")

    def labels(text: str) -> list[str]:
        """What is written in it: glyphs are outlines, but each text is a comment too."""
        return re.findall(r"<!--(.*?)-->", text)

    assert labels(figure) == labels(committed)
    assert len(labels(figure)) > 5


def test_the_script_writes_what_is_asked_for(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "examples" / "gallery.py"), str(tmp_path), "drive-signals"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.split() == ["drive-signals"]
    assert [p.name for p in (tmp_path / "figures").iterdir()] == ["drive.svg"]
