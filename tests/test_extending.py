"""The examples of docs/extending.md do what the page says."""

from __future__ import annotations

import importlib
import json
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.parameters.writing import parameter_text, write_parameters

PAGE = Path(__file__).resolve().parents[1] / "docs" / "extending.md"


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Save an example of the page under the file name in its first line, and import it."""
    monkeypatch.syspath_prepend(tmp_path)

    def load(name: str) -> ModuleType:
        [code] = re.findall(rf"```python\n(# {name}\.py\n.*?)```", PAGE.read_text(), flags=re.DOTALL)
        (tmp_path / f"{name}.py").write_text(code)
        return importlib.import_module(name)

    return load


def test_law(example: Any) -> None:
    stiffness, coulomb, viscous, speed = 1.4e6, 0.54, 30.0, 1e-3
    law = example("my_law").ViscousDahl("1.4 N/um", coulomb, viscous)
    time = np.linspace(0.0, 2e-3, 201)
    found = ss.simulation.friction_response(law, time, speed * time, tolerance=1e-12)["friction_force"].values
    expected = coulomb * (1.0 - np.exp(-stiffness * speed * time / coulomb)) + viscous * speed
    np.testing.assert_allclose(found[1:], expected[1:], rtol=1e-5)  # at time 0 it rests
    with pytest.raises(ss.QuantityError, match="sigma_0"):
        law._replace(sigma_0=-1.0)


def test_piezo_model(example: Any, tmp_path: Path) -> None:
    """By its name in a parameter set, in what results say, and read back from them."""
    own = example("my_piezo").ColemanHodgdon(0.3, "0.05 1/V", 0.004)
    model = ss.load_actuator("kang2007").replace(piezo=ss.physics.piezo.Piezo(own))
    write_parameters(tmp_path / "bent.toml", parameter_text(model, title="bent", source="the test"))
    assert ss.load_actuator(tmp_path / "bent.toml").piezo == model.piezo
    said = json.loads(json.dumps(ss.registry.piezos.written(type(own))))
    assert said["piezo model_of"].endswith("my_piezo.py")
    assert ss.registry.piezos.of_results(said) is type(own)
    loop = ss.physics.piezo.duhem_output(own, [0.0, 100.0, 0.0])
    assert 0.0 < loop[-1] < 10.0  # V: it has not come back


def test_step_of_a_job(example: Any, tmp_path: Path) -> None:
    example("my_step")
    samples = {"end_effector_position": (np.array([0.0, 3e-6]), "m")}
    (tmp_path / "out" / "recordings").mkdir(parents=True)
    ss.save_recording(ss.make_recording([0.0, 1e-3], samples), tmp_path / "out" / "recordings" / "a.nc")
    job = tmp_path / "job.yaml"
    job.write_text("title: Own\nsteps: [{drift: {chanel: x}}]\n")
    with pytest.raises(ValueError, match=r"steps\.0\.drift: .*'chanel' \(did you mean 'channel'"):
        ss.run_job(job, tmp_path / "out")
    job.write_text("title: Own\nsteps: [{drift: {}}]\n")
    assert "3 µm" in str(ss.run_job(job, tmp_path / "out"))


def test_reader(example: Any, tmp_path: Path) -> None:
    samples = np.array([[0.0, 0.0], [65.0, 6.5], [30.0, 3.25]], dtype="<f4")
    samples.tofile(tmp_path / "scope.raw")
    recording = example("my_reader").read_scope(tmp_path / "scope.raw")
    ss.recording.validate_recording(recording)
    np.testing.assert_allclose(recording["time"], [0.0, 1e-5, 2e-5], rtol=1e-12)
    np.testing.assert_allclose(recording["end_effector_position"], [0.0, 6.5e-6, 3.25e-6], rtol=1e-6)
    assert recording["end_effector_position"].attrs["units"] == "m"


def test_view(example: Any, tmp_path: Path) -> None:
    found = ss.view(example("my_view").Wear(2.5e-6, 40_000))
    assert "2.5 µm" in str(found)
    ss.report.write_report(found, tmp_path / "out")
    written = json.loads((tmp_path / "out" / "results.json").read_text("utf-8"))
    assert written["numbers"]["depth"] == {"value": 2.5e-6, "unit": "m"}
