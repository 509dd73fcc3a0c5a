"""Outcome of a run of the engine, an integer: the constants of `c/engine.h`. DONE means that the run reached
its end, or that an orbit was found."""

from __future__ import annotations

from ._abi import ffi

DONE, STEP_TOO_SMALL, TOO_MANY_STEPS, NOT_FOUND, NO_NUMBER = (
    int(ffi.integer_const(name))
    for name in ("DONE", "STEP_TOO_SMALL", "TOO_MANY_STEPS", "NOT_FOUND", "NO_NUMBER")
)
