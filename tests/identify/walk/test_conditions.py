"""One set of values for all conditions, or not; and which of them move."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import stickslip as ss
from stickslip.quantities.units import QuantityError

KANG = ss.load_actuator("kang2007").replace(stage_reaction=False)
DRIVE = ss.Sawtooth(65.0, 50.0, periods=4)
FREE = ("sigma_0", "coulomb_force")
OPTIONS = {"drive": DRIVE, "hops": 0, "channel": ()}


def walk(seed: int, celsius: float, softening: float):
    """A walk whose friction falls by a share of `softening` per degree above 20 degrees, with noise."""
    law = KANG.friction
    force = law.coulomb_force * (1.0 - softening * (celsius - 20.0))
    made = KANG.replace(friction=law._replace(coulomb_force=force, stiction_force=force))
    shown = ss.simulate(made, DRIVE, 0.1, sample_rate=5e3)[["end_effector_position", "drive_voltage"]]
    noise = 20e-9 * np.random.default_rng(seed).standard_normal(shown["time"].size)
    shown["end_effector_position"] += noise
    return shown.assign_attrs(title=f"walk {seed}", temperature=f"{celsius} °C")


def test_a_force_that_moves_is_found_and_named() -> None:
    walks = [walk(i, celsius, 5e-3) for i, celsius in enumerate((40.0, 20.0, 30.0, 20.0))]
    found = ss.identify.identify_conditions(walks, KANG, FREE, "temperature", **OPTIONS)
    assert found.at == pytest.approx((293.15, 303.15, 313.15))
    assert found.unit == "K"
    assert not found.one_set_explains_all
    assert found.moving["coulomb_force"] < 1e-6
    assert found.moving["sigma_0"] > 1e-3
    force = found.table["value"].sel(parameter="coulomb_force").values
    assert force / KANG.friction.coulomb_force == pytest.approx([1.0, 0.95, 0.9], rel=5e-3)
    low, high = (found.table[end].sel(parameter="coulomb_force").values for end in ("low", "high"))
    assert np.all(low < force)
    assert np.all(force < high)
    assert "no one set of values explains all temperature" in found.report()
    assert "coulomb_force moves" in found.statement


def test_where_nothing_moves_nothing_is_said_to() -> None:
    walks = []
    for i, volts in enumerate((55.0, 65.0, 75.0)):
        one = walk(i, 20.0, 0.0)
        walks.append(one.assign_attrs(variables=json.dumps({"voltage": f"{volts} V", "operator": "x"})))
    found = ss.identify.identify_conditions(walks, KANG, FREE, "voltage", **OPTIONS)
    assert (found.at, found.unit) == ((55.0, 65.0, 75.0), "V")
    assert found.chance > 0.01
    assert found.one_set_explains_all


def test_what_cannot_be_told_apart_is_refused() -> None:
    walks = [walk(i, 20.0, 0.0) for i in range(2)]
    with pytest.raises(ss.recording.RecordingError, match=r"temperature is 293\.1 K in all recordings"):
        ss.identify.identify_conditions(walks, KANG, FREE, "temperature", **OPTIONS)
    with pytest.raises(
        ss.recording.RecordingError, match=r"walk 0 does not say its 'temperatur' \(did you mean 'temp"
    ):
        ss.identify.identify_conditions(walks, KANG, FREE, "temperatur", **OPTIONS)
    wrong = [walks[0], walks[1].assign_attrs(temperature="3 V")]
    with pytest.raises(QuantityError, match="temperature of walk 1 = '3 V'"):
        ss.identify.identify_conditions(wrong, KANG, FREE, "temperature", **OPTIONS)


def test_a_file_asks_for_it(tmp_path: Path) -> None:
    recordings = []
    for i, celsius in enumerate((20.0, 40.0)):
        ss.save_recording(walk(i, celsius, 5e-3), tmp_path / f"w{i}.nc")
        drive = {"shape": "Sawtooth", "fields": {"amplitude": 65.0, "frequency": 50.0, "periods": 4}}
        recordings.append({"file": f"w{i}.nc", "drive": drive})
    content = {
        "kind": "walk",
        "title": "Warm",
        "model": "kang2007",
        "change": {"stage_reaction": False},
        "free": list(FREE),
        "hops": 0,
        "by": "temperature",
        "recordings": recordings,
    }
    (tmp_path / "walk.yaml").write_text(yaml.safe_dump(content), "utf-8")
    document = ss.run_job(tmp_path / "walk.yaml", tmp_path / "out")
    found = document.numbers["by_condition"]
    assert found["one_set_explains_all"] is False
    assert found["conditions"]["condition_2"]["temperature"].value == pytest.approx(313.15)
    assert "coulomb_force moves" in document.summary
    assert document.pictures()[-1].name == "conditions"
