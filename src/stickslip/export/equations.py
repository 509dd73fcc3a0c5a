"""Texts of stickslip_equations.h and stickslip_layout.h: a model's equations in C, translated from the Python
functions that the package's solvers compile, and the sizes of its arrays."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..engine.interface import numbers, row_of
from ..engine.laws import LAW, functions
from ..engine.sizes import sizes
from ..engine.translator import (
    BOOL,
    INT,
    REAL,
    Array,
    Record,
    Translation,
    TranslationError,
    real,
    record_type,
)
from ..friction import element, elements
from ..friction.law import _implementation
from ..physics.actuator import Actuator, PulledSlider, StageModes
from ..physics.electronics import Amplifier, StrainGauge
from ..physics.piezo import Creep, MaxwellCapacitor, Piezo, PrandtlIshlinskii
from ..quantities.records import Quantity, quantities
from ..quantities.units import QuantityError
from ..recording.chain import Chain
from ..simulation.models import mechanism, system
from .modes import modes_c
from .piezo import piezo_c, two_port_c, two_port_checks
from .signal_chain import (
    amplifier_after,
    amplifier_input,
    amplifier_settled,
    channel_output,
    sensor_after,
    sensor_output,
)

# Records whose Python method `_check` is not translated to C. Most of their conditions are on types and array
# lengths, which C code cannot change. `_checks` and `two_port_checks` write the others in C: the order of the
# voltage limits, and the order of a MaxwellCapacitor's elements. A piezo's plays and creep stay bounded for
# all values.
UNCHECKED = (Actuator, PulledSlider, StageModes, Piezo, PrandtlIshlinskii, MaxwellCapacitor, Creep)


# Names of the macros in stickslip_layout.h that are the same for every layout of the model.
_SAME = ("OF(name)", "WATCHED(test)")


class SignalChain(NamedTuple):
    """Amplifier and sensor between a control program and the actuator; each is None if it is missing."""

    amplifier: Amplifier | None = None
    capacitance: float | None = None  # capacitance of the piezo that the amplifier charges, F
    sensor: StrainGauge | Chain | None = None  # sensor of the end-effector position, or its channel


def equations(model: Any, chain: SignalChain, step: float, any_layout: bool) -> str:
    """Return the text of stickslip_equations.h, without its first comment: records, laws and checks in C.

    Args:
        model: actuator or pulled slider.
        chain: amplifier and sensor.
        step: integration step of the exported code, s; half of it is the interval between stored positions,
            from which a delayed channel is computed.
        any_layout: default of the macro STICKSLIP_ANY_LAYOUT: if True, parameters may change which bodies and
            elements the model has, and the integrator is slower.

    Raises:
        TranslationError: a function is outside the subset of Python that can be translated, or the law's
            elements are records of different types.
        QuantityError: the delay of the position channel is negative.
    """
    made = Translation()
    law, kind = model.friction, record_type(model)
    made.record(kind)
    made.function(mechanism, (kind,))
    piezo = piezo_c(made, getattr(model, "piezo", None))
    parts = [*_law(made, law), *piezo, *two_port_c(made, model), *modes_c(made, model)]
    parts += _chain(made, chain, step)
    checks = [*_checks(made, "model", kind), *two_port_checks(model)]
    for name, inner in record_type(chain).fields:
        if isinstance(inner, Record):
            checks += _checks(made, f"chain->{name}", inner)
    return "\n".join(
        [
            _HEAD,
            "/* 1: parameters may change what moves; the integrator is slower by a half then. */",
            f"#ifndef STICKSLIP_ANY_LAYOUT\n#define STICKSLIP_ANY_LAYOUT {int(any_layout)}\n#endif",
            *(f"#define {name} {value}" for name, value in room(model).items()),
            "",
            made.text(),
            f"typedef {kind.c_name} stickslip_model;",
            *parts,
            _limits(kind),
            *_check(checks),
            "#endif",
            "",
        ]
    )


_HEAD = """#ifndef STICKSLIP_EQUATIONS_H
#define STICKSLIP_EQUATIONS_H

#include <stddef.h>

#include "engine/law.h"
"""


def _law(made: Translation, law: Any) -> list[str]:
    """Return C lines of the friction law in the form that the engine calls.

    They contain macros of the law's sizes, the functions of one element, and stickslip_law_row, which writes
    the numbers of an element into an array.

    Args:
        made: translation, to which the functions are added.
        law: friction law of the model.

    Raises:
        TranslationError: the law cannot be translated, or its elements are records of different types.
    """
    name, kind, one = type(law).__name__, record_type(law), element(law, 0)
    inner, count = record_type(one), elements(law)
    whole, static = _implementation(law), "breakaway" in functions(type(one))
    try:
        text = LAW.c_of(made, inner)
    except TranslationError as error:
        raise TranslationError(f"{name} cannot be exported to C: {error}") from None
    if whole.element:
        of, got = made.function(whole.element, (kind, INT))
        if got != inner:
            raise TranslationError(f"{name} cannot be exported to C: its elements differ in type")
        filled = [f"const {inner.c_name} of = {of}(law, i);"]
    else:
        filled = [f"const {inner.c_name} of = *law;", "(void)i;"]
    filled += [f"row[{k}] = {number};" for k, number in enumerate(row_of(inner, "of"))] or ["(void)row;"]
    return [
        f"#define STICKSLIP_STATES {max(count, 1)} /* of the law; 1 of one that has none */",
        f"#define STICKSLIP_STATIC_LAW {int(static)} /* 1: true rest, a set-valued force */",
        f"#define STICKSLIP_NUMBERS {max(numbers(inner), 1)} /* of an element of the law */",
        f"#define STICKSLIP_LAW law_{type(one).__name__}",
        "",
        text,
        "/* The numbers of an element of the law, as its struct takes them. */",
        _calls(
            "void stickslip_law_row",
            f"const {kind.c_name} *law, int i, real_t row[STICKSLIP_NUMBERS]",
            "\n    ".join([*filled, "(void)of;"]),
        ),
    ]


def _calls(head: str, arguments: str, body: str) -> str:
    return f"static inline {head}({arguments})\n{{\n    {body}\n}}\n"


def _chain(made: Translation, chain: SignalChain, step: float) -> list[str]:
    """Return C lines of the amplifier and the sensor, with macros that say which of them exist.

    `made` is the translation, to which their functions are added; `step` is the integration step, s.

    Raises:
        QuantityError: the delay of the position channel is negative.
    """
    kind = record_type(chain)
    if not kind.fields:
        struct = "typedef struct { char unused; } stickslip_signal_chain;"
    else:
        struct = f"typedef {made.record(kind)} stickslip_signal_chain;"
    flags = [
        f"#define STICKSLIP_HAS_{part.upper()} {int(getattr(chain, part) is not None)}"
        for part in ("amplifier", "sensor")
    ]
    delay = chain.sensor.delay if isinstance(chain.sensor, Chain) else None
    if delay is not None and delay < 0.0:
        raise QuantityError(f"Chain.delay = {delay:g} s is out of range: what is exported cannot be early")
    # Number of past positions that the C code stores for a delayed channel, half a step apart: enough to have
    # one before and one after the time to which the channel's output belongs.
    kept = 0 if delay is None else 2 * math.ceil(delay / step * (1.0 - 1e-9)) + 2
    output = ""
    spacing = f"#define STICKSLIP_LATE_SPACING {0.5 * step!r} /* s, of these positions */"
    late = f"#define STICKSLIP_LATE {kept} /* positions of the past that are kept */"
    lines = [*flags, late, *([spacing] if kept else []), struct, ""]
    fields = dict(kind.fields)
    if chain.amplifier is not None:
        name, _ = made.function(amplifier_after, (fields["amplifier"], REAL, REAL, REAL, REAL))
        lines.append(_calls(
            "real_t stickslip_amplifier_after",
            "const stickslip_signal_chain *chain, real_t wanted, real_t now, real_t h",
            f"return {name}(&chain->amplifier, chain->capacitance, wanted, now, h);",
        ))  # fmt: skip
        for own, function in (("settled", amplifier_settled), ("input", amplifier_input)):
            name, _ = made.function(function, (fields["amplifier"], REAL))
            lines.append(_calls(
                f"real_t stickslip_amplifier_{own}", "const stickslip_signal_chain *chain, real_t volts",
                f"return {name}(&chain->amplifier, volts);",
            ))  # fmt: skip
    if isinstance(chain.sensor, Chain):
        output, _ = made.function(channel_output, (fields["sensor"], REAL))
    elif chain.sensor is not None:
        after, _ = made.function(sensor_after, (fields["sensor"], REAL, REAL, REAL))
        output, _ = made.function(sensor_output, (fields["sensor"], REAL))
        lines.append(_calls(
            "real_t stickslip_sensor_after",
            "const stickslip_signal_chain *chain, real_t position, real_t now, real_t h",
            f"return {after}(&chain->sensor, position, now, h);",
        ))  # fmt: skip
    if chain.sensor is not None:
        lines.append(_calls(
            "real_t stickslip_sensor_output", "const stickslip_signal_chain *chain, real_t seen",
            f"return {output}(&chain->sensor, seen);",
        ))  # fmt: skip
    return lines


def room(model: Any) -> dict[str, Any]:
    """Return the engine's array sizes by macro name: the largest over all layouts that parameters allow.

    Values are numbers, or C expressions as text. The keys are LARGEST_MODES (stage modes and end-effector),
    LARGEST_ELEMENTS (contacts and two-port) and LARGEST_STATES (positions and velocities, bristles, two-port
    elements).
    """
    port, law = getattr(model, "two_port", None), model.friction
    further = getattr(model, "further_modes", None)
    modes = 2 + (len(further.gain) if further is not None else 0)
    stops = len(port.stiffnesses) if port is not None else 0
    return {
        "LARGEST_MODES": modes,
        # 2 with STICKSLIP_ANY_LAYOUT, else 1: for a constant size of 1, gcc would warn of loops over one
        # element.
        "LARGEST_ELEMENTS": "(1 + STICKSLIP_ANY_LAYOUT)" if port is None else "2",
        "LARGEST_STATES": 2 * modes + elements(law) + stops,
    }


def layout(model: Any) -> str:
    """Return the text of stickslip_layout.h, without its first comment.

    The macros are the engine's sizes for this model's layout (bodies, stage modes, elements of the friction)
    or, if STICKSLIP_ANY_LAYOUT is 1, for any layout that the parameters allow.
    """
    fixed = sizes(system(model).plant, "stickslip")
    free = {name: fixed[name] for name in _SAME}
    any_plant, this_plant = (
        "\n".join(f"#define {name} {text}" for name, text in one.items()) for one in (free, fixed)
    )
    return (
        "#ifndef STICKSLIP_LAYOUT_H\n#define STICKSLIP_LAYOUT_H\n\n"
        f'#if STICKSLIP_ANY_LAYOUT\n{any_plant}\n#include "engine/any_size.inl"\n'
        f"#else\n{this_plant}\n#endif\n\n#endif\n"
    )


def _limits(kind: Record) -> str:
    """Return two C functions, which return the lower and the upper limit of the model's input.

    The limits are the fields min_voltage and max_voltage of the record `kind`, V; infinite if it has none.
    """
    lines = []
    for end, field, none in (("low", "min_voltage", "-INFINITY"), ("high", "max_voltage", "INFINITY")):
        has = field in dict(kind.fields)
        body = f"return model->{field};" if has else f"(void)model;\n    return R({none});"
        lines.append(_calls(f"real_t stickslip_input_{end}", "const stickslip_model *model", body))
    return "\n".join(lines)


def _checks(made: Translation, owner: str, kind: Record) -> list[str]:
    """Return C lines for a function that returns an error message if values of a record are wrong.

    The ranges of the single values are checked first, then the relations between values. Inner records are
    included.

    Args:
        made: translation, to which the record's own check is added.
        owner: C expression of the record; a name alone, without "." or "->", is a pointer.
        kind: type of the record.
    """
    lines, specs = [], quantities(kind.record_class)
    arrow = "->" if "->" not in owner and "." not in owner else "."
    for name, inner in kind.fields:
        field = f"{owner}{arrow}{name}"
        if isinstance(inner, Record):
            lines += _checks(made, field, inner)
        elif inner != BOOL and name in specs:
            label = f"{kind.record_class.__name__}.{name}"
            text = f"{label} is out of range: {specs[name].meaning} must be {specs[name].range_text()}"
            said = text.encode("ascii", "replace").decode().replace("%", "percent")
            if isinstance(inner, Array):
                for i in range(inner.length):
                    lines.append(f'if (!({_allowed(specs[name], f"{field}[{i}]")})) {{ return "{said}"; }}')
            else:
                lines.append(f'if (!({_allowed(specs[name], field)})) {{ return "{said}"; }}')
    own = getattr(kind.record_class, "_check", None)
    if own is not None and kind.record_class not in UNCHECKED:
        name = made.check(own, kind)
        lines.append(f"wrong = {name}(&{owner});\n    if (wrong != NULL) {{ return wrong; }}")
    elif "min_voltage" in dict(kind.fields):
        lines.append(
            f"if (!({owner}{arrow}min_voltage < {owner}{arrow}max_voltage)) "
            '{ return "Actuator.min_voltage is out of range: it must be < max_voltage"; }'
        )
    return lines


def _allowed(spec: Quantity, field: str) -> str:
    """Return the C condition that a field is in its range.

    The condition is false for NaN, and for infinity unless infinity is an end of the range.

    Args:
        spec: quantity of the field, with its bounds.
        field: C expression of the field.
    """
    parts = []
    for sign, limit in ((">=", spec.minimum), (">", spec.above), ("<=", spec.maximum), ("<", spec.below)):
        if limit is not None:
            parts.append(f"{field} {sign} {real(limit)}")
    if spec.minimum is None and spec.above is None:
        parts.append(f"{field} > R(-INFINITY)")
    if spec.maximum is None and spec.below is None:
        parts.append(f"{field} < R(INFINITY)")
    return " && ".join(f"({part})" for part in parts)


def _check(lines: list[str]) -> list[str]:
    body = "\n".join(f"    {line}" for line in lines)
    return [
        "/* NULL, or what is wrong with the parameters. */",
        "static inline const char *stickslip_check("
        "const stickslip_model *model, const stickslip_signal_chain *chain)",
        "{\n    const char *wrong = NULL;\n    (void)chain;\n    (void)wrong;",
        f"{body}\n    return NULL;\n}}\n",
    ]
