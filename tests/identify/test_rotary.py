"""What turns: the same motion as what slides on a radius, in rad and N m, from the file to the report."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss
from stickslip.quantities.units import ANGLE
from stickslip.recording import RecordingError

from .step_system import step_recording
from .stops import made_loops

RADIUS = 0.012
DRIVE = ss.Sawtooth(65.0, 20.0, periods=3)


def on_radius(recording, **powers: int):
    """The recording with channels over the radius to a power, and their units turned."""
    changed = {
        name: (recording[name].values * RADIUS**power, ANGLE.unit(recording[name].attrs["units"]))
        for name, power in powers.items()
    }
    kept = {
        name: (x.values, x.attrs["units"]) for name, x in recording.data_vars.items() if name not in powers
    }
    return ss.make_recording(recording["time"].values, {**kept, **changed}, title="turned")


@pytest.mark.parametrize(
    ("slides", "turns"),
    [
        ("m", "rad"), ("N", "N m"), ("kg", "kg m^2"), ("m/V", "rad/V"), ("m/s", "rad/s"), ("N/m", "N m/rad"),
        ("N s/m", "N m s/rad"), ("1/N", "1/(N m)"), ("s", "s"),
    ],
)  # fmt: skip
def test_units_of_what_turns(slides: str, turns: str) -> None:
    assert ANGLE.unit(slides) == turns


def test_loops() -> None:
    loops = made_loops((4e4, 1.5e4), (1.2, 0.9), noise=0.01, bias=0.2)
    free = ["stiffness_1", "stiffness_2", "strength_1", "strength_2", "bias"]
    start = ss.MaxwellSlip((2e4, 2e4), (0.8, 1.4))
    about = {"reference_normal_force": 5.0, "correlated": False}
    straight = ss.identify_loops(loops, start, free, **about)
    law = ss.MaxwellSlip(
        tuple(x * RADIUS**2 for x in start.stiffness), tuple(x * RADIUS for x in start.strength)
    )
    angular = on_radius(loops, position=-1, friction_force=1)
    fit = ss.identify_loops(angular, law, free, **about, tolerance=1e-9 / RADIUS)
    assert {p.name: p.unit for p in fit.parameters} == {
        "stiffness_1": "N m/rad", "stiffness_2": "N m/rad", "strength_1": "N m", "strength_2": "N m",
        "bias": "N m",
    }  # fmt: skip
    for name, value in straight.values.items():
        assert fit.values[name] == pytest.approx(value * RADIUS ** (2 if "stiff" in name else 1), rel=1e-3)
    assert fit.recordings[0].unit == "N m"
    assert " N " not in fit.report().replace("N m", "")
    wrong = loops.assign(position=angular["position"])
    with pytest.raises(RecordingError, match="position is in rad, but friction_force in N: rad goes"):
        ss.identify_loops(wrong, law, free, **about)


def test_walks_with_what_is_tied_and_bounded_in_units_of_torques() -> None:
    law = ss.LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.5401)
    model = ss.load_actuator("kang2007").replace(stage_reaction=False, friction=law)
    shown = ss.simulate(model, DRIVE, 0.15, sample_rate=2e3, tolerance=1e-10)
    shown["end_effector_position"] += 2e-8 * np.random.default_rng(0).standard_normal(shown.sizes["time"])
    angular = on_radius(shown[["end_effector_position"]], end_effector_position=-1)
    turning = model.replace(
        gain=model.gain / RADIUS,
        end_effector_mass=model.end_effector_mass * RADIUS**2,
        friction=ss.LuGre(1e6 * RADIUS**2, 34.9 * RADIUS**2, 0.0, 0.6 * RADIUS, 0.6 * RADIUS),
    )
    fit = ss.identify_friction(
        angular,
        turning,
        ["sigma_0", "coulomb_force"],
        drive=DRIVE,
        channel=("offset",),
        bounds={"coulomb_force": ("1 mN m", "30 mN m")},
        tied={"sigma_1": "'25 us' * sigma_0"},
        tolerance=1e-10 / RADIUS,
    )
    assert {p.name: p.unit for p in fit.shown} == {
        "sigma_0": "N m/rad", "coulomb_force": "N m", "offset": "rad", "sigma_1": "N m s/rad",
    }  # fmt: skip
    assert fit.values["sigma_0"] == pytest.approx(1.399e6 * RADIUS**2, rel=0.02)
    assert fit.values["coulomb_force"] == pytest.approx(0.5401 * RADIUS, rel=5e-3)
    assert fit.recordings[0].unit == "rad"


def test_steps_and_features() -> None:
    recording = step_recording(60.0, 0.05e-6, 0)
    angular = on_radius(recording, end_effector_position=-1)
    straight, fit = ss.identify_step(recording), ss.identify_step(angular)
    units = {p.name: p.unit for p in fit.parameters}
    assert units["gain"] == "rad/V"
    assert units["offset_1"] == "rad"
    assert fit.values["gain"] == pytest.approx(straight.values["gain"] / RADIUS, rel=1e-6)
    assert ss.identify.step_features(angular)["gain"].attrs["units"] == "rad/V"
    walk = ss.simulate(ss.load_actuator("kang2007"), DRIVE, 0.15, sample_rate=5e3)
    shown = on_radius(walk[["end_effector_position", "drive_voltage"]], end_effector_position=-1)
    features = ss.identify.sawtooth_features(shown)
    assert features["net_step"].attrs["units"] == features["peak"].attrs["units"] == "rad"
    assert features["period"].attrs["units"] == "s"


def test_a_file_in_milliradians_is_read_and_inspected(tmp_path) -> None:
    time = np.arange(200) * 1e-3
    table = np.column_stack([time, 1e3 * np.sin(30.0 * time), np.cos(30.0 * time)])
    path = tmp_path / "turned.csv"
    np.savetxt(path, table, "%.6f", ",", header="time [s],angle [mrad],torque [mN m]", comments="")
    columns = {"time": "time", "position": "angle", "friction_force": "torque"}
    found = ss.read_recording(path, columns)
    assert found["position"].attrs["units"] == "rad"
    assert found["friction_force"].attrs["units"] == "N m"
    assert float(found["position"].max()) == pytest.approx(1.0, rel=1e-3)
    seen = ss.inspect_file(path)
    assert seen.recording is not None
    assert [x.attrs["units"] for x in seen.recording.data_vars.values()] == ["rad", "N m"]
    with pytest.raises(RecordingError, match="drive_voltage is a quantity in V"):
        ss.read_recording(path, {"time": "time", "drive_voltage": "angle"})


@pytest.mark.parametrize("rotary", [False, True])
def test_a_model_predicts_only_positions_of_its_own_unit(rotary: bool) -> None:
    """A fit of the same linear model to angles is rotary, so that its predictions suit them."""
    model = ss.load_actuator("kang2007").replace(stage_reaction=False)
    walk = ss.simulate(model, DRIVE, 0.15, sample_rate=2e3)[["end_effector_position"]]
    in_unit = {unit: walk.copy(deep=True) for unit in ("m", "rad")}
    in_unit["rad"]["end_effector_position"].attrs["units"] = "rad"
    other, own = ("m", "rad") if rotary else ("rad", "m")
    predictor = ss.identify.Predictor(model.replace(rotary=rotary))
    said = f"is in {other}, but the model moves in {own}: give an actuator with rotary = "
    with pytest.raises(ss.QuantityError, match=said + ("false" if rotary else "true")):
        ss.verify(predictor, in_unit[other], drive=DRIVE)
    assert ss.verify(predictor, in_unit[own], drive=DRIVE).r_squared > 0.9999
    fit = ss.identify_friction(in_unit["rad"], model, ["coulomb_force"], drive=DRIVE, hops=0, diagnose=False)
    assert fit.model is not None
    assert fit.model.rotary
    for judged in (fit, ss.identify.Predictor(fit.model)):
        assert ss.verify(judged, in_unit["rad"], drive=DRIVE).unit == "rad"
        with pytest.raises(ValueError, match="is in m, but"):
            ss.verify(judged, in_unit["m"], drive=DRIVE)
