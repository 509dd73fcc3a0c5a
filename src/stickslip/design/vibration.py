r"""Goals for the vibration of the stage: the load on the tip of the piezo, and the sound.

The second derivative of a polygon u(t) with period T consists of its corners at t_k, where its slope changes
by :math:`\Delta s_k`. So the harmonics of the stage's acceleration a are, with the gain C and the response G
of the stage without friction (natural frequency ω_0, damping ratio ζ),

.. math:: \hat a_n = C\,G(i\omega_n)\,\frac1T \sum_k \Delta s_k\, e^{-i\omega_n t_k}, \qquad
          G(i\omega) = \frac{\omega_0^2}{\omega_0^2 - \omega^2 + 2 i \zeta \omega_0 \omega}, \qquad
          \omega_n = \frac{2\pi n}{T}

They fall with the square of the frequency beyond that of the stage. In time, the stage vibrates freely
between corners,

.. math:: \ddot a + 2\zeta\omega_0 \dot a + \omega_0^2 a = \omega_0^2 C \sum_k \Delta s_k\, \delta(t - t_k)

so that its extremes are in closed form. The friction of the contact is left out: it adds at most the Coulomb
force to the load on the tip. Both goals use the stage of the given model, under all conditions.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError
from .moving import PeriodicMotions
from .polygons import Polygons

Array = NDArray[np.float64]
# HARMONICS, MOST: smallest and largest number of harmonics of the drive that are summed for the noise. HEARD:
# frequency, Hz, up to which all harmonics are included, the upper limit of hearing.
HARMONICS, MOST, HEARD = 256, 2**17, 20e3
# Smallest value that is used for half the difference of the stage's two poles, relative to the natural
# frequency. At critical damping the poles coincide, and the closed form of the vibration would divide by
# zero.
APART = 1e-6

Gain = Annotated[float, Quantity("m/V", "C", "displacement of the stage per volt")]
Frequency = Annotated[float, Quantity("rad/s", "ω_0", "natural frequency of the stage", above=0)]
Damping = Annotated[float, Quantity("", "ζ", "damping ratio of the stage", above=0)]


def _corners(shapes: Polygons) -> Array:
    """Return the slope of the voltage after each of the k corners of n polygons minus that before, V/s,
    [n, k]."""
    slopes = shapes.slopes()
    return slopes - np.roll(slopes, 1, axis=1)


def audible(shapes: Polygons) -> int:
    """Return the number of harmonics for the noise of all polygons: those of the slowest one up to 20 kHz,
    and at least `HARMONICS`.

    Raises:
        QuantityError: the drive is so slow that there are more than `MOST`.
    """
    slowest = 1.0 / float(shapes.period.max())
    if not slowest * MOST >= HEARD:
        raise QuantityError(
            f"frequency = {slowest:.3g} Hz is out of range: audible noise is computed for drives of at least "
            f"{HEARD / MOST:.3g} Hz"
        )
    return max(HARMONICS, math.ceil(HEARD / slowest))


def acceleration(
    shapes: Polygons, gain: float, natural: float, damping: float, count: int = HARMONICS
) -> NDArray[np.complex128]:
    """Return harmonics 1 to `count` of the stage's acceleration, complex amplitudes of exp(i ω_n t) with
    positive n, [n, count], m/s^2, or rad/s^2 for a rotary actuator; see the module for the equation.

    Args:
        shapes: n polygons of the drive voltage.
        gain: gain of the stage, m/V, or rad/V.
        natural: natural frequency of the stage, rad/s.
        damping: damping ratio of the stage.
        count: number of harmonics.
    """
    n = np.arange(1, count + 1)
    lines = [
        jumps @ np.exp(-2j * math.pi * shares[:, None] * n)
        for jumps, shares in zip(_corners(shapes), shapes.shares, strict=True)
    ]
    omega = 2.0 * math.pi * n / shapes.period[:, None]
    response = natural**2 / (natural**2 - omega**2 + 2j * damping * natural * omega)
    return gain * response * np.array(lines) / shapes.period[:, None]


def least_acceleration(shapes: Polygons, gain: float, natural: float, damping: float) -> Array:
    """Return the least (most negative) acceleration of the stage within a period of its periodic vibration,
    [n], m/s^2, or rad/s^2 for a rotary actuator; see the module.

    Args:
        shapes: n polygons of the drive voltage.
        gain: gain of the stage, m/V, or rad/V.
        natural: natural frequency of the stage, rad/s.
        damping: damping ratio of the stage.
    """
    root = np.emath.sqrt(damping**2 - 1.0)
    root = root if abs(root) > APART else APART
    poles = natural * np.array([root - damping, -root - damping], dtype=complex)
    sides = np.diff(shapes.shares, append=1.0) * shapes.period[:, None]
    # The acceleration between two corners is the sum of two parts c exp(p t), one for each pole p. A corner
    # excites both parts equally, with opposite signs. The corners of all earlier periods form a geometric
    # series, whose sum is the division by 1 - exp(p T).
    kick = natural**2 * gain / (poles[0] - poles[1]) * np.array([1.0, -1.0])
    jumps, fades = _corners(shapes)[..., None] * kick, np.exp(sides[..., None] * poles)
    parts = np.zeros((len(sides), 2), dtype=complex)
    for k in range(sides.shape[1]):
        parts = (parts + jumps[:, k]) * fades[:, k]
    parts = parts / -np.expm1(shapes.period[:, None] * poles)
    least = np.full(len(sides), math.inf)
    swing = 2.0 * math.pi / abs((poles[0] - poles[1]).imag) if damping < 1.0 else math.inf
    for k in range(sides.shape[1]):
        parts = parts + jumps[:, k]
        with np.errstate(divide="ignore", invalid="ignore"):
            turned = np.log(-parts[:, 1] * poles[1] / (parts[:, 0] * poles[0])) / (poles[0] - poles[1])
            first = np.nan_to_num(np.mod(turned.real, swing))
        for at in (np.zeros(len(sides)), first, first + swing):
            at = np.minimum(at, sides[:, k])
            least = np.minimum(least, (parts * np.exp(at[:, None] * poles)).sum(axis=1).real)
        parts = parts * fades[:, k]
    return least


def a_weighting(frequency: Array) -> Array:
    """Return the A-weighting, a factor on amplitudes that is 1 at 1 kHz, at frequencies [Hz] in their shape
    [iec2013]."""
    f2 = frequency**2
    poles = (f2 + 20.6**2) * np.sqrt((f2 + 107.7**2) * (f2 + 737.9**2)) * (f2 + 12194.0**2)
    return 10.0 ** (2.0 / 20.0) * 12194.0**2 * f2**2 / poles


def _stage_of(model: Any) -> dict[str, float]:
    if model.static:
        raise QuantityError("a stage without a natural frequency has no acceleration that could be known")
    return {
        "gain": model.gain,
        "natural_frequency": model.natural_frequency,
        "damping_ratio": model.damping_ratio,
    }


@record
class TipLoad(NamedTuple):
    """Goal: smallest tension of the piezo, N, or N m for a rotary actuator.

    The tension is the largest force with which the piezo pulls the mass of the stage back: mass times the
    most negative acceleration, or 0. The preload of the piezo must exceed it.
    """

    mass: Annotated[float, Quantity("kg", "m_s", "mass that the piezo moves", above=0)]
    gain: Gain
    natural_frequency: Frequency
    damping_ratio: Damping

    label, unit, sign, moves = "tension at the tip", "N", -1.0, False

    @classmethod
    def of_stage(cls, model: Any) -> Self:
        """Return the goal for an actuator `model`: stage mass, gain, natural frequency and damping ratio are
        taken from the model.

        Raises:
            QuantityError: the stage is static and has no natural frequency.
        """
        return cls(mass=model.stage_mass, **_stage_of(model))

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        along = least_acceleration(shapes, abs(self.gain), self.natural_frequency, self.damping_ratio)
        tension = self.mass * np.maximum(-along, 0.0)
        return np.broadcast_to(tension[:, None], moved.steps.shape)


@record
class Noise(NamedTuple):
    """Goal: smallest A-weighted rms acceleration of the stage, m/s^2, or rad/s^2 for a rotary actuator.

    The sound pressure of a source that is small compared with the wavelength is in proportion to this
    acceleration; half the acceleration is 6 dB less.
    """

    gain: Gain
    natural_frequency: Frequency
    damping_ratio: Damping

    label, unit, sign, moves = "audible acceleration", "m/s^2", -1.0, False

    @classmethod
    def of_stage(cls, model: Any) -> Self:
        """Return the goal for an actuator `model`: gain, natural frequency and damping ratio of its stage are
        taken from the model.

        Raises:
            QuantityError: the stage is static and has no natural frequency.
        """
        return cls(**_stage_of(model))

    def of(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        count = audible(shapes)
        harmonics = acceleration(shapes, self.gain, self.natural_frequency, self.damping_ratio, count)
        heard = a_weighting(np.arange(1, count + 1) / shapes.period[:, None]) * np.abs(harmonics)
        loud = np.sqrt(2.0 * np.sum(heard**2, axis=1))
        return np.broadcast_to(loud[:, None], moved.steps.shape)
