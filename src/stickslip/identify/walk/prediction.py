"""Prediction of a recorded position by a simulation with fitted or given values of the actuator."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from numpy.typing import NDArray

from ...estimate.parameter import Values
from ...physics.actuator import Actuator
from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, unit_for
from ...recording import RecordingError
from ...recording.chain import Chain
from ..recorded.channels import names_of, unit_of
from ..recorded.known_noise import SIMULATED
from .displacement import Displacement
from .position_channel import OBSERVED

if TYPE_CHECKING:
    import xarray as xr

# Error tolerance of simulations that are compared with a recording, m (rad): far below any noise.
TOLERANCE = SIMULATED


@record
class Predictor(NamedTuple):
    """A model that predicts recordings: the actuator `model`, and the `chain` of instruments (slew rate of
    the drive, delay and offset of the position); `tolerance` is the error tolerance of simulations, m
    (rad)."""

    model: Actuator
    chain: Chain = Chain()
    tolerance: Annotated[float, Quantity("m", "", "tolerance of the simulations", above=0.0)] = TOLERANCE

    observed = OBSERVED

    @classmethod
    def of(
        cls, model: Actuator, values: Values, slew_rate: float | None, tolerance: float = TOLERANCE
    ) -> Predictor:
        """Return the predictor of a model, with delay [s] and offset [m] of the channel from the fitted
        `values` by name (0 if absent), and the slew rate of recorded jumps, V/s (None: instantaneous)."""
        delay, offset = values.get("delay", 0.0), values.get("offset", 0.0)
        return cls(model, Chain(delay, offset, slew_rate=slew_rate or math.inf), tolerance)

    def predict(self, recording: xr.Dataset, drive: Any = None) -> NDArray:
        """Return the predicted position at the recording's samples, m (rad), shape (n,). `drive` is a
        waveform in the recording's time; None: the recording's own waveform or its channel drive_voltage.

        Raises:
            QuantityError: the recorded position is in m and the model moves in rad, or the other way round.
            RecordingError: the motion cannot be simulated, or the recording shows no drive.
        """
        name, chain = names_of([recording])[0], self.chain
        own, unit = unit_for(self.model, "m"), unit_of([recording], OBSERVED)
        if OBSERVED in recording and unit != own:
            raise QuantityError(
                f"{OBSERVED} of {name} is in {unit}, but the model moves in {own}: give an actuator with "
                f"rotary = {str(own == 'm').lower()}, or correct the unit of the recording"
            )
        try:
            motion = Displacement(recording, drive, name, self.model, self.tolerance, chain.known_slew_rate)
            return motion.position(self.model, chain.delay) + chain.offset
        except ArithmeticError as error:
            raise RecordingError(
                f"the model cannot predict {self.observed} [m] of {name}: {error}"
            ) from error
