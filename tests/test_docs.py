"""The documentation: the tutorial runs, and its pages build without a warning."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from public_names import everything

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


def test_the_pages_build_without_a_warning_and_need_no_network(tmp_path: Path) -> None:
    """All but the execution of the tutorial, which the test above runs."""
    options = ["-D", "nb_execution_mode=off", "-W", "--keep-going", "-q", "-b", "html"]
    command = [sys.executable, "-m", "sphinx", *options, "-d", str(tmp_path / "trees")]
    done = subprocess.run(
        [*command, str(ROOT / "docs"), str(tmp_path / "pages")],
        capture_output=True,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
    )
    assert done.returncode == 0, done.stderr
    pages = {p: p.read_text("utf-8") for p in (tmp_path / "pages").rglob("*.html")}
    for path, text in pages.items():
        loaded = re.findall(r'<(?:script|img|link)[^>]+(?:src|href)="(https?:[^"]+)"', text)
        assert not loaded, f"{path.name} loads {loaded}"
    reference = "".join(text for path, text in pages.items() if path.parent.name == "api")
    for name in everything():
        assert f'id="stickslip.{name}"' in reference, name
