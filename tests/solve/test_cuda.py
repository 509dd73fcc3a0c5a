"""The GPU's engine in Numba's simulator, in a process of its own: the members must be those of the CPU."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from stickslip.actuator import Actuator
from stickslip.friction import LuGre
from stickslip.simulation import SimulationWarning, simulate_ensemble
from stickslip.waveform.periodic import Sawtooth

MODEL = Actuator(0.1057e-6, 3303.1, 0.524, 0.2, 0.1, LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.65))
PARAMETERS = {
    "sigma_0": [1e6, 1.4e6, -1.0, 3e6],
    "end_effector_mass": [0.1, 0.2, 0.1, 0.05],
    "amplitude": [65.0, 40.0, 65.0, 90.0],  # so that each has a table of its own
}


def on_the_simulator() -> dict[str, dict[str, list]]:
    """By the GPU's simulator, whose arrays are none that Numba compiles for, and by the processors."""
    code = f"""
import json, warnings
warnings.simplefilter("error")
from stickslip.actuator import Actuator
from stickslip.friction import LuGre
from stickslip.simulation import simulate_ensemble
from stickslip.waveform.periodic import Sawtooth
model = Actuator(0.1057e-6, 3303.1, 0.524, 0.2, 0.1, LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.65))
found = {{}}
for engine in ("cpu", "cuda"):
    one = simulate_ensemble(model, Sawtooth(65.0, 50.0), 0.08, parameters={PARAMETERS!r}, engine=engine)
    found[engine] = {{name: one[name].values.tolist() for name in ("net_displacement", "status", "steps")}}
print(json.dumps(found))
"""
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.compiled
def test_the_simulated_gpu_takes_the_steps_of_the_cpu() -> None:
    found = on_the_simulator()
    assert found["cuda"]["status"] == [0, 0, 4, 0]
    # The processors' engine is C, which rounds in another order: the same steps, other last bits.
    assert found["cuda"]["status"] == found["cpu"]["status"]
    assert found["cuda"]["steps"] == found["cpu"]["steps"]
    np.testing.assert_allclose(
        found["cuda"]["net_displacement"], found["cpu"]["net_displacement"], rtol=0, atol=1e-12
    )


def test_what_a_gpu_cannot_do_the_processors_do_and_say_so() -> None:
    with pytest.warns(SimulationWarning, match="trajectories are asked for"):
        found = simulate_ensemble(
            MODEL, Sawtooth(65.0, 50.0), 0.02, parameters=PARAMETERS, times=[0.01, 0.02], engine="cuda"
        )
    assert "end_effector_position" in found
