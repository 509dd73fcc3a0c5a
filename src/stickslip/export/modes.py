"""C code of the stage's vibration modes after the first one: functions that return their numbers.

The engine simulates all modes.
"""

from __future__ import annotations

from typing import Any

from ..engine.translator import REAL, Translation, record_type
from ..simulation.models import stage_mode


def modes_c(made: Translation, model: Any) -> list[str]:
    """Return C lines of the vibration modes after the first one of the stage of `model`.

    They are the macro STICKSLIP_FURTHER, the number of these modes, and, if there are any, two functions of a
    mode's index. These return the mode's record ss_Mode, and its acceleration per unit of the contact's
    force. `made` is the translation, to which their types and functions are added.
    """
    modes = getattr(model, "further_modes", None)
    count = 0 if modes is None else len(modes.gain)
    lines = [f"#define STICKSLIP_FURTHER {count} /* modes of the stage after its first */"]
    if modes is None:
        return lines
    made.record(record_type(modes))
    name, _ = made.function(stage_mode, (REAL,) * 3)
    push = "(model->stage_reaction && !model->clamped) ? R(-1.0) / model->further_modes.mass[m] : R(0.0)"
    return [
        *lines,
        "static inline ss_Mode stickslip_further_mode(const stickslip_model *model, int m)",
        "{",
        "    const ss_StageModes *of = &model->further_modes;",
        f"    return {name}(of->gain[m], of->natural_frequency[m], of->damping_ratio[m]);",
        "}\n",
        "/* Its acceleration per unit of the contact's force. */",
        "static inline real_t stickslip_further_push(const stickslip_model *model, int m)",
        "{",
        *(() if modes.mass else ("    (void)model;", "    (void)m;")),
        f"    return {push if modes.mass else 'R(0.0)'};",
        "}\n",
    ]
