"""The chain between a plant and the samples of its position: one record for fits, predictions and files."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..physics.electronics.noise import delayed
from ..quantities.records import Quantity, record


@record
class Chain(NamedTuple):
    """From the drive that was asked for to the piezo, and from the end-effector to the position channel.

    The amplifier follows jumps at its slew rate; the channel shows the motion later by `delay`, `scale` times
    as large and moved by `offset`. A fit has these free; a prediction takes them as found; the virtual rig
    (`Bench.with_chain`) and exported C apply them. `zeroed`: the mean
    of the position before the drive begins is taken off, so that the offset is what is left.
    """

    delay: Annotated[float, Quantity("s", "t_d", "of the channel behind the drive")] = 0.0
    offset: Annotated[float, Quantity("m", "x_0", "of the channel")] = 0.0
    scale: Annotated[float, Quantity("", "s", "of the channel over the position", above=0)] = 1.0
    slew_rate: Annotated[float, Quantity("V/s", "", "of the amplifier", above=0, maximum=math.inf)] = math.inf
    zeroed: bool = False

    @property
    def unit(self) -> str:
        """Of what it shows."""
        return "m"

    def sense(
        self, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator | None = None
    ) -> NDArray[np.float64]:
        """What the channel shows [n], m, of the position [n], m, sampled at `sample_rate` Hz: so it can be
        mounted on a bench, as a sensor without noise."""
        del random
        return self.scale * delayed(position, sample_rate, self.delay) + self.offset

    @property
    def known_slew_rate(self) -> float | None:
        """V/s; None for an amplifier that follows at once."""
        return self.slew_rate if math.isfinite(self.slew_rate) else None
