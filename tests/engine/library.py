"""The engine built with a few laws of the tests, and called as the former engine is: `periods.integrate`."""

from __future__ import annotations

import ctypes
import subprocess
from ctypes import POINTER, Structure, c_char_p, c_double, c_int, c_int32, c_int64, c_uint32, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.engine import laws
from stickslip.engine.translator import Translation
from stickslip.friction import element, elements
from stickslip.plant.system import Plant
from stickslip.waveform.drive import Drive

Array = NDArray[np.float64]

C = Path(laws.__file__).parent / "c"
LARGEST = 16  # modes, and elements
WARNINGS = ["-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Wshadow", "-Werror"]
STRICT = ["-std=c99", "-ffp-contract=off", "-fPIC", "-shared"]
SHARES = ("velocity", "push", "position", "feed")


def _fields(kind: Any, names: str) -> list[tuple[str, Any]]:
    return [(name, kind) for name in names.split()]


class _Law(Structure):
    _fields_ = (
        ("name", c_char_p),
        *_fields(c_int, "parameters smooth period"),
        *_fields(c_void_p, "rate breakaway project tick choose branch_rate left"),
    )


class _Mode(Structure):
    _fields_ = _fields(c_double, "stiffness damping drive acceleration")


class _Element(Structure):
    _fields_ = (
        *_fields(c_void_p, "law parameters along"),
        *_fields(c_double * LARGEST, " ".join(SHARES)),
        *_fields(c_double, "normal drive drive_rate"),
        *_fields(c_int32, "states loaded follows positioned fed"),
        *_fields(c_uint32, "felt pushed"),
        *_fields(c_int32, "first place pinned"),
    )


class _Plant(Structure):
    _fields_ = (
        *_fields(c_int32, "modes elements"),
        ("rate", c_double),
        ("mode", _Mode * LARGEST),
        ("element", _Element * LARGEST),
        *_fields(c_int32, "states statics loaded branched sampled follows plain"),
    )


class _Table(Structure):
    _fields_ = (("segments", c_int64), *_fields(c_void_p, "start polynomial first harmonic"))


class _Task(Structure):
    _fields_ = (
        *_fields(c_void_p, "plant drive load state"),
        *_fields(c_double, "begin end tolerance"),
        *_fields(c_int64, "max_steps count"),
        *_fields(c_void_p, "times samples account resume stop"),
        ("careful", c_int32),
    )


class _Result(Structure):
    _fields_ = (("reached", c_double), *_fields(c_int64, "accepted rejected"))


def source(own: list[type]) -> str:
    """The laws of the package, and those of the tests."""
    made = Translation()
    found = [laws.law_c(made, laws.of_numbers(law)) for law in own]
    names = "".join(f", &law_{law.__name__}" for law in own)
    every = [f"&law_{law.__name__}" for law in laws.packaged()]
    head = '#include "laws.h"\n' + made.text() + "\n".join(found)
    return f"{head}\nconst struct law *const every_law[] = {{{', '.join(every)}{names}}};\n"


class Engine:
    """The library, in a folder.

    Args:
        folder: what is built there.
        own: laws of the tests.
        flags: for the compiler.
    """

    def __init__(self, folder: Path, own: list[type], *flags: str) -> None:
        (folder / "laws_of_tests.c").write_text(source(own))
        files = [str(C / "engine.c"), str(folder / "laws_of_tests.c")]
        made = folder / "engine.so"
        subprocess.run(["cc", *STRICT, *flags, f"-I{C}", *files, "-o", str(made), "-lm"], check=True)
        self.library = ctypes.CDLL(str(made))
        self.library.stickslip_resume_size.restype = c_int64
        count = len(laws.packaged()) + len(own)
        table = (POINTER(_Law) * count).in_dll(self.library, "every_law")
        self.laws = {one.contents.name.decode(): one.contents for one in table}
        self.stop = c_int32(0)

    def plant(self, of: Plant) -> tuple[_Plant, list[Array]]:
        """A plant as the engine takes it, and the arrays that it points to."""
        made, arrays = _Plant(modes=len(of.modes), elements=len(of.elements), rate=of.rate), []
        for m, mode in enumerate(of.modes[:LARGEST]):
            made.mode[m] = _Mode(*mode)
        for e, one in enumerate(of.elements[:LARGEST]):
            arrays += self._element(made.element[e], one)
        return made, arrays

    def _element(self, made: Any, one: Any) -> list[Array]:
        states = elements(one.law)
        records = [element(one.law, i) for i in range(max(states, 1))]
        arrays = [np.array([laws.row(record) for record in records])]
        made.law = ctypes.addressof(self.laws[type(records[0]).__name__])
        made.parameters = arrays[0].ctypes.data
        if one.along is not None:
            arrays.append(np.array(laws.row(one.along)))
            made.along = arrays[1].ctypes.data
        for name in SHARES:
            for k, share in enumerate(getattr(one, name) or ()):
                getattr(made, name)[k] = share or 0.0
        made.normal, made.drive, made.drive_rate = one.normal, one.drive or 0.0, one.drive_rate or 0.0
        made.states, made.loaded = states, one.loaded is not None
        made.follows, made.positioned, made.fed = (
            one.drive_rate is not None,
            bool(one.position),
            bool(one.feed),
        )
        made.felt, made.pushed = (
            sum(1 << m for m, share in enumerate(shares) if share is not None)
            for shares in (one.velocity, one.push)
        )
        return arrays

    def resume_size(self, of: Plant) -> int:
        """How many numbers a row of continuation has."""
        plant, _ = self.composed(of)
        return self.library.stickslip_resume_size(ctypes.byref(plant))

    def composed(self, of: Plant) -> tuple[_Plant, list[Array]]:
        plant, arrays = self.plant(of)
        assert self.library.stickslip_compose(ctypes.byref(plant)) == 0
        return plant, arrays

    def integrate(
        self,
        of: Plant,
        drive: Drive,
        load: Drive,
        q: Array,
        span: Array,
        tolerance: float,
        careful: bool,
        max_steps: int,
        times: Array,
        samples: Array,
        resume: Array,
        account: Any,
    ) -> tuple[int, float, int, int]:
        """`stickslip.solve.periods.integrate`, by the engine."""
        plant, kept = self.composed(of)
        tables = [_table(one) for one in (drive, load)]
        result, address = _Result(), ctypes.addressof
        task = _Task(address(plant), address(tables[0][0]), address(tables[1][0]), q.ctypes.data)
        task.begin, task.end, task.tolerance, task.max_steps = span[0], span[1], tolerance, max_steps
        task.count, task.times, task.samples = times.size, times.ctypes.data, samples.ctypes.data
        task.account = None if account is None else account[2].ctypes.data
        task.resume = resume.ctypes.data if resume.size else None
        task.stop, task.careful = address(self.stop), int(careful)
        outcome = self.library.stickslip_integrate(ctypes.byref(task), ctypes.byref(result))
        del kept
        return outcome, result.reached, result.accepted, result.rejected


def _table(of: Drive) -> tuple[_Table, list[Any]]:
    arrays = [np.ascontiguousarray(array) for array in (of.start, of.polynomial, of.first, of.harmonic)]
    return _Table(of.start.size, *(array.ctypes.data for array in arrays)), arrays
