"""A small case of `benchmarks.folder_fuzz`, with two folders that hold damage of most kinds."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

from benchmarks.folder_fuzz import run


def test_good_runs_are_listed_and_bad_entries_have_reasons() -> None:
    with ThreadPoolExecutor(1) as thread:  # for a browser may be driven by a loop of this one
        found = thread.submit(run, 2, seed=40).result()
    assert found.wrong == []
    assert found.counts["good runs"] >= 4
    assert found.counts["listed with a reason"] >= 3
    assert found.counts["requests"] > 20
