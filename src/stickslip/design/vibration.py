r"""Vibration of the stage as goals: the load on the tip of the piezo, and the sound.

The corners of a polygon u(t) of the period T, at t_k, where its slope changes by :math:`\Delta s_k`, are all
that its second derivative has. So the harmonics of the stage's acceleration are, with the gain C and the
response G of the stage without friction,

.. math:: \hat a_n = C\,G(i\omega_n)\,\frac1T \sum_k \Delta s_k\, e^{-i\omega_n t_k}, \qquad
          G(i\omega) = \frac{\omega_0^2}{\omega_0^2 - \omega^2 + 2 i \zeta \omega_0 \omega}, \qquad
          \omega_n = \frac{2\pi n}{T}

They fall with the square of the frequency beyond that of the stage. The friction of the contact is left out:
it adds at most the Coulomb force to the load on the tip. Both goals are of the stage as it is given, the same
under all conditions.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ..records import Quantity, record
from ..units import QuantityError
from .moving import Moved
from .polygons import Polygons

Array = NDArray[np.float64]
HARMONICS = 256

Gain = Annotated[float, Quantity("m/V", "C", "displacement of the stage per volt")]
Frequency = Annotated[float, Quantity("rad/s", "ω_0", "natural frequency of the stage", above=0)]
Damping = Annotated[float, Quantity("", "ζ", "damping ratio of the stage", above=0)]


def acceleration(shapes: Polygons, gain: float, natural: float, damping: float) -> NDArray[np.complex128]:
    """Harmonics 1 to `HARMONICS` of the stage's acceleration, m/s^2, [n, harmonics]; see the module."""
    slopes = shapes.slopes()
    corners = slopes - np.roll(slopes, 1, axis=1)
    n = np.arange(1, HARMONICS + 1)
    turns = np.exp(-2j * math.pi * shapes.shares[:, :, None] * n)
    omega = 2.0 * math.pi * n / shapes.period[:, None]
    response = natural**2 / (natural**2 - omega**2 + 2j * damping * natural * omega)
    return gain * response * np.einsum("mk,mkn->mn", corners, turns) / shapes.period[:, None]


def a_weighting(frequency: Array) -> Array:
    """How much of an amplitude at a frequency [Hz] is heard, 1 at 1 kHz [iec2013]."""
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
    """Greatest tension of the piezo, N, as little as can be: what it pulls the mass of the stage back with,
    which its preload must exceed."""

    mass: Annotated[float, Quantity("kg", "m_s", "mass that the piezo moves", above=0)]
    gain: Gain
    natural_frequency: Frequency
    damping_ratio: Damping

    label, unit, sign, moves = "tension at the tip", "N", -1.0, False

    @classmethod
    def of_stage(cls, model: Any) -> Self:
        """With the numbers of an actuator.

        Raises:
            QuantityError: its stage has no natural frequency.
        """
        return cls(mass=model.stage_mass, **_stage_of(model))

    def of(self, shapes: Polygons, moved: Moved) -> Array:
        harmonics = acceleration(shapes, self.gain, self.natural_frequency, self.damping_ratio)
        spectrum = np.pad(harmonics, ((0, 0), (1, 0))) * 2.0 * HARMONICS
        along = math.copysign(1.0, self.gain) * np.fft.irfft(spectrum, 2 * HARMONICS, axis=1)
        tension = self.mass * np.maximum(-along.min(axis=1), 0.0)
        return np.broadcast_to(tension[:, None], moved.steps.shape)


@record
class Noise(NamedTuple):
    """A-weighted rms acceleration of the stage, m/s^2, as little as can be: the sound pressure of a source
    that is small beside the wave is in proportion to it, so that half of it is 6 dB less."""

    gain: Gain
    natural_frequency: Frequency
    damping_ratio: Damping

    label, unit, sign, moves = "audible acceleration", "m/s^2", -1.0, False

    @classmethod
    def of_stage(cls, model: Any) -> Self:
        """With the numbers of an actuator.

        Raises:
            QuantityError: its stage has no natural frequency.
        """
        return cls(**_stage_of(model))

    def of(self, shapes: Polygons, moved: Moved) -> Array:
        harmonics = acceleration(shapes, self.gain, self.natural_frequency, self.damping_ratio)
        heard = a_weighting(np.arange(1, HARMONICS + 1) / shapes.period[:, None]) * np.abs(harmonics)
        loud = np.sqrt(2.0 * np.sum(heard**2, axis=1))
        return np.broadcast_to(loud[:, None], moved.steps.shape)
