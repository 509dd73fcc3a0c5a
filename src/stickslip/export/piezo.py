"""C code of a piezo's hysteresis and creep, as loops over translated functions of `stickslip.physics.piezo`.

Within a step the voltage is linear in time. The output of the hysteresis is approximated as linear, too, and
creep is exact for a linear input. The engine simulates the elements of a `MaxwellCapacitor`, a two-port:
charge and force act on each other.
"""

from __future__ import annotations

from typing import Any

from ..engine.interface import numbers, row_of
from ..engine.laws import LAW
from ..engine.translator import REAL, Translation, record_type
from ..friction import element
from ..friction.maxwell_slip import MaxwellElement
from ..physics.piezo import BoucWen, Creep, MaxwellCapacitor, Piezo, PrandtlIshlinskii
from ..physics.piezo.bouc_wen import bent
from ..physics.piezo.creep import lag_change
from ..physics.piezo.operators import beyond, play
from ..simulation.two_port import PER_VOLT


def refused(piezo: Piezo | None) -> str:
    """Return the reason why a piezo model cannot be exported, as a text; "" if it can, or without a piezo.

    Exported code has the hystereses PrandtlIshlinskii, BoucWen and MaxwellCapacitor, and Creep.
    """
    if piezo is None:
        return ""
    hystereses = PrandtlIshlinskii | BoucWen | MaxwellCapacitor
    for part, known in ((piezo.hysteresis, hystereses), (piezo.creep, Creep)):
        if part is not None and not isinstance(part, known):
            return (
                f"a {type(part).__name__} is not part of exported code, which has PrandtlIshlinskii, "
                "BoucWen, MaxwellCapacitor and Creep: export the actuator with replace(piezo=None)"
            )
    return ""


def piezo_c(made: Translation, piezo: Piezo | None) -> list[str]:
    """Return C lines of a piezo's hysteresis and creep, which the exported step method uses.

    They are macros of the numbers of states, and, where needed, the functions stickslip_hysteresis and
    stickslip_creep. `made` is the translation, to which their functions are added.
    """
    hysteresis, creep = (None, None) if piezo is None else piezo
    port = isinstance(hysteresis, MaxwellCapacitor)
    counts = {
        "PIEZO": int(hysteresis is not None or creep is not None),
        "HYSTERESIS": _states(hysteresis),
        "TWO_PORT": len(hysteresis.stiffnesses) if port else 0,
        "CREEP": 0 if creep is None else len(creep.shares),
    }
    defines = [f"#define STICKSLIP_{name} {count}" for name, count in counts.items()]
    if piezo is None or not counts["PIEZO"]:
        return [*defines, ""]
    lines = [*defines, f"typedef {made.record(record_type(piezo))} stickslip_piezo;", ""]
    if hysteresis is not None and not port:
        body = _bouc_wen(made, hysteresis) if isinstance(hysteresis, BoucWen) else _plays(made, hysteresis)
        lines += [
            "/* The hysteresis' output [V] at the voltage u, after one of `before`; moves its states z. */",
            "static inline real_t stickslip_hysteresis(",
            "    const stickslip_piezo *piezo, real_t before, real_t u, real_t z[STICKSLIP_HYSTERESIS])",
            "{",
            *(f"    {line}" for line in body),
            "}\n",
        ]
    if creep is not None:
        name, _ = made.function(lag_change, (REAL,) * 5)
        lines += [
            "/* How a term of creep changes over a step of h; the hysteresis' output goes along a line. */",
            "static inline real_t stickslip_creep(",
            "    const stickslip_piezo *piezo, int k, real_t h, real_t x, real_t begin, real_t end)",
            "{",
            f"    return {name}(piezo->creep.time_constants[k], h, x, begin, end);",
            "}\n",
        ]
    return lines


def _states(hysteresis: object) -> int:
    if isinstance(hysteresis, PrandtlIshlinskii):
        return len(hysteresis.thresholds)
    return int(isinstance(hysteresis, BoucWen))


def felt(gain, stage_mass, natural_frequency, capacitance):  # type: ignore[no-untyped-def]
    """Return the voltage at the elements of a MaxwellCapacitor per displacement of the stage, V/m.

    The charge per displacement, which is the force per voltage `gain * stage_mass * natural_frequency**2`,
    is divided by the capacitance.

    Args:
        gain: displacement of the stage per voltage, m/V.
        stage_mass: mass of the stage, kg.
        natural_frequency: natural angular frequency of the stage, rad/s.
        capacitance: capacitance of the piezo, F.
    """
    return gain * stage_mass * natural_frequency**2 / capacitance


def two_port_c(made: Translation, model: Any) -> list[str]:
    """Return C lines for the elements ("stops") of a `MaxwellCapacitor`; [] if the model has none.

    The engine simulates a stop as an element of a friction law. The lines contain the law (unless the model's
    friction has it already), `felt` in C, and a function that computes the numbers of all stops. `made` is
    the translation, to which types and functions are added.
    """
    port = getattr(model, "two_port", None)
    if port is None:
        return []
    name, _ = made.function(felt, (REAL,) * 4)
    stop = record_type(MaxwellElement(*(1.0,) * 6))
    made.record(stop)
    known = isinstance(element(model.friction, 0), MaxwellElement)
    return [
        *(() if known else (LAW.c_of(made, stop),)),
        f"#define STICKSLIP_PER_VOLT {PER_VOLT!r} /* m, of the states of the stops */",
        f"#define STICKSLIP_STOP_NUMBERS {numbers(stop)}",
        "#define STICKSLIP_STOP_LAW law_MaxwellElement",
        "/* V/m: by how much the stops feel the stage. */",
        "static inline real_t stickslip_felt(const stickslip_model *model)",
        "{",
        f"    return {name}(model->gain, model->stage_mass, model->natural_frequency,",
        "        model->piezo.hysteresis.capacitance);",
        "}\n",
        "/* The numbers of the stops as elements of a law: stickslip.physics.piezo.MaxwellCapacitor.stops */",
        "static inline void stickslip_stops(const ss_MaxwellCapacitor *of,",
        "    real_t row[STICKSLIP_TWO_PORT][STICKSLIP_STOP_NUMBERS])",
        "{",
        "    real_t after = R(1.0) / of->capacitance, width[STICKSLIP_TWO_PORT], share[STICKSLIP_TWO_PORT];",
        "    for (int j = STICKSLIP_TWO_PORT - 1; j >= 0; --j) {",
        "        const real_t slope = after + of->stiffnesses[j];",
        "        const real_t before = (j > 0) ? of->breakaways[j - 1] / of->stiffnesses[j - 1] : R(0.0);",
        "        width[j] = (of->breakaways[j] / of->stiffnesses[j] - before) * slope;",
        "        share[j] = (R(1.0) / after - R(1.0) / slope) / of->capacitance;",
        "        after = slope;",
        "    }",
        "    for (int j = 0; j < STICKSLIP_TWO_PORT; ++j) {",
        "        width[j] += (j > 0) ? width[j - 1] : R(0.0);",
        f"        const {stop.c_name} one = {{",
        "            share[j], R(STICKSLIP_PER_VOLT) * share[j] * width[j],",
        "            R(STICKSLIP_PER_VOLT) * share[j] * width[j], R(1.0), R(1.0), R(0.0)};",
        *(f"        row[j][{k}] = {number};" for k, number in enumerate(row_of(stop, "one"))),
        "    }",
        "}\n",
    ]


def two_port_checks(model: Any) -> list[str]:
    """Return C lines that return an error message if the elements of a `MaxwellCapacitor` are out of order.

    The charges at which they slip must ascend. The list is empty if the model has fewer than two elements.
    """
    port = getattr(model, "two_port", None)
    of = "model->piezo.hysteresis"
    said = "MaxwellCapacitor: the charges at which the elements slip must ascend"
    return [
        f"if (!({of}.breakaways[{i}] / {of}.stiffnesses[{i}] "
        f'< {of}.breakaways[{i + 1}] / {of}.stiffnesses[{i + 1}])) {{ return "{said}"; }}'
        for i in range(len(port.stiffnesses) - 1 if port is not None else 0)
    ]


def _plays(made: Translation, of: PrandtlIshlinskii) -> list[str]:
    one, _ = made.function(play, (REAL,) * 3)
    past, _ = made.function(beyond, (REAL,) * 2)
    zones = len(of.dead_zones)
    lines = ["const ss_PrandtlIshlinskii *of = &piezo->hysteresis;", "real_t v = u, sum = R(0.0);"]
    if of.skews:
        lines += [
            f"for (int j = 0; j < {zones}; ++j) {{",
            f"    v += of->skews[j] * ({past}(u, of->dead_zones[j]) - {past}(R(0.0), of->dead_zones[j]));",
            "}",
        ]
    lines += [
        "for (int i = 0; i < STICKSLIP_HYSTERESIS; ++i) {",
        f"    z[i] = {one}(v, of->thresholds[i], z[i]);",
        "    sum += of->weights[i] * z[i];",
        "}",
    ]
    if zones:
        lines += [
            f"for (int j = 0; j < {zones}; ++j) {{",
            f"    sum += of->slopes[j] * {past}(u, of->dead_zones[j]);",
            "}",
        ]
    return [*lines, "(void)before;", "return sum;"]


def _bouc_wen(made: Translation, of: BoucWen) -> list[str]:
    name, _ = made.function(bent, (record_type(of), REAL, REAL, REAL))
    return [f"z[0] = {name}(&piezo->hysteresis, z[0], before, u);", "return u - z[0];"]
