"""Pages of measured results: a study replaces its parts of the page, and only these."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from benchmarks import (
    control_mpc,
    folder_fuzz,
    hostile_files,
    open_loop,
    random_actuators,
    random_orbits,
    real_moves,
)
from benchmarks.results import filled, write_page

WALKS = len(open_loop.WALKS)
FUZZED = folder_fuzz.Found()
FUZZED.seconds["history"] = [1.5]
PAGES = {
    open_loop.OUT: lambda: open_loop.measured(
        [open_loop.Trial([*range(WALKS)], [0.5] * WALKS, [0.1] * WALKS, False)] * 2, 3
    ),
    real_moves.OUT: lambda: real_moves.measured(
        {w: real_moves.Scripted(np.array([20.0, -30.0]), np.array([0.2, 0.3])) for w in real_moves.SESSIONS},
        [real_moves.Moved(True, 0.3, 20e-9, "")] * 3,
        1,
    ),
    hostile_files.PAGE: lambda: hostile_files.measured(
        [hostile_files.Cost("Python", "a.csv", 1.0, 0.5, 200.0, 1, "a.csv: no", True)], 1
    ),
    control_mpc.OUT: lambda: control_mpc.measured(
        "9.9", [control_mpc.Row("ours", "as it is", (1.0, 2.0), 0.0, 0.0)]
    ),
    folder_fuzz.PAGE: lambda: folder_fuzz.measured(FUZZED, "python -m benchmarks.folder_fuzz 7", 12.0),
    random_orbits.PAGE: lambda: random_orbits.measured(
        [random_orbits.compared(random_actuators.member(number, 3)) for number in (0, 1)], 2, 3
    ),
}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_study_has_the_parts_of_its_page(page: Path, tmp_path: Path) -> None:
    parts = PAGES[page]()
    text = write_page(tmp_path / "page.md", parts, page)
    for part in parts.values():
        assert part.strip() in text
    words = re.compile(r"<!-- (\w+) -->.*?<!-- end -->|\n<sub>.*", re.DOTALL)
    assert words.sub(r"\1", text).strip() == words.sub(r"\1", page.read_text(encoding="utf-8")).strip()
    assert re.search(r"\n<sub>\d{4}-\d\d-\d\d, .*</sub>\n\Z", text)


def test_another_part_is_refused() -> None:
    page = "# Title\n\n<!-- rows -->\n\n1\n\n<!-- end -->\n"
    assert filled(page, {"rows": "2"}, Path("p.md")) == page.replace("1", "2")
    with pytest.raises(ValueError, match=r"p\.md: the page has the parts \['rows'\], measured are \['row'\]"):
        filled(page, {"row": "2"}, Path("p.md"))
