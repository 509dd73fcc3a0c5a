"""The public interface: few names at the top, the rest in sub-packages, and every type that a call names."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from typing import Any

import pytest
from public_names import ROOMS, TOP, everything

import stickslip as ss


def test_the_top_level_is_small_and_the_rest_is_in_rooms() -> None:
    assert len(TOP) <= 60
    assert len(everything()) > 2 * len(TOP)
    for room, module in ROOMS.items():
        assert inspect.getdoc(module), room


def test_an_extra_that_is_missing_hides_nothing_else() -> None:
    program = (
        "import sys; sys.modules['matplotlib'] = sys.modules['pydantic'] = None; import stickslip as ss; "
        "print(ss.VirtualRig.__name__, hasattr(ss, 'simulat'))"
    )
    command = [sys.executable, "-W", "ignore", "-c", program]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "VirtualRig False\n"


def test_a_name_that_there_is_not() -> None:
    for name in ("simulat", "Path", "np"):  # nor what a room imports for itself
        with pytest.raises(AttributeError, match=name):
            getattr(ss, name)


def test_the_rooms_cost_nothing_until_they_are_used() -> None:
    found = subprocess.run(
        [sys.executable, "-c", "import stickslip, sys; print([m for m in sys.modules if 'stickslip.' in m])"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert found.strip() == "['stickslip._lazy']"


def types_in(annotation: str, home: str) -> set[Any]:
    """The classes of this package that an annotation names."""
    words = re.findall(r"[A-Za-z_]\w*", re.sub(r"'[^']*'", "", annotation))
    found = {vars(sys.modules[home]).get(word) for word in words}
    return {one for one in found if inspect.isclass(one) and one.__module__.startswith("stickslip")}


def test_every_type_that_a_call_takes_or_returns_is_public() -> None:
    public = everything()
    hidden = set()
    for name, call in public.items():
        if not inspect.isfunction(call):
            continue
        signature = inspect.signature(call)
        annotations = [p.annotation for p in signature.parameters.values()] + [signature.return_annotation]
        for one in annotations:
            if isinstance(one, str):
                home = inspect.unwrap(call).__module__
                hidden |= {
                    f"{name}: {t.__module__}.{t.__name__}" for t in types_in(one, home) - {*public.values()}
                }
    assert not hidden
