"""The steps of an encoder are in the intervals: presliding within three counts says little of a stiffness."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss
from stickslip.friction import LuGre
from stickslip.identify.recorded.levels import converter_step

COUNT = 0.2e-6


def strokes(law: LuGre, seed: int, count: float):
    """A contact that yields over 0.4 um or so under strokes of 3 counts, seen by an encoder."""
    random = np.random.default_rng(seed)
    time = np.linspace(0.0, 2.0, 801)
    stroke = 1.5 * COUNT * random.uniform(0.9, 1.1)
    position = stroke * np.sin(2.0 * np.pi * time) + COUNT * random.uniform()
    force = ss.simulation.friction_response(law, time, position)["friction_force"].values
    force = force + 2e-3 * random.standard_normal(time.size)
    shown = np.round(position / count) * count if count else position
    return ss.make_recording(time, {"position": shown, "friction_force": force}, title="strokes")


def covered(count: float, n: int) -> tuple[int, list[float]]:
    inside, widths = 0, []
    law = LuGre(1.4e6, 0.0, 0.0, 0.54, 0.54)
    for seed in range(n):
        recording = strokes(law, seed, count)
        fit = ss.identify_loops(recording, law, ["sigma_0", "coulomb_force"])
        low, high = fit.confidence_intervals()["sigma_0"]
        inside += low < law.sigma_0 < high
        widths.append((high - low) / law.sigma_0)
    return inside, widths


def test_steps_are_in_the_intervals() -> None:
    inside, wide = covered(COUNT, 4)
    assert inside >= 3
    _, narrow = covered(0.0, 2)
    assert np.median(wide) > 5.0 * np.median(narrow)


def test_it_is_said() -> None:
    law = LuGre(1.4e6, 0.0, 0.0, 0.54, 0.54)
    fit = ss.identify_loops(strokes(law, 0, COUNT), law, ["sigma_0", "coulomb_force"])
    assert any("position stands at steps of 200 nm" in said for said in fit.remarks)
    smooth = ss.identify_loops(strokes(law, 0, 0.0), law, ["sigma_0", "coulomb_force"])
    assert not any("steps" in said for said in smooth.remarks)


def test_steps_are_seen_where_there_are_some() -> None:
    x = np.linspace(0.0, 1e-5, 1000)
    assert converter_step(np.round(x / 1e-7) * 1e-7) == pytest.approx(1e-7)
    assert converter_step(x) == 0.0
    assert converter_step(x + 1e-8 * np.random.default_rng(0).standard_normal(1000)) == 0.0
    fast = np.concatenate([np.zeros(100), np.cumsum(np.random.default_rng(1).integers(1, 6, 900))])
    assert converter_step(1e-7 * fast) == pytest.approx(1e-7), "most samples stand at levels of their own"
