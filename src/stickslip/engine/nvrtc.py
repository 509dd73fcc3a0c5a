"""NVRTC, NVIDIA's compiler of CUDA C++, which comes as a wheel and needs no GPU."""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path
from typing import Any

from cffi import FFI

ffi = FFI()
ffi.cdef("""
int nvrtcCreateProgram(void **program, const char *source, const char *name, int count,
                       const char *const *headers, const char *const *names);
int nvrtcCompileProgram(void *program, int count, const char *const *options);
int nvrtcDestroyProgram(void **program);
int nvrtcGetProgramLogSize(void *program, size_t *size);
int nvrtcGetProgramLog(void *program, char *log);
int nvrtcGetPTXSize(void *program, size_t *size);
int nvrtcGetPTX(void *program, char *text);
int nvrtcGetCUBINSize(void *program, size_t *size);
int nvrtcGetCUBIN(void *program, char *image);
int nvrtcGetNumSupportedArchs(int *count);
int nvrtcGetSupportedArchs(int *archs);
""")
PACKAGE = "nvidia.cuda_nvrtc"  # Python package of NVIDIA's wheel; `_FILES` are paths of the library in it
_FILES = ("lib/libnvrtc.so.12", "bin/nvrtc64_120_0.dll")
# Options of NVRTC. Fused multiply-add is off, so that results round as on processors. Warning 177, about
# unused functions and constants, is off, because each layout of plants has some.
OPTIONS = ("-default-device", "-std=c++20", "-fmad=false", "-diag-suppress=177")


class GpuError(RuntimeError):
    """Error: the GPU, its driver or its compiler NVRTC failed; the message contains the reason that they
    give."""


@functools.cache
def library() -> Any:
    """Return NVRTC, opened as a library; None where it is not installed."""
    try:
        found = importlib.util.find_spec(PACKAGE)
    except ModuleNotFoundError:
        return None
    folders = (found.submodule_search_locations or ()) if found else ()
    files = [Path(folder, file) for folder in folders for file in _FILES]
    return next((ffi.dlopen(str(file)) for file in files if file.exists()), None)


def architectures() -> list[int]:
    """Return the compute capabilities that NVRTC compiles for, ascending: 90 is 9.0."""
    count: Any = ffi.new("int *")
    _checked(library().nvrtcGetNumSupportedArchs(count))
    found: Any = ffi.new("int[]", count[0])
    _checked(library().nvrtcGetSupportedArchs(found))
    return sorted(found)


def compiled(source: str, headers: dict[str, str], target: str, *options: str) -> tuple[bytes, str]:
    """Compile a kernel.

    Args:
        source: CUDA C++.
        headers: text of each header that it includes, by name.
        target: "sm_90" for a GPU's own code (cubin), "compute_90" for PTX, which a driver compiles.
        options: further options of NVRTC.

    Returns:
        A pair: the compiled code (cubin or PTX), and the messages of the compiler.

    Raises:
        GpuError: the source is not valid, or NVRTC fails.
    """
    lib = library()
    names, texts = _texts(headers), _texts(headers.values())
    program: Any = ffi.new("void **")
    _checked(
        lib.nvrtcCreateProgram(program, source.encode(), b"members.cu", len(headers), texts[0], names[0])
    )
    try:
        given, _ = kept = _texts([*OPTIONS, f"-arch={target}", *options])
        outcome = lib.nvrtcCompileProgram(program[0], len(kept[1]), given)
        log = _read(lib.nvrtcGetProgramLogSize, lib.nvrtcGetProgramLog, program[0]).rstrip(b"\0").decode()
        if outcome != 0:
            raise GpuError(f"NVRTC cannot compile the engine: {log}")
        if target.startswith("sm_"):
            return _read(lib.nvrtcGetCUBINSize, lib.nvrtcGetCUBIN, program[0]), log
        return _read(lib.nvrtcGetPTXSize, lib.nvrtcGetPTX, program[0]), log
    finally:
        lib.nvrtcDestroyProgram(program)


def _texts(given: Any) -> tuple[Any, list[Any]]:
    """Return texts as a C array of strings, and a list of objects that must exist as long as the array."""
    kept = [ffi.new("char[]", one.encode()) for one in given]
    return ffi.new("char *[]", kept), kept


def _read(size_of: Any, fill: Any, program: Any) -> bytes:
    size: Any = ffi.new("size_t *")
    _checked(size_of(program, size))
    found: Any = ffi.new("char[]", size[0])
    _checked(fill(program, found))
    memory: Any = ffi.buffer(found, size[0])
    return bytes(memory)


def _checked(outcome: int) -> None:
    if outcome != 0:
        raise GpuError(f"NVRTC fails with error {outcome} (see nvrtcResult in nvrtc.h)")
