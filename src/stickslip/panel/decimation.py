"""Reduction of curves to as many points as a screen can show.

Samples are grouped into buckets of successive samples. Only the minimum and maximum of each are drawn, so
that no peak is lost.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


def extremes(values: Float32, bucket: int) -> Float32:
    """Return minimum and maximum of each group of `bucket` successive samples.

    `values` has the shape [rows, n], one row for each channel; the result has [rows, 2 (n // bucket)].
    Samples after the last complete bucket are left out. The maximum comes first where the last sample of a
    bucket is below its first, so that a slope looks like a slope. A bucket of 1 returns the samples
    unchanged.
    """
    rows, count = values.shape[0], values.shape[1] // bucket
    if bucket == 1:
        return values
    shaped = values[:, : count * bucket].reshape(rows, count, bucket)
    return _paired(shaped.min(axis=2), shaped.max(axis=2), shaped[:, :, 0] > shaped[:, :, -1])


def window(time: NDArray[np.float64], values: Float32, points: int) -> tuple[NDArray[np.float64], Float32]:
    """Reduce curves to about `points` points each; return times [m] and values [rows, m].

    Curves with at most `points` samples are returned unchanged. The first and the last sample are kept,
    because users read the end value of a curve. The minimum and maximum of a bucket of samples are placed at
    the times of its first and last sample.

    Args:
        time: times of the samples [n]; their intervals may differ.
        values: samples of each channel [rows, n].
        points: wished number of points.
    """
    bucket = max(1, -(-2 * (time.size - 2) // max(points - 2, 2)))
    if bucket < 3:
        return time, values
    starts = np.arange(1, time.size - 2, bucket)  # a single remaining sample joins the previous bucket
    ends = np.append(starts[1:], time.size - 1)
    edges = np.stack([starts, ends - 1], axis=1)
    within = values[:, :-1]
    low, high = np.minimum.reduceat(within, starts, axis=1), np.maximum.reduceat(within, starts, axis=1)
    pairs = _paired(low, high, values[:, starts] > values[:, ends - 1])
    times = time[np.concatenate([[0], edges.ravel(), [time.size - 1]])]
    return times, np.concatenate([values[:, :1], pairs, values[:, -1:]], axis=1)


def _paired(low: Float32, high: Float32, falling: NDArray[np.bool_]) -> Float32:
    """Interleave the minimum `low` and maximum `high` of each bucket [rows, n] in drawing order [rows, 2 n].

    `falling` is True for buckets in which the values fall: their maximum comes first.
    """
    first, second = np.where(falling, high, low), np.where(falling, low, high)
    return np.stack([first, second], axis=2).reshape(low.shape[0], -1)
