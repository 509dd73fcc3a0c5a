"""The page of results, in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from .equal_error import cost_at
from .problems import MEMBERS

Row = dict[str, Any]

# Where the ratios are taken: an error that every good tool reaches, m.
TARGETS = {"P1": 0.3e-9, "P2": 1e-9}


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

Made by `make bench` (`make bench PART=trajectory` for one part), which keeps every number in `results.json`.
All tools run on one machine in the same session, turn by turn, and restart where the drive jumps; compilation
is not counted. What is compared is CPU time, the median over all turns. The problems are stated in
`benchmarks/problems.py`, the peers' programs in `benchmarks/peers/` were written for this comparison, and
errors are those against trajectories of an independent solver at a relative tolerance of 1e-13.
"""


def _where(found: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {number}" for name, number in sorted(found["versions"].items()))
    return (
        f"<sub>{found['made']}, {found['machine']}; load {found['load_average']:.1f} (above the number of "
        f"cores: other programs ran as well); took {found['took_s']:.0f} s. {versions}.</sub>"
    )


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
    text = [
        "8 periods, 1.6 s, 1601 samples. P1 is the thesis's actuator; P2 has a stiff contact with a Stribeck "
        "curve. The cost at a given error lies between two settings of a tool, on a straight line in "
        "logarithmic axes. *Engine* is the compiled solver with its samples; `ss.simulate` adds checks and "
        "the labelled dataset. The engine copies periods once two began alike; a drive of which *no period "
        "repeats* (they differ by 1e-9 of the amplitude) shows what it needs where it cannot.",
        "![work-precision](work-precision.svg)",
    ]
    for problem, target in TARGETS.items():
        groups = _groups(row for row in rows if row["problem"] == problem)
        costs = {
            name: cost_at(group, target, "cpu_ms_median", "max_error_m") for name, group in groups.items()
        }
        order = sorted(costs, key=lambda name: costs[name] or float("inf"))
        ours = [name for name in order if name[0] == "stickslip"]
        best = min((c for name, c in costs.items() if c and name not in ours), default=None)
        body = []
        for name in order:
            cost = costs[name]
            ratio = "best peer" if cost == best else _number(cost / best) if cost and best else "-"
            body.append(
                (name[0], name[1], _number(cost), ratio if ratio in ("best peer", "-") else f"{ratio} x")
            )
        text.append(
            _table(("tool", "method", f"{problem}: CPU ms at {target * 1e9:g} nm", "of the best peer"), body)
        )
        if best:
            gains = ", ".join(f"{best / c:.1f} x ({name[1]})" for name in ours if (c := costs[name]))
            text.append(f"{problem}: ahead of the best peer by {gains}.")
    return [*text, "<details><summary>All runs</summary>", _runs(rows), "</details>"]


def _runs(rows: Iterable[Row]) -> str:
    head = ("problem", "tool", "method", "setting", "CPU ms", "least", "wall ms", "runs", "max error, m")
    body = (
        (
            row["problem"],
            row["tool"],
            row["method"],
            row["setting"],
            _number(row["cpu_ms_median"]),
            _number(row["cpu_ms_min"]),
            _number(row["wall_ms_median"]),
            str(row["repeats"]),
            _number(row.get("max_error_m"), 2),
        )
        for row in rows
    )
    return _table(head, body)


def _steady(rows: list[Row]) -> list[str]:
    text = [
        "The net step per period once the motion is periodic: solved for, and waited for. Those who wait are "
        "told how many periods it takes to 0.1 nm, which in truth nobody knows before."
    ]
    head = ("problem", "tool", "method", "setting", "CPU ms", "net step, um", "error, m")
    body = (
        (
            row["problem"],
            row["tool"],
            row["method"],
            row["setting"],
            _number(row["cpu_ms_median"]),
            f"{row['net_step_m'] * 1e6:.6f}",
            _number(row["max_error_m"], 2),
        )
        for row in sorted(rows, key=lambda row: (row["problem"], row["cpu_ms_median"]))
    )
    return [*text, _table(head, body)]


def _ensemble(rows: list[Row]) -> list[str]:
    members = [row for row in rows if "median_error_m" in row]
    growth = [row for row in rows if "peak_memory_bytes" in row]
    head = ("tool", "method", "setting", "per s", "per CPU s", "median error, m", "max error, m")
    body = (
        (
            row["tool"],
            row["method"],
            row["setting"],
            f"{1e3 * row['members'] / row['wall_ms_median']:.0f}",
            f"{1e3 * row['members'] / row['cpu_ms_median']:.0f}",
            _number(row["median_error_m"], 2),
            _number(row["max_error_m"], 2),
        )
        for row in sorted(members, key=lambda row: row["cpu_ms_median"])
    )
    text = [
        "P3: the net displacement of P1 after 1.6 s for 4096 sets of stiffness, Coulomb force and mass, on "
        "all cores. Simulations per second of wall time, and per second of CPU time of one core, which other "
        "programs disturb less. The truth is a fixed step of 1 us.",
        _table(head, body),
    ]
    costs = {
        name: cost_at(group, 1e-9, "cpu_ms_median", "median_error_m")
        for name, group in _groups(members).items()
    }
    best = min((c for name, c in costs.items() if c and name[0] != "stickslip"), default=None)
    if best:
        for name, cost in costs.items():
            if cost:
                text.append(
                    f"At a median error of 1 nm, {name[0]}, {name[1]}: {1e3 * MEMBERS / cost:.0f} per CPU "
                    f"second, {best / cost:.2g} x the best peer."
                )
    if growth:
        head = ("members", "wall s", "per s", "peak memory, MiB")
        body = (
            (
                str(row["members"]),
                _number(row["wall_ms_median"] / 1e3),
                f"{1e3 * row['members'] / row['wall_ms_median']:.0f}",
                f"{row['peak_memory_bytes'] / 2**20:.0f}",
            )
            for row in growth
        )
        text += ["Summaries only, in a fresh process each:", _table(head, body), "![scaling](scaling.svg)"]
    return text


def _fit(rows: list[Row]) -> list[str]:
    head = ("from", "tool", "method", "CPU ms", "at the global optimum")
    body = []
    for row in sorted(rows, key=lambda row: (row["setting"], row["cpu_ms_median"])):
        if "starts" in row:
            where = f"{row['at_the_optimum']} of {row['starts']}"
        else:
            where = f"{row['away_in_standard_errors']:.2g} standard errors off it"
            where = f"{'yes' if row['global'] else 'no'}, {where}"
        body.append((row["setting"], row["tool"], row["method"], _number(row["cpu_ms_median"], 4), where))
    return [
        "P4: sigma_0, sigma_1 and F_C from P1's positions with 20 nm of noise, from the poor start "
        "(1e6, 30, 1.5), and from starts drawn within a factor 30 of the truth in every parameter, as many "
        "of a hundred as a minute allows.",
        _table(head, body),
    ]


def _campaign(rows: list[Row]) -> list[str]:
    head = (
        "tool",
        "method",
        "CPU s",
        "times one search of ours",
        "evaluations",
        "rms, nm",
        "from ours, standard errors",
    )
    ours = min(row["cpu_ms_median"] for row in rows if row["tool"] == "stickslip")
    body = []
    for row in sorted(rows, key=lambda row: row["cpu_ms_median"]):
        sign = "" if row["ended"] else "> "
        body.append(
            (
                row["tool"],
                row["method"],
                f"{sign}{row['cpu_ms_median'] / 1e3:.3g}",
                f"{sign}{row['cpu_ms_median'] / ours:.3g}",
                str(row["evaluations"]),
                f"{1e9 * row['rms_m']:.4g}",
                f"{row['away_in_standard_errors']:.2g}",
            )
        )
    return [
        "The friction fit of the thesis's campaign on the virtual rig: 4082 samples of the walk at 65 V and "
        "5 Hz, forward and back, with the bench's noise; sigma_0, sigma_1, F_C, delay and offset from the "
        "thesis's start (1e6, 30, 1.5). The same recording, drive, start and bounds for every tool; peers "
        "difference their derivatives. *One search alone* is what peers do, and what ratios are to; before "
        "it, `ss.identify_friction` looks for a start of its own, and after it averages over what the "
        "recording hardly determines (sigma_1). A time after > is that at which a fit that had not ended "
        "was stopped.",
        _table(head, body),
    ]


def _accuracy(rows: list[Row]) -> list[str]:
    worst = max(rows, key=lambda row: row["error_over_tolerance"])
    ordered = sorted(row["error_over_tolerance"] for row in rows)
    head = ("law", "error over tolerance", "median", "actuators")
    laws = sorted({row["law"] for row in rows})
    body = []
    for law in laws:
        values = sorted(row["error_over_tolerance"] for row in rows if row["law"] == law)
        body.append((law, _number(values[-1]), _number(values[len(values) // 2]), str(len(values))))
    return [
        f"{len(rows)} actuators drawn at random over three decades of stiffness, mass, voltage, frequency; "
        "with and without the friction's reaction on the stage, external force and incline; three periods at "
        "a tolerance of 1 nm against an independent solution. "
        f"Median error {ordered[len(ordered) // 2]:.2g} tolerances, worst {ordered[-1]:.3g}.",
        _table(head, body),
        f"The worst, {worst['problem'].removeprefix('random ')}: {worst['setting']}.",
    ]


def _startup(rows: list[Row]) -> list[str]:
    head = ("what, in a fresh process", "wall s", "CPU s", "least CPU s", "aim s")
    body = (
        (
            row["setting"],
            *(_number(row[name] / 1e3, 2) for name in ("wall_ms_median", "cpu_ms_median", "cpu_ms_min")),
            f"{row['limit_ms'] / 1e3:g}",
        )
        for row in rows
    )
    return ["Less what an empty process takes; the byte code of the libraries is there.", _table(head, body)]


_SECTIONS = {
    "trajectory": ("One trajectory", _trajectory),
    "steady": ("Steady stepping", _steady),
    "ensemble": ("Ensembles", _ensemble),
    "fit": ("Fit", _fit),
    "campaign": ("The campaign's fit", _campaign),
    "accuracy": ("Accuracy on random actuators", _accuracy),
    "startup": ("Start-up", _startup),
}
