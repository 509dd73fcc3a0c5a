"""A term that the model lacks is named, and the advice, followed, gives the truth."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.identify.walk import terms

KANG = ss.load_actuator("kang2007").replace(stage_reaction=False)
DRIVE = ss.Sawtooth("65 V", "20 Hz", periods=8)
FREE = ["sigma_0", "sigma_1", "coulomb_force"]
START = KANG.replace(
    friction=KANG.friction._replace(sigma_0=1e6, sigma_1=30.0, coulomb_force=0.5, stiction_force=0.5)
)
NOISE = 10e-9


def contact(seed: int, **more: float) -> tuple[Any, np.random.Generator]:
    """Kang's actuator with another contact."""
    rng = np.random.default_rng(seed)
    force = 0.54 * rng.uniform(0.8, 1.25)
    law = KANG.friction._replace(
        sigma_0=1.4e6 * rng.uniform(0.7, 1.4),
        sigma_1=35.0 * rng.uniform(0.7, 1.4),
        coulomb_force=force,
        stiction_force=force * more.pop("ratio", 1.0),
    )
    return KANG.replace(friction=law._replace(**more)), rng


def recorded(model: Any, rng: np.random.Generator) -> Any:
    walk = ss.simulate(model, DRIVE, sample_rate="4 kHz", tolerance=1e-10)
    position = walk["end_effector_position"].values
    noise = NOISE * rng.standard_normal(position.size)
    return ss.make_recording(walk["time"].values, {"end_effector_position": (position + noise, "m")})


def missing(cause: str, seed: int) -> tuple[Any, Any]:
    """A model with a term that `START` lacks, and its walk."""
    model, rng = contact(
        seed,
        **{terms.VISCOUS: {"sigma_2": 9.0}, terms.STRIBECK: {"ratio": 1.3, "stribeck_velocity": 5e-3}}.get(
            cause, {}
        ),
    )
    force = model.friction.coulomb_force
    changes: dict[str, dict[str, Any]] = {
        terms.CONSTANT: {"external_force": 0.05 * force},
        terms.REACTION: {"stage_reaction": True},
    }  # NO_REACTION: this contact as it is; START then has the reaction
    model = model.replace(**changes.get(cause, {}))
    return model, recorded(model, rng)


@pytest.mark.parametrize(
    ("cause", "seed"),
    [
        (terms.VISCOUS, 1),
        (terms.STRIBECK, 2),
        (terms.CONSTANT, 4),
        (terms.REACTION, 6),
        (terms.NO_REACTION, 7),
    ],
)
def test_what_is_missing_is_named(cause: str, seed: int, tmp_path: Path) -> None:
    truth, recording = missing(cause, seed)
    start = START.replace(stage_reaction=cause == terms.NO_REACTION)
    fit = ss.identify_friction(recording, start, FREE, drive=DRIVE)
    advice = fit.advice
    assert fit.failures
    assert advice is not None
    assert advice.explains
    advice = next(one for one in (advice, *advice.equal) if one.cause == cause)
    assert fit.advice.sentence in fit.report() or any(fit.advice.sentence in one for one in fit.failures)
    ss.save_fit(fit, tmp_path / "fit.json")
    assert ss.load_fit(tmp_path / "fit.json").advice == fit.advice
    assert pickle.loads(pickle.dumps(advice)) == advice
    better = ss.identify_friction(
        recording, start.replace(**advice.change), [*advice.free], drive=DRIVE, bounds={**advice.bounds}
    )
    assert better.advice is None
    assert not better.failures
    assert better.rmse == pytest.approx(NOISE, rel=0.1)
    low, high = better.confidence_intervals(0.999)["coulomb_force"]
    assert low < truth.friction.coulomb_force < high


def test_a_right_model_gets_no_advice() -> None:
    model, rng = contact(1)
    fit = ss.identify_friction(recorded(model, rng), START, FREE, drive=DRIVE)
    assert fit.advice is None
    assert not fit.failures
