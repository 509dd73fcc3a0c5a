"""Planning of experiments: the choice of the recordings that determine an actuator's parameters best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..estimate import Fit
from ..estimate.posterior import Posterior
from ..identify.walk.experiments import PlannedWalk
from ..physics.actuator import Actuator
from ..quantities.progress import Progress, unheard
from ..quantities.records import DURATION, SAMPLE_RATE, did_you_mean, whole
from ..quantities.units import QuantityError, unit_for, with_prefix
from ..recording.chain import Chain
from ..rig import Limits
from ..simulation.steady import steady_step
from ..simulation.steady_derivatives import steady_step_derivatives
from ..waveform import Sawtooth
from ..waveform.signal import Waveform
from .candidates import beyond, limits_of, refused, sawtooths, walks_of
from .choice import Over, PlanGoal, chosen, criterion, score
from .free_drives import FreeDrives, searched
from .information import Seen, covariance, seen, stacked
from .plan import Plan, of_choice
from .starting import Start, draws_of, start

if TYPE_CHECKING:
    import xarray as xr

# Amplitude [V] and frequency [Hz] of the sawtooth with which a plan is compared by default: the walk of
# [kang2007, 5.3].
USUAL = (65.0, 5.0)
ALL = "all"
# Smallest steady step, m, or rad for a rotary actuator, whose prediction can be the goal of a plan.
LEAST_STEP = 1e-9
# Largest expected standard error of a parameter on a logarithmic scale, relative to its value, if all
# candidates are recorded; a parameter with a larger error counts as undetermined.
LOST = 5.0
# Largest number of candidates that are also simulated at the draws.
MOST_FOLLOWED = 24
# Largest number of draws of the parameters at which a drive is optimised, besides the values of the model.
# More draws would take too long, because each tried drive is simulated at all of them.
MOST_SEARCHED = 3


def plan_experiment(
    model: Actuator | Fit,
    candidates: Mapping[str, PlannedWalk | Waveform]
    | Sequence[PlannedWalk | Waveform]
    | FreeDrives
    | None = None,
    *,
    free: Sequence[str] | None = None,
    goal: str | Waveform = ALL,
    recordings: int = 3,
    duration: float | str = 1.6,
    sample_rate: float | str | None = None,
    noise: float | str | xr.Dataset | None = None,
    limits: Limits | None = None,
    chain: Chain | None = None,
    channel: Sequence[str] = ("delay", "offset"),
    draws: int | Posterior | Mapping[str, Any] | None = None,
    over: Over = "worst",
    default: PlannedWalk | Waveform | None = None,
    seed: int = 0,
    progress: Progress = unheard,
) -> Plan:
    """Choose the most informative recordings for an actuator's parameters.

    The information of a recording is computed before it is made: the derivatives of its samples by all free
    parameters of `identify_friction` give the covariance of its fit (see `design.information`).

    Args:
        model: the actuator with its known values, or a fit by `identify_friction`, whose free
            parameters, delay, sample rate and noise are then the defaults.
        candidates: recordings to choose from, waveforms or `identify.PlannedWalk`, by name or in a list. By
            default a grid of sawtooths in bursts to and fro, over voltage, frequency and rise, within the
            limits; `design.FreeDrives()`: that grid, and an optimised drive.
        free: parameters to determine, as for `identify_friction`, including the stage's "natural_frequency",
            "damping_ratio" and "gain".
        goal: "all" (the product of the standard errors, including correlations: D-optimal), the name of one
            parameter, or a periodic waveform, whose steady step is to be predicted best.
        recordings: number of recordings; a candidate may be taken more than once.
        duration, sample_rate: duration, s, and sample rate, Hz, of candidates that do not give them; by
            default the sample rate of the fit or of the recorded noise, otherwise 2 kHz.
        noise: standard deviation of a sample, m, white; or a recording of end_effector_position at rest,
            whose noise, with its spectrum and drift, applies to all candidates. By default: the noise of the
            fit.
        limits: limits of voltage, slew rate, duty and position. By default: `Limits()` with the actuator's
            finite voltages.
        chain: chain of the position channel: delay, scale, slew rate of the amplifier (the steepest flank of
            the grid), and whether each recording is `zeroed` by the 0.1 s before it, with its own
            error. By default: a chain with the delay of the fit.
        channel: free parameters of the channel.
        draws: other possible values of the parameters, because a plan at given values is only valid near
            them: a number of draws from the fit's normal distribution (by default 8 for a fit, none for an
            actuator), a `posterior`, or arrays by name, of which up to 32 sets are taken.
        over: "worst": the plan is optimal for the worst draw; "mean": on average.
        default: recording with which the plan is compared at equal time; by default, the sawtooth of 65 V (or
            what the limits allow) at 5 Hz.
        seed: seed of the draws.
        progress: called for each simulated recording, with activity and finished fraction.

    Returns:
        A plan: the recordings, and the expected half-width of the 95 % interval of each parameter.
        Half-widths are linearised: a half-width of half a value only says that the interval is wide. The
        lags of filter and sensor count as a delay, as in the fit; further smoothing by them is a bias that
        is not included. Neither is the uncertainty of a stage that is taken as known.

    Raises:
        QuantityError: an unknown name, no candidates, none within the limits, a goal that no candidate
            determines (with "all", such parameters are left out and reported), or draws of another model.
    """
    limits = limits or limits_of(model)
    duration = DURATION.check(duration, "duration")
    sample_rate = None if sample_rate is None else SAMPLE_RATE.check(sample_rate, "sample_rate")
    recordings = whole(recordings, "recordings", 1, 1000)
    if over not in ("worst", "mean"):
        raise QuantityError(f"over = {over!r} is out of range: it must be 'worst' or 'mean'")
    begin = start(model, free, channel, chain, sample_rate, noise)
    starts = draws_of(begin, model, draws, seed)
    wanted = _goal(goal, starts)
    named = _named(candidates, begin, limits, duration)
    found, left_out = _simulated(named, starts, wanted, limits, progress)
    if found and isinstance(candidates, FreeDrives):
        _search(candidates, named, found, starts, wanted, limits, over, seed, progress)
    if not found:
        raise QuantityError(
            "no candidate can be taken: "
            + "; ".join(f"{name}: {why}" for name, why in list(left_out.items())[:3])
            + (f"; and {len(left_out) - 3} more" if len(left_out) > 3 else "")
        )
    names = list(found)
    every = stacked([found[name] for name in names], axis=1)
    wanted = _without_unseen(every, wanted, begin)
    taken = chosen(every, wanted, over, int(recordings))
    usual = _usual(default, begin, limits, duration, every, taken)
    compared = stacked(
        [seen(one.model, usual, "default", one.space, one.chain, one.colour) for one in starts]
    )
    progress("planning the experiment", 1.0)
    walks = {name: named[name] for name in names}
    return of_choice(begin, walks, every, taken, compared, wanted, limits, left_out)


def _goal(goal: str | Waveform, starts: Sequence[Start]) -> PlanGoal:
    space, free = starts[0].space, starts[0].free
    if isinstance(goal, str):
        if goal == ALL:
            return PlanGoal(ALL, space.own, None)
        if goal not in free:
            raise QuantityError(
                f"goal = {goal!r} is not free{did_you_mean(goal, [ALL, *free])}: it may be {ALL!r}, a "
                f"waveform, {', '.join(free)}"
            )
        one = np.array([float(name == goal) for name in space.names])
        return PlanGoal(goal, space.own, np.tile(one, (len(starts), 1)))
    if not hasattr(goal, "drive"):
        raise QuantityError(f"goal = {goal!r:.60} must be {ALL!r}, the name of a parameter, or a waveform")
    rows = [_of_step(one, goal) for one in starts]
    return PlanGoal(f"steady step of {goal!r}", space.own, np.array(rows))


def _of_step(at: Start, waveform: Waveform) -> np.ndarray:
    """Return the derivatives of ln(steady step) by the k coordinates of the fit (logarithms for parameters on
    a logarithmic scale), shape (k,); 0 for delay and offset of the position channel.

    Args:
        at: starting point with one set of parameter values (the model's, or a draw).
        waveform: periodic drive that makes the step.

    Raises:
        QuantityError: the steady step is below `LEAST_STEP`.
    """
    own = [name for name in at.space.ties.varying if name in at.free or name not in ("delay", "offset")]
    step = steady_step(at.model, waveform)
    if abs(step) < LEAST_STEP:
        raise QuantityError("goal: this waveform has no net step, so there is nothing to predict")
    by = steady_step_derivatives(at.model, waveform, parameters=own)
    columns = {name: np.array([value]) for name, value in by.items()}
    columns |= {name: np.zeros(1) for name in ("delay", "offset")}
    values = at.space.ties({p.name: p.start for p in at.space.parameters})
    slopes = [p.slope(p.start) for p in at.space.parameters]
    return at.space.ties.follow(columns, values, at.space.names)[0] * slopes / step


def _named(candidates: Any, begin: Start, limits: Limits, duration: float) -> dict[str, PlannedWalk]:
    how = (duration, begin.sample_rate, begin.noise)
    if candidates is None or isinstance(candidates, FreeDrives):
        found = sawtooths(limits, min(begin.chain.slew_rate, limits.max_slew), *how)
        if not found:
            raise QuantityError(
                f"no sawtooth fits: in {with_prefix(duration, 's', 3)} up to {limits.max_voltage:g} V none "
                "of the usual grid has a burst there and back; give candidates"
            )
        return found
    found = walks_of(candidates, *how)
    if begin.colour is not None:
        for name, walk in found.items():
            if abs(walk.sample_rate / begin.sample_rate - 1.0) > 1e-3:
                raise QuantityError(
                    f"candidate {name!r} is sampled at {walk.sample_rate:g} Hz, and the noise is known at "
                    f"{begin.sample_rate:g} Hz"
                )
    return found


def _simulated(
    named: Mapping[str, PlannedWalk],
    starts: Sequence[Start],
    goal: PlanGoal,
    limits: Limits,
    progress: Progress,
) -> tuple[dict[str, Seen], dict[str, str]]:
    """Simulate candidates; return the information of each by name, arrays [draws, ...], and the reasons why
    others are excluded, by name.

    If there are more than `MOST_FOLLOWED` candidates, only those that are most informative at the values of
    the model are simulated at the draws, because of the computing time.

    Args:
        named: planned recordings by name.
        starts: starting points: with the model's own values first, then with each draw.
        goal: goal of the plan.
        limits: limits of the rig, which the recordings must keep.
        progress: called for each simulated recording.
    """
    found: dict[str, Seen] = {}
    left_out: dict[str, str] = {}
    first, share = starts[:1], 1.0 / len(starts)
    for i, (name, walk) in enumerate(named.items()):
        progress(f"planning: {name}", share * i / len(named))
        why = refused(walk, limits, name)
        if why:
            left_out[name] = why
        else:
            _follow(name, walk, first, limits, found, left_out)
    if len(starts) == 1:
        return found, left_out
    kept = _foremost(found, goal)
    over_draws: dict[str, Seen] = {}
    for i, name in enumerate(kept):
        progress(f"planning: {name}", share + (1.0 - share) * i / len(kept))
        _follow(name, named[name], starts, limits, over_draws, left_out)
    beside = f"not among the {MOST_FOLLOWED} that tell most at the values of the model"
    left_out |= {name: beside for name in found if name not in kept}
    return over_draws, left_out


def _follow(
    name: str,
    walk: PlannedWalk,
    starts: Sequence[Start],
    limits: Limits,
    found: dict[str, Seen],
    left_out: dict[str, str],
) -> None:
    """Simulate a candidate; add its information to `found`, or the reason for its exclusion to `left_out`.

    A candidate is excluded if it cannot be simulated, or if it leaves the position limits. Both mappings have
    the candidate's `name` as key; the information has arrays [draws, ...], one for each of `starts`.
    """
    try:
        of = stacked([seen(one.model, walk, name, one.space, one.chain, one.colour) for one in starts])
    except (ArithmeticError, QuantityError) as error:
        left_out[name] = str(error)
        return
    why = beyond(float(of.low.min()), float(of.high.max()), limits, unit_for(starts[0].model, "m"))
    if why:
        left_out[name] = why
    else:
        found[name] = of


def _search(
    asked: FreeDrives,
    named: dict[str, PlannedWalk],
    found: dict[str, Seen],
    starts: Sequence[Start],
    goal: PlanGoal,
    limits: Limits,
    over: Over,
    seed: int,
    progress: Progress,
) -> None:
    """Optimise a drive, starting from the best candidate, and add its recording as a further candidate.

    The recording is added to `named` under the name "free drive" with its frequency. Its information is added
    to `found`, unless the recording cannot be simulated or leaves the position limits. `asked` are the
    options of the search, other arguments as for `_simulated` and `choice.chosen`.

    Raises:
        QuantityError: the drive of the best candidate does not start with a sawtooth.
    """
    name = min(found, key=lambda one: float(score(found[one], goal, "mean")))
    some = starts[: 1 + MOST_SEARCHED]
    wanted = goal if goal.gradients is None else goal._replace(gradients=goal.gradients[: len(some)])

    def told(walk: PlannedWalk) -> float:
        of: dict[str, Seen] = {}
        if not refused(walk, limits, "free drive"):
            _follow("free drive", walk, some, limits, of, {})
        return float(score(of["free drive"], wanted, over)) if of else np.nan

    slew_rate = starts[0].chain.slew_rate
    walk = searched(asked, named[name], limits, slew_rate, told, seed, progress)
    drive: Any = walk.drive
    called = f"free drive {1.0 / drive.parts[0][0].period:.4g} Hz"
    _follow(called, walk, starts, limits, found, {})
    named[called] = walk


def _foremost(found: Mapping[str, Seen], goal: PlanGoal) -> list[str]:
    """Return the names of the most informative candidates, at most `MOST_FOLLOWED`: half of them for the
    goal, the others for each parameter of the actuator in turn. `found` is the information of candidates by
    name."""
    names = list(found)
    if len(names) <= MOST_FOLLOWED:
        return names
    every = stacked([found[name] for name in names], axis=1)
    one = goal if goal.gradients is None else goal._replace(gradients=goal.gradients[:1])
    orders = [np.argsort(score(every, one, "mean"), kind="stable").tolist()]
    for place in np.flatnonzero(goal.own):
        unit = np.eye(goal.own.size)[[place]]
        orders.append(np.argsort(score(every, goal._replace(gradients=unit), "mean"), kind="stable").tolist())
    kept = dict.fromkeys(orders[0][: MOST_FOLLOWED // 2])
    for ranked in zip(*orders[1:], strict=True):
        kept |= dict.fromkeys(ranked)
        if len(kept) >= MOST_FOLLOWED:
            break
    return [names[i] for i in sorted(list(kept)[:MOST_FOLLOWED])]


def _without_unseen(every: Seen, goal: PlanGoal, begin: Start) -> PlanGoal:
    """Return the goal without parameters that all candidates together do not identify (see `LOST`).

    Args:
        every: information of all candidates, arrays [draws, candidates, ...].
        goal: goal of the plan.
        begin: starting point with the parameters of the fit.

    Raises:
        QuantityError: no parameter remains, or the goal is a single quantity that is not identified.
    """
    total = Seen(*(one.sum(axis=1) for one in every))
    deviations = np.sqrt(np.diagonal(covariance(total), axis1=-2, axis2=-1)).max(axis=0)
    most = [LOST if p.log else np.finfo(float).max for p in begin.space.parameters]
    lost = goal.own & (deviations > most)
    kept = goal._replace(own=goal.own & ~lost)
    names = [name for name, gone in zip(begin.space.names, lost, strict=True) if gone]
    if goal.name not in names and kept.own.any() and np.all(np.isfinite(criterion(total, kept))):
        return kept
    what = " and ".join(names) if goal.gradients is None else goal.name
    raise QuantityError(
        f"{what} cannot be determined: no candidate tells it, nor do all of them together; leave that out of "
        "free, or give candidates that tell more"
    )


def _usual(
    default: PlannedWalk | Waveform | None,
    begin: Start,
    limits: Limits,
    duration: float,
    every: Seen,
    taken: Sequence[int],
) -> PlannedWalk:
    """Return the recording with which a plan is compared: `default`, or `USUAL` up to the voltage limits.

    A waveform is recorded for `duration` [s], or for as long as the longest chosen candidate if that is
    longer; the sawtooth `USUAL` for at least two of its periods.

    Args:
        default: recording or waveform; None: the sawtooth `USUAL`.
        begin: starting point of the plan, with sample rate, noise and model.
        limits: limits of the voltage.
        duration: least duration, s.
        every: information of the candidates, arrays [draws, candidates, ...].
        taken: indices of the chosen candidates.
    """
    if isinstance(default, PlannedWalk):
        return default
    longest = max(duration, float(np.max(every.duration[0, list(taken)])))
    if default is not None:
        return PlannedWalk(default, longest, begin.sample_rate, begin.noise)
    drive = Sawtooth(min(USUAL[0], limits.max_voltage, begin.model.max_voltage), USUAL[1])
    return PlannedWalk(drive, max(longest, 2.0 / USUAL[1]), begin.sample_rate, begin.noise)
