"""Export of a regulator, or of a whole `Mover`, as one C99 header with bit-identical output.

The state machine of moves is the engine's own C; the regulator does the operations of the Python code in the
same order. Bit-identity requires IEEE 754 doubles and separately rounded products and sums: ``gcc -std=c99``
does so (``-ffp-contract=off`` elsewhere).
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .._version import __version__
from ..engine._abi import ffi
from ..engine.library import SOURCES
from ..quantities.units import QuantityError
from .blocks import Regulator
from .moving import Mover

_SOURCE = """\
/* A regulator made by stickslip {version}: {rate:g} updates a second, {low:g} V to {high:g} V.
   regulator_begin once, at rest, then regulator_step at each update. SI: V, m (rad). */
#ifndef STICKSLIP_REGULATOR_H
#define STICKSLIP_REGULATOR_H

#include <math.h>

typedef struct {{
    double sections[{size}][2]; /* what notches and low-pass keep */
    double integral, from, target, slope, last;
}} regulator;

#define REGULATOR_SECTIONS {count}

static const double regulator_coefficients[{size}][5] = {{ /* b0, b1, b2, a1, a2 */
{rows}
}};

/* From rest at a voltage [V] and a wanted position [m]: the output goes on without a jump. */
static inline void regulator_begin(regulator *r, double voltage, double target)
{{
    int k;
    for (k = 0; k < REGULATOR_SECTIONS; ++k)
        r->sections[k][0] = r->sections[k][1] = 0.0;
    r->integral = voltage;
    r->from = r->target = target;
    r->slope = r->last = 0.0;
}}

/* The voltage [V] for a measured and a wanted position [m]. */
static inline double regulator_step(regulator *r, double measured, double target)
{{
    double value = target - measured, ahead, others, wanted, given;
    int k;
    for (k = 0; k < REGULATOR_SECTIONS; ++k) {{
        const double *c = regulator_coefficients[k];
        double *s = r->sections[k];
        const double out = c[0] * value + s[0];
        s[0] = c[1] * value - c[3] * out + s[1];
        s[1] = c[2] * value - c[4] * out;
        value = out;
    }}
    r->integral += {ki} * value;
    ahead = target - r->from + {lead} * (target - r->target);
    r->target = target;
    others = {kp} * value + {feedforward} * ahead;
{derivative}    wanted = r->integral + others;
    given = wanted < {c_low} ? {c_low} : wanted;
    given = given > {c_high} ? {c_high} : given;
    if (given != wanted && (wanted - given) * value > 0.0)
        r->integral -= {ki} * value;
    return given;
}}

#endif
"""
_DERIVATIVE = """\
    r->slope = {fading} * r->slope + {fresh} * ((value - r->last) * {rate});
    r->last = value;
    others += {kd} * r->slope;
"""


def _number(value: float) -> str:
    """Return a number as exact C source text: a hexadecimal literal, or (INFINITY) with its sign."""
    return float(value).hex() if math.isfinite(value) else f"({'-' if value < 0.0 else ''}INFINITY)"


def regulator_source(regulator: Regulator) -> str:
    """Return a C header as text, with the functions `regulator_begin` and `regulator_step` of this regulator.

    Raises QuantityError for a regulator with the inverse of a piezo."""
    if regulator.inverse is not None:
        raise QuantityError("a regulator with a PiezoInverse is not translated to C: give it a gain in V/m")
    sections = [section.coefficients for section in regulator.sections]
    rows = [f"    {{{', '.join(map(_number, one))}}}" for one in sections or [(0.0,) * 5]]
    pid, fading = regulator.pid, regulator.fading
    derivative = ""
    if pid.derivative:
        derivative = _DERIVATIVE.format(
            fading=_number(fading),
            fresh=_number(1.0 - fading),
            rate=_number(regulator.rate),
            kd=_number(pid.derivative),
        )
    return _SOURCE.format(
        version=__version__,
        rate=regulator.rate,
        low=regulator.low,
        high=regulator.high,
        size=max(len(sections), 1),
        count=len(sections),
        rows=",\n".join(rows),
        ki=_number(regulator.per_tick),
        lead=_number(regulator.lead_ticks),
        kp=_number(pid.proportional),
        feedforward=_number(regulator.feedforward),
        derivative=derivative,
        c_low=_number(regulator.low),
        c_high=_number(regulator.high),
    )


def export_regulator(regulator: Regulator, path: str | os.PathLike[str]) -> Path:
    """Write the C header of a regulator, such as regulator.h, and return its path. Raises QuantityError as
    `regulator_source`, and OSError."""
    target = Path(path)
    target.write_text(regulator_source(regulator), encoding="utf-8")
    return target


_HEAD = """
#ifndef STICKSLIP_MADE_H
#define STICKSLIP_MADE_H
#define MOVER_API static inline

"""
_MADE = """
/* The numbers of a mover made by stickslip {version}. */
{tables}
static const mover_plan mover_made = {numbers};

/* At rest: once, before the first step. */
static inline void mover_start(mover *m, regulator *loop)
{{
    mover_begin(m, &mover_made);
    regulator_begin(loop, m->voltage, 0.0);
}}

/* The voltage [V] for a measured and a wanted position [m]; `tick` counts the updates. After an `error` it
   stays. */
static inline double mover_step(mover *m, regulator *loop, double measured, double target, int64_t tick)
{{
    const bool regulates = mover_before(m, measured, target, tick);
    if (m->begins) {{
        m->begins = false;
        regulator_begin(loop, m->voltage, m->before);
    }}
    if (regulates)
        mover_after(m, measured, regulator_step(loop, measured, m->wanted));
    return m->voltage;
}}

#endif
"""


def _initial(value: Any, tables: Iterator[str]) -> str:
    """Return the C source text that initialises a struct, or one of its members.

    Args:
        value: struct, array, pointer (cffi objects) or number.
        tables: names of the C arrays to which the pointers in the struct refer; each pointer takes the next.
    """
    kind = ffi.typeof(value) if isinstance(value, ffi.CData) else None
    if kind is None:
        return _number(value) if isinstance(value, float) else str(value)
    if kind.kind == "pointer":
        return next(tables)
    if kind.kind == "array":
        return f"{{{', '.join(_initial(one, tables) for one in value)}}}"
    members = [f".{name} = {_initial(getattr(value, name), tables)}" for name, _ in kind.fields]
    return "{" + ",\n    ".join(members) + "}"


def mover_source(mover: Mover) -> str:
    """Return a C header, as text, of a mover that starts at rest with the step sizes learned until now, which
    are also written to `mover.plan`.

    Raises QuantityError if the regulator contains the inverse of a piezo.

    With a ``mover m`` and a ``regulator loop``, C calls ``mover_start(&m, &loop)`` once, and at each update
    ``mover_step(&m, &loop, measured, target, tick)``.
    """
    mover.plan.table = mover.steps_of.of[0]
    # Names of the C arrays, in the order of the pointers in the struct mover_plan.
    names = ("mover_slip", "mover_voltages", "mover_forward", "mover_backward")
    rows = zip(names, (mover.slipping, *mover.steps_of.rows), strict=True)
    tables = [f"static const double {name}[] = {{{', '.join(map(_number, row))}}};" for name, row in rows]
    made = _MADE.format(
        version=__version__, tables="\n".join(tables), numbers=_initial(mover.plan[0], iter(names))
    )
    machine = [(SOURCES / name).read_text(encoding="ascii") for name in ("arrival.h", "mover.h")]
    return "".join([regulator_source(mover.regulator), _HEAD, *machine, made])


def export_mover(mover: Mover, path: str | os.PathLike[str]) -> Path:
    """Write the C header of a mover, such as mover.h, and return its path. Raises QuantityError as
    `mover_source`, and OSError."""
    target = Path(path)
    target.write_text(mover_source(mover), encoding="utf-8")
    return target
