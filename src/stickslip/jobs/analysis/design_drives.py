"""Searches of a design file: the fastest drive, the front of two goals, the actuator itself."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from ...design import (
    Front,
    OptimisedActuator,
    OptimisedWaveform,
    optimise_actuator,
    optimise_waveform,
    waveform_front,
)
from ...design.built import Built
from ...identify.results import model_numbers
from ...quantities.arguments import arguments_of
from ...quantities.input_file import yaml_text
from ...quantities.records import quantities_within
from ...quantities.units import unit_for
from ...report import Column, Number, Picture, Section, Table
from ...report.figures.conditions import draw_conditions, draw_front
from ...report.figures.plotting import plot
from ...report.figures.style import svg
from ...waveform.knots import PeriodicKnots
from .design_given import (
    GeneratorSpec,
    Given,
    Goal,
    Made,
    Quantity,
    SearchSpec,
    arrays,
    goal_of,
    output_stage,
)
from .model import named_model

# Conditions that a table shows, the worst ones, and points of a front: all of them are in results.json.
MOST_ROWS, MOST_POINTS = 30, 12
STOPPED = "stopped before the end of the search: the best until then"


class OptimiseSpec(
    SearchSpec, arguments_of(optimise_waveform, "knots", "draws", "quantile", "minimum_speed", "budget")
):
    """As `optimise_waveform`; a goal is "speed", "ripple", "tip_load", "noise" or one with a number. `draws`
    are taken of the file's `uncertainty`, where it has one."""

    goal: Goal | None = None
    generator: GeneratorSpec | None = None

    def made(self, given: Given) -> Made:
        """Search, and say what was found; raises QuantityError."""
        common = self.common(given)
        common["output"] = output_stage(self.limits, self.generator, given.folder)
        found = optimise_waveform(
            given.model,
            goal=goal_of(self.goal, given.model),
            uncertainty=given.uncertainty,
            **common,
        )
        value, saw = (Number(one, found.unit) for one in (found.value, found.sawtooth_value))
        section = Section(
            "Optimised drive",
            paragraphs=["; ".join(found.report().splitlines()[1:3])],
            tables=(_conditions_table(found), _knots_table(found.waveform)),
            figures=_pictures(found),
        )
        files = {"drive.yaml": _run_of(found.waveform)}
        if found.played is not None:
            files["drive.csv"] = _csv(found.played)
        return Made(
            section,
            _sentence(found.report()),
            _drive_numbers(found),
            [(f"{found.goal.label} in the worst condition", value), ("best sawtooth", saw)],
            files,
            f"optimise: {STOPPED}" if found.interrupted else "",
        )


class FrontSpec(SearchSpec, arguments_of(waveform_front, "knots", "points", "generations")):
    """As `design.waveform_front`: drives of which none is better than another in both of two goals."""

    goals: list[Goal] = ["speed"]  # noqa: RUF012  # pydantic copies it

    def made(self, given: Given) -> Made:
        """Search, and say what was found; raises QuantityError."""
        found = waveform_front(
            given.model,
            goals=tuple(goal_of(one, given.model) for one in self.goals),  # type: ignore[arg-type]
            **self.common(given),
        )
        names = [str(name) for name in found.table if name != "frequency"]
        labels = [str(found.table[name].attrs["long_name"]) for name in names]
        said = f"{len(found.waveforms)} drives of which none is better in both, {labels[0]} and {labels[1]}."
        caption = f"Each point is a drive: what more {labels[0]} takes of {labels[1]}."
        figure = svg(draw_front(found.table)[0].figure)
        picture = Picture("front", caption, figure, f"{labels[1]} over {labels[0]} of all drives")
        tables = (_front_table(found, names),)
        section = Section("Front of two goals", tables=tables, figures=(picture,))
        return Made(
            section, said, _front_numbers(found), stopped=f"front: {STOPPED}" if found.interrupted else ""
        )


class ActuatorSpec(
    SearchSpec, arguments_of(optimise_actuator, "draws", "minimum_speed", "holding_force", "budget")
):
    """As `design.optimise_actuator`: `free` are fields with their ranges; `models` are parameter sets by
    name, of which each is searched, in place of the model of the file."""

    goal: Goal | None = None
    free: dict[str, list[Quantity]]
    models: dict[str, str] | None = None

    def made(self, given: Given) -> Made:
        """Search, and say what was found; raises QuantityError."""
        models = {name: named_model(given.folder, one) for name, one in (self.models or {}).items()}
        found = optimise_actuator(
            models or given.model,
            goal=goal_of(self.goal, given.model),
            free=self.free,
            uncertainty=given.uncertainty,
            **self.common(given),
        )
        best, goal = found.best, found.goal
        lines = found.report().splitlines()
        shown = {"as found": best.values, "as given": best.before}
        label = goal.label.capitalize()
        caption = f"{label} in every condition: as found and as given, each with its best sawtooth."
        section = Section(
            "Optimised actuator",
            paragraphs=lines[1:2],
            tables=(_free_table(best), *([_choices_table(found)] if len(found.each) > 1 else [])),
            figures=(_conditions_picture("actuator", caption, best.conditions.names, shown, found),),
        )
        numbers = {
            "reached": Number(found.value, found.unit),
            "as_given": Number(found.given_value, found.unit),
            "name": found.name,
            "free": {
                name: {"value": x, "unit": unit, "given": given_x, "range_low": low, "range_high": high}
                for name, x, unit, given_x, low, high in zip(
                    best.space.names, best.found, best.space.units, best.space.given, best.space.low,
                    best.space.high, strict=True,
                )
            },
            "load": Number(found.load, ""),
            "waveform": _waveform_numbers(best.waveform),
            "model": model_numbers(found.model),
            "conditions": list(best.conditions.names),
            **arrays({"values": (best.values, found.unit), "values_as_given": (best.before, found.unit)}),
            "evaluations": Number(sum(one.evaluations for one in found.each), ""),
        }  # fmt: skip
        stopped = f"actuator: {STOPPED}" if any(one.interrupted for one in found.each) else ""
        value = Number(found.value, found.unit)
        highlights = [(f"{goal.label} of the actuator found", value)]
        return Made(section, _sentence(lines[0]), numbers, highlights, stopped=stopped)


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


def _run_of(waveform: PeriodicKnots) -> str:
    """For the `waveform:` of a run of an experiment file."""
    fields = {"times": [*waveform.times], "values": [*waveform.values], "period": waveform.period}
    made = {"waveform": [{"shape": "PeriodicKnots", "fields": fields}]}
    return "# For a run of an experiment file; s, V.\n" + yaml_text(made)


def _csv(played: Any) -> str:
    """One period, as the generator plays it."""
    text = io.StringIO()
    np.savetxt(
        text,
        np.column_stack([played.times, played.values]),
        "%.9g",
        ",",
        header="time [s],voltage [V]",
        comments="",
    )
    return text.getvalue()


def _sentence(report: str) -> str:
    """The first line of a report."""
    first = report.splitlines()[0]
    return f"{first[0].upper()}{first[1:]}."
