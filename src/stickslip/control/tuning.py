r"""Gains from models: the quickest regulator that keeps its margins on every model of a posterior.

The loop is that of the sticking actuator (`simulation.sticking`), held voltages, a delay of whole ticks and
the regulator. With the loop's response L, the greatest sensitivity tells the distance to instability
[astrom2006]

.. math:: M_S = \max_\omega \left|\frac{1}{1 + L(i\omega)}\right|, \qquad
          g_m \ge \frac{M_S}{M_S - 1}, \qquad \varphi_m \ge 2 \arcsin\frac{1}{2 M_S}

Whether the closed loop is stable is told by the poles of its discrete system, not by its margins. Friction
that slides, hysteresis and creep are not in these models.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from ..actuator import Actuator
from ..estimate.posterior import Posterior
from ..records import Quantity, record
from ..simulation.sticking import sticking
from ..units import unit_for, with_prefix
from .blocks import RATE, LowPass, Notch, Pid, Regulator, whole_number

Array = NDArray[np.float64]

_POINTS = 1200  # frequencies at which margins are looked for
_MEMBERS = 40  # of a posterior


class MarginError(ValueError):
    """Gains that a model of the posterior does not stand; names the margin."""


@record
class Requirement(NamedTuple):
    """What the loop must keep on every model."""

    max_sensitivity: Annotated[float, Quantity("", "M_S", "greatest sensitivity", above=1, maximum=100)] = 1.7
    gain_margin: Annotated[float, Quantity("", "g_m", "gain margin", minimum=1)] = 2.0
    phase_margin: Annotated[float, Quantity("rad", "φ_m", "phase margin", minimum=0)] = math.radians(45.0)


DEFAULT = Requirement()


class Margins(NamedTuple):
    """Of a loop, the worst of several models: whether all are stable, the greatest sensitivity, gain margin,
    phase margin [rad], and the least crossover [Hz]."""

    stable: bool
    sensitivity: float
    gain_margin: float
    phase_margin: float
    crossover: float

    def report(self) -> str:
        """In one line."""
        if not self.stable:
            return "unstable"
        return (
            f"sensitivity {self.sensitivity:.3g}, gain margin {self.gain_margin:.3g}, phase margin "
            f"{math.degrees(self.phase_margin):.3g} degrees, crossover {with_prefix(self.crossover, 'Hz')}"
        )


class Tuning(NamedTuple):
    """A regulator's gains and filters, the margins that they keep over so many `models`; the feedforward,
    V/m, and how late the actuator follows it, s."""

    pid: Pid
    notches: tuple[Notch, ...]
    low_pass: LowPass | None
    margins: Margins
    feedforward: float
    lag: float
    models: int

    def regulator(self, rate: float | str, **options: Any) -> Regulator:
        """At a rate [Hz]; `options` as of `Regulator`: min_voltage, max_voltage, lead, feedforward."""
        own = {"notches": self.notches, "low_pass": self.low_pass, "feedforward": self.feedforward}
        return Regulator(self.pid, rate, **own | options)


class Loop(NamedTuple):
    """An actuator that sticks, sampled: state transition (n, n), input (n,), output (n,), rate [Hz], and its
    response [m/V] at the frequencies of `grid`."""

    a: Array
    b: Array
    c: Array
    rate: float
    response: NDArray[np.complex128]


def grid(rate: float) -> Array:
    """Frequencies [Hz] at which margins are looked for, at a rate [Hz]."""
    return np.geomspace(1.0, 0.499 * rate, _POINTS)


def sampled_loop(model: Actuator, rate: float | str, *, delay: int = 1) -> Loop:
    """The sticking actuator under voltages held for a tick, with `delay` whole ticks between a measured
    position and its voltage (0: put out at once). Raises QuantityError for a rate or a delay out of range,
    and as `simulation.sticking`."""
    hertz, delay, linear = RATE.check(rate, "rate"), whole_number(delay, "delay"), sticking(model)
    n = linear.b.size
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = linear.a / hertz, linear.b / hertz
    step = expm(whole)
    a, b, c = step[:n, :n], step[:n, n], linear.c
    size = n + delay
    late, into = np.zeros((size, size)), np.zeros(size)
    late[:n, :n] = a
    late[:n, n : n + 1] = b[:, None] if delay else late[:n, n : n + 1]
    late[n:, n:] = np.eye(delay, k=1)  # what was put out, on its way
    if delay:
        into[-1] = 1.0
    else:
        into[:] = b
    out = np.append(c, np.zeros(delay))
    z = np.exp(2j * math.pi * grid(hertz) / hertz)
    # Of the plant without its delay: that has no eigenvectors of its own.
    poles, vectors = np.linalg.eig(a)
    shares = (c @ vectors) * np.linalg.solve(vectors, b)
    return Loop(late, into, out, hertz, (shares / (z[:, None] - poles)).sum(axis=1) / z**delay)


def models_of(
    model: Actuator, posterior: Posterior | Sequence[Actuator] | None, members: int = _MEMBERS
) -> list[Actuator]:
    """The model, and those of a posterior's draws, evenly taken, or of a list."""
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
    """The worst over the loops, whose rate is the regulator's."""
    control = regulator.response(grid(regulator.rate))
    return _worst([_margins(regulator, control, loop) for loop in loops])


def _worst(found: list[Margins]) -> Margins:
    return Margins(
        all(one.stable for one in found),
        max(one.sensitivity for one in found),
        min(one.gain_margin for one in found),
        min(one.phase_margin for one in found),
        min(one.crossover for one in found),
    )


def _margins(regulator: Regulator, control: NDArray[np.complex128], loop: Loop) -> Margins:
    open_loop = control * loop.response
    sensitivity = float(np.max(1.0 / np.abs(1.0 + open_loop)))
    phase, size = np.unwrap(np.angle(open_loop)), np.abs(open_loop)
    at = [s for turns in (1.0, 3.0) for _, s in _crossings(phase + turns * math.pi, size)]
    # Where it is below 1 from the first frequency on, it crossed before, with the phase that it has there.
    crossed = [p for _, p in _crossings(np.log(size), phase)] or [float(phase[0])]
    turned = min(abs(math.remainder(p + math.pi, 2.0 * math.pi)) for p in crossed)
    first = int(np.argmax(size < 1.0))
    gain = 1.0 / max(at) if at else math.inf
    return Margins(_stable(regulator, loop), sensitivity, gain, turned, float(grid(loop.rate)[first]))


def _crossings(values: Array, others: Array) -> list[tuple[int, float]]:
    """Where the values change sign, and the others there."""
    at = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))
    share = values[at] / (values[at] - values[at + 1])
    return list(zip(at.tolist(), (others[at] + share * (others[at + 1] - others[at])).tolist(), strict=True))


def step_response(regulator: Regulator, loop: Loop, ticks: int) -> Array:
    """Where the actuator is, as a share of a target that jumps at tick 0, at so many ticks; by the feedback
    alone."""
    closed, into = closed_loop(regulator, loop)
    x, found, n = np.zeros(into.size), np.empty(ticks), loop.b.size
    for k in range(ticks):
        found[k] = loop.c @ x[:n]
        x = closed @ x + into
    return found


def _stable(regulator: Regulator, loop: Loop) -> bool:
    """Whether all poles of the closed loop are within the unit circle."""
    return bool(np.abs(np.linalg.eigvals(closed_loop(regulator, loop)[0])).max() < 1.0 - 1e-12)


def closed_loop(regulator: Regulator, loop: Loop) -> tuple[Array, Array]:
    """State transition and input, the target, of a loop that is closed; the states of the loop come first."""
    a, b, c, d = regulator.state_space()
    n, m = loop.b.size, b.size
    closed = np.zeros((n + m, n + m))
    closed[:n, :n] = loop.a - d * np.outer(loop.b, loop.c)
    closed[:n, n:] = np.outer(loop.b, c)
    closed[n:, :n] = -np.outer(b, loop.c)
    closed[n:, n:] = a
    return closed, np.append(d * loop.b, b)


def check_margins(
    regulator: Regulator,
    model: Actuator,
    requirement: Requirement = DEFAULT,
    *,
    posterior: Posterior | Sequence[Actuator] | None = None,
    delay: int = 1,
) -> Margins:
    """The margins of a regulator on a model and a posterior.

    Raises:
        MarginError: the loop is unstable on one of them, or keeps less than is required.
        QuantityError: see `simulation.sticking`.
    """
    loops = [sampled_loop(one, regulator.rate, delay=delay) for one in models_of(model, posterior)]
    found = margins(regulator, loops)
    wrong = _wrong(found, requirement)
    if wrong:
        raise MarginError(f"gains refused, over {len(loops)} models: {wrong}")
    return found


def _wrong(found: Margins, wanted: Requirement) -> str:
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
    rate: float | str,
    requirement: Requirement = DEFAULT,
    *,
    posterior: Posterior | Sequence[Actuator] | None = None,
    delay: int = 1,
) -> Tuning:
    """Integral gain, notch and low-pass for the quickest loop that keeps what is required on all models.

    Tried are no notch and notches at the frequencies of the model's modes, each with several low-passes; of
    each the greatest gain is found by bisection, and the quickest is taken.

    Args:
        model: identified.
        rate: Hz, of the loop.
        requirement: margins.
        posterior: of `ss.posterior`, or other actuators that the loop must suit too.
        delay: whole ticks between a measured position and its voltage, the sensor's delay among them.

    Raises:
        MarginError: no gain keeps them.
        QuantityError: rate or delay is out of range, the actuator's gain is not above 0 (those of a `Pid` are
            not below); see `simulation.sticking`.
    """
    hertz, models = RATE.check(rate, "rate"), models_of(model, posterior)
    loops = [sampled_loop(one, hertz, delay=delay) for one in models]
    stroke = Quantity(unit_for(model, "m/V"), "C", "the stroke per volt of what is tuned", above=0)
    stroke.check(model.gain, "Actuator.gain")
    poles = np.linalg.eigvals(sticking(model).a)
    resonances = sorted({float(abs(p)) / (2.0 * math.pi) for p in poles if p.imag > 0.0})
    filters: list[tuple[Notch, ...]] = [()]
    filters += [(Notch(f, width),) for f in resonances if f < 0.4 * hertz for width in (0.4, 0.8)]
    corners = [None, *(c for c in np.geomspace(0.3 * min(resonances, default=1e3), 0.2 * hertz, 5))]
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
    lag = -float(np.angle(loops[0].response[0])) / (2.0 * math.pi * grid(hertz)[0])
    made = Regulator(pid, hertz, notches=notches, low_pass=low_pass)
    return Tuning(pid, notches, low_pass, margins(made, loops), 1.0 / model.gain, lag, len(models))


def _greatest(
    model: Actuator,
    rate: float,
    notches: tuple[Notch, ...],
    low_pass: LowPass | None,
    loops: list[Loop],
    requirement: Requirement,
) -> float:
    """The greatest integral gain, V/(m s), that keeps the margins; 0 if none does."""
    low, high = 0.0, 2.0 * math.pi * 0.1 * rate / model.gain
    for _ in range(12):
        middle = 0.5 * (low + high) if low else 0.25 * high
        made = Regulator(Pid(middle), rate, notches=notches, low_pass=low_pass)
        control = made.response(grid(rate))
        if any(_wrong(_margins(made, control, loop), requirement) for loop in loops):
            high = middle
        else:
            low = middle
    return low
