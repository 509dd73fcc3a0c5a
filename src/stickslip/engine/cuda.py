"""Integrate the members of an ensemble on a GPU, one thread each, with the equations and steps of the
processors.

The engine's own C is compiled by NVRTC for each layout of plants, and runs through NVIDIA's driver.
"""

from __future__ import annotations

import functools
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from cffi import FFI
from numpy.typing import NDArray

from . import nvrtc
from .binding import Array
from .cuda_source import THREADS, headers, kernel, layout, refused
from .library import SOURCES
from .members import Integers
from .nvrtc import GpuError

__all__ = ["AT_ONCE", "integrate_members", "missing", "refused"]

# Number of blocks of members that are processed at the same time: the GPU integrates one, while the processor
# prepares the next.
AT_ONCE = 2
DRIVER = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
# Constants of cuda.h: flag of a stream that runs beside the default one, and numbers of the two attributes of
# a device that give its compute capability.
_NON_BLOCKING, _MAJOR, _MINOR = 1, 75, 76

ffi = FFI()
ffi.cdef(
    """
typedef double real_t;
typedef unsigned long long address;
int cuInit(unsigned int flags);
int cuGetErrorString(int outcome, const char **text);
int cuDeviceGet(int *device, int number);
int cuDeviceGetAttribute(int *value, int attribute, int device);
int cuDevicePrimaryCtxRetain(void **context, int device);
int cuCtxSetCurrent(void *context);
int cuModuleLoadData(void **module, const void *image);
int cuModuleGetFunction(void **function, void *module, const char *name);
int cuStreamCreate(void **stream, unsigned int flags);
int cuStreamSynchronize(void *stream);
int cuStreamDestroy_v2(void *stream);
int cuMemAlloc_v2(address *memory, size_t size);
int cuMemFree_v2(address memory);
int cuMemcpyHtoDAsync_v2(address to, const void *from, size_t size, void *stream);
int cuMemcpyDtoHAsync_v2(void *to, address from, size_t size, void *stream);
int cuLaunchKernel(void *function, unsigned int grid_x, unsigned int grid_y, unsigned int grid_z,
                   unsigned int block_x, unsigned int block_y, unsigned int block_z, unsigned int shared,
                   void *stream, void **arguments, void **further);
"""
    + "\n".join(
        line for line in (SOURCES / "gpu.h").read_text("ascii").splitlines() if not line.startswith("#")
    )
)
_COMPILING = threading.Lock()


@functools.cache
def missing() -> str:
    """Return the reason why this machine cannot run the engine on a GPU; "" if it can."""
    if nvrtc.library() is None:
        return "NVRTC is not installed (extra stickslip[cuda])"
    try:
        _device()
    except (OSError, GpuError) as error:
        return f"there is no NVIDIA GPU that can be used ({error})"
    return ""


def integrate_members(
    plant: Any,
    drives: tuple[Any, Integers, Any],
    values: Array,
    states: Array,
    spans: Array,
    tolerance: float,
    careful: bool,
    max_steps: int,
    results: tuple[Integers, Array, Integers],
) -> None:
    """Integrate many trajectories on a GPU, one thread each.

    Args:
        plant: any of the plants, all of one layout.
        drives: tables of the members (`waveform.members.Drives`), the index of each member's table, and the
            load.
        values: numbers of each plant, see `members.ComposedMembers`.
        states, spans, tolerance, careful, max_steps: see `members.integrate_members`.
        results: three arrays [members] that are filled in place, as the states are: outcomes (members that
            are not DONE at the start are left out), times reached [s], and steps tried.

    Raises:
        GpuError: the GPU, its driver or its compiler failed.
        TypeError: a law of the plant runs on processors only.
    """
    text, numbers = layout(plant, values)
    tables, which, load = drives
    with _COMPILING:
        function = _function(text)
    with _Memory.opened() as memory:
        task: Any = ffi.new("struct gpu_members *")
        task.count, task.tolerance, task.careful, task.max_steps = len(values), tolerance, careful, max_steps
        task.numbers, task.which = memory.sent(numbers), memory.sent(which)
        task.spans = memory.sent(spans)
        _fill_table(task.drives, tables, memory)
        _fill_table(task.load, load, memory)
        names, columns = ("states", "outcomes", "reached", "steps"), (states, *results)
        for name, column in zip(names, columns, strict=True):
            setattr(task, name, memory.sent(column))
        arguments: Any = ffi.new("void *[]", [task])
        grid = -(-len(values) // THREADS)
        launch = (function, grid, 1, 1, THREADS, 1, 1, 0, memory.stream, arguments, ffi.NULL)
        _call("cuLaunchKernel", *launch)
        for name, column in zip(names, columns, strict=True):
            memory.received(getattr(task, name), column)
        _call("cuStreamSynchronize", memory.stream)


def _fill_table(to: Any, table: Any, memory: _Memory) -> None:
    """Copy a segment table (`waveform.drive.Drive`), or the tables of many drives
    (`waveform.members.Drives`), to the GPU, and store sizes and addresses of the arrays in the C struct
    `to`."""
    to.segments, to.harmonics = table.start.shape[-1], table.harmonic.shape[-2]
    for name in ("start", "polynomial", "harmonic", "first"):
        dtype = np.int64 if name == "first" else np.float64
        setattr(to, name, memory.sent(np.asarray(getattr(table, name), dtype)))


class _Memory:
    """Arrays in the memory of the GPU, and the stream through which they are copied."""

    def __init__(self) -> None:
        self.stream: Any = ffi.NULL
        self._addresses: list[int] = []
        self._sent: list[Any] = []  # arrays that must exist until the stream has copied them

    @classmethod
    @contextmanager
    def opened(cls) -> Iterator[_Memory]:
        """Yield GPU memory and a stream for one launch; both are freed at the end."""
        made = cls()
        _call("cuCtxSetCurrent", _device()[0])  # the driver needs this call in each thread
        made.stream = _got("void **", "cuStreamCreate", _NON_BLOCKING)
        try:
            yield made
        finally:
            driver().cuStreamSynchronize(made.stream)
            for address in made._addresses:
                driver().cuMemFree_v2(address)
            driver().cuStreamDestroy_v2(made.stream)

    def sent(self, array: NDArray[Any]) -> Any:
        """Copy an array to new memory of the GPU; return the pointer to the copy."""
        array = np.ascontiguousarray(array)
        address = _got("address *", "cuMemAlloc_v2", max(array.nbytes, 8))
        self._addresses.append(address)
        self._sent.append(array)
        _call("cuMemcpyHtoDAsync_v2", address, _bytes(array), array.nbytes, self.stream)
        kind = "int64_t *" if array.dtype == np.int64 else "real_t *"
        return ffi.cast(kind, address)

    def received(self, pointer: Any, array: NDArray[Any]) -> None:
        """Copy memory of the GPU, from `pointer` on, into `array`; complete only after the stream is
        synchronised."""
        _call("cuMemcpyDtoHAsync_v2", _bytes(array), ffi.cast("address", pointer), array.nbytes, self.stream)


def _bytes(array: NDArray[Any]) -> Any:
    return ffi.cast("void *", array.ctypes.data)


@functools.cache
def driver() -> Any:
    """Return NVIDIA's driver, opened as a library.

    Raises:
        OSError: it is not installed.
    """
    return ffi.dlopen(DRIVER)


@functools.cache
def _device() -> tuple[Any, int]:
    """Return the context of the first GPU, and its compute capability as a number: 90 is 9.0."""
    _call("cuInit", 0)
    device = _got("int *", "cuDeviceGet", 0)
    major, minor = (_got("int *", "cuDeviceGetAttribute", what, device) for what in (_MAJOR, _MINOR))
    return _got("void **", "cuDevicePrimaryCtxRetain", device), 10 * major + minor


@functools.cache
def _function(text: str) -> Any:
    """Return the compiled kernel, as a function of the driver, for the layout of plants that `text`, the
    header layout.h, describes. Each layout is compiled once per process."""
    context, capability = _device()
    _call("cuCtxSetCurrent", context)
    known = max((one for one in nvrtc.architectures() if one <= capability), default=capability)
    target = f"{'sm' if known == capability else 'compute'}_{known}"
    image, _ = nvrtc.compiled(kernel(), {**headers(), "layout.h": text}, target)
    module = _got("void **", "cuModuleLoadData", ffi.from_buffer(image))
    return _got("void **", "cuModuleGetFunction", module, b"stickslip_gpu_members")


def _got(kind: str, name: str, *arguments: Any) -> Any:
    """Call a function of the driver that writes a result through its first argument, a pointer of the C type
    `kind`; return the result. Raises GpuError if the function fails."""
    found: Any = ffi.new(kind)
    _call(name, found, *arguments)
    return found[0]


def _call(name: str, *arguments: Any) -> None:
    outcome = getattr(driver(), name)(*arguments)
    if outcome != 0:
        text: Any = ffi.new("char **")
        driver().cuGetErrorString(outcome, text)
        known: Any = ffi.string(text[0]) if text[0] else b"an error that it does not name"
        raise GpuError(f"{name} of NVIDIA's driver fails: {known.decode()} ({outcome})")
