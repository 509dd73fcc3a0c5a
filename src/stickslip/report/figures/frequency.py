"""Figure of frequency responses: gain, phase, residual and coherence, measured and by models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from .scale import Scale, scale_for
from .style import SERIES, drawn, legend_above, panels, trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DOTS: dict[str, Any] = {"marker": "o", "ms": 3.2, "mew": 0, "ls": "none", "alpha": 0.4}


class Response(NamedTuple):
    """A frequency response, arrays of shape (n,).

    `frequency` is in Hz, ascending. `value` is complex, output over input in SI, and `deviation` its standard
    deviation in the same unit. `coherence` is from 0 to 1. Deviation and coherence are None if not known.
    """

    frequency: ArrayLike
    value: ArrayLike
    deviation: ArrayLike | None = None
    coherence: ArrayLike | None = None


@drawn
def frequency_response(
    measured: Mapping[str, Response],
    models: Mapping[str, Response] | None = None,
    *,
    unit: str,
    name: str = "gain",
    log_frequency: bool = True,
) -> Figure:
    """Draw gain and phase over frequency, measured as points and models as lines; below, residual and
    coherence.

    The band of a measured gain is two standard deviations on each side. A model has the colour of the
    measured response with the same name. The model's residual, the modulus of the complex difference from
    this response, is drawn if the model covers the measured frequencies.

    Args:
        measured, models: responses by name ("30 V").
        unit: SI unit of all responses, such as "m/V".
        name: name of the modulus, for the axis.
        log_frequency: True for a logarithmic frequency axis.
    """
    models = models or {}
    residuals = _residuals(measured, models)
    coherences = {label: r for label, r in measured.items() if r.coherence is not None}
    figure, axes = panels((2.4, 1.6, *([1.25] if residuals else []), *([1.15] if coherences else [])))
    everything = [response.value for response in (*measured.values(), *models.values())]
    scale = scale_for(unit, *(np.abs(np.asarray(value)) for value in everything))
    names = list(dict.fromkeys((*measured, *models)))
    colours = {label: SERIES[i % len(SERIES)] for i, label in enumerate(names)}

    for label, response in measured.items():
        _band(axes[0], response, scale, colours[label])
        dots = {**_DOTS, "color": colours[label], "label": f"{label}, measured"}
        polar(axes[0], axes[1], response.frequency, response.value, scale, **dots)
    for label, response in models.items():
        line = {
            "color": colours[label],
            "lw": 1.1,
            "label": f"{label}, model" if label in measured else label,
        }
        polar(axes[0], axes[1], response.frequency, response.value, scale, **line)
    axes[0].set_yscale("log")
    moduli = scale(np.concatenate([np.abs(np.asarray(value)) for value in everything]))
    # The axis ends at half the least modulus, because bands of standard deviations reach far below the
    # curves.
    axes[0].set_ylim(bottom=0.5 * moduli[moduli > 0.0].min())
    axes[0].set_ylabel(scale.label(name))
    axes[1].set_ylabel("phase (°)")
    axes[1].yaxis.set_major_locator(MaxNLocator(5, steps=[1, 1.5, 3, 4.5, 9, 10]))

    if residuals:
        small = scale_for(unit, *(values for _, values in residuals.values()))
        for label, (f, values) in residuals.items():
            trace(axes[2], f, small(values), **{**_DOTS, "color": colours[label], "alpha": 0.6})
        axes[2].set_yscale("log")
        axes[2].set_ylabel(small.label("|residual|"))
    if coherences:
        for label, response in coherences.items():
            dots = {**_DOTS, "color": colours[label]}
            trace(axes[-1], np.asarray(response.frequency), np.asarray(response.coherence), **dots)
        axes[-1].set_ylim(0.0, 1.05)
        axes[-1].set_ylabel("coherence")

    if log_frequency:
        axes[-1].set_xscale("log")
    axes[-1].set_xlabel("frequency (Hz)")
    legend_above(axes[0], columns=3)
    return figure


def polar(
    gain: Axes, phase: Axes, frequency: ArrayLike, response: ArrayLike, scale: Scale, **how: Any
) -> None:
    """Draw modulus and phase of a complex response over frequency, on the axes `gain` and `phase`.

    The phase is unwrapped and starts above -270 and at most at 90 degrees. So measurement and model of a
    negative gain, whose phase is near 180 degrees, start at the same value.

    Args:
        gain, phase: axes of modulus and phase.
        frequency: Hz, shape (n,).
        response: complex, SI, shape (n,).
        scale: scale of the modulus.
        how: passed to matplotlib.
    """
    f, value = np.asarray(frequency, dtype=float), np.asarray(response, dtype=complex)
    trace(gain, f, scale(np.abs(value)), **how)
    degrees = np.degrees(np.unwrap(np.angle(value)))
    trace(phase, f, degrees - 360.0 * np.ceil((degrees[0] - 90.0) / 360.0), **how)


def _band(panel: Axes, response: Response, scale: Scale, colour: str) -> None:
    if response.deviation is None:
        return
    gain, error = np.abs(np.asarray(response.value)), 2.0 * np.asarray(response.deviation, dtype=float)
    lower = np.maximum(gain - error, 1e-3 * gain)  # positive, because the axis is logarithmic
    panel.fill_between(
        np.asarray(response.frequency), scale(lower), scale(gain + error), color=colour, alpha=0.2, lw=0
    )


def _residuals(
    measured: Mapping[str, Response], models: Mapping[str, Response]
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return the measured frequencies [Hz] and |model - measured| there, in SI, by label of the model.

    Models are interpolated linearly. Models without a measured response of the same label, or that do not
    cover its frequencies, are left out.
    """
    found = {}
    for label, model in models.items():
        if label not in measured:
            continue
        f, at = np.asarray(measured[label].frequency, dtype=float), np.asarray(model.frequency, dtype=float)
        if at[0] <= f[0] and at[-1] >= f[-1]:
            value = np.interp(f, at, np.asarray(model.value, dtype=complex))
            found[label] = (f, np.abs(value - np.asarray(measured[label].value)))
    return found
