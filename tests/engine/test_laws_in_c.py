"""The laws of the package in C beside their Python functions, on many random inputs."""

from __future__ import annotations

import ctypes
import math
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip.engine import laws
from stickslip.engine.translator import Translation, TranslationError
from stickslip.friction import LuGre, Stribeck, normal_force

C = Path(laws.__file__).parent / "c"
N = 10_000
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
# Above the rounding of the C library's exponential and power in either place; relative to the largest term.
WITH_EXPONENTIALS = 1e-14
# No function of these calls an exponential, power or sine for the parameters below.
EXACT = {"Coulomb", "CoulombViscous", "StictionCoulombViscous", "ResetIntegrator"}


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    made = tmp_path_factory.mktemp("laws") / "laws.so"
    source = str(Path(__file__).with_name("laws.c"))
    flags = ["-O0", "-ffp-contract=off", "-shared", "-fPIC", f"-I{C}"]
    subprocess.run(
        ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", *flags, source, "-o", str(made), "-lm"], check=True
    )
    found = ctypes.CDLL(str(made))
    found.name_of.restype = ctypes.c_char_p
    return found


def spread(rng: np.random.Generator, low: float, high: float, n: int = N) -> np.ndarray:
    return np.exp(rng.uniform(math.log(low), math.log(high), n))


def parameters(law: type, rng: np.random.Generator) -> np.ndarray:
    """Rows of parameters over decades; some velocities are infinite, some stiction is Coulomb friction."""
    share = {
        "sigma_0": spread(rng, 1e4, 1e8),
        "sigma_1": spread(rng, 1e-1, 1e3),
        "sigma_2": np.where(rng.random(N) < 0.2, 0.0, spread(rng, 1e-2, 1e2)),
        "coulomb_force": spread(rng, 1e-2, 1e2),
        "stribeck_velocity": spread(rng, 1e-5, 1e-1),
        "exponent": rng.choice([1.0, 2.0, 0.5, 1.5, 0.7], N),
        "damping_velocity": np.where(rng.random(N) < 0.5, np.inf, spread(rng, 1e-3, 1.0)),
        "stiction_excess": np.where(rng.random(N) < 0.5, 0.0, rng.uniform(0, 1, N)),
        "attraction_rate": spread(rng, 1, 1e4),
    }
    share["stiction_force"] = share["coulomb_force"] * np.where(rng.random(N) < 0.3, 1.0, spread(rng, 1, 3))
    share["breakaway_deflection"] = share["coulomb_force"] / share["sigma_0"] * rng.uniform(0.01, 0.99, N)
    share |= {
        "stiffness": share["sigma_0"],
        "strength": share["coulomb_force"],
        "stiction": share["stiction_force"],
    }
    return np.ascontiguousarray(np.array([share[name] for name in law._fields]).T)


def inputs(law: type, p: np.ndarray, rng: np.random.Generator) -> list[np.ndarray]:
    """Velocities with 0 among them, their growth, states up to beyond their bounds and on them."""
    v = rng.choice([-1.0, 1.0], N) * spread(rng, 1e-10, 1.0)
    v[rng.random(N) < 0.02] = 0.0
    growth = rng.choice([-1.0, 1.0], N) * spread(rng, 1e-8, 1e3)
    if "breakaway" in laws.functions(law):
        return [v, growth, rng.choice([-1.0, 1.0], N)]
    column = {name: p[:, i] for i, name in enumerate(law._fields)}
    stiff = column.get("sigma_0", column.get("stiffness"))
    bound = column.get("coulomb_force", column.get("strength"))
    limit = column["breakaway_deflection"] if bound is None else bound / stiff
    z = rng.choice([-1.0, 1.0], N) * limit * np.where(rng.random(N) < 0.1, 1.0, rng.uniform(0, 1.6, N))
    return [v, growth, z]


def pointer(array: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def number_of(library: ctypes.CDLL, law: type) -> int:
    """The place of a law among those of the package."""
    return [library.name_of(i).decode() for i in range(len(laws.packaged()))].index(law.__name__)


def in_python(law: type, role: str, p: np.ndarray, given: list[np.ndarray], branch: np.ndarray) -> np.ndarray:
    function = laws.functions(law)[role]
    records = [tuple.__new__(law, one) for one in p.tolist()]
    v, growth, z = (one.tolist() for one in given)
    order: dict[str, tuple[Any, ...]] = {
        "rate": (records, v, z),
        "breakaway": (records,),
        "project": (records, z),
        "choose": (records, v, growth, z),
        "branch_rate": (records, v, z, branch.tolist()),
        "left": (records, v, growth, z, branch.tolist()),
    }
    return np.array([function(*one) for one in zip(*order[role], strict=True)], dtype=float)


@pytest.mark.parametrize("law", laws.packaged(), ids=lambda law: law.__name__)
def test_every_function_of_a_law_is_the_same_in_c(law: Any, library: ctypes.CDLL) -> None:
    rng = np.random.default_rng(len(law.__name__))
    i = number_of(library, law)
    assert library.length_of(i) == len(law._fields)
    p = parameters(law, rng)
    given = inputs(law, p, rng)
    branch = rng.integers(0, 2 if law.__name__ == "ResetIntegrator" else 3, N).astype(np.int32)
    for number, role in enumerate(laws.LAW.arguments):
        mine = [np.abs(given[0]) if number > 3 else given[0], *given[1:]]
        found = np.full((2, N), np.nan)
        columns = [pointer(np.ascontiguousarray(one)) for one in mine]
        there = library.evaluate(
            i, number, ctypes.c_long(N), pointer(p), *columns, pointer(branch), *map(pointer, found)
        )
        assert bool(there) == (role in laws.functions(law))
        if not there:
            continue
        expected = in_python(law, role, p, mine, branch)
        found = found.T if expected.ndim == 2 else found[0]
        if law.__name__ in EXACT or role == "choose":
            differs = found != expected
            assert not np.any(differs), (role, np.count_nonzero(differs))
        else:
            scale = np.maximum(np.abs(expected), terms(law, role, p, mine, expected.ndim))
            assert np.all(np.abs(found - expected) <= WITH_EXPONENTIALS * scale), role


def terms(law: Any, role: str, p: np.ndarray, given: list[np.ndarray], dimensions: int) -> np.ndarray:
    """The size of the terms that a result is the difference of."""
    column = {name: p[:, i] for i, name in enumerate(law._fields)}
    speed, z = np.abs(given[0]), np.abs(given[2])
    stiff = column.get("sigma_0", column.get("stiffness", 1.0))
    fade = column.get("sigma_1", 0.0)
    limit = column.get("coulomb_force", column.get("strength", 1.0)) / stiff
    rate = speed * (1.0 + z / limit)
    if "attraction_rate" in column:
        rate = rate + (column["attraction_rate"] * limit + speed / 1e-8 * (role == "branch_rate")) * (
            1.0 + z / limit
        )
    force = stiff * z + fade * rate + column.get("sigma_2", 0.0) * speed
    if role == "left":
        return 1.0 + z / limit
    return np.array([force, rate]).T if dimensions == 2 else np.abs(z)


Contact = tuple[float, float]


def on_branch(law: Any, v: float, z: float, side: float, branch: int) -> Contact:
    """Force and rate on a branch of a law, or of one without any."""
    known = laws.functions(type(law))
    if "branch_rate" not in known:
        return known["rate"](law, v, z)
    force, rate = known["branch_rate"](law, abs(v), side * z, branch)
    return side * force, side * rate


def slopes(law: Any, v: float, z: float, side: float, branch: int) -> list[float]:
    """F, dF/dv, dF/dz, dż/dv, dż/dz by differences away from rest and off the bound."""
    at = math.copysign(v, side)
    dv = math.copysign(1e-5 * abs(at) + 1e-11, side)
    dz = math.copysign(1e-5 * abs(z) + 1e-15, z)
    (f, r), (f_v, r_v), (f_z, r_z) = (
        on_branch(law, *one, side, branch) for one in ((at, z), (at + dv, z), (at, z + dz))
    )
    return [f, (f_v - f) / dv, (f_z - f) / dz, (r_v - r) / dv, (r_z - r) / dz]


def beyond_rest(law: Any, v: float, z: float, side: float, branch: int) -> list[float]:
    """Force and rate as on one side of v = 0, mirrored in the point v = 0 beyond it."""
    here = on_branch(law, math.copysign(v, side), z, side, branch)
    if v * side >= 0.0:
        return list(here)
    return [2.0 * rest - one for rest, one in zip(on_branch(law, 0.0, z, side, branch), here, strict=True)]


def kink(law: Any, z: float, v: float) -> float:
    """By how much dż/dv jumps at v = 0, times a speed."""
    rate = laws.functions(type(law))["rate"]
    return abs(rate(law, v, z)[1] + rate(law, -v, z)[1])


def bounded(law: Any, z: float, towards: float) -> float:
    """A state on the bound that it moves towards."""
    project = laws.functions(type(law)).get("project", lambda law, z: z)
    bound = project(law, z + towards)
    return bound if bound != z + towards else project(law, z)


def static_slope(law: Any, v: float, side: float) -> list[float]:
    """F and dF/dv of a static law; a difference that is small where v is."""
    rate = laws.functions(type(law))["rate"]
    dv = 1e-5 * abs(v) + (min(1e-11, 1e-2 * abs(v)) if abs(v) > 1e-14 else 1e-11)
    force = rate(law, side * abs(v), side)[0]
    return [force, side * (rate(law, side * (abs(v) + dv), side)[0] - force) / dv]


def seen(library: ctypes.CDLL, law: type, *columns: np.ndarray) -> np.ndarray:
    """What a step in C sees of contacts with these parameters, velocities, states, sides and branches."""
    found = np.empty((len(columns[0]), 10))
    library.see(number_of(library, law), ctypes.c_long(len(found)), *map(pointer, columns), pointer(found))
    return found


@pytest.mark.parametrize("law", laws.packaged(), ids=lambda law: law.__name__)
def test_a_step_in_c_sees_the_same_slopes(law: Any, library: ctypes.CDLL) -> None:
    """To the last bit, for parameters that need no exponential: differences would magnify its rounding."""
    rng, n = np.random.default_rng(11), 1000
    p = parameters(law, rng)
    given = inputs(law, p, rng)
    p, v, z = p[:n].copy(), given[0][:n].copy(), given[2][:n].copy()
    for i, name in enumerate(law._fields):
        same = {"stiction_force": "coulomb_force", "stiction": "strength"}.get(name, name)
        p[:, i] = {"exponent": 1.0, "damping_velocity": np.inf}.get(name, p[:, law._fields.index(same)])
    side = rng.choice([-1.0, 1.0], n)
    branch = rng.integers(0, 2, n) * ("choose" in laws.functions(law))
    found = seen(library, law, p, v, z, side, branch.astype(np.int32))
    static = "breakaway" in laws.functions(law)
    for k, (speed, state, way) in enumerate(zip(v.tolist(), z.tolist(), side.tolist(), strict=True)):
        own, at = tuple.__new__(law, p[k].tolist()), (speed, state, way, int(branch[k]))
        expected = [*slopes(own, *at), *beyond_rest(own, *at), kink(own, state, speed)]
        last = static_slope(own, speed, way) if static else [bounded(own, state, 1e-3 * state), 0.0]
        np.testing.assert_array_equal(found[k], [*expected, *last])


@pytest.mark.parametrize("exponent", [0.1, 0.3, 0.5, 0.7, 1.0, 2.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_slope_of_a_stribeck_curve(exponent: float, side: float, library: ctypes.CDLL) -> None:
    """In closed form, at any speed: the force may fall ever more steeply towards rest."""
    law = Stribeck(0.5, 0.8, 2e-3, 3.0, exponent)
    speed = np.array([3e-14, 1e-11, 1e-8, 1e-6, 1e-5, 3e-3, 0.2])
    ones = np.ones(speed.size)
    columns = (np.tile(law, (speed.size, 1)), side * speed, side * ones, side * ones)
    found = seen(library, Stribeck, *columns, np.zeros(speed.size, np.int32))
    power = (speed / 2e-3) ** exponent
    np.testing.assert_allclose(found[:, 8], side * (0.5 + 0.3 * np.exp(-power) + 3.0 * speed), rtol=1e-14)
    rounding = 4e-16 / (1e-5 * speed + np.minimum(1e-2 * speed, 1e-11))
    expected = 3.0 - 0.3 * exponent * power / speed * np.exp(-power)
    assert np.all(np.abs(found[:, 9] - expected) <= np.maximum(1e-2 * np.abs(expected), rounding))


def test_a_bristle_beyond_its_reversal(library: ctypes.CDLL) -> None:
    """Value and slope at v = 0 are those of the side; dż/dv jumps by 2 |z| sigma_0/g."""
    law, h = LuGre(1.4e6, 35.0, 0.7, 0.54, 0.7, 1e-3), 1e-7
    v = np.array([h, 0.0, -h, 2e-3])
    columns = (np.tile(law, (4, 1)), v, np.full(4, 3e-7), np.ones(4), np.zeros(4, np.int32))
    found = seen(library, LuGre, *columns)
    np.testing.assert_allclose(found[1, 5:7] - found[2, 5:7], found[0, 5:7] - found[1, 5:7], rtol=1e-9)
    g = 0.54 + 0.16 * math.exp(-4.0)
    assert found[3, 7] == pytest.approx(2.0 * 3e-7 * 1.4e6 / g * 2e-3, rel=1e-12)


def test_the_normal_force_along_the_stroke_is_the_same_in_c(library: ctypes.CDLL) -> None:
    rng = np.random.default_rng(5)
    columns = [rng.normal(0, 100, N), rng.choice([1.0, -2.0, 0.0, 2.5], N), rng.uniform(0, 0.5, N)]
    columns += [spread(rng, 1e-4, 1e-2), rng.normal(0, 2, N), rng.normal(0, 1e-3, N)]
    columns += [rng.choice([1.0, 1.0 / 3.0, 0.0], N), rng.uniform(-0.5, 0.5, N)]
    p, x = np.ascontiguousarray(np.array(columns).T), rng.normal(0, 5e-3, N)
    found = np.empty((N, 7))
    library.press(ctypes.c_long(N), pointer(p), pointer(x), pointer(found))
    records = [tuple.__new__(normal_force.NormalForce, one) for one in p.tolist()]
    expected = []
    for record, at in zip(records, x.tolist(), strict=True):
        along, softening = normal_force.along(record, at), normal_force.softening(record, at)
        kept = normal_force.kept(record, at) if at > 0.0 else math.nan
        leaning, uniform = normal_force.leaning(record, at), normal_force.uniform(record)
        expected.append([*along, softening, kept, leaning, float(uniform)])
    wanted = np.array(expected)
    known = np.isfinite(wanted)
    assert np.array_equal(known[:, :3], np.isfinite(found[:, :3]))
    # The slopes are differences of terms of the sizes that the ripple gives them.
    scale = np.maximum(np.abs(wanted), [1.0, 2e4, 4e9, 1.0, 1.0, 1.0, 1.0])
    assert np.all(np.abs(found - wanted)[known] <= WITH_EXPONENTIALS * scale[known])


@pytest.mark.parametrize("flag", ["-DSTICKSLIP_DOUBLE", "-DSTICKSLIP_FLOAT"])
def test_the_c_files_compile_without_warnings(flag: str, tmp_path: Path) -> None:
    source = tmp_path / "all.c"
    source.write_text(
        '#include "laws.h"\n#include "normal_force.h"\nconst struct law *law(int i);\n'
        "const struct law *law(int i) { return packaged_law[i]; }\n"
    )
    command = [
        "gcc",
        *WARNINGS,
        "-Wdouble-promotion",
        flag,
        f"-I{C}",
        "-c",
        str(source),
        "-o",
        str(tmp_path / "all.o"),
    ]
    subprocess.run(command, check=True)


def calls_what_is_refused(x: float) -> float:
    return sorted((x,))[0]


def test_a_refusal_is_the_same_a_second_time() -> None:
    made = Translation()
    for _ in range(2):
        with pytest.raises(TranslationError, match="sorted is outside the subset"):
            made.function(calls_what_is_refused, ("real_t",))
