"""GNU Octave: lsode (ODEPACK) and ode15s (SUNDIALS). It times itself; its start is not counted."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from .. import problems
from ..problems import DAMPING, DRIVE, PERIOD, PERIODS, SAMPLES, SLOPE, STIFFNESS
from ..worker import Case, Timed, serve

PROGRAM = """
1;
function d = rates (t, q)
  v = q(2) - q(5);
  g = {coulomb} + {excess} * exp (-(v / {stribeck})^2);
  dz = v - {sigma_0} * abs (v) / g * q(3);
  force = {sigma_0} * q(3) + {sigma_1} * dz;
  d = [q(2); {drive} * t - {damping} * q(2) - {stiffness} * q(1); dz; q(5); force / {mass}];
end
tau = linspace (0, {period}, {samples} + 1);
scale = {scale}';
if (strcmp ("{method}", "lsode"))
  lsode_options ("relative tolerance", {tolerance});
  lsode_options ("absolute tolerance", {tolerance} * scale);
  lsode_options ("step limit", 1000000);
else
  options = odeset ("RelTol", {tolerance}, "AbsTol", {tolerance} * scale);
end
q = zeros (5, 1);
x = 0;
clock = tic; cpu = cputime;
for k = 1:{periods}
  if (strcmp ("{method}", "lsode"))
    s = lsode (@(q, t) rates (t, q), q, tau);
  else
    [t, s] = {method} (@rates, tau, q, options);
  end
  x = [x; s(2:end, 4)];
  q = s(end, :)';
end
printf ("%.17g\\n", cputime - cpu, toc (clock), x);
"""


def simulator(problem: str, method: str, tolerance: float) -> Callable[[], Timed]:
    octave = shutil.which("octave-cli")
    if octave is None:
        raise FileNotFoundError("octave-cli is not installed")
    p = problems.PROBLEMS[problem]
    program = PROGRAM.format(
        **p._asdict() | {"scale": list(p.scale)},
        coulomb=p.coulomb_force,
        excess=p.stiction_force - p.coulomb_force,
        stribeck=p.stribeck_velocity,
        drive=DRIVE * SLOPE,
        damping=DAMPING,
        stiffness=STIFFNESS,
        period=PERIOD,
        periods=PERIODS,
        samples=SAMPLES,
        method=method,
        tolerance=tolerance,
    )

    def run() -> Timed:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "run.m"
            file.write_text(program)
            done = subprocess.run(
                [octave, "--no-gui", "--quiet", "--no-window-system", file],
                capture_output=True,
                text=True,
                check=True,
                timeout=60,
            )
        cpu, wall, *positions = map(float, done.stdout.split())
        return Timed(np.array(positions), cpu, wall)

    return run


def trajectory() -> Iterator[Case]:
    for problem, method in (("P1", "lsode"), ("P1", "ode15s"), ("P2", "ode15s")):
        make = partial(simulator, problem, method, 3e-6)
        yield Case("GNU Octave", method, "rtol 3e-06", problem, make, partial(problems.error, problem))


if __name__ == "__main__":
    serve({"trajectory": trajectory}, [])
