"""CPU seconds of the tests by folder, with a budget (a plugin of pytest: ``-p tools.cpu_seconds``).

Counted is the time of the test processes and of the processes that they started and waited for, not that of a
clock: other programs on the machine do not change it.
"""

from __future__ import annotations

import resource
from collections import Counter
from collections.abc import Generator
from pathlib import PurePath
from typing import Any

import pytest

_KEY = "cpu_seconds"
_SLOWEST = 20  # files that are named


def _used() -> float:
    of = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in of)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--cpu-budget", type=float, metavar="S", help="fail above so many CPU seconds of all tests"
    )


class _Seconds:
    """Time used by each test, in the process that runs it."""

    def __init__(self) -> None:
        self._before = _used()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: Any) -> Generator[None, Any, Any]:
        if call.when == "teardown":  # what no test used, such as collecting, is counted to the next one
            now = _used()
            item.user_properties.append((_KEY, now - self._before))
            self._before = now
        return (yield)


class _Table:
    """The sum by folder and file, in the process that reports."""

    def __init__(self, budget: float | None) -> None:
        self._budget, self._files = budget, Counter[str]()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "teardown":
            used: Any = dict(report.user_properties).get(_KEY, 0.0)
            self._files[report.nodeid.split("::")[0]] += used

    @property
    def _whole(self) -> float:
        return sum(self._files.values())

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self._budget is not None and self._whole > self._budget and not session.exitstatus:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        folders = Counter[str]()
        for file, seconds in self._files.items():
            folders[str(PurePath(file).parent)] += seconds
        allowed = "" if self._budget is None else f", of {self._budget:,.0f} allowed"
        terminalreporter.section(f"CPU seconds: {self._whole:,.0f}{allowed}")
        for title, found in (
            ("by folder", folders.most_common()),
            ("by file", self._files.most_common(_SLOWEST)),
        ):
            terminalreporter.write_line(title)
            for name, seconds in found:
                terminalreporter.write_line(f"{seconds:8.1f}  {name}")


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):  # of xdist; who distributes the tests runs none
        config.pluginmanager.register(_Table(config.getoption("--cpu-budget")))
    config.pluginmanager.register(_Seconds())
