"""Noise of a channel, and the variance of its drift from sample to sample, from a recording at rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...estimate.coloured import Coloured, coloured
from ...quantities.units import QuantityError

if TYPE_CHECKING:
    import xarray as xr

FEWEST = 100  # fewest samples of a recording at rest that shows the noise of a channel
# Largest relative difference of sampling intervals at which two recordings have the same sample rate.
SAME_RATE = 1e-3


class AtRest(NamedTuple):
    """Noise of a channel at rest: `level`, its standard deviation, in the unit of the channel; `colour`, its
    autocovariance and drift; and `rate`, the sample rate [Hz] of the recording."""

    level: float
    colour: Coloured
    rate: float

    def check(self, rate: float, what: str) -> None:
        """Raise QuantityError unless another recording has the sample rate of this noise.

        Args:
            rate: sample rate of the other recording, Hz.
            what: subject and verb for the message, such as "the walk has".
        """
        if abs(rate / self.rate - 1.0) > SAME_RATE:
            raise QuantityError(
                f"noise: the recording at rest has {self.rate:.6g} Hz, and {what} {rate:.6g} Hz, but its "
                "noise is that of its rate"
            )


def noise_at_rest(recording: xr.Dataset, channel: str) -> AtRest:
    """Return the noise of the named channel from a recording at rest.

    Raises:
        QuantityError: the channel is missing, has fewer than 100 samples, is not finite, or is constant.
    """
    if channel not in recording or recording.sizes.get("time", 0) < FEWEST:
        raise QuantityError(f"noise: a recording at rest has at least {FEWEST} samples of {channel}")
    values, time = np.asarray(recording[channel].values, dtype=float), recording["time"].values
    if not np.all(np.isfinite(values)):
        raise QuantityError(f"noise: {channel} of the recording at rest is not finite everywhere")
    level = float(np.std(values))
    if not level > 0.0:
        raise QuantityError("noise: the recording at rest shows none, all its samples are the same")
    return AtRest(level, coloured([values], walks=True), (time.size - 1) / float(time[-1] - time[0]))


def drift_at_rest(recording: xr.Dataset, channel: str, others: Sequence[xr.Dataset]) -> float:
    """Return the variance that a drift (random walk) adds from sample to sample, in the squared unit of the
    channel; 0 if the recording at rest shows no drift.

    Args:
        recording: recording at rest.
        channel: name of the channel.
        others: recordings to which the drift is applied; they must have the sample rate of `recording`.

    Raises:
        QuantityError: see `noise_at_rest`; or the sample rates differ.
    """
    rest = noise_at_rest(recording, channel)
    for other in others:
        time = other["time"].values
        rest.check((time.size - 1) / float(time[-1] - time[0]), "another has")
    return rest.colour.walk
