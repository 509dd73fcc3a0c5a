"""Variables of an FMU: inputs, outputs and parameters, each with its place in the C code."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from ..engine.translator import KEYWORDS
from ..physics.actuator import Actuator
from ..quantities.units import unit_for
from .equations import SignalChain
from .source import Exported, exported_values, meaning
from .values import plain

Mode = Literal["plant", "observer", "feedforward"]
MEASURED = "measured_position"  # name of an input that only the mode "observer" has


class ModelVariable(NamedTuple):
    """One variable of an FMU: its attributes in modelDescription.xml, and its place in the C code.

    `reference` is the value reference, by which importers name the variable. `c` is its member of the C
    struct fmi_data. `start` is the initial value; None for outputs without one.
    """

    name: str
    reference: int
    c: str
    causality: Literal["input", "output", "parameter"]
    unit: str
    description: str
    start: float | bool | None = None

    @property
    def boolean(self) -> bool:
        return isinstance(self.start, bool)


_OUTPUTS = (
    ("end_effector_position", "m", "Position of the end-effector"),
    ("stage_position", "m", "Position of the stage"),
    ("sliding_displacement", "m", "Stage position minus end-effector position"),
    (
        "friction_force",
        "N",
        "Friction force of the stage on the end-effector, mean of the last internal step",
    ),
    ("drive_voltage", "V", "Input of the actuator, behind the amplifier if there is one"),
    ("stage_velocity", "m/s", "Velocity of the stage"),
    ("end_effector_velocity", "m/s", "Velocity of the end-effector"),
)
_INPUTS, _FIRST_OUTPUT, _FIRST_PARAMETER = 1, 100, 1000


def variables(
    found: Exported, chain: SignalChain, mode: Mode, step: float, rest: float
) -> list[ModelVariable]:
    """Return all variables of an FMU: inputs, outputs and parameters, with units of the linear or rotary
    model.

    Value references of inputs are from 1, of outputs from 100, and of parameters from 1000 on.

    Args:
        found: the model with the sources of its values.
        chain: amplifier and sensor.
        mode: "plant", "observer" or "feedforward", see `export_fmu`.
        step: longest internal step, s.
        rest: input at rest, V, or m for a pulled slider.
    """
    made = [*_inputs(found.model, mode, step, rest), *_outputs(found.model, chain, mode)]
    # An observer's gain is valid only for the step of its export, so that step is no parameter.
    made += [one for one in _parameters(found, step) if mode != "observer" or one.name != "step"]
    return [one._replace(unit=unit_for(found.model, one.unit)) for one in made]


def _inputs(model: Any, mode: Mode, step: float, rest: float) -> list[ModelVariable]:
    drive = ("voltage", "V", "Drive voltage") if isinstance(model, Actuator) else (
        "spring_end", "m", "Position of the spring's far end")  # fmt: skip
    wanted = {
        "plant": [drive],
        "observer": [
            drive,
            (
                MEASURED,
                "m",
                f"Measured position of the end-effector at the begin of a communication step of {step:g} s, "
                "which the observer's gain is for",
            ),
        ],
        "feedforward": [
            ("wanted_position", "m", "Wanted position of the end-effector"),
            ("wanted_velocity", "m/s", "Its first derivative"),
            ("wanted_acceleration", "m/s2", "Its second derivative"),
        ],
    }[mode]
    starts = [0.0 if mode == "feedforward" else rest, 0.0, 0.0]
    return [
        ModelVariable(name, _INPUTS + i, f"input[{i}]", "input", unit, words, starts[i])
        for i, (name, unit, words) in enumerate(wanted)
    ]


def _outputs(model: Any, chain: SignalChain, mode: Mode) -> list[ModelVariable]:
    first = _FIRST_OUTPUT
    if mode == "feedforward":
        return [
            ModelVariable("voltage", first, "voltage", "output", "V", "Drive voltage for the wanted motion"),
            ModelVariable("would_slide", first + 1, "would_slide", "output", "",
                     "Whether the wanted motion needs more force than friction holds", False),
        ]  # fmt: skip
    known = list(_OUTPUTS)
    if not isinstance(model, Actuator):
        known[4] = ("drive_voltage", "m", "Position of the spring's far end")
    if chain.sensor is not None:
        known.append(("sensor_output", chain.sensor.unit, "Output of the sensor on the end-effector"))
    return [
        ModelVariable(name, first + i, f"outputs.{name}", "output", unit, words)
        for i, (name, unit, words) in enumerate(known)
    ]


def _parameters(found: Exported, step: float) -> list[ModelVariable]:
    made = [
        ModelVariable("step", _FIRST_PARAMETER, "step", "parameter", "s",
                 "Longest internal step; a communication step is divided into equal ones", step)
    ]  # fmt: skip
    for name, value in exported_values(found.model).items():
        unit, symbol, words = meaning(found.model, name)
        said = plain(
            f"{words[:1].upper()}{words[1:]}{f', {symbol}' if symbol else ''}; {found.sources[name]}"
        )
        place = ".".join(f"{part}_" if part in KEYWORDS else part for part in name.split("."))
        several = isinstance(value, tuple)
        for i, one in enumerate(value if several else (value,)):
            index = f"[{i + 1}]" if several else ""
            c = f"parameters.model.{place}{f'[{i}]' if several else ''}"
            number = one if isinstance(one, bool) else float(one)
            made.append(
                ModelVariable(name + index, _FIRST_PARAMETER + len(made), c, "parameter", unit, said, number)
            )
    return made


def variables_h(found: list[ModelVariable], mode: Mode, token: str, step: float, rest: float) -> str:
    """Return the text of fmi_variables.h, without its first comment.

    The C functions in it return the address of a variable for a value reference, and say whether a reference
    is an input or a parameter; the macros define mode, token, step and input at rest.

    Args:
        found: all variables of the FMU.
        mode: "plant", "observer" or "feedforward".
        token: GUID in braces, as in modelDescription.xml.
        step: default of the longest internal step, s.
        rest: input at rest, V, or m for a pulled slider.
    """
    accessors = []
    for kind, boolean in (("real", False), ("boolean", True)):
        c_type = "bool" if boolean else "real_t"
        cases = [
            f"    case {v.reference}U: return &data->{v.c}; /* {v.name} */"
            for v in found
            if v.boolean is boolean
        ]
        accessors.append(
            f"static {c_type} *fmi_{kind}(fmi_data *data, unsigned int reference)\n{{\n"
            "    switch (reference) {\n" + "\n".join(cases) + ("\n" if cases else "")
            + "    default: (void)data; return NULL;\n    }\n}\n"
        )  # fmt: skip
    return "\n".join([
        "#ifndef FMI_VARIABLES_H", "#define FMI_VARIABLES_H", "",
        f"#define MODE {mode.upper()}", f'#define TOKEN "{token}"',
        f"#define DEFAULT_STEP {step!r}", f"#define REST_INPUT {rest!r}", "",
        *accessors,
        "static bool is_parameter(unsigned int reference)\n{\n"
        f"    return reference >= {_FIRST_PARAMETER}U;\n}}\n",
        "static bool is_input(unsigned int reference)\n{\n"
        f"    return (reference >= {_INPUTS}U) && (reference < {_FIRST_OUTPUT}U);\n}}\n",
        "#endif", "",
    ])  # fmt: skip
