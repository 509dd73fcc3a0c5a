"""Outcome of a run of the engine, an integer: the constants of `c/engine.h`.

DONE: the run reached its end, or an orbit was found. STEP_TOO_SMALL: integration steps became smaller than
floating point resolves. TOO_MANY_STEPS: more steps were needed than allowed. NOT_FOUND: no periodic orbit
was found. NO_NUMBER: the run reached its end, but a sample is infinite or NaN.
"""

from __future__ import annotations

from ._abi import ffi

DONE, STEP_TOO_SMALL, TOO_MANY_STEPS, NOT_FOUND, NO_NUMBER = (
    int(ffi.integer_const(name))
    for name in ("DONE", "STEP_TOO_SMALL", "TOO_MANY_STEPS", "NOT_FOUND", "NO_NUMBER")
)
