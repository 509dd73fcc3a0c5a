r"""Variation of a virtual rig's contact from run to run, as measured on real contacts.

A factor f multiplies all friction forces (Coulomb, stiction), a factor s the stiffness of the bristle.
Lengths change with the ratio f/s. In run k of a series the logarithms of f and s are (less half their
variance, so that the mean factor is 1)

.. math:: \ln f_k = \sigma_f\,e_k + \sigma_d\,d_k, \qquad d_k = \rho\,d_{k-1} + \sqrt{1-\rho^2}\,e'_k,
      \qquad \rho = e^{-1/n}, \qquad \ln s_k = \sigma_s\,e''_k

with independent standard normal e, e', e''. σ_f and σ_s are the scatter of friction and stiffness from run to
run; σ_d is the size of a slow change of the friction, which is forgotten after about n runs. Runs are
numbered, so that each of them can be drawn alone and reproduced bit for bit. A rig that is opened again
continues with the next number.
"""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..physics.actuator import Actuator
from ..quantities.records import Quantity, quantities, record
from .irregularity import REGULAR, Irregularity, Slips

_OWN, _SLOW = 1, 2  # numbers of the random streams for the scatter of single runs and for the slow change


@record
class Variation(NamedTuple):
    """Relative standard deviations of the contact from run to run; 0, the default, is no variation.

    `friction` and `stiffness` vary independently from run to run, `drift` is a slow change of the friction
    with a memory of `drift_runs` runs. From stroke to stroke of a tribometer they were: friction 0.4 %, drift
    1.2 % with drift_runs 15, stiffness 2 % (see docs/decisions/rig.md).
    """

    friction: Annotated[float, Quantity("", "σ_f", "scatter of friction", minimum=0, maximum=0.3)] = 0.0
    drift: Annotated[float, Quantity("", "σ_d", "slow change of friction", minimum=0, maximum=0.3)] = 0.0
    drift_runs: Annotated[
        float, Quantity("", "n", "runs after which the slow change is forgotten", minimum=1, maximum=1e6)
    ] = 15.0
    stiffness: Annotated[
        float, Quantity("", "σ_s", "scatter of the bristle's stiffness", minimum=0, maximum=0.3)
    ] = 0.0

    @property
    def none(self) -> bool:
        """Return True if all variations are 0, so that every run has the same contact."""
        return self.friction == self.drift == self.stiffness == 0.0


class Repeats(NamedTuple):
    """State of a series of runs of a virtual rig.

    `variation` is the size of the variation from run to run, `series` the seed of the series, and `number`
    the number of the next run. `irregularity` describes how steps within a run differ from each other.
    """

    variation: Variation = Variation()
    series: int = 0
    number: int = 0
    irregularity: Irregularity = REGULAR

    def factors(self, run: int = 0) -> tuple[float, float]:
        """Return the factors of friction f and of stiffness s in a run; `run` 0 is the next run.

        The module explains the factors.
        """
        return _factors(self.variation, self.series, self.number + run)

    def actuator(self, actuator: Actuator, run: int = 0) -> Actuator:
        """Return the actuator with the contact of a run; `run` 0 is the next run.

        Without variation, and without a slipping end-effector (clamped), the actuator is unchanged.
        """
        if self.variation.none or actuator.clamped:
            return actuator
        friction, stiffness = self.factors(run)
        scale = {"N": friction, "N/m": stiffness, "m": friction / stiffness}
        law: Any = actuator.friction
        units = {name: one.unit for name, one in quantities(type(law)).items() if one.unit in scale}
        changed = {name: _times(getattr(law, name), scale[unit]) for name, unit in units.items()}
        return actuator.replace(friction=law._replace(**changed))

    def slips(self, actuator: Actuator, run: int = 0) -> Slips | None:
        """Return the irregular slips of a run (`run` 0 is the next run); None without irregularity or if
        clamped.

        QuantityError as `Slips`.
        """
        if self.irregularity.none or actuator.clamped:
            return None
        return Slips(self.irregularity, actuator, (self.series, self.number + run))

    def told(self, actuator: Actuator, runs: int = 1, after: int = 0) -> dict[str, str]:
        """Return the true contact of one or several runs, as the attribute `contact` of their recording.

        Args:
            actuator: the actuator without variation.
            runs: number of runs of the recording.
            after: number of runs between the next run and the first run of the recording.

        Returns:
            {"contact": JSON text}; empty without variation. The text is an object for one run, a list of
            objects for several. Each has `number` of the run, its factors `friction` and `stiffness`, and the
            changed fields of the friction law in SI units.
        """
        if self.variation.none or actuator.clamped:
            return {}
        found = []
        for run in range(after, after + runs):
            law, before = self.actuator(actuator, run).friction._asdict(), actuator.friction._asdict()
            friction, stiffness = self.factors(run)
            found.append(
                {"number": self.number + run, "friction": friction, "stiffness": stiffness}
                | {name: value for name, value in law.items() if value != before[name]}
            )
        return {"contact": json.dumps(found[0] if runs == 1 else found)}

    def document(self) -> dict[str, Any]:
        """Return the series as JSON data, fields by name."""
        return {
            **self._asdict(),
            "variation": self.variation._asdict(),
            "irregularity": self.irregularity._asdict(),
        }

    @classmethod
    def of_document(cls, found: dict[str, Any]) -> Repeats:
        """Return the series from `document`'s data, with defaults for missing fields."""
        return cls(
            Variation(**found.get("variation", {})),
            int(found.get("series", 0)),
            int(found.get("number", 0)),
            Irregularity(**found["irregularity"]) if "irregularity" in found else REGULAR,
        )


EXACT = Repeats()  # series in which every run has the same contact and every slip follows the equations


def _factors(variation: Variation, series: int, number: int) -> tuple[float, float]:
    own = np.random.default_rng([series, _OWN, number]).standard_normal(2)
    steps = np.random.default_rng([series, _SLOW]).standard_normal(number + 1)
    rho = math.exp(-1.0 / variation.drift_runs)
    steps[1:] *= math.sqrt(1.0 - rho * rho)
    slow = 0.0
    for step in steps.tolist():
        slow = rho * slow + step
    of_friction = variation.friction * own[0] + variation.drift * slow
    of_friction -= 0.5 * (variation.friction**2 + variation.drift**2)
    of_stiffness = variation.stiffness * own[1] - 0.5 * variation.stiffness**2
    return math.exp(of_friction), math.exp(of_stiffness)


def _times(value: Any, factor: float) -> Any:
    return tuple(one * factor for one in value) if isinstance(value, tuple) else value * factor
