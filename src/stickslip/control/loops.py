r"""Loops of a sticking actuator, sampled at the update rate: frequency responses and closed-loop stability.

A resonance is as narrow as its damping, and a loop may pass -1 on the flank of a resonance only. So responses
are computed at frequencies that are evenly spaced on a logarithmic scale, and near each pole and zero p of
the loop at

.. math:: \omega = \omega_p \pm \sigma_p \sinh(k h), \qquad \sigma_p = -\ln|p| / T, \quad
    \omega_p = |\arg p| / T

with the tick T and whole numbers k. So a resonance is passed in steps of h, however narrow it is
[astrom2006].

The response is exact for voltages that are held for a tick, including aliasing. A mode near or above the
Nyquist frequency that vibrates for longer than a tick appears at another frequency, which changes by as much
as the mode's frequency does. Margins of such a loop are not reliable.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ..physics.actuator import Actuator
from ..physics.electronics.output import OutputStage, output_of
from ..quantities.units import array_si
from ..simulation.sticking import Sticking, sticking
from .blocks import RATE, Regulator, whole_number

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
StateSpace = tuple[Array, Array, Array, float]

_POINTS = 1200  # number of frequencies on the logarithmic scale of `grid`
# Spacing h of frequencies near a resonance (see the module), and largest change of a delay's phase between
# two frequencies, rad.
_STEP, _TURN = 0.025, 0.1
# Ratio of damping to frequency of a resonance (σ_p/ω_p in the module) above which the logarithmic scale alone
# is dense enough, and ratio that is assumed for an undamped mode.
_WIDE = 0.2
_NARROW = 1e-9
# Largest number of states of a closed loop whose poles are computed; for more, the Nyquist criterion is used.
_STATES = 48
# Number of frequencies in one refinement about the largest sensitivity, and largest number of refinements.
_FINER, _ROUNDS = 13, 6
# Frequency over update rate above which a mode counts as aliased, and gets no notch: if its frequency is
# wrong by 5 %, the frequency at which it appears is wrong by up to 10 %.
NEAR_NYQUIST = 0.4
# Share r of a mode's vibration that remains after one tick, below which the mode is not a resonance of the
# sampled loop: the ratio of its largest to its smallest response, (1 + r) / (1 - r), is then below 1.7.
RINGS = 0.25
SEEN = 1e-3  # share of a mode in the static stroke above which it is reported as aliased
# Relative change of the largest sensitivity by further frequencies between two, below which none are added.
_EVEN = 1e-4


class Loop(NamedTuple):
    """A sticking actuator, sampled at the update rate, as a linear system from voltage [V] to position [m].

    Fields: state transition `a` (n, n), input `b` (n,), output `c` (n,), including the states of the delay;
    `rate` [Hz]; `delay` in ticks; `poles` and their `residues` [m/V], and `zeros`, of z and without the
    delay; complex `response` [m/V] at `frequencies` [Hz] below half the rate; and `aliased`, frequency [Hz]
    of the lowest mode that the updates do not resolve, or 0. For a rotary actuator m is rad.
    """

    a: Array
    b: Array
    c: Array
    rate: float
    delay: int
    poles: Complex
    residues: Complex
    zeros: Complex
    frequencies: Array
    response: Complex
    aliased: float = 0.0

    def at(self, frequencies: ArrayLike) -> Complex:
        """Return the complex response [m/V] at frequencies [Hz] (n,), including the delay."""
        return _response(
            self.poles, self.residues, array_si(frequencies, "Hz", "frequencies"), self.rate, self.delay
        )


def _response(poles: Any, residues: Any, frequencies: Array, rate: float, delay: int) -> Complex:
    z = np.exp(2j * math.pi / rate * frequencies)
    return (residues / (z[:, None] - poles)).sum(axis=1) / z**delay


def grid(rate: float, delay: int = 0) -> Array:
    """Return frequencies [Hz], evenly spaced on a logarithmic scale, up to 0.499 times the update rate [Hz].

    At the lowest one, at most 1 Hz, a delay of `delay` ticks has a phase below 0.01 rad."""
    first = min(1.0, 1e-4 * rate, 0.01 * rate / (2.0 * math.pi * (delay + 1)))
    return np.geomspace(first, 0.499 * rate, _POINTS)


def _about(roots: Iterable[complex], rate: float, ends: Array) -> list[Array]:
    """Return a list with an array of frequencies [Hz] around each narrow resonance, with a spacing in
    proportion to its damping.

    Args:
        roots: poles and zeros of a sampled system.
        rate: update rate, Hz.
        ends: array of frequencies, Hz; only frequencies between its first and last are returned.
    """
    found = []
    for root in roots:
        # A real pole or zero is no resonance.
        if abs(root.imag) < 1e-6 * abs(root):
            continue
        turn = abs(float(np.angle(root)))
        fading = max(abs(math.log(max(abs(root), 1e-300))), _NARROW * turn)
        if not 0.0 < fading < _WIDE * turn:
            continue
        # Start half a spacing beside the resonance, because without damping the response there is infinite.
        off = fading * np.sinh(np.arange(0.5 * _STEP, math.asinh(_WIDE * turn / fading), _STEP))
        both = np.concatenate([turn - off, turn + off]) * (rate / (2.0 * math.pi))
        found.append(both[(both > ends[0]) & (both < ends[-1])])
    return found


def _frequencies(rate: float, delay: int, roots: Iterable[complex]) -> Array:
    known = grid(rate, delay)
    parts = [known, *_about(roots, rate, known)]
    # The phase of a delay is proportional to the frequency, so the logarithmic scale is too coarse at high
    # ones: add evenly spaced frequencies.
    if delay:
        apart = _TURN * rate / (2.0 * math.pi * delay)
        first = apart / (known[1] / known[0] - 1.0)
        parts.append(np.arange(first, known[-1], apart))
    return np.unique(np.concatenate(parts))


def sampled_loop(model: Actuator, output: OutputStage | float | str, *, delay: int = 1) -> Loop:
    """Return the sticking actuator behind an output stage, sampled at its updates.

    Args:
        model: identified actuator, whose contact sticks.
        output: output stage, of which the update rate and the amplifier's lag are used; or the rate alone,
            Hz. Limits of slope and current are not in a linear loop.
        delay: number of ticks between a measured position and the output of its voltage; 0: at once.

    Raises:
        QuantityError: a rate or a delay is out of range; see `simulation.sticking`.
    """
    stage = output_of(output)
    hertz, delay = RATE.check(stage.update_rate, "output.update_rate"), whole_number(delay, "delay")
    own = sticking(model)
    linear = _behind(own, stage.lag)
    n = linear.b.size
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = linear.a / hertz, linear.b / hertz
    step = scipy.linalg.expm(whole)
    a, b, c = step[:n, :n], step[:n, n], linear.c
    size = n + delay
    late, into = np.zeros((size, size)), np.zeros(size)
    late[:n, :n] = a
    late[:n, n : n + 1] = b[:, None] if delay else late[:n, n : n + 1]
    late[n:, n:] = np.eye(delay, k=1)  # the last states are voltages that wait for their output
    if delay:
        into[-1] = 1.0
    else:
        into[:] = b
    out = np.append(c, np.zeros(delay))
    # Poles and residues without the delay: the matrix of a delay line has too few eigenvectors.
    roots: Any = np.linalg.eig(a)
    poles, vectors = roots
    residues = (c @ vectors) * np.linalg.solve(vectors, b)
    zeros = _zeros(a, b, c)
    known = _frequencies(hertz, delay, [*poles, *zeros])
    response = _response(poles, residues, known, hertz, delay)
    aliased = _aliased(own, hertz)
    return Loop(late, into, out, hertz, delay, poles, residues, zeros, known, response, aliased)


def _behind(own: Sticking, lag: float) -> Sticking:
    """Return the linear model with an amplifier in front, a lag of first order with this time constant [s].
    Its output voltage becomes the last state; without a lag, the model is returned unchanged."""
    if not lag > 0.0:
        return own
    n = own.b.size
    a = np.zeros((n + 1, n + 1))
    a[:n, :n], a[:n, n], a[n, n] = own.a, own.b, -1.0 / lag
    return Sticking(a, np.append(np.zeros(n), 1.0 / lag), np.append(own.c, 0.0))


def _aliased(own: Sticking, rate: float) -> float:
    """Return the frequency [Hz] of the lowest mode that updates at this rate [Hz] do not resolve; 0 without
    such a mode. See `NEAR_NYQUIST`, `RINGS` and `SEEN`."""
    roots: Any = np.linalg.eig(own.a)
    poles, vectors = roots
    shares = np.abs((own.c @ vectors) * np.linalg.solve(vectors, own.b) / poles)
    hertz = np.abs(poles) / (2.0 * math.pi)
    beyond = (poles.imag > 0.0) & (hertz > NEAR_NYQUIST * rate) & (np.exp(poles.real / rate) > RINGS)
    found = hertz[beyond & (shares > SEEN * np.abs(own.c @ np.linalg.solve(own.a, own.b)))]
    return float(found.min()) if found.size else 0.0


def _zeros(a: Any, b: Any, c: Array) -> Complex:
    """Return the zeros of c (z - a)⁻¹ b with a magnitude below 1000, as eigenvalues of a matrix pencil."""
    n = b.size
    left, right = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    left[:n, :n], left[:n, n], left[n, :n] = a, b / (np.abs(b).max() or 1.0), c
    right[:n, :n] = np.eye(n)
    found: Any = scipy.linalg.eigvals(left, right)
    return found[np.isfinite(found) & (np.abs(found) < 1e3)]


def crossings(values: Array, others: Array) -> list[tuple[int, float]]:
    """Return a list of pairs, one for each change of sign of `values` [n]: the index before the change, and
    the value of `others` [n] at the zero, interpolated linearly."""
    above = values > 0.0
    at = np.flatnonzero(above[1:] != above[:-1])
    share = values[at] / (values[at] - values[at + 1])
    return list(zip(at.tolist(), (others[at] + share * (others[at + 1] - others[at])).tolist(), strict=True))


class OpenLoop(NamedTuple):
    """A regulator in series with a loop: the open loop.

    Fields: `regulator`, its state space `own`, and `loop`; the response from error to position (without unit)
    at `frequencies` [Hz], as complex `curve`, natural logarithm of its magnitude `level`, and `phase` [rad],
    continuous (unwrapped); `real`, its real value at half the update rate; and `turned`, its magnitudes where
    the phase is any odd multiple of 180 degrees, half the update rate included.
    """

    regulator: Regulator
    loop: Loop
    own: StateSpace
    frequencies: Array
    curve: Complex
    level: Array
    phase: Array
    real: float
    turned: list[float]

    @classmethod
    def of(cls, regulator: Regulator, loop: Loop) -> OpenLoop:
        """Return the open loop of a regulator and a loop with the same update rate."""
        own = regulator.state_space()
        a, b, c, d = own
        roots = [*np.linalg.eigvals(a), *(np.linalg.eigvals(a - np.outer(b, c) / d) if d else ())]
        known, response = loop.frequencies, loop.response
        if more := _about(roots, loop.rate, known):
            known = np.union1d(known, np.concatenate(more))
            response = loop.at(known)
        curve = regulator.response(known) * response
        last = np.array([0.5 * loop.rate])
        real = float((regulator.response(last) * loop.at(last))[0].real)
        size = np.maximum(np.abs(curve), 1e-300)
        across = crossings(curve.imag / size, size)
        turned = [s for k, s in across if curve[k].real < 0.0] + ([-real] if real < 0.0 else [])
        return cls(regulator, loop, own, known, curve, np.log(size), np.unwrap(np.angle(curve)), real, turned)

    def at(self, frequencies: Array) -> Complex:
        """Return the complex response from error to position (without unit) at frequencies [Hz] (n,)."""
        return self.regulator.response(frequencies) * self.loop.at(frequencies)

    def sensitivity(self, factor: float = 1.0) -> float:
        """Return the maximum magnitude of the sensitivity function 1 / (1 + L), with the regulator's gain
        multiplied by `factor`; infinite if the open loop L passes through -1."""
        known, curve = self.frequencies, factor * self.curve
        away = np.abs(1.0 + curve)
        k, least = int(np.argmin(away)), min(float(away.min()), abs(1.0 + factor * self.real))
        for _ in range(_ROUNDS):
            low, high = max(k - 1, 0), min(k + 1, known.size - 1)
            if float(np.abs(np.diff(curve[low : high + 1])).max()) ** 2 < 8.0 * _EVEN * least**2:
                break
            known = np.linspace(known[low], known[high], _FINER)
            curve = factor * self.at(known)
            away = np.abs(1.0 + curve)
            k, least = int(np.argmin(away)), min(float(away.min()), least)
        return 1.0 / least if least else math.inf

    def stable(self, factor: float = 1.0) -> bool:
        """Return True if all poles of the closed loop are inside the unit circle, with the regulator's gain
        multiplied by `factor`; with more than `_STATES` states, by the Nyquist criterion."""
        a, b, c, d = self.own
        if self.loop.b.size + b.size > _STATES:
            return self._turns(factor)
        closed, _ = _closed((a, b, factor * c, factor * d), self.loop)
        # Without integral gain the regulator's integral is constant: remove this state, whose pole is 1.
        if not self.regulator.per_tick:
            keep = np.arange(len(closed)) != len(closed) - 3
            closed = closed[np.ix_(keep, keep)]
        return bool(np.abs(np.linalg.eigvals(closed)).max() < 1.0 - 1e-12)

    def _turns(self, factor: float) -> bool:
        """Return True if the closed loop is stable by the Nyquist criterion.

        1 + L, with the open loop L, is multiplied by a factor 1 - p/z for each pole p of the open loop on the
        unit circle (integral, undamped modes). By the argument principle, the phase of the product then turns
        by π, along the upper half of the circle, for each pole of the closed loop outside it. A loop that
        passes too close to -1 for this count has no margin anyway. `factor` multiplies the regulator's gain.
        """
        rate, known = self.loop.rate, np.append(self.frequencies, 0.5 * self.loop.rate)
        later = np.exp(-2j * math.pi / rate * known)
        value = 1.0 + factor * np.append(self.curve, self.real)
        undamped = self.loop.poles[np.abs(self.loop.poles) > 1.0 - _NARROW]
        for pole in [*([1.0] if self.regulator.per_tick else []), *undamped]:
            value = value * (1.0 - pole * later)
        turned = float(np.unwrap(np.angle(value))[-1])
        # At frequency 0 the value 1 + L, with the loop's response L, must be positive. Otherwise the feedback
        # is positive, and the loop unstable.
        stroke = float((self.loop.residues / (1.0 - self.loop.poles)).sum().real)
        pid = self.regulator.pid
        begins = stroke if pid.integral else 1.0 + factor * pid.proportional * stroke
        return begins > 0.0 and round(turned / math.pi) == 0


def step_response(regulator: Regulator, loop: Loop, ticks: int) -> Array:
    """Return the position at each tick (ticks,) after a unit step of the target at tick 0, in the closed loop
    without feedforward and voltage limits."""
    closed, into = closed_loop(regulator, loop)
    x, found, n = np.zeros(into.size), np.empty(ticks), loop.b.size
    for k in range(ticks):
        found[k] = loop.c @ x[:n]
        x = closed @ x + into
    return found


def closed_loop(regulator: Regulator, loop: Loop) -> tuple[Array, Array]:
    """Return the closed loop without feedforward and limits: state transition (n, n), and input (n,) from the
    target. The first states are those of `loop`, the others those of the regulator."""
    return _closed(regulator.state_space(), loop)


def _closed(own: StateSpace, loop: Loop) -> tuple[Array, Array]:
    a, b, c, d = own
    n, m = loop.b.size, b.size
    closed = np.zeros((n + m, n + m))
    closed[:n, :n] = loop.a - d * np.outer(loop.b, loop.c)
    closed[:n, n:] = np.outer(loop.b, c)
    closed[n:, :n] = -np.outer(b, loop.c)
    closed[n:, n:] = a
    return closed, np.append(d * loop.b, b)
