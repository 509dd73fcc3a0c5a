"""Record of the signal chain (amplifier's slew rate, delay, scale and offset of the position channel) for
fits, predictions and files."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..physics.electronics.noise import delayed
from ..quantities.records import Quantity, record


@record
class Chain(NamedTuple):
    """Signal chain from the requested drive to the piezo, and from the end-effector to the position channel.

    The amplifier follows jumps at its `slew_rate` [V/s]. The channel contains the position delayed by `delay`
    [s], multiplied by `scale`, plus `offset` [m]. A fit can have delay and offset free; a prediction uses the
    estimates; the virtual rig (`Bench.with_chain`) and exported C apply them. If `zeroed` is True, the mean
    position before the drive starts is subtracted from the channel, and `offset` is the remaining offset.
    """

    delay: Annotated[float, Quantity("s", "t_d", "delay of the position channel")] = 0.0
    offset: Annotated[float, Quantity("m", "x_0", "offset of the position channel")] = 0.0
    scale: Annotated[float, Quantity("", "s", "recorded over true position", above=0)] = 1.0
    slew_rate: Annotated[float, Quantity("V/s", "", "of the amplifier", above=0, maximum=math.inf)] = math.inf
    zeroed: bool = False

    @property
    def unit(self) -> str:
        """Return the unit of the position channel, always "m"."""
        return "m"

    def sense(
        self, position: NDArray[np.float64], sample_rate: float, random: np.random.Generator | None = None
    ) -> NDArray[np.float64]:
        """Return the samples of the position channel, m, shape (n,): the true position [n], m, sampled at
        `sample_rate` [Hz], with the chain's delay, scale and offset.

        With this method a simulated rig can use the chain as a sensor without noise; `random` is not used.
        """
        del random
        return self.scale * delayed(position, sample_rate, self.delay) + self.offset

    @property
    def known_slew_rate(self) -> float | None:
        """Return the slew rate, V/s; None for an amplifier without a limit."""
        return self.slew_rate if math.isfinite(self.slew_rate) else None
