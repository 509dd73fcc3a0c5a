"""Prepare the engine's C sources for NVRTC, with a header that describes one layout of plants."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..friction.law import element
from ._abi import ffi
from .binding import Array, ComposedPlant
from .interface import of_numbers, of_package
from .law_of import EngineLaw
from .laws import LAW
from .library import SOURCES
from .members import numbers_of
from .sizes import largest, sizes
from .translator import Record, Translation, record_type

# Number of threads in a block of the GPU, and of blocks that run on a multiprocessor at the same time. Each
# thread may then use 128 of the multiprocessor's 65,536 registers.
THREADS, BLOCKS = 128, 4
# Pattern of a compound literal of a struct in C99, `(struct cut){...}`, which is written `cut{...}` in C++.
_LITERAL = re.compile(r"\((?:struct )?(OF\(\w+\)|\w+)\)\{")
# Pattern of the definition of a function that is static, but not inline.
_FUNCTION = re.compile(r"^static (?!inline|const)(?=[^=;{]*\()", re.MULTILINE)
# Standard headers that NVRTC does not have, by name. The functions of math.h are built into NVRTC.
_STANDARD = {
    "math.h": "#define NAN __longlong_as_double(0x7ff8000000000000LL)\n"
    "#define INFINITY __longlong_as_double(0x7ff0000000000000LL)\n",
    "stdbool.h": "",
    "stddef.h": "#undef NULL\n#define NULL nullptr\n",
    "stdint.h": "typedef int int32_t;\ntypedef unsigned int uint32_t;\ntypedef long long int64_t;\n",
    "stdlib.h": "#include <stddef.h>\n",
}
# Patterns of the C definition of a law's struct, and of one field in it.
_STRUCT = re.compile(r"^static const struct law \w+ = \{.*?^\};", re.MULTILINE | re.DOTALL)
_FIELD = re.compile(r"^    \.(\w+) = (.*),$", re.MULTILINE)
_KINDS = dict.fromkeys(("parameters", "smooth", "period"), "int ")
_FLAGS = ("states", "loaded", "follows", "positioned", "fed", "felt", "pushed", "first", "place", "pinned")
_SUMS = ("modes", "elements", "states", "statics", "loaded", "branched", "sampled", "follows")


def as_cpp(text: str) -> str:
    """Return C source of the engine as C++20: literals of structs, which differ, are rewritten."""
    return _LITERAL.sub(r"\1{", text)


def for_gpu(text: str) -> str:
    """Return a source of the engine in the form that the kernel includes.

    Functions that are not inline in C are marked as ``__noinline__``. Otherwise NVRTC makes the kernel one
    function, which takes ten times as long to compile.
    """
    return _FUNCTION.sub("static __noinline__ ", as_cpp(text))


@functools.cache
def headers() -> dict[str, str]:
    """Return the text of each header that the kernel includes, by name, without `layout.h`."""
    files = [file for file in SOURCES.iterdir() if file.suffix in (".h", ".inl")]
    found = {file.name: for_gpu(file.read_text("ascii")) for file in files}
    return {**_STANDARD, **found}


def kernel() -> str:
    """Return the CUDA source of the kernel that integrates members."""
    return (SOURCES / "members.cu").read_text("ascii")


def layout(plant: Any, values: Array) -> tuple[str, Array]:
    """Return the text of the header `layout.h` for plants of one layout, and an array [numbers, members] of
    the numbers in which the plants differ. The header contains sizes, laws, and the C function `fill_plant`,
    which makes a plant from one column of the array.

    Args:
        plant, values: see `members.ComposedMembers`.

    Raises:
        QuantityError: the plant is larger than the engine allows.
        TypeError: an element has no law, or one that a GPU cannot run (see `refused`).
    """
    composed = ComposedPlant(plant)
    for law in composed.laws:
        if why := refused(law):
            raise TypeError(why)
    numbers, lines = [], []
    for place, given in numbers_of(plant, values):
        at = sum(len(row) for row in numbers)
        cast = "(const ss_NormalForce *)" if place[-1] == "along" else ""
        value = f"numbers[{at}]" if given.ndim == 1 else f"{cast}(numbers + {at})"
        lines.append(f"{_member(place)} = {value};")
        numbers.append(given.reshape(len(values), -1).T)
    kinds = tuple(_kind(element(one.law, 0)) for one in plant.elements)
    fill = "\n".join(f"    {line}" for line in [*lines, *_constants(composed.struct, kinds)])
    stacked = np.concatenate(numbers)
    macros = {"NUMBERS": len(stacked), "THREADS": THREADS, "BLOCKS": BLOCKS, "HOT": "static inline"}
    macros |= {**largest(plant), **sizes(plant, "gpu")}
    defined = "\n".join(f"#define {name} {value}" for name, value in macros.items())
    functions = tuple(tuple(LAW.functions(kind.record_class).items()) for kind in kinds)
    head = f'{defined}\n\n{_laws(kinds, functions)}\n#include "plant.h"\n\n'
    return f"{head}static void fill_plant(struct plant *P, const real_t *numbers)\n{{\n{fill}\n}}\n", stacked


def _constants(struct: Any, kinds: tuple[Record, ...]) -> Iterator[str]:
    """Yield the C lines of `fill_plant` for members of the struct `plant` that are the same in all plants.

    Args:
        struct: C struct of any of the plants.
        kinds: the translator's type of the law of each element.
    """
    for name in _SUMS:
        yield f"P->{name} = {getattr(struct, name)};"
    for e, kind in enumerate(kinds):
        if len(set(kinds)) > 1:
            yield f"P->element[{e}].law = &law_{kind.record_class.__name__};"
        for name in _FLAGS:
            yield f"P->element[{e}].{name} = {getattr(struct.element[e], name)};"


def refused(law: EngineLaw) -> str:
    """Return the reason why a law, as the engine runs it, cannot run on a GPU; "" if it can."""
    if law.how in ("package", "compiler"):
        return ""
    name: Any = ffi.string(law.pointer.name)
    return (
        f"the law {name.decode()} cannot run on a GPU: its functions cannot be translated to C, "
        "or there is no C compiler here that could check their translation"
    )


def _member(place: tuple[str | int, ...]) -> str:
    """Return the C expression for a field of the plant, given by its path of names and indices."""
    return "P->" + "".join(f"[{one}]" if isinstance(one, int) else f".{one}" for one in place)[1:]


@functools.cache
def _laws(kinds: tuple[Record, ...], _functions: Any) -> str:
    """Return the C source of the laws of these record types.

    If all elements have the same law, the struct type `law` gets its functions as constants. They are then
    known at compile time, and inlined into the integration step. `_functions`, the Python functions of the
    laws, only distinguish entries of the cache.
    """
    made = Translation()
    each = dict.fromkeys(kinds)
    laws = "\n".join(LAW.c_of(made, kind) for kind in each)
    head = ""
    if len(each) == 1:
        head, laws = "#define STICKSLIP_ONE_LAW\n", _STRUCT.sub(_one_law, laws)
    return as_cpp("\n".join([head, '#include "law.h"\n', made.text(), laws]))


def _one_law(struct: re.Match[str]) -> str:
    """Return the C++ definition of a struct type `law`, whose members are constants of the type, from a match
    of `_STRUCT`, the C definition of a law."""
    members = [
        f"    static constexpr {_KINDS.get(name, f'law_{name}_fn *')}{name} = {value};"
        for name, value in _FIELD.findall(struct[0])
        if name != "name"
    ]
    return "\n".join(["struct law {", *members, "};"])


def _kind(record: Any) -> Record:
    return of_numbers(type(record)) if of_package(type(record)) else record_type(record)
