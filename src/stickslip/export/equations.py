"""stickslip_equations.h: the equations of a model in C, translated from what the solvers compile."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..actuator import Actuator, PulledSlider, StageModes
from ..chain import Chain
from ..electronics import Amplifier, StrainGauge
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
from ..friction import element, elements, rate
from ..friction.law import _implementation
from ..mechanism import holding_force, joined, slider_acceleration, stage_acceleration
from ..piezo import Creep, MaxwellCapacitor, Piezo, PrandtlIshlinskii
from ..records import Quantity, quantities
from ..simulation.models import mechanism
from ..units import QuantityError
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

# Records whose `_check` is not translated: of the models, of lengths, which cannot change, and of a piezo,
# whose plays and lags stay bounded whatever their values are.
UNCHECKED = (Actuator, PulledSlider, StageModes, Piezo, PrandtlIshlinskii, MaxwellCapacitor, Creep)


class SignalChain(NamedTuple):
    """What stands between a program and the actuator; each part may be missing."""

    amplifier: Amplifier | None = None
    capacitance: float | None = None  # F, of the piezo; with the amplifier
    sensor: StrainGauge | Chain | None = None  # on the end-effector


def equations(model: Any, chain: SignalChain, step: float) -> str:
    """The text of stickslip_equations.h, without its first comment, for steps of `step` [s].

    Raises:
        TranslationError: a function of the law is outside the subset that can be translated.
    """
    made = Translation()
    law, kind = model.friction, record_type(model)
    made.record(kind)
    _, mech = made.function(mechanism, (kind,))
    for function in (stage_acceleration, slider_acceleration):
        made.function(function, (mech, REAL, REAL, REAL, REAL))
    made.function(holding_force, (mech, REAL, REAL, Array(7)))
    made.function(joined, (mech, REAL))
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

#include "stickslip_real.h"
"""


def _law(made: Translation, law: Any) -> list[str]:
    """The functions of the friction law under the names that the step method calls."""
    count, kind = elements(law), record_type(law)
    one = element(law, 0)
    whole, single = _implementation(law), _implementation(one)
    inner = record_type(one)
    if single.rate is None:
        raise TranslationError(f"{type(law).__name__} cannot be exported to C: its elements have no rate")
    rate, result = made.function(single.rate, (inner, REAL, REAL), ("force", "dz"))
    if len(getattr(result, "members", ())) != 2:
        raise TranslationError(
            f"{type(law).__name__} cannot be exported to C: its rate must give (force, dz)"
        )
    lines = [
        f"#define STICKSLIP_STATES {max(count, 1)} /* of the law, or its direction of sliding */",
        f"#define STICKSLIP_STATIC_LAW {int(count == 0)} /* 1: true rest, a set-valued force */",
        f"#define STICKSLIP_LINEAR_LAW {int(_linear(law))} /* 1: the rate of the state is linear in it */",
        f"typedef {inner.c_name} stickslip_element;",
        f"typedef {result.c_name} stickslip_contact;",
        "",
        _calls("stickslip_contact stickslip_law_rate", "const stickslip_element *law, real_t v, real_t z",
               f"return {rate}(law, v, z);"),
    ]  # fmt: skip
    head = f"stickslip_element stickslip_law_element(const {kind.c_name} *law, int i)"
    if whole.element:
        name, got = made.function(whole.element, (kind, INT))
        if got != inner:
            raise TranslationError(
                f"{type(law).__name__} cannot be exported to C: its elements differ in type"
            )
        lines.append(f"static inline {head}\n{{\n    return {name}(law, i);\n}}\n")
    else:
        lines.append(f"static inline {head}\n{{\n    (void)i;\n    return *law;\n}}\n")
    if whole.breakaway:
        name, _ = made.function(whole.breakaway, (kind,))
        body = f"return {name}(law);"
    else:
        body = "(void)law;\n    return R(0.0);"
    lines.append(_calls("real_t stickslip_law_breakaway", f"const {kind.c_name} *law", body))
    if single.project:
        name, _ = made.function(single.project, (inner, REAL))
        body = f"return {name}(law, z);"
    else:
        body = "(void)law;\n    return z;"
    lines.append(_calls("real_t stickslip_law_project", "const stickslip_element *law, real_t z", body))
    return lines


def _linear(law: Any) -> bool:
    """Whether the rate of the internal state is linear in it, also where a parameter is changed later."""
    variants = [law]
    for name, value in law._asdict().items():
        if isinstance(value, float):
            try:
                variants.append(law._replace(**{name: 1.3 * value}))
            except QuantityError:
                continue
    for one in (element(variant, i) for variant in variants for i in range(elements(variant))):
        for v in (-1e-2, -1e-4, 1e-5, 1e-3, 1e-1):
            for z in np.geomspace(1e-9, 1e-4, 11):
                low, middle, high = (rate(one, v, at)[1] for at in (-z, 0.5 * z, 2.0 * z))
                if abs(0.5 * (low + high) - middle) > 1e-9 * max(abs(low), abs(high), abs(middle)):
                    return False
    return elements(law) > 0


def _calls(head: str, arguments: str, body: str) -> str:
    return f"static inline {head}({arguments})\n{{\n    {body}\n}}\n"


def _chain(made: Translation, chain: SignalChain, step: float) -> list[str]:
    """Amplifier and sensor, as far as there are any."""
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
    # Positions that are kept for a channel that is late, each half step: one on either side of what it shows.
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


def _limits(kind: Record) -> str:
    """The limits of the input; without end where the model has none."""
    lines = []
    for end, field, none in (("low", "min_voltage", "-INFINITY"), ("high", "max_voltage", "INFINITY")):
        has = field in dict(kind.fields)
        body = f"return model->{field};" if has else f"(void)model;\n    return R({none});"
        lines.append(_calls(f"real_t stickslip_input_{end}", "const stickslip_model *model", body))
    return "\n".join(lines)


def _checks(made: Translation, owner: str, kind: Record) -> list[str]:
    """Lines that return what is wrong with a record's values: ranges, then how they fit each other."""
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
    """The range of a field as a condition, false for NaN; infinity only where it is a limit itself."""
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
