"""Views of searches: an optimised drive, a front of two goals, an optimised actuator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...design import Front, OptimisedActuator, OptimisedWaveform
from ...design.built import Built
from ...identify.results import model_numbers
from ...quantities.records import quantities_within
from ...quantities.units import unit_for
from ...waveform.knots import PeriodicKnots
from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.conditions import draw_conditions, draw_front
from ..figures.plotting import plot
from ..figures.style import svg
from ..viewing import document_of

# Largest number of rows of the table of conditions (the worst ones), and of the table of a front's drives
# (evenly chosen ones). results.json has all of them.
MOST_ROWS, MOST_POINTS = 30, 12
STOPPED = "stopped before the end of the search: the best until then"


@document_of.register
def optimised_document(found: OptimisedWaveform) -> Document:
    """Return a document with an optimised drive, and the goal's value in every condition.

    The values are compared with those of the best sawtooth. An interrupted search is a failure.
    """
    value, saw = (Number(one, found.unit) for one in (found.value, found.sawtooth_value))
    lines = found.report().splitlines()
    section = Section(
        "Optimised drive",
        paragraphs=["; ".join(lines[1:3])],
        tables=(_conditions_table(found), _knots_table(found.waveform)),
        figures=_pictures(found),
    )
    return Document(
        title="Optimised drive",
        summary=_sentence(lines[0]),
        sections=(section,),
        highlights=((f"{found.goal.label} in the worst condition", value), ("best sawtooth", saw)),
        numbers=_drive_numbers(found),
        failures=(STOPPED,) if found.interrupted else (),
        interrupted=found.interrupted,
    )


@document_of.register
def front_document(found: Front) -> Document:
    """Return a document with the Pareto-optimal drives for two goals: a figure, and a table of drives."""
    names = [str(name) for name in found.table if name != "frequency"]
    labels = [str(found.table[name].attrs["long_name"]) for name in names]
    picture = Picture(
        "front",
        f"Each point is a drive: what more {labels[0]} takes of {labels[1]}.",
        svg(draw_front(found.table)[0].figure),
        f"{labels[1]} over {labels[0]} of all drives",
    )
    return Document(
        title="Front of two goals",
        summary=f"{len(found.waveforms)} drives of which none is better in both, {' and '.join(labels)}.",
        sections=(Section("Front of two goals", tables=(_front_table(found, names),), figures=(picture,)),),
        numbers=_front_numbers(found),
        failures=(STOPPED,) if found.interrupted else (),
        interrupted=found.interrupted,
    )


@document_of.register
def actuator_document(found: OptimisedActuator) -> Document:
    """Return a document with an optimised actuator: its free values as given and as found.

    A figure shows the goal's value in each condition for both actuators, each with its best sawtooth.
    """
    best, label, lines = found.best, found.goal.label, found.report().splitlines()
    shown = {"as found": best.values, "as given": best.before}
    caption = f"{label.capitalize()} in every condition: as found and as given, each with its best sawtooth."
    section = Section(
        "Optimised actuator",
        paragraphs=lines[1:2],
        tables=(_free_table(best), *([_choices_table(found)] if len(found.each) > 1 else [])),
        figures=(_conditions_picture("actuator", caption, best.conditions.names, shown, found),),
    )
    interrupted = any(one.interrupted for one in found.each)
    return Document(
        title="Optimised actuator",
        summary=_sentence(lines[0]),
        sections=(section,),
        highlights=((f"{label} of the actuator found", Number(found.value, found.unit)),),
        numbers=_actuator_numbers(found),
        failures=(STOPPED,) if interrupted else (),
        interrupted=interrupted,
    )


def _actuator_numbers(found: OptimisedActuator) -> dict[str, Any]:
    best, space = found.best, found.best.space
    columns = (space.names, best.found, space.units, space.given, space.low, space.high)
    return {
        "reached": Number(found.value, found.unit),
        "as_given": Number(found.given_value, found.unit),
        "name": found.name,
        "free": {
            name: {"value": x, "unit": unit, "given": given, "range_low": low, "range_high": high}
            for name, x, unit, given, low, high in zip(*columns, strict=True)
        },
        "load": Number(found.load, ""),
        "waveform": _waveform_numbers(best.waveform),
        "model": model_numbers(found.model),
        "conditions": list(best.conditions.names),
        **arrays({"values": (best.values, found.unit), "values_as_given": (best.before, found.unit)}),
        "evaluations": Number(sum(one.evaluations for one in found.each), ""),
    }


def _conditions_table(found: OptimisedWaveform) -> Table:
    order = np.argsort(found.goal.sign * found.values)[:MOST_ROWS].tolist()
    unit = found.unit
    rows = [
        (found.conditions.names[i], float(found.values[i]), float(found.sawtooth_values[i])) for i in order
    ]
    left = found.values.size - len(rows)
    return Table(
        f"{found.goal.label.capitalize()} in every condition, the worst first.",
        (Column("condition"), Column("optimised drive", unit), Column("best sawtooth", unit)),
        rows,
        notes=f"{left} better ones are in results.json." if left else "",
    )


def _knots_table(waveform: PeriodicKnots) -> Table:
    rows = list(zip(waveform.times, waveform.values, strict=True))
    caption = f"The drive: lines through these values, repeated after {1e3 * waveform.period:.6g} ms."
    return Table(caption, (Column("time", "s"), Column("voltage", "V")), rows)


def _pictures(found: OptimisedWaveform) -> list[Picture]:
    shown = {"optimised drive": found.values, "best sawtooth": found.sawtooth_values}
    label = found.goal.label.capitalize()
    caption = f"{label} in every condition, from the worst to the best of the optimised drive."
    return [
        Picture(
            "drive",
            "One period of the optimised drive and of the best sawtooth, at the piezo, and how far the "
            "end-effector comes in it, in the model as it is.",
            svg(plot(found)[0].figure),
            "Voltage and position over a period of both drives",
        ),
        _conditions_picture("conditions", caption, found.conditions.names, shown, found),
    ]


def _conditions_picture(name: str, caption: str, names: Any, shown: dict[str, Any], found: Any) -> Picture:
    goal = found.goal
    figure = svg(draw_conditions(names, shown, goal.label, found.unit, goal.sign)[0].figure)
    return Picture(name, caption, figure, f"{goal.label} in {len(names)} conditions: {' and '.join(shown)}")


def _front_table(found: Front, names: list[str]) -> Table:
    count = len(found.waveforms)
    some = found.table.isel(point=np.unique(np.linspace(0, count - 1, MOST_POINTS).round().astype(int)))
    columns = [Column(str(some[n].attrs["long_name"]), str(some[n].attrs["units"])) for n in names]
    rows = list(zip(*(some[n].values.tolist() for n in (*names, "frequency")), strict=True))
    left = f"All {count} are in results.json." if count > len(rows) else ""
    return Table("Drives of the front.", (*columns, Column("frequency", "Hz")), rows, notes=left)


def _free_table(best: Built) -> Table:
    space = best.space
    rows = [
        (name, *(Number(float(x), unit) for x in row))
        for name, unit, *row in zip(
            space.names, space.units, space.given, best.found, space.low, space.high, strict=True
        )
    ]
    heads = ("field", "given", "found", "from", "to")
    return Table("What was free of the actuator.", tuple(Column(head) for head in heads), rows)


def _choices_table(found: OptimisedActuator) -> Table:
    unit = found.unit
    rows = [(str(name), float(row["value"]), float(row["given"])) for name, row in found.choices.iterrows()]
    columns = (Column("model"), Column(found.goal.label, unit), Column("as given", unit))
    return Table(f"{found.goal.label.capitalize()} of each model in the worst condition.", columns, rows)


def _waveform_numbers(waveform: Any) -> dict[str, Any]:
    if isinstance(waveform, PeriodicKnots):
        made = {
            "times": (waveform.times, "s"),
            "values": (waveform.values, "V"),
            "period": (waveform.period, "s"),
        }
        return {"shape": "PeriodicKnots", **arrays(made)}
    fields = {"amplitude": "V", "frequency": "Hz", "rise_fraction": "", "offset": "V"}
    return {
        "shape": type(waveform).__name__,
        **{n: Number(getattr(waveform, n), u) for n, u in fields.items()},
    }


def _drive_numbers(found: OptimisedWaveform) -> dict[str, Any]:
    unit = found.unit
    known = quantities_within(found.model)
    units = {name: known[name].unit if name in known else "" for name in found.conditions.columns}
    columns = {f"condition_{name}": (one, units[name]) for name, one in found.conditions.columns.items()}
    return {
        "reached": Number(found.value, unit),
        "sawtooth_value": Number(found.sawtooth_value, unit),
        "waveform": _waveform_numbers(found.waveform),
        "sawtooth": _waveform_numbers(found.sawtooth),
        "fell_back": found.fell_back,
        "evaluations": Number(found.evaluations, ""),
        "quantile": Number(found.quantile, ""),
        "conditions": list(found.conditions.names),
        **arrays(
            {
                "values": (found.values, unit),
                "sawtooth_values": (found.sawtooth_values, unit),
                "speeds": (found.speeds, unit_for(found.model, "m/s")),
                **columns,
            }
        ),
    }


def _front_numbers(found: Front) -> dict[str, Any]:
    table = {str(n): (one.values, str(one.attrs["units"])) for n, one in found.table.data_vars.items()}
    drives = {f"drive_{i}": _waveform_numbers(one) for i, one in enumerate(found.waveforms, start=1)}
    return {**arrays(table), "drives": drives, "evaluations": Number(found.evaluations, "")}


def arrays(values: Mapping[str, tuple[Any, str]]) -> dict[str, Any]:
    """Return arrays in the form of results.json: mappings with "value" and "unit" by name.

    `values` has pairs (values, SI unit) by name.
    """
    return {name: {"value": np.asarray(one), "unit": unit} for name, (one, unit) in values.items()}


def _sentence(line: str) -> str:
    return f"{line[0].upper()}{line[1:]}."
