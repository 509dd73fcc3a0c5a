"""Outcomes of a run: the numbers of `c/engine.h`."""

from __future__ import annotations

from ._abi import ffi

DONE, STEP_TOO_SMALL, TOO_MANY_STEPS, NOT_FOUND, NO_NUMBER = (
    int(ffi.integer_const(name))
    for name in ("DONE", "STEP_TOO_SMALL", "TOO_MANY_STEPS", "NOT_FOUND", "NO_NUMBER")
)
