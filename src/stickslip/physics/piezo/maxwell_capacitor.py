r"""Maxwell slip model with charge: the piezo as a two-port of voltage, charge, force and displacement.

.. math:: u = \sum_i k_i E_{q_i}[q] + \frac{q - T y}{C_0}, \qquad
          F = T\,\frac{q - T y}{C_0}, \qquad q_i = v_i / k_i

u is the voltage, q the charge, y the stroke, F the force of the ceramic, T its force per volt (the actuator's
`drive_force_per_volt`) and C_0 the capacitance if blocked [goldfarb1997, eq. 5-9]. E_r is the stop operator
of half-width r: element i takes the voltage k_i per charge until v_i, and then slips. There is no hysteresis
between charge and force, so an actuator under charge control has no loop. Under voltage control, a motion of
the stage also moves charge and so acts on the elements.

Under voltage control the charge is a Prandtl-Ishlinskii operator of u + T y/C_0, whose half-widths ρ_j and
weights a_j follow from the k_i in closed form [krejci2001]:

.. math:: q = C_0 \left( e - \sum_j a_j E_{\rho_j}[e] \right), \qquad e = u + T y / C_0

The model is rate-independent, without creep and without leakage: a charge remains without end, whereas a real
charge amplifier loses it at low frequencies. It is valid for voltages up to those from which the elements
were identified.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...quantities import registry
from ...quantities.records import Quantity, of_kind, record
from ...quantities.units import QuantityError, to_si
from .operators import Operators
from .prandtl_ishlinskii import PrandtlIshlinskii

Array = NDArray[np.float64]


@registry.piezos.add
@record
class MaxwellCapacitor(NamedTuple):
    """Maxwell slip model with charge: a two-port that reacts to the load; see the module.

    `capacitance` is C_0 [F]; `stiffnesses` k_i [V/C] and `breakaways` v_i [V] are those of the elements, in
    the order of ascending v_i/k_i.

    With `charge_drive` the drive commands the charge instead of the voltage, as this charge over the
    capacitance of the free piezo [V]; so the static stroke is the gain multiplied by the command. If the
    command jumps, the current is infinite for an instant, which no sample shows.
    """

    capacitance: Annotated[
        float, Quantity("F", "C_0", "capacitance if blocked, all elements slipping", above=0)
    ]
    stiffnesses: Annotated[tuple[float, ...], Quantity("V/C", "k_i", "voltage per charge of each", above=0)]
    breakaways: Annotated[tuple[float, ...], Quantity("V", "v_i", "voltage where elements slip", above=0)]
    charge_drive: bool = False

    def _check(self) -> None:
        if len(self.stiffnesses) != len(self.breakaways) or not self.stiffnesses:
            raise QuantityError(
                f"MaxwellCapacitor has {len(self.stiffnesses)} stiffnesses [V/C] and {len(self.breakaways)} "
                "breakaways [V]: it must have one of each per element"
            )
        reach = np.array(self.breakaways) / np.array(self.stiffnesses)
        if not np.all(np.diff(reach) > 0.0):
            raise QuantityError(
                "MaxwellCapacitor: the charges v_i/k_i at which the elements slip must ascend, these are "
                f"{', '.join(f'{q:.3g}' for q in reach)} C"
            )

    def stops(self) -> tuple[Array, Array]:
        """Return half-widths ρ_j [V] and weights a_j of the stop operators that act on e = u + T y/C_0 under
        voltage control (see the module).

        Both have the shape [elements], or [elements, members] if fields are arrays with a value per member.
        """
        every = np.array(np.broadcast_arrays(*self.stiffnesses, *self.breakaways, self.capacitance))
        n = len(self.stiffnesses)
        k, v, c_0 = every[:n], every[n:-1], every[-1]
        charge, slope = v / k, 1.0 / c_0 + np.append(np.cumsum(k[::-1], axis=0)[::-1], 0.0 * k[:1], axis=0)
        width = np.cumsum(np.diff(charge, axis=0, prepend=0.0 * k[:1]) * slope[:-1], axis=0)
        return width, np.diff(1.0 / slope, axis=0) / c_0

    @property
    def operators(self) -> Operators:
        """Return the elements as plays whose input is the charge q [C]: thresholds v_i/k_i [C] and weights
        k_i [V/C].

        The voltage across the elements is Σ k_i q minus the output of the plays.
        """
        k, v, none = np.array(self.stiffnesses), np.array(self.breakaways), np.zeros(0)
        return Operators(v / k, k, none, none, none)

    @classmethod
    def of_plays(
        cls,
        plays: PrandtlIshlinskii,
        capacitance: float | str,
        gain: float | str,
        stiffness: float | str,
    ) -> MaxwellCapacitor:
        """Return the two-port whose unloaded stage follows a slow voltage like the plays.

        Args:
            plays: two or more plays without dead zones, the first with the threshold 0; their weights sum to
                1, so that the gain is that of large strokes.
            capacitance: capacitance C_0 of the blocked piezo, F.
            gain: gain of the actuator, m/V.
            stiffness: stiffness of piezo and stage together, N/m.

        Raises:
            QuantityError: the plays are not of this form, or another argument is not above 0.
        """
        of_kind(plays, PrandtlIshlinskii, "plays")
        farad, gain = to_si(capacitance, "F", "capacitance"), to_si(gain, "m/V", "gain")
        stiffness = to_si(stiffness, "N/m", "stiffness")
        r, w = np.array(plays.thresholds), np.array(plays.weights)
        if plays.dead_zones or r[0] != 0.0 or abs(w.sum() - 1.0) > 1e-9 or r.size < 2:
            raise QuantityError(
                "a MaxwellCapacitor is made of plays [V] with one of threshold 0 and one above it, without "
                f"dead zones, whose weights sum to 1; these sum to {w.sum():.6g}"
            )
        if not (gain > 0.0 and stiffness > 0.0 and farad > 0.0):
            raise QuantityError(
                f"capacitance = {farad} F, gain = {gain} m/V and stiffness = {stiffness} N/m must be > 0"
            )
        # Slopes of the initial curve (output of the plays over the voltage) between successive thresholds.
        slope = np.cumsum(w)
        # Output of the plays, V, at which each further play starts to move.
        wanted = np.cumsum(np.diff(r) * slope[:-1])
        # Charge of the piezo per volt of the plays' output, C/V.
        charge = farad + gain**2 * stiffness
        lost = -np.diff(1.0 / slope)
        return cls(
            farad,
            tuple((lost / charge)[lost > 0.0].tolist()),
            tuple((lost * wanted)[lost > 0.0].tolist()),
        )
