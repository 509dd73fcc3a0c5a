"""No call of a user waits for a compiler: none is started, and Numba is not imported."""

from __future__ import annotations

import subprocess
import sys

import pytest

BEGIN = """
import subprocess, sys
import numpy as np

subprocess.Popen = None
import stickslip as ss

a = ss.load_actuator("kang2007-hysteresis" if "piezo" in sys.argv else "kang2007")
w = ss.Sawtooth(amplitude=65.0, frequency=50.0)
"""
CALLS = """
ss.simulate(a, w, 0.1, energy=True)
assert "scipy.signal" not in sys.modules  # as long to import as all the rest
ss.simulate(a, ss.Sine(40.0, 50.0, offset=40.0), 0.1)
ss.simulate_ensemble(a, w, 0.1, parameters={"sigma_0": [1e6, 2e6], "amplitude": [30.0, 60.0]})
ss.steady_step(a, w)
ss.steady_steps(a, w, parameters={"frequency": [20.0, 50.0]})
ss.simulation.sensitivities(a, w, 0.1, parameters=["sigma_0", "amplitude"])
ss.simulation.steady_step_derivatives(a, w, parameters=["sigma_0", "amplitude"])
t = np.linspace(0.0, 1.0, 99)
ss.simulation.friction_response(a.friction, t, 1e-6 * np.sin(9.0 * t))
assert "numba" not in sys.modules
"""


@pytest.mark.parametrize("model", ["stage", "piezo"])
def test_nothing_is_compiled_at_run_time(model: str) -> None:
    code = BEGIN + CALLS
    done = subprocess.run([sys.executable, "-c", code, model], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
