"""Members on a GPU: the kernel compiles without one, and gives on a processor what the engine gives."""

from __future__ import annotations

import ctypes
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from engine import cases, own, pretended
from engine.test_members import CASES, LEFT_OUT, Task
from stickslip.engine import cuda, cuda_source, nvrtc
from stickslip.friction import law as registered
from stickslip.simulation import SimulationWarning, simulate_ensemble
from stickslip.simulation.plant.system import values_of

# Together: one law and several, bristles and static laws, composed ones, a load along the stroke and in time,
# a user's own law, a two-port.
LAYOUTS = (
    "the thesis's actuator",
    "Coulomb",
    "Maxwell slip",
    "a load along the stroke and in time",
    "an amplifier",
    "a sampled controller",
    "a two-port",
)
SAWTOOTH = ss.Sawtooth(65.0, 50.0)
PARAMETERS = {
    "sigma_0": [1e6, 1.4e6, -1.0, 3e6],
    "end_effector_mass": [0.1, 0.2, 0.1, 0.05],
    "amplitude": [65.0, 40.0, 65.0, 90.0],  # so that each has a table of its own
}
# A thread of more could not run beside 511 others on a multiprocessor.
MOST_REGISTERS = 128


@pytest.fixture
def pretended_gpu(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    caches = (cuda.driver, cuda.missing, cuda._device, cuda._function)
    pretended.install(monkeypatch, tmp_path)
    yield
    for cached in caches:
        cached.cache_clear()


def on_gpu(task: Task, max_steps: int = 200_000) -> tuple[np.ndarray, np.ndarray]:
    """Times reached and steps of the members of a task, which changes as by `Task.followed`."""
    case, count = task.case, len(task.values)
    reached, steps = np.zeros(count), np.zeros(count, np.int64)
    results = task.outcomes, reached, steps
    drives = task.drives, task.which, case.load
    how = case.tolerance, case.careful, max_steps
    cuda.integrate_members(case.plant, drives, task.values, task.states, task.spans, *how, results)
    return reached, steps


@pytest.mark.usefixtures("pretended_gpu")
@pytest.mark.parametrize("name", LAYOUTS)
def test_the_kernel_takes_the_steps_of_the_processors(name: str) -> None:
    """To the last bit, with the same C."""
    here, there = Task(CASES[name]), Task(CASES[name])
    here.outcomes[2] = there.outcomes[2] = LEFT_OUT
    expected = here.followed(times=np.zeros(0))
    reached, steps = on_gpu(there)
    np.testing.assert_array_equal(there.outcomes, here.outcomes)
    np.testing.assert_array_equal(reached, expected.reached)
    np.testing.assert_array_equal(steps, expected.steps)
    np.testing.assert_array_equal(there.states, here.states)
    assert steps[0] > 0


@pytest.mark.usefixtures("pretended_gpu")
def test_an_ensemble_on_the_gpu_is_that_of_the_processors() -> None:
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for engine in ("cpu", "cuda"):
            found[engine] = simulate_ensemble(
                cases.KANG, SAWTOOTH, 0.08, parameters=PARAMETERS, engine=engine
            )
    assert found["cuda"]["status"].values.tolist() == [0, 0, 4, 0]
    assert found["cuda"].identical(found["cpu"])
    assert ctypes.CDLL(cuda.DRIVER).pretended_live() == 0, "memory of the GPU is left"


@pytest.mark.usefixtures("pretended_gpu")
def test_a_law_of_a_user_runs_on_the_gpu() -> None:
    model, varied = cases.KANG.replace(friction=own.Own(1e6, 0.5)), {"end_effector_mass": [0.1, 0.2]}
    found = [
        simulate_ensemble(model, SAWTOOTH, 0.02, parameters=varied, engine=engine)
        for engine in ("cpu", "cuda")
    ]
    assert found[1].identical(found[0])
    assert found[1]["status"].values.tolist() == [0, 0]


@pytest.mark.usefixtures("pretended_gpu")
def test_what_the_driver_refuses_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nvrtc, "compiled", lambda *given: (b"/nowhere.so\0", ""))
    with pytest.raises(
        nvrtc.GpuError, match=r"cuModuleLoadData of NVIDIA's driver fails: no kernel image.*209"
    ):
        on_gpu(Task(CASES["Coulomb"]))


@pytest.mark.parametrize("target", ["compute_75", "compute_90"])
@pytest.mark.parametrize("name", [LAYOUTS[0], LAYOUTS[3], LAYOUTS[4]])
def test_the_kernel_compiles_for_a_gpu_without_a_warning(name: str, target: str) -> None:
    plant = CASES[name].plant
    text, _ = cuda_source.layout(plant, values_of(plant))
    code, said = nvrtc.compiled(cuda_source.kernel(), {**cuda_source.headers(), "layout.h": text}, target)
    assert said == ""
    assert f".target sm_{target[-2:]}".encode() in code


@pytest.mark.parametrize("function", [own.with_table, own.with_other_functions, own.newton])
def test_a_users_law_compiles_for_a_gpu(function: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables, functions of `math` and loops among them."""
    made = registered._IMPLEMENTATIONS[own.Own]._replace(rate=function)
    monkeypatch.setitem(registered._IMPLEMENTATIONS, own.Numbers, made)
    plant = cases.three_modes()
    plant = plant._replace(elements=(plant.elements[0]._replace(law=own.NUMBERS),))
    text, _ = cuda_source.layout(plant, values_of(plant))
    source = """#include "layout.h"
extern "C" __global__ void kernel(const real_t *p, real_t v, real_t z, real_t *o)
{
    law_rate_Numbers(p, v, z, o, o + 1);
}
"""
    _, said = nvrtc.compiled(source, {**cuda_source.headers(), "layout.h": text}, "compute_90")
    assert said == ""


def test_a_thread_has_at_most_128_registers() -> None:
    plant = CASES[LAYOUTS[0]].plant
    text, _ = cuda_source.layout(plant, values_of(plant))
    sources = cuda_source.kernel(), {**cuda_source.headers(), "layout.h": text}
    code, said = nvrtc.compiled(*sources, "sm_90", "--ptxas-options=-v")
    assert code.startswith(b"\x7fELF")
    found = re.findall(r"Used (\d+) registers", said)
    assert [int(one) for one in found] == [MOST_REGISTERS]


def test_a_kernel_that_is_wrong_is_refused() -> None:
    with pytest.raises(nvrtc.GpuError, match=r"(?s)cannot compile the engine.*members\.cu\(1\): error"):
        nvrtc.compiled("wrong", {}, "compute_90")


def test_what_a_gpu_cannot_do_the_processors_do_and_say_so() -> None:
    with pytest.warns(SimulationWarning, match="trajectories are asked for"):
        found = simulate_ensemble(
            cases.KANG, SAWTOOTH, 0.02, parameters=PARAMETERS, times=[0.01, 0.02], engine="cuda"
        )
    assert "end_effector_position" in found


def test_without_a_gpu_the_processors_do_it_and_say_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuda, "DRIVER", "libnothing.so.1")
    for cached in (cuda.driver, cuda.missing, cuda._device):
        cached.cache_clear()
    say: dict[str, Any] = {"match": r"there is no NVIDIA GPU that can be used \(.*libnothing\.so\.1"}
    with pytest.warns(SimulationWarning, **say):
        simulate_ensemble(cases.KANG, SAWTOOTH, 0.02, parameters=PARAMETERS, engine="cuda")
    monkeypatch.setattr(nvrtc, "library", lambda: None)
    cuda.missing.cache_clear()
    assert cuda.missing() == "NVRTC is not installed (extra stickslip[cuda])"
    cuda.missing.cache_clear()


@pytest.mark.usefixtures("no_compiler")
def test_a_law_that_runs_as_python_is_refused() -> None:
    plant = CASES["an amplifier"].plant
    with pytest.raises(
        TypeError, match="the law Lag cannot run on a GPU: its functions cannot be translated"
    ):
        cuda_source.layout(plant, values_of(plant))
