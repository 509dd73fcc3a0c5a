"""Trajectories by the engine: stored steps and positions, continuation, limits, and what sanitizers say."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from engine import cases
from engine.library import SANITIZED as CHECKED
from engine.library import WARNINGS, built, integrate
from engine.stored import EVERY, stored
from plants import Lag
from stickslip.engine import binding, compiled_law, laws
from stickslip.engine.outcome import DONE, TOO_MANY_STEPS

CASES, STORED = cases.cases(), stored("trajectories")
OWN = [Lag, cases.Integrator]
CLOSE = 1e-12  # m, what positions may differ by: rounding, which trajectories amplify


def followed(case: cases.Case, resume: np.ndarray | None = None) -> cases.Answer:
    return cases.answer(case, resume)


def answered(name: str) -> dict[str, np.ndarray]:
    """What is stored of a case."""
    found = followed(CASES[name])
    made = {"steps": np.array(found[:4]), "state": found.state, "samples": found.samples[::EVERY]}
    return made | ({"account": found.account[::EVERY]} if CASES[name].energy else {})


@pytest.mark.parametrize("name", CASES)
def test_as_stored(name: str) -> None:
    """The same steps, the same positions, outputs and work, up to rounding."""
    found, expected = answered(name), STORED[name]
    assert found.keys() == expected.keys()
    assert found["steps"].tolist() == pytest.approx(expected["steps"].tolist(), rel=1e-12)
    assert found["steps"][2] > 15
    positions = slice(0, 2 * len(CASES[name].plant.modes), 2)
    assert np.ptp(expected["samples"][:, positions]) > 1e-8
    for key in ("samples", "state"):
        ours, theirs = found[key][..., positions], expected[key][..., positions]
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=CLOSE)
    for key in ("samples", "account"):
        if key in found:
            scale = np.nanmax(np.abs(expected[key]), axis=0) + 1e-300
            np.testing.assert_allclose(found[key] / scale, expected[key] / scale, rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    "name",
    # A careful run of another length has another tolerance.
    [name for name in CASES if not CASES[name].careful],
)
def test_goes_on_to_the_last_bit(name: str) -> None:
    """A run that ends and is taken up again is the run over both, wherever it ended."""
    case = CASES[name]
    whole = followed(case)
    for share in (0.3, 0.55, 0.93):
        row = np.zeros(binding.ComposedPlant(case.plant).resume_size)
        followed(case._replace(end=share * case.end, energy=False), row)
        assert row[0] == 1.0
        assert 0.0 <= row[2] <= share * case.end
        rest = case.times[case.times > share * case.end]
        q, samples = np.full(case.state.size, np.nan), case.room[: rest.size]
        span, further = (0.0, case.end), (case.tolerance, case.careful, 200_000)
        outcome, *_ = integrate(
            case.plant, case.drive, case.load, q, span, *further, rest, samples, resume=row
        )
        assert outcome == DONE
        np.testing.assert_array_equal(q, whole.state)
        np.testing.assert_array_equal(samples, whole.samples[-rest.size :])


def test_samples_change_no_step() -> None:
    case = CASES["elastoplastic"]
    many, few = followed(case), followed(case._replace(samples=2))
    assert many[:4] == few[:4]
    np.testing.assert_array_equal(many.state, few.state)
    np.testing.assert_array_equal(many.samples[-1], few.samples[-1])


def test_gives_up_after_so_many_steps() -> None:
    case = CASES["elastoplastic"]
    samples, q = case.room, case.state.copy()
    span, further = (0.0, case.end), (case.tolerance, False, 20)
    outcome, reached, accepted, rejected = integrate(
        case.plant, case.drive, case.load, q, span, *further, case.times, samples
    )
    assert outcome == TOO_MANY_STEPS
    assert accepted + rejected == 20
    assert 0.0 < reached < case.end
    np.testing.assert_array_equal(np.isfinite(samples[:, 0]), case.times <= reached)


def test_says_that_a_plant_does_not_fit() -> None:
    lib, large = binding.library(), binding.ffi.new("struct plant *")
    large.modes = lib.LARGEST_MODES + 1
    assert lib.stickslip_compose(large) == lib.DOES_NOT_FIT


SANITIZED = """
import sys
from pathlib import Path

from engine import cases, test_near, test_orbits, test_trajectories
from engine.library import built
from stickslip.engine import compiled_law, library

library.FILE = built(Path(sys.argv[1]), *sys.argv[2:])
compiled_law.FLAGS += tuple(sys.argv[2:])
for case in cases.cases().values():
    assert test_trajectories.followed(case).accepted > 0
    for own in (False, True):
        assert test_near.Task(case).by_engine(own)[0][2] > 0
for law in test_orbits.LAWS.values():
    assert test_orbits.Task(law, "sawtooth").by_engine().periods[0] > 0
print("silent")
"""


def _runtime(name: str) -> str:
    found = subprocess.run(["cc", f"-print-file-name={name}"], capture_output=True, text=True, check=True)
    return found.stdout.strip()


def test_reaches_beyond_no_array_and_relies_on_nothing_undefined(tmp_path: Path) -> None:
    """The address and undefined-behaviour sanitizers end the process where they find something.

    Their build is not optimised; the compiler warns of nothing in it.
    """
    preload = " ".join(_runtime(name) for name in ("libasan.so", "libubsan.so"))
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(sys.path),
        "LD_PRELOAD": preload,
        "ASAN_OPTIONS": "detect_leaks=0",  # Python leaves memory to the end of its process
    }
    command = [sys.executable, "-c", SANITIZED, str(tmp_path), *CHECKED, *WARNINGS]
    found = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert (found.returncode, found.stdout) == (0, "silent\n"), found.stderr[-4000:]


def test_compiles_optimised_without_a_warning(tmp_path: Path) -> None:
    """Warnings differ with what the compiler looks through."""
    built(tmp_path, "-O2", *WARNINGS)
    for law in OWN:
        built(tmp_path, "-O2", *WARNINGS, of=compiled_law.source(laws.of_numbers(law), laws.LAW))
