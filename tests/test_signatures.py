"""Every public call takes strings with units where it takes a quantity, and says what is wrong with one."""

from __future__ import annotations

import contextlib
import functools
import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from public_names import everything

import stickslip as ss
from stickslip import control, design, study
from stickslip.control.loops import sampled_loop
from stickslip.identify.frequency.amplitude import AmplitudeModel
from stickslip.physics import contact
from stickslip.quantities.progress import Progress, unheard
from stickslip.recording import calibration

# Plain numbers: shares, ratios, a scale in multiples of the noise, the relative steps of `estimate`.
PLAIN = {"level", "load", "normal_load", "share", "loss_scale", "difference_step", "settled", "exponent"}
# What parses or prints a quantity, and what the solver calls.
OTHERS = (
    "quantities.units.",
    "friction.rate",
    "friction.force",
    "friction.project",
    "estimate.fit_least_squares",
)
NO_QUANTITY = ("3 cd", "much", True, [[1.0]], {})


def calls() -> Iterator[tuple[str, Callable[..., Any]]]:
    """The public functions, and constructors that people call; records check themselves, results are made
    by functions."""
    for name, one in everything().items():
        called = inspect.isfunction(one) or (inspect.isclass(one) and "__init__" in vars(one))
        if called and not (is_dataclass(one) or (inspect.isclass(one) and issubclass(one, Exception))):
            yield name, one


def of_numbers(parameter: inspect.Parameter) -> bool:
    given = parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
    number = re.search(r"\bfloat\b", str(parameter.annotation)) is not None
    return given and number and not str(parameter.annotation).startswith("Callable")


def quantities() -> Iterator[tuple[str, Callable[..., Any], inspect.Parameter]]:
    for name, call in calls():
        if name.startswith(OTHERS):
            continue
        for parameter in inspect.signature(call).parameters.values():
            if of_numbers(parameter) and parameter.name not in PLAIN:
                yield f"{name}-{parameter.name}", call, parameter


def walk() -> Any:
    return ss.make_recording(
        np.arange(20) * 1e-3,
        {
            "end_effector_position": np.arange(20) * 1e-9,
            "position": np.arange(20) * 1e-9,
            "friction_force": np.arange(20) * 1e-3,
            "drive_voltage": np.arange(20.0),
        },
    )


def filled(other: inspect.Parameter, folder: Path) -> Any:
    """Something for another argument, which should not have been looked at."""
    if other.name == "recordings":
        return walk()
    if other.name == "waveform":
        return ss.Sawtooth(65.0, 5.0)
    if other.name == "fit":
        return SimpleNamespace(observed="position")
    if "AmplitudeModel" in str(other.annotation):
        return MODES
    # What says whether positions are in m or in rad.
    if other.name in OF_UNITS:
        return OF_UNITS[other.name]()
    return 1.0 if of_numbers(other) else str(folder / "x")


KANG = ss.load_actuator("kang2007")
BENCH = ss.rig.load_bench("kang2007-bench")
NONE = np.zeros((1, 1, 1))
MODE = ss.identify.ModalModel(np.ones(1), np.ones(1), 0.0, NONE, NONE, NONE[0])
MODES = AmplitudeModel(MODE, MODE, 1.0, 1.0, 0.5, 2.0)
OF_UNITS: dict[str, Callable[[], Any]] = {
    "model": lambda: KANG,
    "source": lambda: KANG,
    "recording": walk,
    "responses": lambda: [xr.Dataset({"response": ("frequency", [1e-6], {"units": "m/V"})})],
    "table": lambda: SimpleNamespace(unit="m"),
    "rig": lambda: ss.rig.VirtualRig(KANG, BENCH),
    "channels": lambda: {"end_effector_position": ss.rig.Channel("interferometer")},
    "limits": ss.rig.Limits,
    "actuators": lambda: [KANG, KANG],
    "waveforms": lambda: [ss.Sawtooth(65.0, 5.0)] * 2,
}


def test_every_quantity_may_have_its_unit(tmp_path: Path) -> None:
    """What is no number of its dimension is refused by name, before anything else is looked at."""
    wrong, found = [], list(quantities())
    assert len(found) > 150
    for name, call, parameter in found:
        if "str" not in str(parameter.annotation):
            wrong.append(f"{name} does not say that it takes a string")
        given: dict[str, Any] = {
            other.name: filled(other, tmp_path)
            for other in inspect.signature(call).parameters.values()
            if other.default is other.empty and other.kind is not other.VAR_KEYWORD
        }
        for value in NO_QUANTITY:
            several = re.search(r"Sequence|tuple", str(parameter.annotation)) is not None
            one = [(value, 0.1)] if parameter.name == "modes" else (value, value) if several else value
            said = "nothing"
            with contextlib.suppress(Exception):
                try:
                    call(**{**given, parameter.name: one})
                except ValueError as error:
                    said = str(error)
            if not re.search(f"{parameter.name}.*{'3 cd' if value == '3 cd' else ''}", said):
                wrong.append(f"{name} = {one!r} says {said}")
    assert not wrong, "\n".join(wrong)


def test_one_signature_of_progress() -> None:
    told = [
        parameter
        for _, call in calls()
        for parameter in inspect.signature(call).parameters.values()
        if parameter.name == "progress"
    ]
    assert len(told) > 8
    assert all(one.annotation == "Progress" and one.default is unheard for one in told)
    assert Progress.__args__ == (str, float, None)


def test_units_in_lists_of_members() -> None:
    model, drive = ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 50.0)
    given = {"sigma_0": ["1.4 N/um", "1.5 N/um"], "amplitude": ["65 V", "0.07 kV"]}
    plain = {"sigma_0": [1.4e6, 1.5e6], "amplitude": [65.0, 70.0]}
    with_units = ss.simulate_ensemble(model, drive, "20 ms", parameters=given)
    assert with_units.identical(ss.simulate_ensemble(model, drive, 0.02, parameters=plain))
    with pytest.raises(ValueError, match=r"sigma_0.*'1 V'.*N/m"):
        ss.simulate_ensemble(model, drive, 0.02, parameters={"sigma_0": ["1 V"]})


SAW = ss.Sawtooth(65.0, 50.0)
LINE = ss.recording.calibration.Calibration("line", (0.0, 2e-6), "V", "m", 0.0, 10.0)
FITTED = ss.recording.calibration.fit_calibration([1.0, 2.0, 4.0], [1e-6, 2e-6, 4.1e-6], 1)
TABLE = ss.design.StepTable(*(np.array([a, b]) for a, b in ((10.0, 100.0), *[(0.0, 1e-6)] * 3)), 0.0, "", "")
REGULATOR = ss.control.Regulator(ss.control.Pid(1e6), "10 kHz")
POSITION = 1e-6 * np.concatenate([np.linspace(-1.0, 1.0, 200), np.linspace(1.0, -1.0, 200)])
FORCE = np.concatenate(
    [1.0 - 2.0 * np.exp(-5e6 * (POSITION[:200] + 1e-6)), 2.0 * np.exp(-5e6 * (1e-6 - POSITION[200:])) - 1.0]
)
NO_FIT: Any = SimpleNamespace()
RESPONSE = functools.partial(ss.simulation.friction_response, KANG.friction)
FORCES, VOLTS, HERTZ = ("N", [0.5, 0.4]), ("V", [50.0, 60.0]), ("Hz", [10.0, 20.0])
SECONDS, SLOPE, LEVELS = ("s", [0.0, 0.01, 0.02]), ("m", [1e-6, 2e-6, 4.1e-6]), ("V", [1.0, 2.0, 4.0])
# Of each array argument: its unit, values of it, and what is to be called with them.
ARRAYS: dict[str, tuple[str, Any, Callable[[Any], Any]]] = {
    "simulate-times": (*SECONDS, lambda v: ss.simulate(KANG, SAW, times=v)),
    "simulate_ensemble-times": (
        *SECONDS, lambda v: ss.simulate_ensemble(KANG, SAW, parameters={"sigma_0": [1.4e6]}, times=v)
    ),
    "simulate_ensemble-parameters": (
        *FORCES, lambda v: ss.simulate_ensemble(KANG, SAW, 0.02, parameters={"coulomb_force": v})
    ),
    "simulation.sensitivities-times": (
        *SECONDS, lambda v: ss.simulation.sensitivities(KANG, SAW, parameters=["coulomb_force"], times=v)
    ),
    "simulation.simulate_together-times": (
        *SECONDS, lambda v: ss.simulation.simulate_together([KANG, KANG], [SAW, SAW], times=v)
    ),
    "steady_steps-parameters": (*VOLTS, lambda v: ss.steady_steps(KANG, SAW, parameters={"amplitude": v})),
    "step_map-voltage": (*VOLTS, lambda v: ss.step_map(KANG, SAW, voltage=v)),
    "step_map-frequency": ("Hz", [50.0, 60.0], lambda v: ss.step_map(KANG, SAW, frequency=v)),
    "step_map-load": ("N", [0.0, 0.1], lambda v: ss.step_map(KANG, SAW, load=v)),
    "step_map-direction": ("", [1.0, -1.0], lambda v: ss.step_map(KANG, SAW, direction=v)),
    "step_map-parameters": (*FORCES, lambda v: ss.step_map(KANG, SAW, parameters={"coulomb_force": v})),
    "step_map-fit": (
        "N", [0.5] * 39 + [0.4],
        lambda v: ss.step_map(KANG, SAW, load=0.0, fit={"coulomb_force": v}, draws=40)
    ),
    "design.backward_rate-position": ("m", [0.0, 3e-6, 2e-6], design.backward_rate),
    "design.load_speed_curve-loads": ("N", [0.0, 0.1], lambda v: design.load_speed_curve(KANG, SAW, v)),
    "design.step_at-voltage": ("V", [20.0, 50.0], lambda v: design.step_at(TABLE, v)),
    "friction_response-time": ("s", [0.0, 0.1], lambda v: RESPONSE(v, [0.0, 1e-6])),
    "friction_response-position": ("m", [0.0, 1e-6], lambda v: RESPONSE([0.0, 0.1], v)),
    "friction_response-normal_force": (
        "N", [1.0, 1.2], lambda v: RESPONSE([0.0, 0.1], [0.0, 1e-6], normal_force=v)
    ),
    "study.drawn_parameters-source": (
        *FORCES, lambda v: study.drawn_parameters({"coulomb_force": v}, KANG, 2, 0)
    ),
    "study.SteadySteps.read-values": (
        *FORCES, lambda v: study.SteadySteps(KANG, SAW).read("coulomb_force", v)
    ),
    "study.WalksFromRest.read-values": (
        *FORCES, lambda v: study.WalksFromRest(KANG, SAW).read("coulomb_force", v)
    ),
    "study.Own.read-values": (*FORCES, lambda v: study.Own(np.sin, {"force": "N"}).read("force", v)),
    "control.Regulator.response-frequencies": (*HERTZ, lambda v: REGULATOR.response(v)),
    "bode-frequencies": (*HERTZ, lambda v: ss.bode(KANG, v)[0].lines[0].get_xdata()),
    "control.Learnt.contraction-frequencies": (
        *HERTZ, lambda v: control.Learnt(REGULATOR, 100).contraction(sampled_loop(KANG, 1e4), v)
    ),
    "recording.calibration.Calibration.__call__-x": ("V", [1.0, 2.0], lambda v: LINE(v)),
    "recording.calibration.Calibration.slope-x": ("V", [1.0, 2.0], lambda v: LINE.slope(v)),
    "recording.calibration.Calibration.inverse-y": ("m", [1e-6, 2e-6], lambda v: LINE.inverse(v)),
    "recording.calibration.Calibration.prediction_band-x": (
        "V", [1.0, 2.0], lambda v: FITTED.prediction_band(v)
    ),
    "recording.calibration.fit_calibration-x": (
        *LEVELS, lambda v: calibration.fit_calibration(v, SLOPE[1], 1).coefficients
    ),
    "recording.calibration.fit_calibration-y": (
        *SLOPE, lambda v: calibration.fit_calibration(LEVELS[1], v, 1).coefficients
    ),
    "physics.contact.measured-heights": (
        "m", 1e-9 * np.sin(np.arange(20.0)), lambda v: contact.measured(v, 1e-8)
    ),
    "physics.contact.sliding_path-sliding_displacement": (
        "m", [0.0, 1e-3, 0.0], lambda v: contact.sliding_path(v)
    ),
    "physics.contact.of_backbone-displacement": (
        "m", [1e-7, 3e-7, 6e-7], lambda v: contact.of_backbone(v, [0.2, 0.4, 0.5])
    ),
    "physics.contact.of_backbone-force": (
        "N", [0.2, 0.4, 0.5], lambda v: contact.of_backbone([1e-7, 3e-7, 6e-7], v)
    ),
    "physics.contact.of_loop-position": ("m", POSITION, lambda v: contact.of_loop(v, FORCE).law),
    "physics.contact.of_loop-force": ("N", FORCE, lambda v: contact.of_loop(POSITION, v).law),
    "physics.contact.backbone-displacement": (
        "m", [0.0, 1e-8],
        lambda v: contact.backbone(lambda a: 1e6 * a, 1e-7, v, friction_coefficient=0.2, stiffness_ratio=0.8),
    ),
    "physics.contact.Ageing.stiction_ratio-rest": (
        "s", [1.0, 10.0], lambda v: contact.Ageing(0.02).stiction_ratio(v)
    ),
}  # fmt: skip
# Of these a wrong unit is tried only: the right one needs a fit.
REFUSED_ONLY: dict[str, Callable[[Any], Any]] = {
    "inverse_drive-times": lambda v: ss.inverse_drive(NO_FIT, v, [0.0, 1e-6]),
    "inverse_drive-positions": lambda v: ss.inverse_drive(NO_FIT, [0.0, 1.0], v),
    "identify.inverse_residual-positions": lambda v: ss.identify.inverse_residual(NO_FIT, NO_FIT, v),
}


def labelled(values: Any, unit: str) -> xr.DataArray:
    """In thousandths of the unit."""
    return xr.DataArray(1e3 * np.asarray(values), dims="x", attrs={"units": f"m{unit}"})


@pytest.mark.parametrize("name", ARRAYS)
def test_an_array_may_have_its_unit(name: str) -> None:
    """Of xarray, and strings in lists and in arrays: as the same numbers in SI."""
    unit, values, call = ARRAYS[name]
    expected = call(np.asarray(values))
    texts = [f"{1e3 * value:.12g} m{unit}" if unit else f"{value:g}" for value in values]
    given = [texts, np.array(texts), np.array(texts, dtype=object)]
    for one in [*given, labelled(values, unit)] if unit else given:
        alike(call(one), expected)


def alike(found: Any, expected: Any) -> None:
    if isinstance(expected, xr.Dataset):
        xr.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12)
    elif isinstance(expected, dict):
        assert found.keys() == expected.keys()
        alike(tuple(found.values()), tuple(expected.values()))
    elif isinstance(expected, tuple):
        for one, other in zip(found, expected, strict=True):
            alike(one, other)
    elif isinstance(expected, str):
        assert found == expected
    else:
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_an_array_in_another_unit_is_refused() -> None:
    for name, call in [*((n, one[2]) for n, one in ARRAYS.items()), *REFUSED_ONLY.items()]:
        field = name.split("-")[1] if name in REFUSED_ONLY else ""
        for given in (xr.DataArray([3.0, 4.0], attrs={"units": "cd"}), ["3 cd", "4 cd"], np.array(["3 cd"])):
            with pytest.raises(ss.QuantityError, match=f"{field}.*'[13] cd'.*'cd'"):
                call(given)


IN_METRES: tuple[Callable[[Any], Any], ...] = (
    lambda v: ss.simulate(KANG, SAW, 0.02, tolerance=v),
    lambda v: ss.simulate_ensemble(KANG, SAW, 0.02, parameters={"load": [1]}, tolerance=v),
    lambda v: ss.simulation.sensitivities(KANG, SAW, 0.02, parameters=["sigma_0"], tolerance=v),
    lambda v: ss.steady_step(KANG, SAW, tolerance=v),
    lambda v: ss.simulation.steady_orbit(KANG, SAW, tolerance=v),
    lambda v: ss.steady_steps(KANG, SAW, parameters={"load": [1]}, tolerance=v),
    lambda v: ss.simulation.steady_step_derivatives(KANG, SAW, parameters=["sigma_0"], tolerance=v),
    lambda v: ss.step_map(KANG, SAW, load=0.0, tolerance=v),
    lambda v: ss.simulation.friction_response(KANG.friction, [0, 1], [0, 1e-6], tolerance=v),
    lambda v: ss.simulation.Motion(KANG, tolerance=v),
    lambda v: ss.rig.VirtualRig(KANG, BENCH, tolerance=v),
)


def test_a_tolerance_that_says_nothing_is_refused() -> None:
    """With an infinite one a walk of 21 um ended at 0.30 m, by its own account without an error."""
    for call in IN_METRES:
        for given in (np.inf, np.nan, 0.0, -1e-9, 0.01, "2 mm", "inf m"):
            with pytest.raises(ss.QuantityError, match=r"^tolerance = .*> 0 and <= 0.001 m"):
                call(given)


# What counts in units that are given beside, or in those of its results.
COUNTS_OTHERWISE = (
    "estimate.",
    "recording.calibration.cross_validation",
    "physics.contact.backbone-load",
    "identify.",
    "make_recording",
    "physics.electronics.",
    "physics.piezo.",
    "waveform.",
    "Sampled.",
    "Sequence.",
)


def test_all_arrays_are_looked_at() -> None:
    found = []
    for name, one in everything().items():
        made = [(name, one)] if inspect.isfunction(one) else []
        if inspect.isclass(one):
            made = [(f"{name}.{n}", f) for n, f in vars(one).items() if inspect.isfunction(f)]
        for label, call in made:
            for p in inspect.signature(call).parameters.values():
                if "ArrayLike" in str(p.annotation) and p.name != "self":
                    found.append(f"{label}-{p.name}")
    public = [name for name in found if "._" not in name or ".__call__" in name]
    missed = {name for name in public if not name.startswith(COUNTS_OTHERWISE)} - {*ARRAYS, *REFUSED_ONLY}
    assert not missed
