"""A model is read from results.json with the units that stand there, and nothing of it is made up."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.export import ExportError, export_c
from stickslip.export.source import exported_values
from stickslip.friction import NormalForce
from stickslip.identify.results import (
    chain_numbers,
    chain_of,
    model_numbers,
    model_of,
    piezo_numbers,
    piezo_of,
)
from stickslip.jobs.analysis.file import AnalysisError
from stickslip.jobs.analysis.results import model_and_chain
from stickslip.physics.piezo import Creep, Piezo, PrandtlIshlinskii
from stickslip.quantities.units import QuantityError
from stickslip.recording.chain import Chain

PIEZO = Piezo(PrandtlIshlinskii((0.0, 20.0), (0.8, 0.2)), Creep((1.0,), (0.01,)))
MODEL = ss.load_actuator("kang2007").replace(piezo=PIEZO, normal_force=NormalForce(slope=2.0))
NUMBERS = model_numbers(MODEL)
CHAIN = Chain(1e-4, 2e-6, slew_rate=1e6, zeroed=True)


def changed(numbers: dict[str, Any], place: str, value: Any) -> dict[str, Any]:
    """A copy with another value in a place; None takes it away."""
    made = json.loads(json.dumps(numbers))
    *path, last = place.split("/")
    inner = made
    for part in path:
        inner = inner[part]
    if value is None:
        del inner[last]
    else:
        inner[last] = value
    return made


def test_what_is_written_is_read_again() -> None:
    for model in (MODEL, MODEL.replace(piezo=None, normal_force=None, max_voltage=100.0, clamped=True)):
        assert model_of(json.loads(json.dumps(model_numbers(model)))) == model
    assert piezo_of(json.loads(json.dumps(piezo_numbers(PIEZO)))) == PIEZO
    for chain in (CHAIN, Chain()):
        assert chain_of({"signal_chain": json.loads(json.dumps(chain_numbers(chain)))}) == chain
    assert chain_of({"parameters": {"delay": {"value": 0.2, "unit": "ms", "low": 0.1}}}) == Chain(2e-4)
    assert chain_of({}) == Chain()


@pytest.mark.parametrize(
    ("place", "value", "unit"),
    [
        ("friction/coulomb_force", 1e3 * MODEL.friction.coulomb_force, "mN"),
        ("actuator/end_effector_mass", 1e3 * MODEL.end_effector_mass, "g"),
        ("actuator/natural_frequency", MODEL.natural_frequency / 6.283185307179586, "Hz"),
        ("piezo/hysteresis/values/thresholds", [0.0, 20000.0], "mV"),
        ("normal_force/slope", 2e-3, "1/mm"),
    ],
)
def test_units_are_converted(place: str, value: Any, unit: str) -> None:
    found = exported_values(model_of(changed(NUMBERS, place, {"value": value, "unit": unit})))
    for name, expected in exported_values(MODEL).items():
        np.testing.assert_allclose(found[name], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ("friction/coulomb_force/unit", "V", r"friction: .*coulomb_force.* has the unit 'V', which is no N"),
        ("friction/coulomb_force/unit", None, r"friction: \[coulomb_force\] has no unit \(expected N\)"),
        ("piezo/creep/values/time_constants/unit", "V", r"piezo\.creep: .*which is no s"),
        ("actuator/stage_reaction", None, r"actuator: \[stage_reaction\] is missing"),
        ("actuator/clamped", "no", r"actuator: \[clamped\] 'no' must be true or false"),
        ("actuator/mass", 1.0, r"actuator: \[mass\] is unknown"),
        ("friction", [1], r"friction = \[1\] must hold fields"),
    ],
)
def test_what_is_wrong_names_file_field_and_unit(tmp_path: Path, place: str, value: Any, words: str) -> None:
    numbers = changed(NUMBERS, place, value)
    with pytest.raises(QuantityError, match=words):
        model_of(numbers)
    file = tmp_path / "results.json"
    file.write_text(json.dumps({"numbers": {"model": numbers}}))
    with pytest.raises(AnalysisError, match=rf"results\.json: .*{words}"):
        model_and_chain(file)
    with pytest.raises(ExportError, match=rf"results\.json: .*{words}"):
        export_c(str(file), tmp_path / "c")


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ("zeroed", 1, r"signal_chain: \[zeroed\] 1 must be true or false"),
        ("zeroed", None, r"signal_chain: \[zeroed\] is missing"),
        ("delay/value", float("nan"), r"signal_chain: .*delay"),
        ("delay/unit", "m", r"signal_chain: .*delay.* which is no s"),
    ],
)
def test_a_wrong_chain_is_refused(place: str, value: Any, words: str) -> None:
    with pytest.raises(QuantityError, match=words):
        chain_of({"signal_chain": changed(chain_numbers(CHAIN), place, value)})
