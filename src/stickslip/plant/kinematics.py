"""Further functions of a plant, as text for one layout: inputs, events, bounds, drift, ticks."""

from __future__ import annotations

from collections.abc import Callable

from .system import Layout
from .writing import (
    Text,
    along_terms,
    drive_terms,
    normal_of,
    own_push,
    padded,
    pin,
    present,
    share_along,
    side_of,
    state_terms,
    states_of,
    static_elements,
    sum_of,
    tuple_of,
)


def speeds(layout: Layout) -> Text:
    made = []
    for e, shape in enumerate(layout.elements):
        along = state_terms(shape, e)
        made.append(sum_of([*along, *drive_terms(shape, e)]))
    return Text([], padded(made))


def relative_speeds(layout: Layout) -> Text:
    made = [sum_of(state_terms(shape, e)) for e, shape in enumerate(layout.elements)]
    return Text([], padded(made))


def size(layout: Layout) -> Text:
    positions = [f"abs(r[{2 * m}])" for m in range(layout.modes)]
    velocities = [f"abs(r[{2 * m + 1}])" for m in range(layout.modes)]
    count = layout.first[-1] - 2 * layout.modes
    states = [f"abs(r[{2 * layout.modes + i}]) * weights[{i}]" for i in range(count)]
    lines = [f"largest = {_largest(velocities)} / plant.rate" if velocities else "largest = 0.0"]
    lines.append(f"largest = {_largest(['largest', *positions, *states])}")
    everything = sum_of(f"r[{c}]" for c in range(layout.first[-1]))
    return Text(lines, f"largest + 0.0 * ({everything})")


def _largest(terms: list[str]) -> str:
    made = terms[0]
    for term in terms[1:]:
        made = f"max({made}, {term})"
    return made


def settled(layout: Layout) -> Text:
    lines = []
    entries = [f"q[{c}]" for c in range(2 * layout.modes)]
    for e, shape in enumerate(layout.elements):
        if shape.states and not shape.smooth:
            speed = sum_of([*state_terms(shape, e), *drive_terms(shape, e)])
            lines.append(f"towards = local if {speed} > 0.0 else -local")
        for law, z in states_of(layout, e):
            entries.append(z if shape.smooth else f"bounded({law}, {z}, towards)")
    return Text(lines, tuple_of(entries))


def kinks(layout: Layout) -> Text:
    lines = []
    for e, shape in enumerate(layout.elements):
        lines.append(f"k{e} = 0.0")
        if not shape.smooth:
            for law, z in states_of(layout, e):
                lines.append(f"k{e} = max(k{e}, reversal_kink({law}, {z}, beyond))")
    return Text(lines, padded(f"k{e}" for e in range(len(layout.elements))))


def brought(layout: Layout) -> Text:
    changes: list[list[str]] = [[] for _ in range(layout.modes)]
    lines = []
    for e, shape in enumerate(layout.elements):
        shared = [m for m in present(shape.velocity) if shape.push[m]]
        lines.append(f"j{e} = 0.0")
        if shape.smooth or not shared:
            continue
        own = f"plant.elements[{e}]"
        speed = sum_of(
            [
                *state_terms(shape, e),
                *drive_terms(shape, e),
            ]
        )
        gives = own_push(shape, e)
        lines += [f"if e == {e} and {gives} != 0.0:", f"    j{e} = (speed - ({speed})) / ({gives})"]
        for m in present(shape.push):
            changes[m].append(f"{own}.push[{m}] * j{e}")
    lines += [f"w{m} = {sum_of([f'q[{2 * m + 1}]', *changes[m]])}" for m in range(layout.modes)]
    for e, shape in enumerate(layout.elements):
        if shape.static:
            pinned = pin(layout, e, "w", f"speed - ({sum_of(drive_terms(shape, e))})")
            lines += [line.replace(f"sides[{e}] == 0.0", f"e == {e}") for line in pinned]
    entries = [entry for m in range(layout.modes) for entry in (f"q[{2 * m}]", f"w{m}")]
    entries += [f"q[{c}]" for c in range(2 * layout.modes, layout.first[-1])]
    return Text(lines, tuple_of(entries))


def riding(layout: Layout) -> Text:
    lines = [f"x{m}, w{m} = q[{2 * m}], q[{2 * m + 1}]" for m in range(layout.modes)]
    for e in static_elements(layout):
        shape, rate = layout.elements[e], f"plant.elements[{e}].drive_rate"
        along = along_terms(shape, e, lambda m: f"begun[{2 * m}]", None)
        kept = sum_of([*along, f"{rate} * (u_begun[0] - u[0])"] if shape.drive_rate else along)
        lines += pin(layout, e, "x", kept)
        lines += pin(layout, e, "w", f"-({sum_of(drive_terms(shape, e))})")
    entries = [entry for m in range(layout.modes) for entry in (f"x{m}", f"w{m}")]
    entries += [f"q[{c}]" for c in range(2 * layout.modes, layout.first[-1])]
    return Text(lines, tuple_of(entries) if static_elements(layout) else "q")


def breakaways(layout: Layout) -> Text:
    made = []
    for e, shape in enumerate(layout.elements):
        along = f" * {share_along(e, shape)}[0]" if shape.along else ""
        here = f"breakaway(plant.elements[{e}].law) * {normal_of(e, shape)}{along}"
        made.append(here if shape.static else "inf")
    return Text([], padded(made))


def statics(layout: Layout) -> Text:
    return Text([], padded("1.0" if s.static else "0.0" for s in layout.elements))


def contacts(layout: Layout) -> Text:
    return Text([], padded("0.0" if s.smooth else "1.0" for s in layout.elements))


def drift_apart(layout: Layout) -> Text:
    lines = ["far = 0.0"]
    for m in range(layout.modes):
        lines += [
            f"far = max(far, abs(q[{2 * m + 1}] - other[{2 * m + 1}]) / plant.rate)",
            f"if plant.modes[{m}].stiffness != 0.0:",
            f"    far = max(far, abs(q[{2 * m}] - other[{2 * m}]))",
        ]
    lines += [f"far = max(far, abs(q[{c}] - other[{c}]))" for c in range(2 * layout.modes, layout.first[-1])]
    return Text(lines, "far")


def gone(layout: Layout) -> Text:
    entries, lines = [], []
    for m in range(layout.modes):
        lines.append(f"x{m} = q[{2 * m}] - begun[{2 * m}]")
        free = f"plant.modes[{m}].stiffness == 0.0 and abs(x{m}) > apart"
        entries += [f"x{m} if {free} else 0.0", "0.0"]
    entries += ["0.0"] * (layout.first[-1] - 2 * layout.modes)
    return Text(lines, tuple_of(entries))


def unloaded(layout: Layout) -> Text:
    entries = [f"q[{c}]" for c in range(2 * layout.modes)]
    for e, shape in enumerate(layout.elements):
        factor = " * min(ratio, 1.0)" if shape.loaded else ""
        if shape.loaded and shape.along:
            factor = f" * kept(plant.elements[{e}].along, ratio)"
        entries += [f"q[{layout.first[e] + i}]{factor}" for i in range(shape.states)]
    return Text([], tuple_of(entries))


def state_of(layout: Layout) -> Text:
    return Text([], tuple_of(f"values[{c}]" for c in range(layout.first[-1])))


def no_sides(layout: Layout) -> Text:
    return Text([], padded("0.0" for _ in layout.elements))


def drive_rates(layout: Layout) -> Text:
    made = [
        f"plant.elements[{e}].drive_rate" if s.drive_rate else "0.0" for e, s in enumerate(layout.elements)
    ]
    return Text([], padded(made))


def follows_drive(layout: Layout) -> Text:
    return Text([], str(any(s.drive_rate and not s.smooth for s in layout.elements)))


def unrest(layout: Layout) -> Text:
    accelerations = _largest(["0.0", *(f"abs(dq[{2 * m + 1}])" for m in range(layout.modes))])
    drives = _largest(["0.0", *(f"abs(plant.modes[{m}].drive)" for m in range(layout.modes))])
    return Text([], f"{accelerations} + {drives} * abs(u[1]) / plant.rate")


def jolt(layout: Layout) -> Text:
    if any(shape.drive_rate for shape in layout.elements):
        return Text([], "inf")
    drives = _largest(["0.0", *(f"abs(plant.modes[{m}].drive)" for m in range(layout.modes))])
    return Text([], f"{drives} * (abs(u[0]) + (abs(u[1]) + abs(u[2]) / plant.rate) / plant.rate)")


def moves_freely(layout: Layout) -> Text:
    free = [f"plant.modes[{m}].stiffness == 0.0" for m in range(layout.modes)]
    placed = any(any(shape.position) or shape.sampled for shape in layout.elements)
    alike = [f"uniform(plant.elements[{e}].along)" for e, s in enumerate(layout.elements) if s.along]
    moves = " and ".join([f"({' or '.join(free) or 'False'})", *alike])
    return Text([], "False" if placed else moves)


def sampled(layout: Layout) -> Text:
    return Text([], str(any(shape.sampled for shape in layout.elements)))


def branched(layout: Layout) -> Text:
    return Text([], str(any(shape.branched for shape in layout.elements)))


def on_branches(layout: Layout) -> Text:
    lines, made = [], []
    for e, shape in enumerate(layout.elements):
        lines.append(f"side{e} = sides[{e}]")
        if shape.branched:
            lines.append(f"side{e} = one = 1.0 if side{e} > 0.0 else -1.0")
            for i, (law, z) in enumerate(states_of(layout, e)):
                at = f"branch_at({law}, one, v[{e}], dv[{e}], {z})"
                lines.append(f"side{e} = with_branch(side{e}, {i}, {at})")
        made.append(f"side{e}")
    return Text(lines, padded(made))


def branches_hold(layout: Layout) -> Text:
    holds = []
    for e, shape in enumerate(layout.elements):
        for i, (law, z) in enumerate(states_of(layout, e)):
            if shape.branched:
                side = side_of(shape, e, i)
                holds.append(f"branch_left({law}, {side}, v[{e}], dv[{e}], {z}) >= 0.0")
    return Text([], " and ".join(holds) or "True")


def decay(layout: Layout) -> Text:
    lines = ["least = 1.0"]
    for e, shape in enumerate(layout.elements):
        own, shared = f"plant.elements[{e}]", [m for m in present(shape.velocity) if shape.push[m]]
        if shape.smooth or not shape.states or not shared:
            continue
        lines += [f"p = -({own_push(shape, e)}) * {own}.normal", "k = 0.0", "c = 0.0"]
        soft = f" * softening({own}.along, {own}.normal)" if shape.along else ""
        for law, _ in states_of(layout, e):
            lines += [
                f"_, fv, fz, zv, _ = law_slopes({law}, 0.0, 0.0, 1.0)",
                f"k += p * fz * zv{soft}",
                "c += p * fv",
            ]
        lines += ["if k > 0.0:", "    least = min(least, max(0.5 * c, 1.0 / lasts) / sqrt(k))"]
    return Text(lines, "least")


def next_tick(layout: Layout) -> Text:
    periods = [f"plant.elements[{e}].law.period" for e, s in enumerate(layout.elements) if s.sampled]
    lines = ["at = inf", *(f"at = min(at, (floor(t / {p} + 1e-9) + 1.0) * {p})" for p in periods)]
    return Text(lines, "at")


def ticked(layout: Layout) -> Text:
    lines, entries = [], [f"q[{c}]" for c in range(layout.first[-1])]
    for e, shape in enumerate(layout.elements):
        if not shape.sampled:
            continue
        law, z = f"plant.elements[{e}].law", f"q[{layout.first[e]}]"
        along = state_terms(shape, e)
        seen = sum_of([*along, *drive_terms(shape, e)])
        lines.append(f"n{e} = t / {law}.period")
        due = f"abs(n{e} - round(n{e})) < 1e-6"
        lines.append(f"z{e} = ticked_state({law}, {seen}, {z}) if {due} else {z}")
        entries[layout.first[e]] = f"z{e}"
    return Text(lines, tuple_of(entries) if lines else "q")


SOURCES: dict[str, Callable[[Layout], Text]] = {
    made.__name__: made
    for made in (
        speeds,
        relative_speeds,
        size,
        settled,
        kinks,
        brought,
        riding,
        breakaways,
        statics,
        contacts,
        drift_apart,
        gone,
        unloaded,
        state_of,
        no_sides,
        drive_rates,
        follows_drive,
        unrest,
        jolt,
        moves_freely,
        branched,
        on_branches,
        branches_hold,
        decay,
        sampled,
        next_tick,
        ticked,
    )
}
