"""The page of results, in Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from .equal_error import cost_at
from .problems import MEMBERS
from .results import provenance

Row = dict[str, Any]

# Where the ratios are taken: an error that every good tool reaches, m.
TARGETS = {"P1": 0.3e-9, "P2": 1e-9}
_AT_WALL = (TARGETS["P2"], "wall_ms_median", "median_error_m")


def page(results: dict[str, Any]) -> str:
    """All parts that have run, in the order below."""
    text = [_INTRODUCTION]
    for part, (title, lines) in _SECTIONS.items():
        if part in results:
            found = results[part]
            rows = [row for row in found["rows"] if "not_run" not in row]
            text += [f"## {title}", *lines(rows), *_not_run(found["rows"]), _where(found)]
    return "\n\n".join(line.strip() for line in text if line) + "\n"


_INTRODUCTION = """
# Benchmarks

`make bench` writes this page (`make bench PART=trajectory` one part). [results.json](results.json) contains
every run, with settings, spread and versions. The tools run in turn on one machine and restart where the
drive jumps. Times are medians of CPU time without compilation. Errors of trajectories refer to an independent
solution at a relative tolerance of 1e-13. Problems: `benchmarks/problems.py`; programs of the other tools:
`benchmarks/peers/`.
"""


def _where(found: dict[str, Any]) -> str:
    load = f"load {found['load_average']:.1f}"
    return provenance(found["made"][:10], found["machine"], found.get("commit", ""), load)


def _not_run(rows: Iterable[Row]) -> list[str]:
    missing = [f"{_name(row)}: {row['not_run']}" for row in rows if "not_run" in row]
    return ["Not run: " + "; ".join(missing) + "."] if missing else []


def _name(row: Row) -> str:
    return ", ".join(str(row[key]) for key in ("tool", "method", "setting", "problem") if row.get(key))


def _table(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(cells) + " |" for cells in body)])


def _number(value: float | None, digits: int = 3) -> str:
    return "-" if value is None else f"{value:.{digits}g}"


def _groups(rows: Iterable[Row]) -> dict[tuple[str, str], list[Row]]:
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        found.setdefault((row["tool"], row["method"]), []).append(row)
    return found


def _trajectory(rows: list[Row]) -> list[str]:
    costs: dict[str, dict[str, float]] = {}
    for problem, target in TARGETS.items():
        groups = _groups(row for row in rows if row["problem"] == problem)
        for (tool, method), group in groups.items():
            cost = cost_at(group, target, "cpu_ms_median", "max_error_m")
            name = f"{tool}, {method}" if tool == "stickslip" else tool
            if cost:
                costs.setdefault(name, {}).setdefault(problem, cost)
                costs[name][problem] = min(cost, costs[name][problem])
    peers = [found for name, found in costs.items() if not name.startswith("stickslip")]
    best = {problem: min(found[problem] for found in peers if problem in found) for problem in TARGETS}
    body = [
        (name, *(_with_ratio(found.get(problem), best[problem]) for problem in TARGETS))
        for name, found in sorted(costs.items(), key=lambda item: item[1].get("P1", float("inf")))
    ]
    return [
        "8 periods, 1601 samples. P1 is the thesis's actuator, P2 has a stiff contact with a Stribeck curve. "
        "Costs are interpolated between two settings of a tool, for its fastest method. *Engine* is the "
        "compiled solver; `ss.simulate` adds checks and the labelled dataset. The engine copies a period "
        "that repeats an earlier one. *No period repeats*: the drive differs by 1e-9 of the amplitude.",
        "![work-precision](work-precision.svg)",
        _table(("tool", *(f"{name}: CPU ms at {error * 1e9:g} nm" for name, error in TARGETS.items())), body),
        "In brackets: the cost relative to the best other tool.",
    ]


def _with_ratio(cost: float | None, best: float) -> str:
    return f"{_number(cost)} ({_number(cost / best)})" if cost else "-"


def _steady(rows: list[Row]) -> list[str]:
    head = ("problem", "tool, setting", "CPU ms", "error, m")
    body = [
        (
            row["problem"],
            f"{row['tool'] if row['tool'] != 'stickslip' else row['method']}, {row['setting']}",
            _number(row["cpu_ms_median"]),
            _number(row["max_error_m"], 2),
        )
        for row in sorted(rows, key=lambda row: (row["problem"], row["cpu_ms_median"]))
        if row["method"] == "ss.steady_step" or row is _cheapest_peer(rows, row["problem"])
    ]
    return [
        "The net step per period of the periodic motion. `ss.steady_step` solves for the periodic motion. "
        "The others, at their fastest setting within 1 nm, simulate until the step has settled to 0.1 nm.",
        _table(head, body),
    ]


def _cheapest_peer(rows: list[Row], problem: str) -> Row | None:
    good = [
        row
        for row in rows
        if row["problem"] == problem and row["tool"] != "stickslip" and row["max_error_m"] < TARGETS["P2"]
    ]
    return min(good, key=lambda row: row["cpu_ms_median"], default=None)


def _ensemble(rows: list[Row]) -> list[str]:
    members = [row for row in rows if "median_error_m" in row]
    growth = [row for row in rows if "peak_memory_bytes" in row]
    costs = {
        name: cost
        for name, group in _groups(members).items()
        if (cost := cost_at(group, TARGETS["P2"], "cpu_ms_median", "median_error_m"))
    }
    best = min((cost for name, cost in costs.items() if name[0] != "stickslip"), default=None)
    body = [
        (
            f"{name[0]}, {name[1]}",
            f"{1e3 * MEMBERS / (cost_at(_groups(members)[name], *_AT_WALL) or math.inf):.0f}",
            f"{1e3 * MEMBERS / cost:.0f}",
            f"{best / cost:.2g}" if best else "-",
        )
        for name, cost in sorted(costs.items(), key=lambda item: item[1])
    ]
    text = [
        "P3: the net displacement of P1 after 1.6 s for 4096 sets of stiffness, Coulomb force and mass, on "
        "all cores: simulations per second at a median error of 1 nm against a fixed step of 1 us.",
        _table(("tool", "per s", "per CPU second", "over the best other tool"), body),
    ]
    ours = [row for row in members if row["tool"] == "stickslip" and row["setting"] == "1e-09 m"]
    text += [
        "At a tolerance of 1 nm `ss.simulate_ensemble` has errors of "
        f"{1e9 * row['median_error_m']:.2f} nm (median), {1e9 * row['max_error_m']:.2f} nm at most."
        for row in ours
    ]
    if growth:
        last = max(growth, key=lambda row: row["members"])
        text += [
            f"Summaries of {last['members']} members take {last['wall_ms_median'] / 1e3:.3g} s and "
            f"{last['peak_memory_bytes'] / 2**20:.0f} MiB.",
            "![scaling](scaling.svg)",
        ]
    return text


def _fit(rows: list[Row]) -> list[str]:
    body = []
    for row in sorted(rows, key=lambda row: (row["setting"], row["cpu_ms_median"])):
        if "starts" in row:
            where = f"{row['at_the_optimum']} of {row['starts']}"
        else:
            where = "yes" if row["global"] else "no"
        name = f"{row['tool']}, {row['method']}"
        body.append((row["setting"], name, _number(row["cpu_ms_median"], 4), where))
    return [
        "P4: sigma_0, sigma_1 and F_C from P1's positions with 20 nm of noise. The poor start is (1e6, 30, "
        "1.5). Random starts lie within a factor 30 of the truth in every parameter; a minute limits their "
        "number.",
        _table(("from", "tool", "CPU ms", "global optimum"), body),
    ]


def _campaign(rows: list[Row]) -> list[str]:
    ours = min(row["cpu_ms_median"] for row in rows if row["tool"] == "stickslip")
    body = []
    for row in sorted(rows, key=lambda row: row["cpu_ms_median"]):
        sign = "" if row["ended"] else "> "
        body.append(
            (
                f"{row['tool']}, {row['method']}",
                f"{sign}{row['cpu_ms_median'] / 1e3:.3g} ({row['cpu_ms_median'] / ours:.3g})",
                str(row["evaluations"]),
                f"{row['away_in_standard_errors']:.2g}",
            )
        )
    return [
        "The friction fit of the thesis's campaign on the virtual rig: 4082 samples of the walk at 65 V and "
        "5 Hz, both ways; sigma_0, sigma_1, F_C, delay and offset from the thesis's start (1e6, 30, 1.5). "
        "All tools have the same recording, drive, start and bounds. The other tools make *one search "
        "alone*; `ss.identify_friction` also searches for starts and averages over parameters that the "
        "recording hardly determines. A time after > belongs to a fit that was stopped.",
        _table(("tool", "CPU s (over one search)", "evaluations", "standard errors from ours"), body),
    ]


def _accuracy(rows: list[Row]) -> list[str]:
    errors = sorted(row["error_over_tolerance"] for row in rows)
    laws = []
    for law in sorted({row["law"] for row in rows}):
        worst = max(row["error_over_tolerance"] for row in rows if row["law"] == law)
        laws.append(f"{law} {_number(worst)}")
    return [
        f"{len(rows)} actuators drawn at random over three decades of stiffness, mass, voltage and "
        "frequency; three periods at a tolerance of 1 nm against an independent solution. Largest errors in "
        "tolerances: "
        f"{', '.join(laws)}; median {errors[len(errors) // 2]:.2g}, worst {errors[-1]:.3g}.",
    ]


def _startup(rows: list[Row]) -> list[str]:
    head = ("task", "wall s", "CPU s", "aim s")
    body = (
        (
            row["setting"],
            *(_number(row[name] / 1e3, 2) for name in ("wall_ms_median", "cpu_ms_median")),
            f"{row['limit_ms'] / 1e3:g}",
        )
        for row in rows
    )
    return ["Time of a new process, minus the time of an empty one; byte code exists.", _table(head, body)]


_SECTIONS = {
    "trajectory": ("One trajectory", _trajectory),
    "steady": ("Steady stepping", _steady),
    "ensemble": ("Ensembles", _ensemble),
    "fit": ("Fit", _fit),
    "campaign": ("The campaign's fit", _campaign),
    "accuracy": ("Accuracy on random actuators", _accuracy),
    "startup": ("Start-up", _startup),
}
