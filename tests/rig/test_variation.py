"""How the contact of a virtual rig differs from run to run: its statistics, that it can be repeated, and
that recordings say it."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from stickslip.friction import LAWS
from stickslip.identify.comparison.laws import example_laws
from stickslip.panel.document import DEFAULT as EXPERIMENT
from stickslip.quantities.input_file import load_yaml
from stickslip.quantities.units import QuantityError
from stickslip.rig import (
    Capture,
    HostedRig,
    Limits,
    Link,
    Repeats,
    Variation,
    VirtualRig,
    WatchedRig,
    measure,
)
from stickslip.rig.description import virtual_device
from stickslip.waveform.periodic import Sawtooth

from datasets import DATASETS  # isort: skip
from plants import law_at, states_of  # isort: skip
from rig.laboratory import ACTUATOR, BENCH, CHANNELS, IDEAL  # isort: skip

TRIBOMETER = DATASETS / "jchristopherson-friction" / "test_data_2.txt"
SOME = Variation(friction=0.004, drift=0.012, drift_runs=15, stiffness=0.02)
DRIVE, CAPTURE = Sawtooth(65.0, 20.0), Capture(0.3, 1e-3, 0.02)
EXAMPLES = example_laws(ACTUATOR.friction)


def logarithms(repeats: Repeats, runs: int) -> np.ndarray:
    """Of the factors of friction and stiffness [2, runs]."""
    return np.log([repeats.factors(run) for run in range(runs)]).T


def test_runs_scatter_as_they_were_told_to() -> None:
    """Standard deviations, correlation from run to run, and a mean factor of 1. Limits are five standard
    errors: of a deviation its value by sqrt(2 n), or of as many independent values as the drift has."""
    runs = 3000
    found = logarithms(Repeats(SOME, 4), runs)
    deviations = np.hypot(SOME.friction, SOME.drift), SOME.stiffness
    independent = runs / (2 * SOME.drift_runs), runs
    for one, deviation, count in zip(found, deviations, independent, strict=True):
        assert np.exp(one).mean() == pytest.approx(1.0, abs=5 * deviation / np.sqrt(count))
        assert one.std() == pytest.approx(deviation, abs=5 * deviation / np.sqrt(2 * count))
    # A step from run to run holds twice the variance of what scatters, and of the drift what is forgotten.
    forgotten = 1.0 - np.exp(-1.0 / SOME.drift_runs)
    step = np.sqrt(2 * SOME.friction**2 + 2 * SOME.drift**2 * forgotten)
    assert np.diff(found[0]).std() == pytest.approx(step, rel=5 / np.sqrt(runs))
    assert abs(np.corrcoef(found[1][1:], found[1][:-1])[0, 1]) < 5 / np.sqrt(runs)
    assert abs(np.corrcoef(found)[0, 1]) < 5 / np.sqrt(independent[0])


def test_scatter_alone_is_independent_and_drift_alone_is_slow() -> None:
    scatter, drift = (
        logarithms(Repeats(Variation(**{name: 0.02}), 9), 1000)[0] for name in ("friction", "drift")
    )
    assert abs(np.corrcoef(scatter[1:], scatter[:-1])[0, 1]) < 5 / np.sqrt(1000)
    assert np.corrcoef(drift[1:], drift[:-1])[0, 1] == pytest.approx(np.exp(-1 / 15), abs=0.03)


def test_any_run_can_be_drawn_by_itself_again_to_the_last_bit() -> None:
    whole = logarithms(Repeats(SOME, 4), 40)
    for number in (0, 1, 17, 39):
        np.testing.assert_array_equal(np.log(Repeats(SOME, 4, number).factors()), whole[:, number])
    assert np.all(logarithms(Repeats(SOME, 5), 40) != whole)


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_law_has_its_forces_and_stiffness_scaled(name: str) -> None:
    """At rest, with bristles bent as much more as force is above stiffness: the force by its factor."""
    law = EXAMPLES[name]
    assert type(law) in LAWS
    repeats = Repeats(Variation(friction=0.1, stiffness=0.2), 1)
    friction, stiffness = repeats.factors()
    varied = repeats.actuator(ACTUATOR.replace(friction=law)).friction
    if not {"sigma_0", "stiffness"} & {*law._fields}:
        slides = (one._replace(sigma_2=0.0) if "sigma_2" in one._fields else one for one in (law, varied))
        forces = [law_at(one, 1.0, np.ones(1))[0] for one in slides]
    else:
        bent = np.full(states_of(law), 0.1e-6)
        forces = [law_at(law, 0.0, bent)[0], law_at(varied, 0.0, bent * friction / stiffness)[0]]
    assert forces[1] == pytest.approx(friction * forces[0], rel=1e-12)
    assert abs(forces[0]) > 1e-3


def test_a_run_is_that_of_the_contact_that_its_recording_tells() -> None:
    rig = VirtualRig(ACTUATOR, BENCH, seed=3, repeats=Repeats(SOME, 8, 5))
    for number in (5, 6):
        seen = measure(rig, DRIVE, IDEAL, CAPTURE, Limits())
        told = json.loads(seen.attrs["contact"])
        assert (told.pop("number"), told.pop("friction"), told.pop("stiffness")) == (
            number,
            *Repeats(SOME, 8, number).factors(),
        )
        assert told.keys() == {"sigma_0", "coulomb_force", "stiction_force"}
        actuator = ACTUATOR.replace(friction=ACTUATOR.friction._replace(**told))
        plain = measure(VirtualRig(actuator, BENCH, seed=3), DRIVE, IDEAL, CAPTURE, Limits())
        assert "contact" not in plain.attrs
        for name in IDEAL:
            np.testing.assert_array_equal(seen[name], plain[name])


def test_nothing_varies_unless_it_is_asked_for() -> None:
    plain = measure(VirtualRig(ACTUATOR, BENCH, seed=3), DRIVE, CHANNELS, CAPTURE, Limits())
    zero = VirtualRig(ACTUATOR, BENCH, seed=3, repeats=Repeats(Variation(drift_runs=3), 8, 5))
    still = measure(zero, DRIVE, CHANNELS, CAPTURE, Limits())
    for name in CHANNELS:
        np.testing.assert_array_equal(plain[name], still[name])
    assert {**plain.attrs, "created": ""} == {**still.attrs, "created": ""}
    clamped = VirtualRig(ACTUATOR.replace(clamped=True), BENCH, repeats=Repeats(SOME))
    assert clamped.told(1) == {}


def test_in_a_process_of_its_own_it_is_the_same_and_averages_tell_all_of_their_runs(tmp_path: Path) -> None:
    capture, repeats = CAPTURE._replace(average=2), Repeats(SOME, 8, 5)
    near = measure(VirtualRig(ACTUATOR, BENCH, seed=3, repeats=repeats), DRIVE, CHANNELS, capture, Limits())
    link = Link(tmp_path / "rig", "a test")
    try:
        hosted = HostedRig(link, virtual_device(ACTUATOR, "kang2007-bench", 3, False, repeats))
        watched = WatchedRig(hosted, CHANNELS, lambda *_: None, lambda _: None, lambda: None)
        far = measure(watched, DRIVE, CHANNELS, capture, Limits())
    finally:
        link.close()
    for name in CHANNELS:
        np.testing.assert_array_equal(far[name], near[name])
    assert far.attrs["contact"] == near.attrs["contact"]
    assert [one["number"] for one in json.loads(far.attrs["contact"])] == [5, 6]


def test_what_is_no_deviation_is_refused() -> None:
    with pytest.raises(QuantityError, match="friction = '50 %' is out of range: scatter of friction must be"):
        Variation(friction="50 %")  # type: ignore[arg-type]
    with pytest.raises(QuantityError, match="drift_runs"):
        Variation(drift_runs=0)


def strokes() -> tuple[np.ndarray, np.ndarray]:
    """Of a reciprocating tribometer [christopherson2021], stroke by stroke: the friction coefficient where it
    slides, and the slope of the force over the first 20 um, N/m; [direction, stroke], without the running-in
    of the first four."""
    time, normal, position, friction = np.loadtxt(TRIBOMETER, skiprows=1).T
    speed = np.convolve(np.gradient(position, time), np.ones(11) / 11, "same")
    moves = np.sign(speed) * (np.abs(speed) > 0.5 * np.percentile(np.abs(speed), 95))
    turns = np.flatnonzero(np.diff(moves)) + 1
    found: dict[float, list[tuple[float, float]]] = {1.0: [], -1.0: []}
    for begin, end in itertools.pairwise(turns):
        if not moves[begin] or end - begin < 20:
            continue
        x, force, load = (one[begin:end] for one in (position, -friction * 1e-6, normal * 1e-6))
        slides, first = slice(int(0.6 * x.size), int(0.95 * x.size)), np.abs(x - x[0]) < 0.02
        slope = np.polyfit(1e-3 * x[first], force[first], 1)[0]
        found[moves[begin]].append((abs(float((force / load)[slides].mean())), float(slope)))
    both = np.array([found[1.0][5:50], found[-1.0][4:49]])
    return both[..., 0], both[..., 1]


def test_the_bench_varies_as_strokes_of_a_tribometer_do() -> None:
    """From one stroke to the next, and to one far away, by the root of half the mean squared difference: the
    model lies within those of the two directions, or a fifth away."""
    spec = load_yaml(EXPERIMENT)["rig"]["variation"]
    variation = Variation(**spec)
    assert variation == SOME

    def apart(values: np.ndarray, strokes: int) -> np.ndarray:
        relative = values / values.mean(axis=1, keepdims=True)
        return np.sqrt(0.5 * np.mean((relative[:, strokes:] - relative[:, :-strokes]) ** 2, axis=1))

    level, slope = strokes()
    for count in (1, 2, 5, 10, 20):
        forgotten = 1.0 - np.exp(-count / variation.drift_runs)
        model = np.hypot(variation.friction, variation.drift * np.sqrt(forgotten))
        low, high = np.sort(apart(level, count))
        assert 0.8 * low < model < 1.2 * high, (count, low, model, high)
        low, high = np.sort(apart(slope, count))
        assert 0.8 * low < variation.stiffness < 1.2 * high, (count, low, high)
