"""Every public call takes strings with units where it takes a quantity, and says what is wrong with one."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from public_names import everything

import stickslip as ss
from stickslip.progress import Progress, unheard

# Plain numbers: shares, ratios, a scale in multiples of the noise, the relative steps of `estimate`.
PLAIN = {"level", "load", "normal_load", "share", "loss_scale", "difference_step", "settled", "exponent"}
# What parses or prints a quantity, and what is called in compiled code only.
OTHERS = ("units.", "friction.rate", "friction.project", "estimate.fit_least_squares")


def calls() -> Iterator[tuple[str, Callable[..., Any]]]:
    """The public functions, and constructors that people call; records check themselves, results are made
    by functions."""
    for name, one in everything().items():
        called = inspect.isfunction(one) or (inspect.isclass(one) and "__init__" in vars(one))
        if called and not (is_dataclass(one) or (inspect.isclass(one) and issubclass(one, Exception))):
            yield name, one


def of_numbers(parameter: inspect.Parameter) -> bool:
    given = parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
    return given and re.search(r"\bfloat\b", str(parameter.annotation)) is not None


def quantities() -> Iterator[Any]:
    for name, call in calls():
        if name.startswith(OTHERS):
            continue
        for parameter in inspect.signature(call).parameters.values():
            if of_numbers(parameter) and parameter.name not in PLAIN:
                yield pytest.param(call, parameter, id=f"{name}-{parameter.name}")


def test_most_calls_are_looked_at() -> None:
    assert len(list(calls())) > 40
    assert len(list(quantities())) > 50


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
    # What says whether positions are in m or in rad.
    if other.name in OF_UNITS:
        return OF_UNITS[other.name]()
    return 1.0 if of_numbers(other) else str(folder / "x")


KANG = ss.load_actuator("kang2007")
OF_UNITS: dict[str, Callable[[], Any]] = {
    "model": lambda: KANG,
    "source": lambda: KANG,
    "recording": walk,
    "table": lambda: SimpleNamespace(unit="m"),
    "rig": lambda: ss.rig.VirtualRig(KANG, ss.rig.load_bench("kang2007-bench")),
    "channels": lambda: {"end_effector_position": ss.rig.Channel("interferometer")},
    "limits": ss.rig.Limits,
}


@pytest.mark.parametrize(("call", "parameter"), list(quantities()))
def test_a_quantity_may_have_its_unit(
    call: Callable[..., Any], parameter: inspect.Parameter, tmp_path: Path
) -> None:
    """A string of another dimension is refused by name, before anything else is looked at."""
    assert "str" in str(parameter.annotation), "says that it takes a string"
    given: dict[str, Any] = {
        other.name: filled(other, tmp_path)
        for other in inspect.signature(call).parameters.values()
        if other.default is other.empty and other.kind is not other.VAR_KEYWORD
    }
    text: Any = "3 cd"
    if parameter.name == "modes":
        text = [(text, 0.1)]
    elif re.search(r"Sequence|tuple", str(parameter.annotation)):
        text = (text, text)
    with pytest.raises(ValueError, match=f"{parameter.name}.*'3 cd'"):
        call(**{**given, parameter.name: text})


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


def test_quantities_of_a_bench() -> None:
    bench = ss.rig.load_bench("kang2007-bench").replace(sample_rate="50 kHz", piezo_capacitance="7 uF")
    assert (bench.sample_rate, bench.piezo_capacitance) == (50e3, 7e-6)
    with pytest.raises(ValueError, match=r"sample_rate.*'3 K'"):
        bench.replace(sample_rate="3 K")


def test_units_in_lists_of_members() -> None:
    model, drive = ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 50.0)
    given = {"sigma_0": ["1.4 N/um", "1.5 N/um"], "amplitude": ["65 V", "0.07 kV"]}
    plain = {"sigma_0": [1.4e6, 1.5e6], "amplitude": [65.0, 70.0]}
    with_units = ss.simulate_ensemble(model, drive, "20 ms", parameters=given)
    assert with_units.identical(ss.simulate_ensemble(model, drive, 0.02, parameters=plain))
    with pytest.raises(ValueError, match=r"sigma_0.*'1 V'.*N/m"):
        ss.simulate_ensemble(model, drive, 0.02, parameters={"sigma_0": ["1 V"]})
