"""The equations of `system` written out for one layout, as the text of Python functions (see `generated`).

Names in the text: ``q2`` an entry of the state, ``a0`` the acceleration of mode 0, ``f0``, ``s0``, ``n0`` output, input and
normal factor of element 0, ``z0_1`` what belongs to its state 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from .system import Layout, Shape

ARGUMENTS = {
    "slope": ("plant", "sides", "q", "u", "normal"),
    "factor": ("plant", "sides", "q", "u", "normal", "per_g"),
    "solved": ("plant", "sides", "w", "r"),
    "speeds": ("plant", "q", "u"),
    "relative_speeds": ("plant", "q"),
    "size": ("plant", "r", "weights"),
    "settled": ("plant", "q", "local"),
    "kinks": ("plant", "q", "beyond"),
    "stopped": ("plant", "q", "u", "e"),
    "riding": ("plant", "sides", "q", "u", "begun", "u_begun"),
    "breakaways": ("plant", "normal"),
    "statics": ("plant",),
    "contacts": ("plant",),
    "drift_apart": ("plant", "q", "other"),
    "gone": ("plant", "q", "begun"),
    "unloaded": ("plant", "q", "factors"),
    "state_of": ("plant", "values"),
    "no_sides": ("plant",),
    "drive_rates": ("plant",),
    "follows_drive": ("plant",),
    "unrest": ("plant", "dq", "u"),
    "moves_freely": ("plant",),
    "sampled": ("plant",),
    "next_tick": ("plant", "t"),
    "ticked": ("plant", "q", "u", "t"),
}


def _function(name: str, lines: Iterable[str], result: str) -> str:
    head = f"def {name}({', '.join(ARGUMENTS[name])}):"
    return "\n    ".join([head, *lines, f"return {result}"]) + "\n"


def _tuple(items: Iterable[str]) -> str:
    made = list(items)
    return f"({', '.join(made)}{',' if len(made) == 1 else ''})"


def _sum(terms: Iterable[str]) -> str:
    return " + ".join(terms) or "0.0"


def _padded(items: Iterable[str]) -> str:
    """A tuple with at least one entry: compiled code cannot index an empty one."""
    return _tuple(list(items) or ["0.0"])


def _present(there: tuple[bool, ...]) -> list[int]:
    return [i for i, yes in enumerate(there) if yes]


def _along(
    shape: Shape, e: int, velocity: Callable[[int], str], position: Callable[[int], str] | None
) -> list[str]:
    """Terms of an element's input that are linear in the state."""
    own = f"plant.elements[{e}]"
    terms = [f"{own}.velocity[{m}] * {velocity(m)}" for m in _present(shape.velocity)]
    if position is not None:
        terms += [f"{own}.position[{m}] * {position(m)}" for m in _present(shape.position)]
    return terms


def _inputs(shape: Shape, e: int, u: str = "u") -> list[str]:
    own = f"plant.elements[{e}]"
    terms = [f"{own}.drive * {u}[0]"] if shape.drive else []
    return terms + ([f"{own}.drive_rate * {u}[1]"] if shape.drive_rate else [])


def _fed(shape: Shape, e: int, of: Callable[[int], str]) -> list[str]:
    return [f"plant.elements[{e}].feed[{i}] * {of(i)}" for i in _present(shape.feed)]


def _states(layout: Layout, e: int) -> list[tuple[str, str]]:
    """(record of the state's law, entry of the state) of each state of an element."""
    first, law = layout.first[e], f"plant.elements[{e}].law"
    return [(f"element({law}, {i})", f"q[{first + i}]") for i in range(layout.elements[e].states)]


def _coefficient(e: int, shape: Shape) -> str:
    own = f"plant.elements[{e}].normal"
    return f"{own} * normal[0]" if shape.loaded else own


def _loaded_share(shape: Shape) -> list[str]:
    """max(dN/dt, 0)/N and its derivative, for elements that feel the load."""
    if not shape.loaded or not shape.states:
        return []
    return [
        "fresh = normal[1] / normal[0] if normal[1] > 0.0 and normal[0] > 0.0 else 0.0",
        "dfresh = normal[2] / normal[0] - fresh * fresh if fresh > 0.0 else 0.0",
    ]


def _held(layout: Layout) -> list[int]:
    return [e for e, shape in enumerate(layout.elements) if shape.static]


def _hold(layout: Layout, target: Callable[[int], str], acceleration: str, force: str) -> list[str]:
    """Lines that add the forces which keep the held contacts at rest; `target`: what their input's rate must cancel."""
    held = _held(layout)
    if not held:
        return []
    lines = []
    for i in held:
        shape = layout.elements[i]
        terms = _along(shape, i, lambda m: f"{acceleration}{m}", None)
        lines.append(f"b{i} = -({_sum([*terms, target(i)])}) if sides[{i}] == 0.0 else 0.0")
        for j in held:
            shared = [m for m in _present(shape.velocity) if layout.elements[j].push[m]]
            stiff = _sum(f"plant.elements[{i}].velocity[{m}] * plant.elements[{j}].push[{m}]" for m in shared)
            one = "1.0" if i == j else "0.0"
            lines.append(f"A{i}_{j} = {stiff} if sides[{i}] == 0.0 and sides[{j}] == 0.0 else {one}")
    lines += _eliminated(held, "A", "b")
    for i in held:
        lines.append(f"b{i} = b{i} if sides[{i}] == 0.0 else 0.0")
        lines.append(f"{force}{i} += b{i}")
        lines += [
            f"{acceleration}{m} += plant.elements[{i}].push[{m}] * b{i}"
            for m in _present(layout.elements[i].push)
        ]
    return lines + [line for i in held for line in _pinned(layout, i, acceleration, f"-({target(i)})")]


def _pinned(layout: Layout, e: int, name: str, kept: str) -> list[str]:
    """A held contact moves the last of its bodies exactly as the others, to the last bit: true rest."""
    shape, own = layout.elements[e], f"plant.elements[{e}].velocity"
    moved = [m for m in _present(shape.velocity) if shape.push[m]]
    if not moved:
        return []
    last = moved[-1]
    others = "".join(f" - {own}[{m}] * {name}{m}" for m in _present(shape.velocity) if m != last)
    return [f"{name}{last} = ({kept}{others}) / {own}[{last}] if sides[{e}] == 0.0 else {name}{last}"]


def _eliminated(rows: list[int], a: str, b: str) -> list[str]:
    """Gauss's elimination of the named entries; what is held twice over is held by the first."""
    lines = []
    for k, pivot in enumerate(rows):
        guard = f" if abs({a}{pivot}_{pivot}) > 1e-9 * S{pivot} else 0.0" if len(rows) > 1 else ""
        if guard:
            lines.insert(0, f"S{pivot} = abs({a}{pivot}_{pivot})")
        lines.append(f"p{pivot} = 1.0 / {a}{pivot}_{pivot}{guard}")
        for i in rows[k + 1 :]:
            lines.append(f"l = {a}{i}_{pivot} * p{pivot}")
            lines += [f"{a}{i}_{j} -= l * {a}{pivot}_{j}" for j in rows[k + 1 :]]
            lines.append(f"{b}{i} -= l * {b}{pivot}")
    for k in range(len(rows) - 1, -1, -1):
        i = rows[k]
        rest = "".join(f" - {a}{i}_{j} * {b}{j}" for j in rows[k + 1 :])
        lines.append(f"{b}{i} = ({b}{i}{rest}) * p{i}")
    return lines


def slope(layout: Layout) -> str:
    lines, rates = [], []
    for e, shape in enumerate(layout.elements):
        inputs = [*_along(shape, e, lambda m: f"q[{2 * m + 1}]", lambda m: f"q[{2 * m}]"), *_inputs(shape, e)]
        lines.append(f"s{e} = {_sum([*inputs, *_fed(shape, e, lambda i: f'f{i}')])}")
        lines += _loaded_share(shape)
        if shape.static:
            lines.append(
                f"f{e} = 0.0 if sides[{e}] == 0.0 else "
                f"smooth_rate(plant.elements[{e}].law, s{e}, sides[{e}], sides[{e}])[0]"
            )
        for i, (law, z) in enumerate(_states(layout, e)):
            call = f"rate({law}, s{e}, {z})" if shape.smooth else f"smooth_rate({law}, s{e}, {z}, sides[{e}])"
            lines.append(f"{'f' + str(e) if i == 0 else 'g'}, d{e}_{i} = {call}")
            if i > 0:
                lines.append(f"f{e} += g")
            if shape.loaded:
                lines.append(f"d{e}_{i} -= fresh * {z}")
            rates.append(f"d{e}_{i}")
        lines.append(f"f{e} *= {_coefficient(e, shape)}")
    for m in range(layout.modes):
        mode = f"plant.modes[{m}]"
        lines.append(
            f"a{m} = {mode}.drive * u[0] + {mode}.acceleration - {mode}.damping * q[{2 * m + 1}]"
            f" - {mode}.stiffness * q[{2 * m}]"
        )
        for e, shape in enumerate(layout.elements):
            if shape.push[m]:
                lines.append(f"a{m} += plant.elements[{e}].push[{m}] * f{e}")
    lines += _hold(
        layout,
        lambda e: f"plant.elements[{e}].drive_rate * u[2]" if layout.elements[e].drive_rate else "0.0",
        "a",
        "f",
    )
    entries = [entry for m in range(layout.modes) for entry in (f"q[{2 * m + 1}]", f"a{m}")]
    forces = _padded(f"f{e}" for e in range(len(layout.elements)))
    return _function("slope", lines, f"{_tuple([*entries, *rates])}, {forces}")


def _linearised(layout: Layout, e: int, shape: Shape) -> list[str]:
    """Output, slopes and partial derivatives by time of an element at the start of a step."""
    own, lines = f"plant.elements[{e}]", []
    inputs = [*_along(shape, e, lambda m: f"q[{2 * m + 1}]", lambda m: f"q[{2 * m}]"), *_inputs(shape, e)]
    lines.append(f"s{e} = {_sum([*inputs, *_fed(shape, e, lambda i: f'f{i}')])}")
    by_time = [f"{own}.drive * u[1]"] if shape.drive else []
    by_time += [f"{own}.drive_rate * u[2]"] if shape.drive_rate else []
    lines.append(f"st{e} = {_sum([*by_time, *_fed(shape, e, lambda i: f'ft{i}')])}")
    lines.append(f"n{e} = {_coefficient(e, shape)}")
    lines += _loaded_share(shape)
    lines += [f"f{e} = 0.0", f"phi{e} = 0.0", f"fast{e} = 0.0", f"ft{e} = 0.0"]
    if shape.static:
        lines += [
            f"if sides[{e}] != 0.0:",
            f"    f{e}, phi{e}, _, _, _ = law_slopes({own}.law, s{e}, sides[{e}], sides[{e}])",
            f"    ft{e} = phi{e} * st{e}",
        ]
    for i, (law, z) in enumerate(_states(layout, e)):
        side = "0.0" if shape.smooth else f"sides[{e}]"
        lines.append(f"f, fv, fz{e}_{i}, zv{e}_{i}, zz = law_slopes({law}, s{e}, {z}, {side})")
        if shape.loaded:
            lines.append("zz -= fresh")
        lines += [
            f"f{e} += f",
            f"ft{e} += fv * st{e}",
            f"fast{e} = max(fast{e}, -zz)",
            f"pz{e}_{i} = 1.0 / (g - zz)",
            f"phi{e} += fv + fz{e}_{i} * zv{e}_{i} * pz{e}_{i}",
            f"zt{e}_{i} = zv{e}_{i} * st{e}" + (f" - dfresh * {z}" if shape.loaded else ""),
            f"fz{e}_{i} *= n{e}",
            f"fp{e}_{i} = fz{e}_{i} * pz{e}_{i}",
        ]
    if shape.loaded:
        lines.append(f"ft{e} = n{e} * ft{e} + {own}.normal * normal[1] * f{e}")
    else:
        lines.append(f"ft{e} *= n{e}")
    return [*lines, f"phi{e} *= n{e}", f"f{e} *= n{e}"]


def _crossed(layout: Layout, i: int, j: int) -> str:
    """What the output of element j does to the input of element i within a step."""
    terms = []
    for m in range(layout.modes):
        shape, pushed = layout.elements[i], layout.elements[j].push[m]
        if not pushed:
            continue
        push = f"X{j}_{m}"
        if shape.velocity[m]:
            terms.append(f"plant.elements[{i}].velocity[{m}] * {push}")
        if m in _present(shape.position):
            terms.append(f"plant.elements[{i}].position[{m}] * {push} * per_g")
    if j in _present(layout.elements[i].feed):
        terms.append(f"plant.elements[{i}].feed[{j}]")
    return _sum(terms)


def _pivots(layout: Layout) -> list[str]:
    """The matrix that is left of the elements, factored in place: U over the inverse pivots P and L."""
    count = len(layout.elements)
    lines = [
        f"X{e}_{m} = plant.elements[{e}].push[{m}] * D{m}"
        for e, shape in enumerate(layout.elements)
        for m in _present(shape.push)
    ]
    entries = len(lines) + 2 * count * count
    for i in range(count):
        for j in range(count):
            static = layout.elements[j].static
            column = f"(phi{j} if sides[{j}] != 0.0 else 1.0)" if static else f"phi{j}"
            lines.append(f"H{i}_{j} = {_crossed(layout, i, j)}")
            one = (
                (f"(1.0 if sides[{i}] != 0.0 else 0.0)" if layout.elements[i].static else "1.0")
                if i == j
                else "0.0"
            )
            lines.append(f"A{i}_{j} = {one} - H{i}_{j} * {column}")
    for k in range(count):
        scale = f"abs(A{k}_{k})"
        if len(_held(layout)) > 1 and layout.elements[k].static:
            lines.insert(entries, f"S{k} = {scale}")
            lines.append(f"P{k} = 1.0 / A{k}_{k} if {scale} > 1e-9 * S{k} else 0.0")
        else:
            lines.append(f"P{k} = 1.0 / A{k}_{k}")
        for i in range(k + 1, count):
            lines.append(f"A{i}_{k} *= P{k}")
            lines += [f"A{i}_{j} -= A{i}_{k} * A{k}_{j}" for j in range(k + 1, count)]
    return lines


def _kept(layout: Layout) -> list[str]:
    """What `factor` hands to `solved`, in order."""
    count = len(layout.elements)
    names = ["per_g"]
    for m in range(layout.modes):
        names += [f"D{m}", f"K{m}"]
    for i in range(count):
        names += [f"phi{i}", f"P{i}"]
        names += [f"H{i}_{j}" for j in range(count)]
        names += [f"A{i}_{j}" for j in range(count) if i != j]
        names += [f"X{i}_{m}" for m in _present(layout.elements[i].push)]
        for k in range(layout.elements[i].states):
            names += [f"fp{i}_{k}", f"zv{i}_{k}", f"pz{i}_{k}"]
    return names


def factor(layout: Layout) -> str:
    lines = ["g = 1.0 / per_g"]
    for m in range(layout.modes):
        mode = f"plant.modes[{m}]"
        lines += [
            f"K{m} = {mode}.stiffness * per_g",
            f"D{m} = 1.0 / (g + {mode}.damping + K{m})",
            f"t{m} = {mode}.drive * u[1]",
        ]
    for e, shape in enumerate(layout.elements):
        lines += _linearised(layout, e, shape)
        for m in _present(shape.push):
            lines.append(f"t{m} += plant.elements[{e}].push[{m}] * ft{e}")
    lines += _hold(
        layout,
        lambda e: f"plant.elements[{e}].drive_rate * u[3]" if layout.elements[e].drive_rate else "0.0",
        "t",
        "ft",
    )
    lines += _pivots(layout)
    for e, shape in enumerate(layout.elements):
        weight = _sum(
            f"abs(plant.elements[{e}].push[{m}] * plant.elements[{e}].velocity[{m}])"
            for m in _present(shape.push)
            if shape.velocity[m]
        )
        for i in range(shape.states):
            made = f"abs(fz{e}_{i}) * ({weight}) / (plant.rate * plant.rate)"
            lines.append(f"w{e}_{i} = {made if shape.smooth else f'max(1.0, {made})'}")
    by_time = [entry for m in range(layout.modes) for entry in ("0.0", f"t{m}")]
    by_time += [f"zt{e}_{i}" for e, shape in enumerate(layout.elements) for i in range(shape.states)]
    weights = [f"w{e}_{i}" for e, shape in enumerate(layout.elements) for i in range(shape.states)]
    fast = [f"fast{e}" for e in range(len(layout.elements))]
    kept = _tuple(_kept(layout))
    return _function("factor", lines, f"{kept}, {_tuple(by_time)}, {_padded(weights)}, {_padded(fast)}")


def solved(layout: Layout) -> str:
    count, first = len(layout.elements), layout.first
    names = _kept(layout)
    lines = [f"{', '.join(names)}, = w"]
    for m in range(layout.modes):
        lines.append(f"x{m} = (r[{2 * m + 1}] - K{m} * r[{2 * m}]) * D{m}")
    for e, shape in enumerate(layout.elements):
        position = [
            f"plant.elements[{e}].position[{m}] * (r[{2 * m}] + x{m}) * per_g"
            for m in _present(shape.position)
        ]
        lines.append(f"b{e} = {_sum([*_along(shape, e, lambda m: f'x{m}', None), *position])}")
        rho = [f"fp{e}_{i} * r[{first[e] + i}]" for i in range(shape.states)]
        lines.append(f"rho{e} = {_sum(rho)}")
        if shape.static:  # a held contact keeps the rate of its input
            kept = _sum(_along(shape, e, lambda m: f"r[{2 * m + 1}]", None))
            lines.append(f"b{e} -= 0.0 if sides[{e}] != 0.0 else ({kept}) * per_g")
    for i in range(count):
        fed = [f"H{i}_{j} * rho{j}" for j in range(count) if layout.elements[j].states]
        lines.append(f"b{i} = {_sum([f'b{i}', *fed])}")
    for i in range(count):
        lines += [f"b{i} -= A{i}_{j} * b{j}" for j in range(i)]
    for i in range(count - 1, -1, -1):
        rest = "".join(f" - A{i}_{j} * b{j}" for j in range(i + 1, count))
        lines.append(f"b{i} = (b{i}{rest}) * P{i}")
    for e, shape in enumerate(layout.elements):
        lines.append(
            f"f{e} = (phi{e} * b{e} if sides[{e}] != 0.0 else b{e})"
            if shape.static
            else f"f{e} = phi{e} * b{e} + rho{e}"
        )
        for m in _present(shape.push):
            lines.append(f"x{m} += X{e}_{m} * f{e}")
    for e in _held(layout):
        kept = _sum(_along(layout.elements[e], e, lambda m: f"r[{2 * m + 1}]", None))
        lines += _pinned(layout, e, "x", f"({kept}) * per_g")
    entries = [entry for m in range(layout.modes) for entry in (f"(r[{2 * m}] + x{m}) * per_g", f"x{m}")]
    for e, shape in enumerate(layout.elements):
        entries += [f"(r[{first[e] + i}] + zv{e}_{i} * b{e}) * pz{e}_{i}" for i in range(shape.states)]
    return _function("solved", lines, _tuple(entries))


def speeds(layout: Layout) -> str:
    made = []
    for e, shape in enumerate(layout.elements):
        along = _along(shape, e, lambda m: f"q[{2 * m + 1}]", lambda m: f"q[{2 * m}]")
        made.append(_sum([*along, *_inputs(shape, e)]))
    return _function("speeds", [], _padded(made))


def relative_speeds(layout: Layout) -> str:
    made = [
        _sum(_along(shape, e, lambda m: f"q[{2 * m + 1}]", lambda m: f"q[{2 * m}]"))
        for e, shape in enumerate(layout.elements)
    ]
    return _function("relative_speeds", [], _padded(made))


def size(layout: Layout) -> str:
    positions = [f"abs(r[{2 * m}])" for m in range(layout.modes)]
    velocities = [f"abs(r[{2 * m + 1}])" for m in range(layout.modes)]
    count = layout.first[-1] - 2 * layout.modes
    states = [f"abs(r[{2 * layout.modes + i}]) * weights[{i}]" for i in range(count)]
    lines = [f"largest = {_largest(velocities)} / plant.rate" if velocities else "largest = 0.0"]
    lines.append(f"largest = {_largest(['largest', *positions, *states])}")
    everything = _sum(f"r[{c}]" for c in range(layout.first[-1]))
    return _function("size", lines, f"largest + 0.0 * ({everything})")


def _largest(terms: list[str]) -> str:
    made = terms[0]
    for term in terms[1:]:
        made = f"max({made}, {term})"
    return made


def settled(layout: Layout) -> str:
    lines = []
    entries = [f"q[{c}]" for c in range(2 * layout.modes)]
    for e, shape in enumerate(layout.elements):
        if shape.states and not shape.smooth:
            # Of a body that follows the drive the sign of the rest decides, which is the slider's.
            speed = _sum(_along(shape, e, lambda m: f"q[{2 * m + 1}]", lambda m: f"q[{2 * m}]"))
            lines.append(f"towards = local if {speed} > 0.0 else -local")
        for law, z in _states(layout, e):
            entries.append(z if shape.smooth else f"bounded({law}, {z}, towards)")
    return _function("settled", lines, _tuple(entries))


def kinks(layout: Layout) -> str:
    lines = []
    for e, shape in enumerate(layout.elements):
        lines.append(f"k{e} = 0.0")
        if not shape.smooth:
            for law, z in _states(layout, e):
                lines.append(f"k{e} = max(k{e}, reversal_kink({law}, {z}, beyond))")
    return _function("kinks", lines, _padded(f"k{e}" for e in range(len(layout.elements))))


def stopped(layout: Layout) -> str:
    changes: list[list[str]] = [[] for _ in range(layout.modes)]
    lines = []
    for e, shape in enumerate(layout.elements):
        shared = [m for m in _present(shape.velocity) if shape.push[m]]
        lines.append(f"j{e} = 0.0")
        if shape.smooth or not shared:
            continue
        own = f"plant.elements[{e}]"
        speed = _sum(
            [*_along(shape, e, lambda m: f"q[{2 * m + 1}]", lambda m: f"q[{2 * m}]"), *_inputs(shape, e)]
        )
        gives = _sum(f"{own}.velocity[{m}] * {own}.push[{m}]" for m in shared)
        lines += [f"if e == {e} and {gives} != 0.0:", f"    j{e} = -({speed}) / ({gives})"]
        for m in _present(shape.push):
            changes[m].append(f"{own}.push[{m}] * j{e}")
    lines += [f"w{m} = {_sum([f'q[{2 * m + 1}]', *changes[m]])}" for m in range(layout.modes)]
    for e, shape in enumerate(layout.elements):
        if shape.static:
            pinned = _pinned(layout, e, "w", f"-({_sum(_inputs(shape, e))})")
            lines += [line.replace(f"sides[{e}] == 0.0", f"e == {e}") for line in pinned]
    entries = [entry for m in range(layout.modes) for entry in (f"q[{2 * m}]", f"w{m}")]
    entries += [f"q[{c}]" for c in range(2 * layout.modes, layout.first[-1])]
    return _function("stopped", lines, _tuple(entries))


def riding(layout: Layout) -> str:
    lines = [f"x{m}, w{m} = q[{2 * m}], q[{2 * m + 1}]" for m in range(layout.modes)]
    for e in _held(layout):
        shape, rate = layout.elements[e], f"plant.elements[{e}].drive_rate"
        along = _along(shape, e, lambda m: f"begun[{2 * m}]", None)
        kept = _sum([*along, f"{rate} * (u_begun[0] - u[0])"] if shape.drive_rate else along)
        lines += _pinned(layout, e, "x", kept)
        lines += _pinned(layout, e, "w", f"-({_sum(_inputs(shape, e))})")
    entries = [entry for m in range(layout.modes) for entry in (f"x{m}", f"w{m}")]
    entries += [f"q[{c}]" for c in range(2 * layout.modes, layout.first[-1])]
    return _function("riding", lines, _tuple(entries) if _held(layout) else "q")


def breakaways(layout: Layout) -> str:
    made = [
        f"breakaway(plant.elements[{e}].law) * {_coefficient(e, shape)}" if shape.static else "inf"
        for e, shape in enumerate(layout.elements)
    ]
    return _function("breakaways", [], _padded(made))


def statics(layout: Layout) -> str:
    return _function("statics", [], _padded("1.0" if s.static else "0.0" for s in layout.elements))


def contacts(layout: Layout) -> str:
    return _function("contacts", [], _padded("0.0" if s.smooth else "1.0" for s in layout.elements))


def drift_apart(layout: Layout) -> str:
    lines = ["far = 0.0"]
    for m in range(layout.modes):
        lines += [
            f"far = max(far, abs(q[{2 * m + 1}] - other[{2 * m + 1}]) / plant.rate)",
            f"if plant.modes[{m}].stiffness != 0.0:",
            f"    far = max(far, abs(q[{2 * m}] - other[{2 * m}]))",
        ]
    lines += [f"far = max(far, abs(q[{c}] - other[{c}]))" for c in range(2 * layout.modes, layout.first[-1])]
    return _function("drift_apart", lines, "far")


def gone(layout: Layout) -> str:
    entries = []
    for m in range(layout.modes):
        entries += [f"q[{2 * m}] - begun[{2 * m}] if plant.modes[{m}].stiffness == 0.0 else 0.0", "0.0"]
    entries += ["0.0"] * (layout.first[-1] - 2 * layout.modes)
    return _function("gone", [], _tuple(entries))


def unloaded(layout: Layout) -> str:
    entries = [f"q[{c}]" for c in range(2 * layout.modes)]
    for e, shape in enumerate(layout.elements):
        factor = " * factors" if shape.loaded else ""
        entries += [f"q[{layout.first[e] + i}]{factor}" for i in range(shape.states)]
    return _function("unloaded", [], _tuple(entries))


def state_of(layout: Layout) -> str:
    return _function("state_of", [], _tuple(f"values[{c}]" for c in range(layout.first[-1])))


def no_sides(layout: Layout) -> str:
    return _function("no_sides", [], _padded("0.0" for _ in layout.elements))


def drive_rates(layout: Layout) -> str:
    made = [
        f"plant.elements[{e}].drive_rate" if s.drive_rate else "0.0" for e, s in enumerate(layout.elements)
    ]
    return _function("drive_rates", [], _padded(made))


def follows_drive(layout: Layout) -> str:
    return _function("follows_drive", [], str(any(s.drive_rate and not s.smooth for s in layout.elements)))


def unrest(layout: Layout) -> str:
    accelerations = _largest(["0.0", *(f"abs(dq[{2 * m + 1}])" for m in range(layout.modes))])
    drives = _largest(["0.0", *(f"abs(plant.modes[{m}].drive)" for m in range(layout.modes))])
    return _function("unrest", [], f"{accelerations} + {drives} * abs(u[1]) / plant.rate")


def moves_freely(layout: Layout) -> str:
    free = [f"plant.modes[{m}].stiffness == 0.0" for m in range(layout.modes)]
    placed = any(any(shape.position) or shape.sampled for shape in layout.elements)
    return _function("moves_freely", [], "False" if placed else " or ".join(free) or "False")


def sampled(layout: Layout) -> str:
    return _function("sampled", [], str(any(shape.sampled for shape in layout.elements)))


def next_tick(layout: Layout) -> str:
    periods = [f"plant.elements[{e}].law.period" for e, s in enumerate(layout.elements) if s.sampled]
    lines = ["at = inf", *(f"at = min(at, (floor(t / {p} + 1e-9) + 1.0) * {p})" for p in periods)]
    return _function("next_tick", lines, "at")


def ticked(layout: Layout) -> str:
    lines, entries = [], [f"q[{c}]" for c in range(layout.first[-1])]
    for e, shape in enumerate(layout.elements):
        if not shape.sampled:
            continue
        law, z = f"plant.elements[{e}].law", f"q[{layout.first[e]}]"
        along = _along(shape, e, lambda m: f"q[{2 * m + 1}]", lambda m: f"q[{2 * m}]")
        seen = _sum([*along, *_inputs(shape, e)])
        lines.append(f"n{e} = t / {law}.period")
        due = f"abs(n{e} - round(n{e})) < 1e-6"
        lines.append(f"z{e} = ticked_state({law}, {seen}, {z}) if {due} else {z}")
        entries[layout.first[e]] = f"z{e}"
    return _function("ticked", lines, _tuple(entries) if lines else "q")


SOURCES: dict[str, Callable[[Layout], str]] = {
    made.__name__: made
    for made in (
        slope,
        factor,
        solved,
        speeds,
        relative_speeds,
        size,
        settled,
        kinks,
        stopped,
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
        moves_freely,
        sampled,
        next_tick,
        ticked,
    )
}
