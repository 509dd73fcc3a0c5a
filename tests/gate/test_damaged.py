"""Files with random damage are refused by their documented error, in one line, or still read."""

from __future__ import annotations

import gzip
import json
import random
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from damaged_json import mutated
from stickslip.export.source import ExportError, exported
from stickslip.gate.errors import GateError, damaged
from stickslip.gate.results import json_attribute, results_numbers
from stickslip.identify.results import model_numbers
from stickslip.jobs.analysis.design_given import draws_of_file
from stickslip.jobs.analysis.move_model import at_intervals
from stickslip.jobs.analysis.verification import AnalysisError, VerificationAnalysis
from stickslip.jobs.campaign.kept import Kept
from stickslip.parameters import ParameterSetError
from stickslip.physics.contact import load_material, load_pair
from stickslip.physics.electronics.parts import load_part
from stickslip.quantities.units import QuantityError
from stickslip.recording.calibration import CalibrationError, available_calibrations, load_calibration
from stickslip.recording.calibration.applying import calibration_attribute
from stickslip.recording.drive import drive_text, named_drive
from stickslip.rig import load_bench
from stickslip.simulation.state import State, as_text, final_state

PACKAGE = Path(ss.__file__).parent
CALIBRATION = f"recording/calibration/sets/{available_calibrations()[0]}.json"
KANG = ss.load_actuator("kang2007")
RUNS = 300  # damaged files of each kind
LONGEST = 700  # characters of a message


def results() -> dict[str, Any]:
    """What an identification of a walk writes."""
    names = ["sigma_0", "coulomb_force"]
    parameters = {}
    for name in names:
        value = getattr(KANG.friction, name)
        parameters[name] = {
            "value": value,
            "unit": "N",
            "standard_error": 0.1 * value,
            "interval": [0.9 * value, value],
        }
    correlation = {"parameters": names, "coefficients": {"value": [[1.0, 0.2], [0.2, 1.0]]}}
    return {"numbers": {"model": model_numbers(KANG), "parameters": parameters, "correlation": correlation}}


def toml_text(content: Any) -> str:
    """The content as TOML, each value on one line; None is left out."""
    if isinstance(content, dict):
        return (
            "{"
            + ", ".join(f"{json.dumps(k)} = {toml_text(v)}" for k, v in content.items() if v is not None)
            + "}"
        )
    if isinstance(content, list):
        return "[" + ", ".join(toml_text(one) for one in content if one is not None) + "]"
    return json.dumps(content)


def toml_file(content: Any) -> str:
    known = content if isinstance(content, dict) else {"x": content}
    return "".join(f"{json.dumps(k)} = {toml_text(v)}\n" for k, v in known.items() if v is not None)


def outcome(act: Callable[[], Any], error: type[Exception]) -> str | None:
    """Return what the documented error says; None where there is none."""
    try:
        act()
    except error as said:
        return str(said)
    return None


def toml_of(name: str) -> Any:
    return tomllib.loads((PACKAGE / name).read_text("utf-8"))


def json_of(name: str) -> Any:
    return json.loads((PACKAGE / name).read_text("utf-8"))


def verified(path: Path) -> Any:
    content = {"kind": "verification", "title": "x", "fit": path.name, "recordings": [{"file": "a.csv"}]}
    return VerificationAnalysis.model_validate(content).load_model(path.parent)


KINDS: dict[str, tuple[Any, str, Callable[[Path], Any], type[Exception]]] = {
    "set": (toml_of("parameters/sets/kang2007.toml"), ".toml", ss.load_actuator, ParameterSetError),
    "bench": (toml_of("rig/benches/kang2007-bench.toml"), ".toml", load_bench, ParameterSetError),
    "part": (toml_of("physics/electronics/sets/pd200x4.toml"), ".toml", load_part, ParameterSetError),
    "pair": (toml_of("physics/contact/pairs/sapphire-steel.toml"), ".toml", load_pair, ParameterSetError),
    "material": (
        toml_of("physics/contact/materials/sapphire.toml"), ".toml", load_material, ParameterSetError
    ),
    "calibration": (json_of(CALIBRATION), ".json", load_calibration, CalibrationError),
    "verify": (results(), ".json", verified, AnalysisError),
    "draws": (results(), ".json", draws_of_file, AnalysisError),
    "export": (results(), ".json", exported, ExportError),
    "intervals": (results(), ".json", lambda path: at_intervals(KANG, path), QuantityError),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_random_damage_is_said_by_the_documented_error(kind: str, tmp_path: Path) -> None:
    content, suffix, load, error = KINDS[kind]
    draw = random.Random(kind)
    path = tmp_path / f"damaged{suffix}"
    write = toml_file if suffix == ".toml" else json.dumps
    path.write_text(write(content), "utf-8")
    load(path)
    refused = 0
    for _ in range(RUNS):
        path.write_text(write(mutated(content, draw)), "utf-8")
        began = time.process_time()
        said = outcome(lambda: load(path), error)
        if said is not None:
            refused += 1
            assert "damaged" in said
            assert "\n" not in said
            assert len(said) < LONGEST
        assert time.process_time() - began < 2.0
    assert refused > RUNS / 10


def test_random_damage_to_what_recordings_say_of_themselves() -> None:
    """Their drive, their final state, what was noted: attributes come from outside as the file does."""
    draw = random.Random(3)
    drive = json.loads(
        drive_text(ss.waveform.Sequence(ss.waveform.Rest(0.1), ss.Sawtooth(65.0, 5.0, periods=3)))
    )
    state = json.loads(as_text(State(1.0, 0.0, 0.0, 0.0, 0.0, (1e-6,), 0.0, (1.0, 2.0), "x")))
    recording = ss.make_recording(np.arange(3.0), {"position": (np.zeros(3), "m")})
    recording.attrs |= {"drive": json.dumps(drive), "final_state": json.dumps(state)}
    assert named_drive(recording) is not None
    assert final_state(recording).bristle_deflections == (1e-6,)
    for _ in range(RUNS):
        recording.attrs["drive"] = json.dumps(mutated(drive, draw))
        named_drive(recording)
        recording.attrs["final_state"] = json.dumps(mutated(state, draw))
        assert "final_state" in (outcome(lambda: final_state(recording), QuantityError) or "final_state")
    for text in ("[" * 100_000, "5", "[1]", '"x"', "", "{", '{"a": 1, "a": 2}'):
        recording.attrs |= {"drive": text, "final_state": text, "variables": text}
        assert named_drive(recording) is None
        assert json_attribute(recording.attrs, "variables") == {}
        with pytest.raises(QuantityError, match="final_state"):
            final_state(recording)
        assert isinstance(json.loads(calibration_attribute({}, text) or "{}"), dict)


def test_a_stage_that_was_kept_and_is_damaged_is_computed_again(tmp_path: Path) -> None:
    """Cut, no gzip, too deep, 200 MB of ones in 200 kB, another key: never an error, never the memory."""
    computed = []

    def compute() -> Any:
        computed.append(1)
        return KANG

    kept = Kept(tmp_path, "key")
    assert kept.stage("stage", compute) == kept.stage("stage", compute) == KANG
    assert len(computed) == 1
    (file,) = tmp_path.glob("*.json.gz")
    whole = file.read_bytes()
    bombs = [
        gzip.compress(b"[" * 100_000),
        gzip.compress(b"1" * 200_000_000, 1),
        gzip.compress(b'{"key": 1}'),
    ]
    for number, raw in enumerate([whole[:100], b"", b"x", *bombs], start=2):
        file.write_bytes(raw)
        assert kept.stage("stage", compute) == KANG
        assert len(computed) == number


def test_numbers_of_results(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    path.write_text('{"numbers": {"a": 1}}')
    assert results_numbers(path) == {"a": 1}
    for text in ("[]", "{}", '{"numbers": [1]}', "5"):
        path.write_text(text)
        with pytest.raises(GateError, match=r"results\.json: there are no 'numbers' in it"):
            results_numbers(path)


def test_only_what_content_leads_to_is_said_as_damage() -> None:
    with pytest.raises(QuantityError, match=r"^mine$"), damaged(QuantityError, "file"):
        raise QuantityError("mine")
    with pytest.raises(MemoryError), damaged(QuantityError, "file"):
        raise MemoryError
    with pytest.raises(KeyboardInterrupt), damaged(QuantityError, "file"):
        raise KeyboardInterrupt
    with pytest.raises(QuantityError, match=r"^file: there is no 'a' in it$"), damaged(QuantityError, "file"):
        raise KeyError("a")
    with pytest.raises(QuantityError, match=r"^file: AttributeError: x y$"), damaged(QuantityError, "file"):
        raise AttributeError("x\ny")
    with (
        pytest.raises(QuantityError, match=r"^file: no fit: too deep$"),
        damaged(QuantityError, "file: no fit"),
    ):
        raise GateError("file: too deep")
