"""A small case of `benchmarks.folder_fuzz`, with two folders that hold damage of most kinds."""

from __future__ import annotations

from benchmarks.folder_fuzz import run


def test_good_runs_are_listed_and_bad_entries_have_reasons() -> None:
    found = run(2, seed=40)
    assert found.wrong == []
    assert found.counts["good runs"] >= 4
    assert found.counts["listed with a reason"] >= 3
    assert found.counts["requests"] > 20
