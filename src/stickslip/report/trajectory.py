"""Report of a simulation: motion, results, parameters and their origin."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ..friction import is_law
from ..parameters import changes, load_set
from ..physics.actuator import Actuator, PulledSlider, load_actuator, load_pulled_slider
from ..quantities.records import quantities_of
from ..quantities.units import with_prefix
from ..simulation.whole_periods import mean_velocity, whole_periods
from ..waveform.signal import Waveform
from .document import Column, Document, Number, Picture, Section, Table
from .figures.style import svg
from .figures.trajectory import trajectory as drawn_trajectory

if TYPE_CHECKING:
    import xarray as xr

_HIGHLIGHTS = ("steady_step", "mean_velocity")
_NOTES = (
    "Greatest values are those of the samples. The net displacement is the last position minus the first: it "
    "includes elastic deflection. The mean velocity is that between equal phases of a periodic drive."
)
_NO_VELOCITY = "needs two whole periods of the drive with samples at their ends, or three"


def trajectory_document(
    model: Actuator | PulledSlider,
    waveform: Waveform,
    trajectory: xr.Dataset,
    steady_step: Number | None = None,
) -> Document:
    """Return the report of a simulation: figure of the motion, results, parameters and their origin.

    Args:
        model, waveform: simulated model and drive.
        trajectory: result of `simulate`.
        steady_step: net displacement per period of the periodic motion, a `Number` in m or rad; None if not
            computed.
    """
    name = model.name or type(model).__name__
    numbers = _results(trajectory, waveform)
    if steady_step is not None:
        numbers["steady_step"] = steady_step
    complete = trajectory.attrs["outcome"] == "complete"
    duration = with_prefix(float(trajectory["time"][-1]), "s")
    body = "slider" if isinstance(model, PulledSlider) else "end-effector"
    summary = f"The {body} moved by {_moved(trajectory, waveform)}."
    if not complete:
        summary = f"The simulation {trajectory.attrs['outcome']}. Until then: {summary}"
    figure = Picture(
        "trajectory",
        f"Drive, positions and friction force of {name} under a {type(waveform).__name__} drive, simulated.",
        svg(drawn_trajectory(trajectory)),
        f"Time plots of the drive, of the positions and of the friction force over {duration}; {summary}",
    )
    results = Table(
        "Results.",
        (Column("quantity"), Column("value")),
        [(_title(key), number) for key, number in numbers.items()],
        notes=_NOTES if complete else trajectory.attrs["outcome"],
    )
    parameters = list(_entries(model))
    drive = list(_entries(waveform))
    return Document(
        title=f"Simulation of {name}",
        summary=summary,
        sections=(
            Section("Trajectory", figures=(figure,)),
            Section("Results", tables=(results,)),
            Section(
                "Model and drive",
                tables=(
                    _parameter_table(f"Parameters of {name}.", parameters, _origins(model)),
                    _parameter_table(f"Drive: {type(waveform).__name__}.", drive, {}),
                ),
            ),
        ),
        highlights=[(_title(key), numbers[key]) for key in _HIGHLIGHTS if key in numbers],
        numbers={
            **numbers,
            "parameters": {field: value for field, _, _, value in parameters},
            "drive": {"shape": type(waveform).__name__} | {field: value for field, _, _, value in drive},
        },
        assumptions=[f"{field} = {words}" for field, words in model.assumptions.items()],
        citations=model.citation,
    )


def _moved(trajectory: xr.Dataset, waveform: Waveform) -> str:
    """Return the displacement in words: over whole periods of the drive, or, if there are too few or the
    drive has no period, from the first sample to the last."""
    time, position = trajectory["time"].values, trajectory["end_effector_position"]
    unit, x = position.attrs["units"], position.values
    found = whole_periods(time, x, waveform)
    if found is None:
        duration = with_prefix(float(time[-1] - time[0]), "s")
        return f"{with_prefix(float(x[-1] - x[0]), unit)} in {duration}, from the first sample to the last"
    periods, displacement = found
    count = "1 period" if periods == 1 else f"{periods} periods"
    return f"{with_prefix(displacement, unit)} in {count} of the drive, between equal phases"


def _results(trajectory: xr.Dataset, waveform: Waveform) -> dict[str, Number]:
    time, x = trajectory["time"].values, trajectory["end_effector_position"].values
    unit = trajectory["end_effector_position"].attrs["units"]
    forces = trajectory["friction_force"].attrs["units"]
    velocity = mean_velocity(time, x, waveform)
    found = {
        "net_displacement": Number(float(x[-1] - x[0]), unit),
        "mean_velocity": Number(math.nan, f"{unit}/s", note=_NO_VELOCITY)
        if velocity is None
        else Number(velocity, f"{unit}/s"),
        "greatest_friction_force": Number(_greatest(trajectory, "friction_force"), forces),
    }
    if "sliding_displacement" in trajectory:
        found["greatest_sliding_displacement"] = Number(_greatest(trajectory, "sliding_displacement"), unit)
    if "spring_force" in trajectory:
        found["greatest_spring_force"] = Number(_greatest(trajectory, "spring_force"), "N")
    if "temperature" in trajectory:  # the simulation included current and heating of the piezo stack
        found["greatest_current"] = Number(_greatest(trajectory, "current"), "A")
        warmer = trajectory["temperature"].values
        found["temperature_rise"] = Number(float(warmer[-1] - warmer[0]), "K")
    found |= {
        "duration": Number(float(time[-1]), "s"),
        "samples": Number(time.size, ""),
        "tolerance": Number(trajectory.attrs["tolerance"], unit),
        "solver_steps": Number(trajectory.attrs["steps"], ""),
    }
    return found


def _greatest(trajectory: xr.Dataset, name: str) -> float:
    return float(np.max(np.abs(trajectory[name].values)))


def _title(key: str) -> str:
    return key.replace("_", " ").replace("end effector", "end-effector")


def _entries(record: Any, prefix: str = "", owner: Any = None) -> Iterator[tuple[str, str, str, Any]]:
    """Yield name, symbol, meaning and value of all fields of a record.

    The value is a `Number`, "yes" or "no", or the name of a law. The fields of a friction law follow the
    law's name, with "friction." before theirs; elements of a tuple have an index "[i]". Other fields, such as
    texts, are left out.

    Args:
        record: model, friction law or waveform.
        prefix: text before each name.
        owner: actuator of a law, which decides between linear and rotary units; None for other records.
    """
    known = quantities_of(record, owner)
    of_drive = getattr(record, "unit", "V")  # unit of a waveform: V, or m for the drive of a pulled slider
    for name, value in record._asdict().items():
        if is_law(value):
            yield f"{prefix}{name}", "", "friction law", type(value).__name__
            yield from _entries(value, f"{prefix}{name}.", record)
        elif name in known and value is not None:
            quantity = known[name]
            values = value if isinstance(value, tuple) else (value,)
            for i, one in enumerate(values):
                index = f"[{i}]" if isinstance(value, tuple) else ""
                unit = of_drive + quantity.unit[1:] if quantity.unit.startswith("V") else quantity.unit
                yield f"{prefix}{name}{index}", quantity.symbol, quantity.meaning, Number(one, unit)
        elif isinstance(value, bool):
            yield f"{prefix}{name}", "", "", "yes" if value else "no"


def _origins(model: Actuator | PulledSlider) -> dict[str, str]:
    """Return the source of each field's value, in words, by field, such as "assumed" or a citation.

    Values that differ from the parameter set are "changed for this simulation". The mapping is empty for a
    model that does not come from a parameter set.
    """
    if not model.name:
        return {}
    entries = load_set(model.name).entries()
    original = load_actuator(model.name) if isinstance(model, Actuator) else load_pulled_slider(model.name)
    origins = {field: "assumed" if entry.assumed else entry.source for field, entry in entries.items()}
    return (
        {"friction": "parameter set"}
        | origins
        | dict.fromkeys(changes(model, original), "changed for this simulation")
    )


def _parameter_table(
    caption: str, entries: list[tuple[str, str, str, Any]], origins: dict[str, str]
) -> Table:
    columns = [Column("field"), Column("symbol"), Column("meaning"), Column("value", digits=6)]
    rows = [[field, symbol, meaning, value] for field, symbol, meaning, value in entries]
    if origins:
        columns.append(Column("origin"))
        rows = [[*row, origins.get(row[0].partition("[")[0], "default")] for row in rows]
    return Table(caption, columns, rows)
