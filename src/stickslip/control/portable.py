"""A regulator, or a whole `Mover`, as C99 in one header: the same operations in the same order, so the same
output to the bit.

That holds where doubles are IEEE 754 and products and sums are rounded one by one: ``gcc -std=c99`` does so
(``-ffp-contract=off`` elsewhere).
"""

from __future__ import annotations

import math
import os
from pathlib import Path

from .._version import __version__
from ..units import QuantityError
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
    """As C takes it, to the bit: where there is no limit, infinity."""
    return float(value).hex() if math.isfinite(value) else f"({'-' if value < 0.0 else ''}INFINITY)"


def regulator_source(regulator: Regulator) -> str:
    """The header; raises QuantityError for a regulator with the inverse of a piezo."""
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
    """Write the header, regulator.h say; its path. Raises QuantityError as `regulator_source`, OSError."""
    target = Path(path)
    target.write_text(regulator_source(regulator), encoding="utf-8")
    return target


_MOVER = """
/* A state machine of moves made by stickslip {version}, and its regulator above. */
#ifndef STICKSLIP_MOVER_H
#define STICKSLIP_MOVER_H

#include <math.h>
#include <stdbool.h>

{constants}

static const double mover_voltages[MOVER_POINTS] = {{{volts}}};
static const double mover_steps[2][MOVER_POINTS] = {{ /* forward, backward, m */
    {{{forward}}},
    {{{backward}}},
}};
static const double mover_slip[MOVER_SLIPPING] = {{{slip}}};
static const double mover_learnt[2][3] = {{{{{learnt_forward}}}, {{{learnt_backward}}}}};

"""


def mover_source(mover: Mover) -> str:
    """The header of a mover that begins at rest, with what it has learnt of its steps; raises QuantityError
    for one whose regulator has the inverse of a piezo."""
    table, learnt = mover.steps_of.table, mover.steps_of.learnt
    constants = "\n".join(
        f"#define MOVER_{name.upper()} {_number(value) if isinstance(value, float) else f'{value}L'}"
        for name, value in mover.constants().items()
    )
    rows = {
        "volts": (0.0, *table.voltages),
        "forward": (0.0, *table.forward),
        "backward": (0.0, *table.backward),
        "slip": mover.slipping,
        "learnt_forward": learnt[0],
        "learnt_backward": learnt[1],
    }
    head = _MOVER.format(
        version=__version__,
        constants=constants,
        **{name: ", ".join(_number(one) for one in row) for name, row in rows.items()},
    )
    parts = [
        (Path(__file__).parent / "c" / name).read_text(encoding="ascii") for name in ("arrival.h", "mover.h")
    ]
    return "".join([regulator_source(mover.regulator), head, *parts])


def export_mover(mover: Mover, path: str | os.PathLike[str]) -> Path:
    """Write the header, mover.h say; its path. Raises QuantityError as `mover_source`, OSError."""
    target = Path(path)
    target.write_text(mover_source(mover), encoding="utf-8")
    return target
