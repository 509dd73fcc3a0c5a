"""Text of stickslip_parameters.c: the values of an exported model, each with its unit, meaning and source."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from ..engine.translator import KEYWORDS, real
from ..quantities.records import quantities
from .equations import SignalChain
from .source import Exported, exported_values, meaning


def parameters_c(found: Exported, chain: SignalChain, gain: NDArray[Any]) -> str:
    """Return the text of stickslip_parameters.c, without its first comment.

    The C function stickslip_default_parameters in it returns a struct of the values of model, signal chain
    and observer's gain.

    Args:
        found: the model with the sources of its values.
        chain: amplifier and sensor.
        gain: the observer's gain, in the order of `gain.observer_gain`.
    """
    lines = []
    for name, value in exported_values(found.model).items():
        unit, symbol, words = meaning(found.model, name)
        said = f"{unit + ', ' if unit else ''}{symbol + ': ' if symbol else ''}{words}; {found.sources[name]}"
        lines += _set(f"model.{name}", value, said)
    for part in ("amplifier", "sensor"):
        record = getattr(chain, part)
        for field, spec in quantities(type(record)).items() if record is not None else ():
            said = f"{spec.unit + ', ' if spec.unit else ''}{spec.symbol}: {spec.meaning}"
            lines += _set(f"chain.{part}.{field}", getattr(record, field), said)
    if chain == SignalChain():
        lines.append("p.chain.unused = 0;")
    if chain.capacitance is not None:
        lines += _set("chain.capacitance", chain.capacitance, "F, C_p: capacitance of the piezo")
    units = ("1, for the stage's position", "1/s, for its velocity", "1, for the end-effector's position",
             "1/s, for its velocity", "1, for the bristles")  # fmt: skip
    for m in range(2, 2 + (len(gain) - len(units)) // 2):
        units += (f"1, for the position of the stage's mode {m}", "1/s, for its velocity")
    for i, (value, said) in enumerate(zip(gain, units, strict=True)):
        lines += _set(f"observer_gain[{i}]", float(value), f"{said}, per metre that was measured too much")
    body = "\n".join(f"    {line}" for line in lines)
    return (
        '#include "stickslip.h"\n\n'
        "stickslip_parameters stickslip_default_parameters(void)\n"
        f"{{\n    stickslip_parameters p;\n{body}\n    return p;\n}}\n"
    )


def _set(name: str, value: Any, said: str) -> list[str]:
    comment = plain(said)
    name = ".".join(f"{part}_" if part in KEYWORDS else part for part in name.split("."))
    if isinstance(value, tuple):
        return [f"/* {comment} */", *(f"p.{name}[{i}] = {real(v)};" for i, v in enumerate(value))]
    text = ("true" if value else "false") if isinstance(value, bool) else real(value)
    return [f"p.{name} = {text}; /* {comment} */"]


_SPELLED = str.maketrans({
    "σ": "sigma_", "ζ": "zeta", "ω": "omega", "β": "beta", "α": "alpha", "δ": "delta", "π": "pi", "τ": "tau",
    "₀": "0", "₁": "1", "₂": "2", "²": "^2", "√": "sqrt ", "µ": "u", "±": "+-", "Δ": "Delta ", "°": " degree",
})  # fmt: skip


def plain(text: str) -> str:
    """Return a text in ASCII, on one line, and without the start or the end of a C comment.

    Greek letters and some signs are spelled out; other letters beyond ASCII become "?".
    """
    ascii_text = text.translate(_SPELLED).encode("ascii", "replace").decode()
    return " ".join(ascii_text.replace("*/", "* /").replace("/*", "/ *").split())
