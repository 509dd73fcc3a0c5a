"""Drive and load as a step needs them: at its nodes, each with its first derivatives by time."""

from __future__ import annotations

import math

from .._jit import fused
from .rodas5p import NODES

# The middle of the step, for the defect of the continuous extension.
C1, C2, C3, C4, C5, MIDDLE = *NODES[1:], 0.5


@fused
def _polynomial(drive, i, tau):
    c0, c1, c2, c3 = (
        drive.polynomial[i, 0],
        drive.polynomial[i, 1],
        drive.polynomial[i, 2],
        drive.polynomial[i, 3],
    )
    return (
        c0 + tau * (c1 + tau * (c2 + tau * c3)),
        c1 + tau * (2.0 * c2 + tau * 3.0 * c3),
        2.0 * c2 + 6.0 * c3 * tau,
        6.0 * c3,
    )


@fused
def at(drive, i, t):
    """u, du/dt, d²u/dt² and d³u/dt³ at time t, by the formula of segment i."""
    tau = t - drive.start[i]
    u, du, ddu, dddu = _polynomial(drive, i, tau)
    for row in range(drive.first[i], drive.first[i + 1]):
        amplitude, chirp = drive.harmonic[row, 0], drive.harmonic[row, 3]
        rate = drive.harmonic[row, 1] + 2.0 * chirp * tau
        angle = drive.harmonic[row, 2] + tau * (drive.harmonic[row, 1] + chirp * tau)
        sine, cosine = amplitude * math.sin(angle), amplitude * math.cos(angle)
        u += sine
        du += rate * cosine
        ddu += 2.0 * chirp * cosine - rate * rate * sine
        dddu -= rate * (6.0 * chirp * sine + rate * rate * cosine)
    return u, du, ddu, dddu


@fused
def at_nodes(drive, i, t, h):
    """As `at`, at the six distinct nodes of a step and in its middle. What a plant does not use, the
    compiler drops."""
    tau = t - drive.start[i]
    if drive.first[i] == drive.first[i + 1]:
        return (
            _polynomial(drive, i, tau),
            _polynomial(drive, i, tau + C1 * h),
            _polynomial(drive, i, tau + C2 * h),
            _polynomial(drive, i, tau + C3 * h),
            _polynomial(drive, i, tau + C4 * h),
            _polynomial(drive, i, tau + C5 * h),
            _polynomial(drive, i, tau + MIDDLE * h),
        )
    return (
        at(drive, i, t),
        at(drive, i, t + C1 * h),
        at(drive, i, t + C2 * h),
        at(drive, i, t + C3 * h),
        at(drive, i, t + C4 * h),
        at(drive, i, t + C5 * h),
        at(drive, i, t + MIDDLE * h),
    )


@fused
def segment_of(drive, t):
    """The segment that holds time t; at a break point, the later one."""
    low, high = 0, drive.start.size
    while high - low > 1:
        middle = (low + high) // 2
        if drive.start[middle] <= t:
            low = middle
        else:
            high = middle
    return low


@fused
def next_break(drive, i, t_end):
    """Where segment i ends, at most t_end."""
    return min(t_end, drive.start[i + 1]) if i + 1 < drive.start.size else t_end
