"""The two figures of the page."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure

from stickslip.report.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    MEASURED,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    WIDTH,
    drawn,
)

from .equal_error import front

Row = dict[str, Any]

# Of the best peers; the others share a colour.
_COLOURS = {
    ("stickslip", "engine"): BLUE,
    ("stickslip", "engine, no period repeats"): SKY,
    ("stickslip", "ss.simulate"): BLACK,
    ("numbalsoda", "DOP853"): VERMILLION,
    ("numbalsoda", "LSODA"): ORANGE,
    ("diffrax", "Tsit5"): GREEN,
    ("scipy odeint", "LSODA"): PURPLE,
}


@drawn
def work_precision(rows: list[Row]) -> Figure:
    """CPU time against error for both problems, one line per tool and method."""
    figure = Figure(figsize=(WIDTH, 3.9))
    for panel, problem in zip(figure.subplots(1, 2, sharey=True), ("P1", "P2"), strict=True):
        groups: dict[tuple[str, str], list[Row]] = {}
        for row in rows:
            if row["problem"] == problem and "not_run" not in row:
                groups.setdefault((row["tool"], row["method"]), []).append(row)
        for name in sorted(groups, key=lambda name: name not in _COLOURS):
            errors, costs = zip(*front(groups[name], "cpu_ms_median", "max_error_m"), strict=True)
            ours = name[0] == "stickslip"
            panel.plot(
                errors,
                costs,
                color=_COLOURS.get(name, MEASURED),
                marker="o" if ours else "s" if name in _COLOURS else ".",
                lw=1.8 if ours else 0.9,
                label=f"{name[0]}, {name[1]}" if name in _COLOURS else None,
                zorder=3 if ours else 2,
            )
        panel.set(xscale="log", yscale="log", xlim=(2e-8, 5e-12), xlabel="largest error of the position (m)")
        panel.set_title(problem, loc="left")
        handles, labels = panel.get_legend_handles_labels()
        if problem == "P1":
            panel.set_ylabel("CPU time (ms)")
            figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


@drawn
def scaling(rows: list[Row]) -> Figure:
    """Time and memory of ensembles against their size."""
    growth = [row for row in rows if "peak_memory_bytes" in row]
    members = [row["members"] for row in growth]
    figure = Figure(figsize=(WIDTH, 2.6))
    left, right = figure.subplots(1, 2)
    left.plot(members, [row["wall_ms_median"] / 1e3 for row in growth], color=BLUE, marker="o")
    first = growth[0]
    left.plot(
        members,
        [first["wall_ms_median"] / 1e3 * n / first["members"] for n in members],
        color=MEASURED,
        ls="--",
        label="in proportion to the first",
    )
    left.set(xscale="log", yscale="log", xlabel="members", ylabel="wall time (s)")
    left.legend()
    right.plot(members, [row["peak_memory_bytes"] / 2**20 for row in growth], color=VERMILLION, marker="o")
    right.set(xscale="log", xlabel="members", ylabel="peak memory (MiB)")
    left.margins(0.05)
    right.set_ylim(0.0, 1.1 * max(row["peak_memory_bytes"] / 2**20 for row in growth))
    return figure
