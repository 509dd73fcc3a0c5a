"""Further modes of the stage in C: their equation of motion is translated, the step method adds them up."""

from __future__ import annotations

from typing import Any

from ..engine.translator import REAL, Translation, record_type


def mode_acceleration(gain, natural_frequency, damping_ratio, per_mass, u, q, w, force):  # type: ignore[no-untyped-def]
    """Acceleration of a further mode of the stage for the drive u and the friction force."""
    free = natural_frequency**2 * (gain * u - q) - 2.0 * damping_ratio * natural_frequency * w
    return free - per_mass * force


def modes_c(made: Translation, model: Any) -> list[str]:
    """How many further modes a stage has, and their acceleration."""
    modes = getattr(model, "further_modes", None)
    count = 0 if modes is None else len(modes.gain)
    lines = [f"#define STICKSLIP_FURTHER {count} /* modes of the stage after its first */"]
    if modes is None:
        return lines
    made.record(record_type(modes))
    name, _ = made.function(mode_acceleration, (REAL,) * 8)
    by_force = "(model->stage_reaction && !model->clamped) ? R(1.0) / of->mass[m] : R(0.0)"
    return [
        *lines,
        "static inline real_t stickslip_further_acceleration(",
        "    const stickslip_model *model, int m, real_t u, real_t q, real_t w, real_t force)",
        "{",
        "    const ss_StageModes *of = &model->further_modes;",
        f"    const real_t per_mass = {by_force if modes.mass else 'R(0.0)'};",
        f"    return {name}(",
        "        of->gain[m], of->natural_frequency[m], of->damping_ratio[m], per_mass, u, q, w, force);",
        "}\n",
    ]
