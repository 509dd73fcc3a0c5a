"""Features of sawtooth walks without a model: steps, scatter, drift and vibration [kang2007, app. 8, 9]."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy
import xarray as xr
from numpy.typing import NDArray

from ..recorded.channels import channel, names_of, refuse_clipped, unit_of
from .mean_step import degrees_of_freedom, mean_step
from .slips import SlipEvents, slips_of
from .vibration import vibration_of

POSITION = "end_effector_position"
# Parts (start, end) of the slow motion through which lines are fitted for the position just before and just
# after a slip, in periods. BEFORE counts from one period before the slip, AFTER from the slip.
BEFORE, AFTER = (0.65, 0.97), (0.25, 0.6)
# Length of the motion after each slip for the spectrum, as a share of a period.
SPECTRUM = 0.25

Array = NDArray[np.float64]


def sawtooth_features(recording: xr.Dataset, *, smoothing: int = 1, observed: str = POSITION) -> xr.Dataset:
    """Return steps, scatter, drift, asymmetry and residual vibration of walks under a sawtooth.

    Everything comes from the data: the slips from the jumps of drive_voltage and the delay after them, or
    without that channel from the position alone. The position just before a slip (the peak) and after it is
    extrapolated to the slip by a line through part of the slow motion.

    Args:
        recording: with end_effector_position [m] (rad), and drive_voltage [V] if there is one.
        smoothing: number of samples of a running mean over the position; [kang2007] takes 3.
        observed: name of the position channel.

    Returns:
        Over "slip": `slip_time` [s], `walk_number` (from 0), `peak` and `valley` [m], `up_step` (previous
        `valley` to `peak`) and `down_step` (`peak` to `valley`), both [m], positive along the walk. The last
        four are NaN where the slow motion is too short, `up_step` also without a slip one period before.
        Over "walk": `direction` (1 forward, -1 backward), `n_slips`, `missing` (periods without a slip),
        `start` [s] of the first period, `bias` [m], the position before it, `period` [s]; and, NaN with fewer
        than two known peaks: `up` and `down` [m], a and b of [kang2007] (a - b is the mean difference of
        peaks, N a - (N-1) b the last peak relative to the bias; for a walk that starts with a jump, medians
        of up_step and down_step); `net_step` [m], the mean step of the process that made the walk; its
        standard error `net_step_error`, from noise of the positions and scatter of the steps; the degrees of
        freedom of Student's t for it, `net_step_freedom`; `scatter` [m] of the net steps, their `drift`
        [m per slip]; `jitter` [s] of the period. Up, down, net step and drift are positive along the walk,
        also backwards. Over "frequency" [Hz]: `spectrum` [m] of the
        motion after the slips. In `attrs`: period [s], delay [s], inverted, asymmetry (net step backward
        over forward, less one), and the mean vibration after the slips: vibration_amplitude [m] at
        `vibration_start` [s] after a slip, vibration_frequency [Hz] and vibration_decay [1/s]. They are
        NaN unless some part of the period shows three cycles of a decaying sine that explains the motion
        within its noise, or nine tenths of its variance. The decay is also NaN if it is uncertain, or if
        the vibration lasts until the next slip.

    Raises:
        RecordingError: the channel is missing, empty, constant, clipped, too short or too coarsely sampled,
            or no slips are found.
    """
    where = names_of([recording])[0]
    x = channel(recording, observed, where, varies=True)
    refuse_clipped(x, observed, where)
    u = channel(recording, "drive_voltage", where) if "drive_voltage" in recording else None
    t = recording["time"].values
    x = scipy.ndimage.uniform_filter1d(x, smoothing, mode="nearest") if smoothing > 1 else x
    slips = slips_of(t, x, u, where)
    steps = _steps(t, x, slips)
    walks = [_walk(t, x, slips, steps, w) for w in np.unique(slips.walk)]
    own = unit_of([recording], observed) or "m"
    frequency, spectrum = _spectrum(t, x, slips)
    over_walks = {name: [walk[name] for walk in walks] for name in WALK_UNITS}
    variables = {
        name: (over, values[name], {"units": own if unit == "m" else unit})
        for over, values, units in (("slip", steps, SLIP_UNITS), ("walk", over_walks, WALK_UNITS))
        for name, unit in units.items()
    }
    variables["spectrum"] = ("frequency", spectrum, {"units": own})
    found = xr.Dataset(variables, {"frequency": ("frequency", frequency, {"units": "Hz"})})
    found.attrs = {
        "period": slips.period,
        "delay": slips.delay,
        "inverted": int(slips.inverted),
        "asymmetry": _asymmetry(walks),
        **vibration_of(t, x, slips),
    }
    return found


# Units of the features over "slip" and over "walk" for a position in m; "" for plain numbers.
SLIP_UNITS = {
    "peak": "m",
    "valley": "m",
    "up_step": "m",
    "down_step": "m",
    "slip_time": "s",
    "walk_number": "",
}
WALK_UNITS = {
    "direction": "",
    "n_slips": "",
    "missing": "",
    "start": "s",
    "bias": "m",
    "up": "m",
    "down": "m",
    "net_step": "m",
    "net_step_error": "m",
    "net_step_freedom": "",
    "scatter": "m",
    "drift": "m",
    "period": "s",
    "jitter": "s",
}


def _line(t: Array, x: Array, first: float, last: float, at: float) -> float:
    """Return the value at time `at` [s] of the least-squares line through the samples x [n] between the times
    `first` and `last` [s]; NaN for fewer than three samples, or if `first` is before all samples. t are the
    ascending times of all samples, s, [n]."""
    i, j = np.searchsorted(t, (first, last))
    if j - i < 3 or first < t[0]:
        return math.nan
    apart = t[i:j] - t[i:j].mean()
    slope = float(apart @ x[i:j]) / float(apart @ apart)
    return float(x[i:j].mean() + slope * (at - t[i:j].mean()))


def _mean(t: Array, x: Array, first: float, last: float) -> float:
    i, j = np.searchsorted(t, (max(first, t[0]), last))
    return float(x[i:j].mean()) if j > i else math.nan


def _steps(t: Array, x: Array, slips: SlipEvents) -> dict[str, Any]:
    """Return the features of each slip by the names in `SLIP_UNITS`, shape (slips,), from times t [s],
    positions x [m] and the slips."""
    p = slips.period
    ends = np.append(slips.time[1:], t[-1])
    peak = np.array([_line(t, x, s - (1 - BEFORE[0]) * p, s - (1 - BEFORE[1]) * p, s) for s in slips.time])
    valley = np.array(
        [
            _line(t, x, s + AFTER[0] * p, min(s + AFTER[1] * p, end), s) if end - s > 0.5 * p else math.nan
            for s, end in zip(slips.time, ends, strict=True)
        ]
    )
    along = -slips.sign
    up = np.full(peak.size, math.nan)
    follows = (np.diff(slips.time) < 1.5 * p) & (np.diff(slips.walk) == 0)
    up[1:][follows] = (along[1:] * (peak[1:] - valley[:-1]))[follows]
    return {
        "slip_time": slips.time,
        "walk_number": slips.walk.astype(float),
        "peak": peak,
        "valley": valley,
        "up_step": up,
        "down_step": along * (peak - valley),
    }


def _walk(t: Array, x: Array, slips: SlipEvents, steps: dict[str, Array], number: int) -> dict[str, float]:
    """Return the features of walk `number`, by the names in `WALK_UNITS`, from times t [s], positions x [m],
    the slips, and the steps of `_steps`. Features that need two known peaks are NaN without them."""
    own = slips.walk == number
    time, peak, p = slips.time[own], steps["peak"][own], slips.period
    along = -float(slips.sign[own][0])
    places = np.concatenate([[0], np.cumsum(np.maximum(1, np.round(np.diff(time) / p)))])
    before = _mean(t, x, time[0] - 1.5 * p, time[0] - 1.05 * p)
    # A walk may start with a slow motion or with a jump. After a slow motion the first peak is above the
    # position before the walk.
    down = float(np.nanmedian(steps["down_step"][own]))
    slip_first = not along * (peak[0] - before) > 0.5 * down
    start = time[0] if slip_first else time[0] - p
    bias = _mean(t, x, start - 0.5 * p, start)
    known = np.isfinite(peak)
    found = {
        "direction": along,
        "n_slips": float(time.size),
        "missing": float(places[-1] + 1 - time.size),
        "start": float(start),
        "bias": bias,
        "period": float(np.median(np.diff(time) / np.diff(places))) if time.size > 1 else math.nan,
    }
    if np.count_nonzero(known) < 2:
        return found | dict.fromkeys(
            ("up", "down", "net_step", "net_step_error", "net_step_freedom", "scatter", "drift", "jitter"),
            math.nan,
        )
    d = along * (peak[known] - bias)
    # A period without a detected slip had no step, or a step whose slip was not detected: the distance
    # between the peaks shows how many steps there were.
    usual = float(np.median(np.diff(d)))
    moves = np.clip(np.round(np.diff(d) / (usual or 1.0)), 1, np.diff(places[known]))
    k = np.concatenate([[0.0], np.cumsum(moves)]) + np.flatnonzero(known)[0]
    n, steps_ = k[-1] + 1, np.diff(d) / moves
    net, error = mean_step(np.diff(d), moves)
    c1, c2 = float((d[-1] - d[0]) / (k[-1] - k[0])), float(d[-1])
    jitter = np.diff(time) - found["period"] * np.diff(places)
    return found | {
        "up": float(np.nanmedian(steps["up_step"][own])) if slip_first else c2 - (n - 1) * c1,
        "down": float(np.nanmedian(steps["down_step"][own])) if slip_first else c2 - n * c1,
        "net_step": net,
        "net_step_error": error,
        "net_step_freedom": float(degrees_of_freedom(steps_.size)),
        "scatter": float(steps_.std(ddof=1)) if steps_.size > 1 else math.nan,
        "drift": float(np.polyfit(np.arange(steps_.size), steps_, 1)[0]) if steps_.size > 2 else math.nan,
        "jitter": float(jitter.std()) if jitter.size > 1 else 0.0,
    }


def _asymmetry(walks: list[dict[str, float]]) -> float:
    forward = [w["net_step"] for w in walks if w["direction"] > 0]
    backward = [w["net_step"] for w in walks if w["direction"] < 0]
    if not forward or not backward:
        return math.nan
    return float(np.mean(backward) / np.mean(forward)) - 1.0


def _spectrum(t: Array, x: Array, slips: SlipEvents) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return frequencies [Hz] and amplitudes [m] of the mean motion (positive along the slip) in the first
    quarter of a period after the slips, less a line through the second half of this part. The amplitudes are
    NaN for fewer than two slips. x are the positions [m] at the ascending times t [s], [n]."""
    interval = float(np.median(np.diff(t)))
    count = max(8, int(SPECTRUM * slips.period / interval))
    pieces = []
    for s, sign in zip(slips.time, slips.sign, strict=True):
        i = int(np.searchsorted(t, s + 2.0 * interval))
        if i + count <= t.size:
            piece = sign * x[i : i + count]
            n = np.arange(count)
            pieces.append(piece - np.polyval(np.polyfit(n[count // 2 :], piece[count // 2 :], 1), n))
    frequency = np.fft.rfftfreq(count, interval)
    if len(pieces) < 2:
        return frequency, np.full(frequency.size, math.nan)
    return frequency, np.abs(np.fft.rfft(np.mean(pieces, axis=0))) * 2.0 / count
