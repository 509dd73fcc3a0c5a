"""Functions inside the engine, which only a test calls: ``inner.c``, built for it."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine import library
from simulation.plant.layouts import U
from stickslip.engine._abi import ffi
from stickslip.engine.binding import ComposedPlant, DriveTable
from stickslip.simulation.plant.system import Plant

Array = NDArray[np.float64]


class Inner:
    """Functions inside the engine, with a plant and arrays."""

    def __init__(self, opened: ctypes.CDLL) -> None:
        self._opened = opened

    def __call__(self, name: str, plant: Plant, *given: Any) -> float:
        composed = ComposedPlant(plant)
        return self.plain(name, composed, *given)

    def plain(self, name: str, *given: Any) -> float:
        """Call a function without a plant."""
        function = getattr(self._opened, f"inner_{name}")
        function.restype = ctypes.c_double
        return function(*map(_as_c, given))

    def slope(
        self, plant: Plant, sides: Array, branches: Array, q: Array, normal: Any
    ) -> tuple[Array, Array]:
        dq, force = np.zeros(q.size), np.zeros(len(plant.elements))
        self("slope", plant, sides, branches, q, np.array(U), np.array(normal), dq, force)
        return dq, force

    def solve(
        self, plant: Plant, sides: Array, branches: Array, q: Array, normal: Any, per_g: float, r: Array
    ) -> tuple[Array, Array, Array, Array]:
        x, t, weights, fast = (np.zeros(q.size) for _ in range(4))
        fast = np.zeros(len(plant.elements))
        u, load = np.array(U), np.array(normal)
        self("solve", plant, sides, branches, q, u, load, per_g, r, x, t, weights, fast)
        return x, t, weights[2 * len(plant.modes) :], fast


def _as_c(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return ctypes.c_void_p(value.ctypes.data)
    if isinstance(value, int):
        return ctypes.c_int64(value)
    if isinstance(value, ComposedPlant | DriveTable):
        address: Any = ffi.cast("uintptr_t", value.struct)
        return ctypes.c_void_p(int(address))
    return ctypes.c_double(value) if isinstance(value, float) else value


def opened(folder: Path) -> Inner:
    """Build and open the functions."""
    text = Path(__file__).with_name("inner.c").read_text()
    built = library.built(folder, "-O0", "-Wall", "-Wextra", "-Werror", of=text)
    return Inner(ctypes.CDLL(str(built)))
