"""View of the steps of a motor: by voltage and direction, with their noise and drift."""

from __future__ import annotations

from ...control import StepLaw
from ...quantities.units import QuantityError, with_prefix
from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.control import step_sizes
from ..figures.style import svg
from ..viewing import document_of

_MANY = 1000  # number of steps for which the drift is stated


@document_of.register
def step_law_document(law: StepLaw) -> Document:
    """Return a document on the steps of a motor, from a result of `fit_steps`.

    The document has the step sizes [m] by voltage and direction, the scatter of single steps, the drift over
    `_MANY` steps, and the loss at a change of direction. If two or more voltages make steps, it also has the
    threshold voltages at which steps start.
    """
    most = law.voltages[-1]
    up, down = law.size(most, 1), law.size(most, -1)
    rows = [
        (volts, Number(f, "m", standard_error=ef), Number(b, "m", standard_error=eb))
        for volts, f, b, ef, eb in zip(*law[:5], strict=True)
    ]
    numbers = {
        "forward": Number(up, "m"),
        "backward": Number(down, "m"),
        "scatter": Number(law.scatter, ""),
        "threshold_scatter": Number(law.threshold_scatter, "m"),
        "common_drift": Number(law.common_drift, ""),
        "own_drift": Number(law.own_drift, ""),
        "reversal": Number(law.reversal, "m", standard_error=law.reversal_error),
    }
    tau, lost, error = (
        with_prefix(one, "m") for one in (law.threshold_scatter, law.reversal, law.reversal_error)
    )
    common, own = (_MANY**0.5 * one for one in (law.common_drift, law.own_drift))
    points = [
        f"single steps scatter by {law.scatter:.1%} of their size, and by {tau} of any size",
        f"over {_MANY} steps both directions drift by {common:.1%}, and each by {own:.1%}",
        f"a change of direction loses {lost} with a standard error of {error}",
    ]
    for direction, name in ((1, "forward"), (-1, "backward")):
        try:
            volts, slope = law.threshold(direction)
        except QuantityError:
            continue
        numbers[f"threshold_{name}"] = Number(volts, "V")
        points.append(f"steps {name} begin at {volts:.1f} V and grow by {with_prefix(slope, 'm')} per volt")
    columns = (Column("voltage", "V"), Column("forward", None), Column("backward", None))
    table = Table("Steps with their standard errors", columns, rows)
    picture = Picture(
        "steps", "Steps by voltage, with intervals of 95 %.", svg(step_sizes(law)), "steps over voltage"
    )
    said = f"At {most:g} V and {law.frequency:g} Hz a step goes {with_prefix(up, 'm')} forward and "
    return Document(
        title="Steps of a motor",
        summary=f"{said}{with_prefix(down, 'm')} backward.",
        sections=(
            Section(
                "Steps",
                points=points,
                tables=(table,),
                figures=(picture,),
            ),
        ),
        highlights=[(name, numbers[name]) for name in ("forward", "backward")],
        numbers=numbers,
    )
