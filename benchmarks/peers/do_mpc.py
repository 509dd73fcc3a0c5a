"""do-mpc: a model predictive controller that knows the linear plant and sees its whole state.

Reads a problem as JSON on standard input, see `benchmarks.control_mpc`; writes for each plant the positions
[m] and the time of an update [s].
"""

from __future__ import annotations

import json
import sys
import time
from importlib.metadata import version

import do_mpc
import numpy as np

UNIT = 1e-6  # m, of the states: solvers want numbers of about one


def controller(problem: dict) -> do_mpc.controller.MPC:
    """For the first plant: the squared error over the horizon, and a little of the change of the voltage."""
    a, b, c = (np.array(problem["plants"][0][name]) for name in "abc")
    model = do_mpc.model.Model("discrete")
    x = model.set_variable("_x", "x", (b.size, 1))
    u = model.set_variable("_u", "u")
    model.set_rhs("x", a @ x + b.reshape(-1, 1) * u)
    model.set_expression("off", (c.reshape(1, -1) @ x - problem["target"] / UNIT) ** 2)
    model.setup()
    made = do_mpc.controller.MPC(model)
    made.set_param(n_horizon=problem["horizon"], t_step=1.0 / problem["rate"], store_full_solution=False)
    made.settings.supress_ipopt_output()
    made.set_objective(mterm=model.aux["off"], lterm=model.aux["off"])
    made.set_rterm(u=problem["weight"])
    made.bounds["lower", "_u", "u"], made.bounds["upper", "_u", "u"] = problem["volts"]
    made.setup()
    return made


def run(problem: dict, plant: dict) -> dict:
    """Tick by tick from rest at 0 V."""
    made = controller(problem)
    a, b, c = (np.array(plant[name]) for name in "abc")
    state = np.array(plant["start"])
    # Velocities and positions in the unit of the model; what is on its way is in V.
    made.x0 = state
    made.u0 = np.zeros(1)
    made.set_initial_guess()
    positions, spent = [], []
    for _ in range(problem["ticks"]):
        positions.append(float(c @ state) * UNIT)
        begun = time.process_time()
        put = float(made.make_step(state.reshape(-1, 1))[0, 0])
        spent.append(time.process_time() - begun)
        state = a @ state + b * put
    return {"positions": positions, "seconds": float(np.median(spent))}


if __name__ == "__main__":
    asked = json.load(sys.stdin)
    found = [run(asked, one) for one in asked["plants"]]
    json.dump({"version": version("do-mpc"), "found": found}, sys.stdout)
