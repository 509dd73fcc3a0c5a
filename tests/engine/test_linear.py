"""Linear algebra of orbits, in C, against NumPy's."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import pytest

from engine.library import built

DECLARED = """
void go(int n, const double *J, const double *defect, const double *scale, int bodies, double least,
        double *a, int *order, double *x);
double grow(int n, const double *J, const double *scale, int squarings, double *a, double *b);
"""
WRITTEN = f"""
#include "linear.h"
{DECLARED}
void go(int n, const double *J, const double *defect, const double *scale, int bodies, double least,
        double *a, int *order, double *x)
{{
    to_orbit(n, J, defect, scale, bodies, least, a, order, x);
}}
double grow(int n, const double *J, const double *scale, int squarings, double *a, double *b)
{{
    return spectral_radius(n, J, scale, squarings, a, b);
}}
"""


class Linear:
    """Both functions on arrays."""

    def __init__(self, folder: Path) -> None:
        self.ffi = cffi.FFI()
        self.ffi.cdef(DECLARED)
        self.library: Any = self.ffi.dlopen(str(built(folder, of=WRITTEN)))

    def given(self, values: np.ndarray) -> Any:
        return self.ffi.cast("double *", self.ffi.from_buffer(np.ascontiguousarray(values, float)))

    def to_orbit(
        self, jacobian: np.ndarray, defect: np.ndarray, scale: np.ndarray, bodies: int, least: float
    ) -> np.ndarray:
        n, x = defect.size, np.empty(defect.size)
        held = [np.ascontiguousarray(one, float) for one in (jacobian, defect, scale)]
        room, order = self.ffi.new(f"double[{n * n}]"), self.ffi.new(f"int[{n}]")
        numbers = [self.given(one) for one in held]
        self.library.go(n, *numbers, bodies, least, room, order, self.given(x))
        return x

    def spectral_radius(self, jacobian: np.ndarray, scale: np.ndarray) -> float:
        n = scale.size
        held = [np.ascontiguousarray(one, float) for one in (jacobian, scale)]
        rooms = [self.ffi.new(f"double[{n * n}]") for _ in range(2)]
        return self.library.grow(n, *[self.given(one) for one in held], 40, *rooms)


@pytest.fixture(scope="module")
def linear(tmp_path_factory: pytest.TempPathFactory) -> Linear:
    return Linear(tmp_path_factory.mktemp("linear"))


@pytest.mark.parametrize("n", [1, 2, 5, 8])
@pytest.mark.parametrize("least", [0.0, 1e-5])
def test_the_way_to_an_orbit_is_the_solution_of_a_linear_system(linear: Linear, n: int, least: float) -> None:
    random = np.random.default_rng(n)
    jacobian, defect, scale = random.normal(size=(n, n)), random.normal(size=n), np.exp(random.normal(size=n))
    if n > 1:
        jacobian[0, 0] = 1.0  # the first pivot is elsewhere
    found = linear.to_orbit(jacobian, defect, scale, n // 2, least)
    np.testing.assert_allclose(found, np.linalg.solve(np.eye(n) - jacobian, defect), rtol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 5, 8])
def test_the_largest_multiplier_is_the_largest_eigenvalue(linear: Linear, n: int) -> None:
    random = np.random.default_rng(n)
    jacobian, scale = random.normal(size=(n, n)), np.exp(random.normal(size=n))
    largest = np.abs(np.linalg.eigvals(jacobian)).max()
    assert linear.spectral_radius(jacobian, scale) == pytest.approx(largest, rel=1e-9)
    assert linear.spectral_radius(np.zeros((n, n)), scale) == 0.0


@pytest.mark.parametrize(("bodies", "least"), [(2, 0.0), (2, 1e-5), (0, 0.0)])
def test_without_an_orbit_the_way_is_infinite(linear: Linear, bodies: int, least: float) -> None:
    assert linear.to_orbit(np.eye(2), np.ones(2), np.ones(2), bodies, least).tolist() == [math.inf] * 2


@pytest.mark.parametrize("scale", [(1.0, 1e-3, 2.0, 1e2), (1e4, 3e4, 2.0, 1.0)])
def test_what_a_period_does_not_change_stays(linear: Linear, scale: tuple[float, ...]) -> None:
    """Of four states, two of bodies, one combination is kept for ever; the others go as the defect says.
    Bodies never stay, however little they change in metres."""
    random = np.random.default_rng(5)
    kept, forgets = random.normal(size=(4, 1)), random.normal(size=(3, 4))
    forgets -= forgets @ kept @ kept.T / float(np.sum(kept**2))  # blind to what is kept
    rest = random.normal(size=(4, 3)) @ forgets
    defect = rest @ random.normal(size=4)
    x = linear.to_orbit(np.eye(4) - rest, defect, np.array(scale), 2, 1e-9)
    np.testing.assert_allclose(rest @ x, defect, rtol=1e-9)
    assert np.count_nonzero(x) == 3
    assert np.all(x[:2] != 0.0)
