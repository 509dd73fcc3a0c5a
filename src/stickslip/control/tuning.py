r"""Tuning of an integral regulator by models: the fastest of several candidates that keeps its stability
margins for the model and for up to 40 draws of a posterior. The margins of any regulator can be checked.

The loop consists of the sticking actuator (`simulation.sticking`), held voltages, a delay of whole ticks and
the regulator. With the loop's response L, the largest sensitivity measures the distance to instability
[astrom2006]

.. math:: M_S = \max_\omega \left|\frac{1}{1 + L(i\omega)}\right|, \qquad
          g_m \ge \frac{M_S}{M_S - 1}, \qquad \varphi_m \ge 2 \arcsin\frac{1}{2 M_S}

g_m is the gain margin and φ_m the phase margin. Stability of the closed loop follows from the poles of its
discrete system, or with a long delay from the Nyquist criterion (`loops`), not from its margins. These models
do not contain sliding friction, hysteresis and creep.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
import xarray as xr

from ..estimate.posterior import Posterior
from ..physics.actuator import Actuator
from ..physics.electronics.output import OutputStage, output_of
from ..quantities.records import Quantity, of_kind, record
from ..quantities.units import unit_for, with_prefix
from ..rig.protocols import check_rate
from ..simulation.sticking import sticking
from .blocks import RATE, ControlWarning, LowPass, Notch, Pid, Regulator
from .loops import NEAR_NYQUIST, Loop, OpenLoop, crossings, sampled_loop

_MEMBERS = 40  # largest number of draws of a posterior that are used


class MarginError(ValueError):
    """Error: a loop does not keep a required margin, or is unstable, for some model of the posterior; the
    message names the margin. Or no gain keeps all margins."""


@record
class MarginRequirement(NamedTuple):
    """Stability margins that the loop must keep for every model.

    Fields: `max_sensitivity`, largest allowed sensitivity M_S; `gain_margin`, smallest ratio; `phase_margin`,
    smallest angle, rad.
    """

    max_sensitivity: Annotated[float, Quantity("", "M_S", "greatest sensitivity", above=1, maximum=100)] = 1.7
    gain_margin: Annotated[float, Quantity("", "g_m", "gain margin", minimum=1)] = 2.0
    phase_margin: Annotated[float, Quantity("rad", "φ_m", "phase margin", minimum=0)] = math.radians(45.0)


DEFAULT = MarginRequirement()


class Margins(NamedTuple):
    """Stability margins of a loop, the worst of several models.

    Fields: `stable`, True if all loops are; largest `sensitivity`; smallest `gain_margin` (a ratio) and
    `phase_margin` [rad]; lowest `crossover` frequency [Hz], at which the magnitude of the open loop falls
    below 1; `aliased`, frequency [Hz] of the lowest mode that the updates do not resolve, 0 without one. With
    an aliased mode the margins are not reliable.
    """

    stable: bool
    sensitivity: float
    gain_margin: float
    phase_margin: float
    crossover: float
    aliased: float = 0.0

    def report(self) -> str:
        """Return the margins in one line of text, or "unstable"."""
        if not self.stable:
            return "unstable"
        said = (
            f"sensitivity {self.sensitivity:.3g}, gain margin {self.gain_margin:.3g}, phase margin "
            f"{math.degrees(self.phase_margin):.3g} degrees, crossover {with_prefix(self.crossover, 'Hz')}"
        )
        if self.aliased:
            said += f"; not to be believed: a mode at {with_prefix(self.aliased, 'Hz')} is aliased"
        return said


class Tuning(NamedTuple):
    """Gains and filters of a regulator, and the margins that it keeps for all models.

    Attributes:
        pid, notches, low_pass: gains and filters of the regulator; no low-pass: None.
        margins: worst margins over all models.
        feedforward: voltage per wanted position, V/m.
        lag: delay of the position behind the voltage at low frequencies, s, for `lead` of the regulator.
        models: number of models.
        loops: loop of each model without the regulator, for `dataset`.
        requirement: margins that were required.
    """

    pid: Pid
    notches: tuple[Notch, ...]
    low_pass: LowPass | None
    margins: Margins
    feedforward: float
    lag: float
    models: int
    loops: tuple[Loop, ...] = ()
    requirement: MarginRequirement = DEFAULT

    def regulator(self, rate: float | str, **options: Any) -> Regulator:
        """Return the regulator with these gains and filters at an update rate [Hz].

        `options` are further arguments of `Regulator`: min_voltage, max_voltage, lead, feedforward. By
        default the feedforward is that of this tuning.
        """
        own = {"notches": self.notches, "low_pass": self.low_pass, "feedforward": self.feedforward}
        return Regulator(self.pid, rate, **own | options)

    @property
    def dataset(self) -> xr.Dataset:
        """Return a dataset for ``ss.plot`` with the complex response open_loop (without unit) over "model"
        and "frequency" (Hz), and as attributes the margins in words, and the required max_sensitivity and
        phase_margin [degrees]."""
        frequencies = np.unique(np.concatenate([one.frequencies for one in self.loops]))
        own = self.regulator(self.loops[0].rate).response(frequencies)
        opened = np.array([own * one.at(frequencies) for one in self.loops])
        return xr.Dataset(
            {"open_loop": (("model", "frequency"), opened, {"units": "1"})},
            {"frequency": ("frequency", frequencies, {"units": "Hz"})},
            {
                "margins": self.margins.report(),
                "max_sensitivity": self.requirement.max_sensitivity,
                "phase_margin": math.degrees(self.requirement.phase_margin),
            },
        )

    def __repr__(self) -> str:
        filters: list[Any] = [*self.notches, *([] if self.low_pass is None else [self.low_pass])]
        parts = [self.pid, *filters, f"feedforward {with_prefix(self.feedforward, 'V/m')}"]
        parts += [f"lag {with_prefix(self.lag, 's')}", f"over {self.models} models: {self.margins.report()}"]
        return f"Tuning({'; '.join(map(str, parts))})"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._numbers() == other._numbers()  # type: ignore[attr-defined]

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash(self._numbers())

    def _numbers(self) -> tuple[Any, ...]:
        """Return all fields as a tuple, for comparison, except `loops`, whose arrays cannot be compared."""
        return tuple(value for name, value in self._asdict().items() if name != "loops")


def models_of(
    model: Actuator, posterior: Posterior | Sequence[Actuator] | None, members: int = _MEMBERS
) -> list[Actuator]:
    """Return a list of the model itself, and of further models: those of a list, or up to `members` models
    with the parameters of evenly chosen draws of a posterior. None: no further models."""
    if posterior is None:
        return [model]
    if not isinstance(posterior, Posterior):
        return [model, *posterior]
    samples = posterior.samples.drop_vars("log_posterior", errors="ignore").stack(member=("chain", "draw"))
    chosen = np.unique(np.linspace(0, samples.sizes["member"] - 1, members).astype(int))
    found = [model]
    for k in chosen:
        values = {str(name): float(one.values[k]) for name, one in samples.data_vars.items()}
        of_law = {name: value for name, value in values.items() if name in model.friction._fields}
        own = {name: value for name, value in values.items() if hasattr(model, name) and name not in of_law}
        found.append(model.replace(friction=model.friction._replace(**of_law), **own))
    return found


def margins(regulator: Regulator, loops: Iterable[Loop]) -> Margins:
    """Return the worst margins of a regulator over the loops, which have the same update rate."""
    return _worst([_margins(OpenLoop.of(regulator, loop)) for loop in loops])


def _worst(found: list[Margins]) -> Margins:
    return Margins(
        all(one.stable for one in found),
        max(one.sensitivity for one in found),
        min(one.gain_margin for one in found),
        min(one.phase_margin for one in found),
        min(one.crossover for one in found),
        min((one.aliased for one in found if one.aliased), default=0.0),
    )


def _warn_of_aliasing(found: Margins, rate: float) -> None:
    if found.aliased:
        mode, hertz = with_prefix(found.aliased, "Hz"), with_prefix(rate, "Hz")
        warnings.warn(
            f"a mode of the stage at {mode} is above {NEAR_NYQUIST:g} of the update rate of {hertz}, and "
            "rings between updates: the loop sees it at another frequency, and the margins hold for exactly "
            "this mode. A faster output helps, or a `posterior` with the uncertainty of its frequency",
            ControlWarning,
            stacklevel=3,
        )


def _margins(opened: OpenLoop, factor: float = 1.0) -> Margins:
    """Return the margins of one open loop, with stability, for the regulator's gain multiplied by
    `factor`."""
    found = _from_curve(opened, factor)
    stable, sensitivity = opened.stable(factor), opened.sensitivity(factor)
    return found._replace(stable=stable, sensitivity=sensitivity, aliased=opened.loop.aliased)


def _from_curve(opened: OpenLoop, factor: float) -> Margins:
    """Return the margins from the response at the computed frequencies, with the regulator's gain multiplied
    by `factor`. Stability is not checked: `stable` is True."""
    level = opened.level + math.log(factor)
    least = float(np.abs(1.0 + factor * opened.curve).min())
    at = [factor * one for one in opened.turned]
    # If the magnitude of the open loop is below 1 at all frequencies, the crossover is below the first one.
    # Take the phase at the first frequency.
    crossed = [p for _, p in crossings(level, opened.phase)] or [float(opened.phase[0])]
    turned = min(abs(math.remainder(p + math.pi, 2.0 * math.pi)) for p in crossed)
    first = int(np.argmax(level < 0.0))
    sensitivity = 1.0 / least if least else math.inf
    gain = 1.0 / max(at) if at else math.inf
    return Margins(True, sensitivity, gain, turned, float(opened.frequencies[first]))


def check_margins(
    regulator: Regulator,
    model: Actuator,
    requirement: MarginRequirement = DEFAULT,
    *,
    posterior: Posterior | Sequence[Actuator] | None = None,
    output: OutputStage | None = None,
    delay: int = 1,
) -> Margins:
    """Check the margins of a regulator for a model and a posterior, and return the worst ones. A
    `ControlWarning` names an aliased mode.

    Args:
        regulator: the regulator.
        model: identified actuator.
        requirement: required margins.
        posterior: result of `ss.posterior`, or other actuators that are checked too.
        output: output stage; by default with the regulator's rate and no lag.
        delay: number of ticks between a measured position and its voltage, including the sensor's delay.

    Raises:
        MarginError: the loop is unstable for one of the models, or has less than a required margin.
        QuantityError: an argument has the wrong type, or the output another rate than the regulator; see
            `simulation.sticking`.
    """
    of_kind(regulator, Regulator, "regulator")
    of_kind(requirement, MarginRequirement, "requirement")
    stage = OutputStage(regulator.rate) if output is None else of_kind(output, OutputStage, "output")
    check_rate(regulator, stage.update_rate)
    loops = [sampled_loop(one, stage, delay=delay) for one in models_of(model, posterior)]
    found = margins(regulator, loops)
    _warn_of_aliasing(found, regulator.rate)
    wrong = _wrong(found, requirement)
    if wrong:
        raise MarginError(f"gains refused, over {len(loops)} models: {wrong}")
    return found


def _wrong(found: Margins, wanted: MarginRequirement) -> str:
    if not found.stable:
        return "the closed loop is unstable"
    said = []
    if found.sensitivity > wanted.max_sensitivity * (1.0 + 1e-9):
        said.append(f"the greatest sensitivity is {found.sensitivity:.3g}, above {wanted.max_sensitivity:g}")
    if found.gain_margin < wanted.gain_margin * (1.0 - 1e-9):
        said.append(f"the gain margin is {found.gain_margin:.3g}, below {wanted.gain_margin:g}")
    if found.phase_margin < wanted.phase_margin * (1.0 - 1e-9):
        degrees = (math.degrees(one) for one in (found.phase_margin, wanted.phase_margin))
        said.append("the phase margin is {:.3g} degrees, below {:.3g}".format(*degrees))
    return "; ".join(said)


def tune(
    model: Actuator,
    output: OutputStage | float | str,
    requirement: MarginRequirement = DEFAULT,
    *,
    posterior: Posterior | Sequence[Actuator] | None = None,
    delay: int = 1,
) -> Tuning:
    """Return the integral regulator, as a `Tuning`, of the fastest loop that keeps the required margins for
    all models.

    Candidates are no notch, and notches at the frequencies of the model's modes, each without low-pass and
    with several low-passes. For each candidate the largest integral gain is found by bisection. The fastest
    loop is that with the largest gain.

    Args:
        model: identified actuator.
        output: converter and amplifier, ``bench.output()``, whose updates are the loop's ticks; or their rate
            alone, Hz. A `ControlWarning` names a mode near the Nyquist frequency.
        requirement: required margins.
        posterior: result of `ss.posterior`, or other actuators for which the loop must keep them too.
        delay: number of ticks between a measured position and its voltage, including the sensor's delay.

    Raises:
        MarginError: no integral gain keeps the required margins.
        QuantityError: the rate or the delay is out of range, the actuator's gain is not above 0, or the
            requirement has the wrong type; see `simulation.sticking`.
    """
    of_kind(requirement, MarginRequirement, "requirement")
    stage, models = output_of(output), models_of(model, posterior)
    hertz = RATE.check(stage.update_rate, "output.update_rate")
    loops = [sampled_loop(one, stage, delay=delay) for one in models]
    stroke = Quantity(unit_for(model, "m/V"), "C", "the stroke per volt of what is tuned", above=0)
    stroke.check(model.gain, "Actuator.gain")
    poles = np.linalg.eigvals(sticking(model).a)
    resonances = sorted({float(abs(p)) / (2.0 * math.pi) for p in poles if p.imag > 0.0})
    filters: list[tuple[Notch, ...]] = [()]
    filters += [(Notch(f, width),) for f in resonances if f < NEAR_NYQUIST * hertz for width in (0.4, 0.8)]
    least, most = 0.3 * min(resonances, default=1e3), 0.2 * hertz
    # The candidate None has no low-pass: a loop that is slow compared with the stage does not need one.
    corners = [None, *(np.geomspace(least, most, 5) if least < most else ())]
    best: tuple[float, Any] = (0.0, None)
    for notches in filters:
        for corner in corners:
            low_pass = None if corner is None else LowPass(float(corner))
            gain = _greatest(model, hertz, notches, low_pass, loops, requirement)
            if gain > 1.02 * best[0]:
                best = gain, (notches, low_pass)
    if best[1] is None:
        raise MarginError("no integral gain keeps the margins that are required")
    gain, (notches, low_pass) = best
    pid = Pid(gain)
    lag = -float(np.angle(loops[0].response[0])) / (2.0 * math.pi * float(loops[0].frequencies[0]))
    made = Regulator(pid, hertz, notches=notches, low_pass=low_pass)
    reached = margins(made, loops)
    _warn_of_aliasing(reached, hertz)
    ahead = 1.0 / model.gain
    return Tuning(pid, notches, low_pass, reached, ahead, lag, len(models), tuple(loops), requirement)


def _greatest(
    model: Actuator,
    rate: float,
    notches: tuple[Notch, ...],
    low_pass: LowPass | None,
    loops: list[Loop],
    requirement: MarginRequirement,
) -> float:
    """Return the largest integral gain, V/(m s), with which a regulator with the filters `notches` and
    `low_pass` keeps the margins of `requirement` for all loops; 0 if no gain does. `rate` is the update rate,
    Hz; `model` gives the largest gain to try."""
    unit = Regulator(Pid(1.0), rate, notches=notches, low_pass=low_pass)
    opened = [OpenLoop.of(unit, loop) for loop in loops]
    low, high = 0.0, 2.0 * math.pi * 0.1 * rate / model.gain
    for _ in range(12):
        middle = 0.5 * (low + high) if low else 0.25 * high
        if all(_keeps(one, middle, requirement) for one in opened):
            low = middle
        else:
            high = middle
    return low


def _keeps(opened: OpenLoop, gain: float, requirement: MarginRequirement) -> bool:
    """Return True if the loop `opened` is stable and keeps the margins of `requirement` when the regulator's
    gain is multiplied by `gain`.

    The margins at the computed frequencies are tested first: they exclude most gains without the expensive
    test of stability.
    """
    if _wrong(_from_curve(opened, gain), requirement):
        return False
    return not _wrong(_margins(opened, gain), requirement)
