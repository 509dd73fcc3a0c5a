"""A GPU that is the processor: the driver is `pretended.cpp`, and kernels are compiled by the C++ compiler.

What the GPU would compile is so run, with its type of numbers, by the Python that would drive the GPU.
"""

from __future__ import annotations

import itertools
import subprocess
from pathlib import Path

import pytest

from stickslip.engine import cuda, cuda_source, nvrtc

FLAGS = ("-std=c++20", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror")
# Of each layout some functions are not used; a test that is always true for it is no mistake.
UNUSED = [f"-Wno-{one}" for one in ("unused", "address", "type-limits", "missing-field-initializers")]
# What is set for each contact is not set where the compiler sees that there is none.
UNUSED += ["-Wno-maybe-uninitialized"]
BEFORE = """
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#define __global__
#define __noinline__
#define __launch_bounds__(threads, blocks)
static thread_local struct { unsigned x; } blockIdx, blockDim, threadIdx;
"""
AFTER = """
extern "C" void launch(unsigned grid, unsigned block, void **arguments)
{
    blockDim.x = block;
    for (blockIdx.x = 0; blockIdx.x < grid; blockIdx.x++)
        for (threadIdx.x = 0; threadIdx.x < block; threadIdx.x++)
            stickslip_gpu_members(*(const struct gpu_members *)arguments[0]);
}
"""


def built(folder: Path, source: str, headers: dict[str, str]) -> Path:
    """Compile a kernel for the processor."""
    for name, text in headers.items():
        if name not in cuda_source._STANDARD:
            file = folder / "engine" / "c" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.resolve().parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
    kernel = folder / "engine" / "c" / "members.cpp"
    kernel.write_text(BEFORE + source + AFTER)
    subprocess.run(["g++", *FLAGS, *UNUSED, kernel, "-o", kernel.with_suffix(".so")], check=True)
    return kernel.with_suffix(".so")


def install(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Put the pretended GPU in the place of NVIDIA's for a test."""
    driver = folder / "driver.so"
    source = Path(__file__).with_name("pretended.cpp")
    subprocess.run(["g++", *FLAGS, "-Wno-unused", source, "-o", driver], check=True)
    numbers = itertools.count()

    def compiled(source: str, headers: dict[str, str], target: str, *options: str) -> tuple[bytes, str]:
        assert target == "sm_90"
        return bytes(built(folder / str(next(numbers)), source, headers)) + b"\0", ""

    monkeypatch.setattr(cuda, "DRIVER", str(driver))
    monkeypatch.setattr(nvrtc, "compiled", compiled)
    monkeypatch.setattr(nvrtc, "library", lambda: True)
    monkeypatch.setattr(nvrtc, "architectures", lambda: [75, 90, 120])
    for cached in (cuda.driver, cuda.missing, cuda._device, cuda._function):
        cached.cache_clear()
