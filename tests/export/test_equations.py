"""The C of every law and of the equations of motion against the Python that it is made from."""

from __future__ import annotations

import sys
from importlib import util
from pathlib import Path

import numpy as np
import pytest

from export.building import C, compiled, output
from friction.samples import ALL, name
from stickslip import load_actuator
from stickslip.export import TranslationError, export_c
from stickslip.friction import LAWS, breakaway, element, elements, project, rate


def points() -> list[tuple[float, float]]:
    rng = np.random.default_rng(7)
    v = rng.choice([-1, 1], 200) * 10.0 ** rng.uniform(-7, 0, 200)
    z = rng.choice([-1, 1], 200) * 10.0 ** rng.uniform(-9, -5.5, 200)
    return [(0.0, 0.0), (0.0, 1e-7), (1e-3, 0.0), *zip(v.tolist(), z.tolist(), strict=True)]


@pytest.mark.parametrize("law", ALL, ids=name)
def test_law(law, tmp_path) -> None:
    export_c(load_actuator("kang2007").replace(friction=law), tmp_path / "c", duration=0.2)
    program = compiled(tmp_path / "c", C / "law.c")
    given = [(v, float(np.sign(v))) for v, _ in points()] if elements(law) == 0 else points()
    lines = output(program, text="\n".join(f"{v!r} {z!r}" for v, z in given)).splitlines()
    one = element(law, max(elements(law), 1) - 1)
    assert float(lines[0]) == breakaway(law)
    for (v, z), line in zip(given, lines[1:], strict=True):
        force, dz, bound = map(float, line.split())
        expected = rate(one, v, z)
        assert force == pytest.approx(expected[0], rel=1e-13, abs=1e-300)
        assert dz == pytest.approx(expected[1], rel=1e-12, abs=1e-300)
        assert bound == project(one, z)


def test_every_law_is_among_the_samples() -> None:
    assert {type(law) for law in ALL} == set(LAWS)


OWN = '''
from __future__ import annotations
import math
from typing import NamedTuple
from stickslip.friction import register

LIMIT = 2e-7

class Own(NamedTuple):
    stiffness: float
    force: float

def shape(ratio, double=2.0):
    """A name that C keeps for itself."""
    return math.tanh(ratio)

def own(law, v, z):
    """Force by a curve."""
{body}

register(Own, own)
'''

GOOD = """
    force, register = 0.0, law.stiffness * z
    for i in range(3):
        if i == 1 and -1.0 < v < 1.0:
            force += register
        elif i > 1:
            force += 0.0
    low, high = -law.force, law.force
    low, high = high, low
    dz = v * (1.0 - abs(z) / LIMIT) if v * z > 0.0 else v
    return force + 0.0 * (low + high) + math.sqrt(z ** 2) * 0.0 + shape_of(v) ** 3 * 1e-3, dz

def shape_of(v):
    return math.tanh(v)
"""


def own_law(tmp_path: Path, body: str, name: str):
    """A law in a file of its user."""
    file = tmp_path / f"{name}.py"
    file.write_text(OWN.replace("{body}", body))
    spec = util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module.Own(1.4e6, 0.5)


def test_a_law_of_the_user(tmp_path) -> None:
    law = own_law(tmp_path, GOOD, "own_good")
    export_c(load_actuator("kang2007").replace(friction=law, name=""), tmp_path / "c", duration=0.2)
    program = compiled(tmp_path / "c", C / "law.c")
    lines = output(program, text="\n".join(f"{v!r} {z!r}" for v, z in points())).splitlines()
    for (v, z), line in zip(points(), lines[1:], strict=True):
        assert list(map(float, line.split()))[:2] == pytest.approx(rate(law, v, z), rel=1e-13, abs=1e-300)


REFUSED = {
    "while": (
        "    while v > 1.0:\n        v = 0.5 * v\n    else:\n        v = 1.0\n    return v, v",
        19,
        "loop with else",
    ),
    "library": ("    import os\n    return v, v", 19, "Import"),
    "list": ("    both = [v, z]\n    return both[0], both[1]", 19, "List"),
    "truth": ("    return (v if law else 0.0), v", 19, "no condition"),
    "text": ("    return 'v', v", 19, "neither a number"),
    "half a round": ("    for i in range(v):\n        z += i\n    return z, v", 19, "whole numbers"),
    "half": ("    if v > 0.0:\n        return z, v", 17, "every path"),
    "field": ("    known = law\n    return known.strength * z, v", 20, "known.strength"),
    "recursion": ("    return own(law, v, z)[0], v", 17, "calls itself"),
    "operator": ("    return z @ 1.0, v", 19, "operator"),
    "single": ("    return z", None, "must give (force, dz)"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused_and_where(case, tmp_path) -> None:
    body, line, reason = REFUSED[case]
    law = own_law(tmp_path, body, f"own_{case}")
    with pytest.raises(TranslationError) as refusal:
        export_c(load_actuator("kang2007").replace(friction=law, name=""), tmp_path / "c")
    text = str(refusal.value)
    assert reason in text
    assert "Own" in text if line is None else f"own (own_{case}, line {line})" in text
    assert not (tmp_path / "c").exists()
    assert not [file for file in tmp_path.iterdir() if file.name.startswith(".")]
