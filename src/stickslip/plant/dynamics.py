"""The equations of `system` and their linear system within a step, as text for one layout."""

from __future__ import annotations

from collections.abc import Callable

from .system import Layout, Shape
from .writing import (
    Text,
    along_terms,
    drive_terms,
    fed_terms,
    holding,
    leaning_of,
    leans,
    loaded_share,
    normal_of,
    own_push,
    padded,
    pin,
    place_of,
    present,
    side_of,
    state_terms,
    states_of,
    static_elements,
    sum_of,
    tuple_of,
)


def slope(layout: Layout) -> Text:
    lines, rates = [], []
    for e, shape in enumerate(layout.elements):
        inputs = [
            *state_terms(shape, e),
            *drive_terms(shape, e),
        ]
        lines.append(f"s{e} = {sum_of([*inputs, *fed_terms(shape, e, lambda i: f'f{i}')])}")
        lines += loaded_share(e, shape)
        if shape.static:
            lines.append(
                f"f{e} = 0.0 if sides[{e}] == 0.0 else "
                f"smooth_rate(plant.elements[{e}].law, s{e}, sides[{e}], sides[{e}])[0]"
            )
        for i, (law, z) in enumerate(states_of(layout, e)):
            side = side_of(shape, e, i)
            call = f"rate({law}, s{e}, {z})" if shape.smooth else f"smooth_rate({law}, s{e}, {z}, {side})"
            lines.append(f"{'f' + str(e) if i == 0 else 'g'}, d{e}_{i} = {call}")
            if i > 0:
                lines.append(f"f{e} += g")
            if shape.along:
                lines.append(f"d{e}_{i} *= soft{e}")
            if shape.loaded or shape.along:
                lines.append(f"d{e}_{i} -= fresh * {z}")
            rates.append(f"d{e}_{i}")
        lines.append(f"f{e} *= n{e}" if shape.along else f"f{e} *= {normal_of(e, shape)}")
        lines += [f"f{e} *= {leaning_of(e)}"] if leans(shape) else []
    for m in range(layout.modes):
        mode = f"plant.modes[{m}]"
        lines.append(
            f"a{m} = {mode}.drive * u[0] + {mode}.acceleration - {mode}.damping * q[{2 * m + 1}]"
            f" - {mode}.stiffness * q[{2 * m}]"
        )
        for e, shape in enumerate(layout.elements):
            if shape.push[m]:
                lines.append(f"a{m} += plant.elements[{e}].push[{m}] * f{e}")
    lines += holding(
        layout,
        lambda e: f"plant.elements[{e}].drive_rate * u[2]" if layout.elements[e].drive_rate else "0.0",
        "a",
        "f",
    )
    entries = [entry for m in range(layout.modes) for entry in (f"q[{2 * m + 1}]", f"a{m}")]
    forces = padded(f"f{e}" for e in range(len(layout.elements)))
    return Text(lines, f"{tuple_of([*entries, *rates])}, {forces}")


def _linearised(layout: Layout, e: int, shape: Shape) -> list[str]:
    """Output, slopes and partial derivatives by time of an element at the start of a step."""
    own, lines = f"plant.elements[{e}]", []
    inputs = [
        *state_terms(shape, e),
        *drive_terms(shape, e),
    ]
    lines.append(f"s{e} = {sum_of([*inputs, *fed_terms(shape, e, lambda i: f'f{i}')])}")
    by_time = [f"{own}.drive * u[1]"] if shape.drive else []
    by_time += [f"{own}.drive_rate * u[2]"] if shape.drive_rate else []
    lines.append(f"st{e} = {sum_of([*by_time, *fed_terms(shape, e, lambda i: f'ft{i}')])}")
    lines += [] if shape.along else [f"n{e} = {normal_of(e, shape)}"]
    lines += loaded_share(e, shape)
    if shape.along and shape.loaded:
        change = f"part{e} * (normal[2] / normal[0] - grown{e} * grown{e}) if normal[0] > 0.0 else 0.0"
        lines += [f"grown{e} = normal[1] / normal[0] if normal[0] > 0.0 else 0.0", f"dfresh = {change}"]
    lines += [f"f{e} = 0.0", f"phi{e} = 0.0", f"fast{e} = 0.0", f"ft{e} = 0.0"]
    if shape.static:
        lines += [
            f"if sides[{e}] != 0.0:",
            f"    f{e}, phi{e} = static_slope({own}.law, s{e}, sides[{e}])",
            f"    ft{e} = phi{e} * st{e}",
        ]
    for i, (law, z) in enumerate(states_of(layout, e)):
        side = "0.0" if shape.smooth else side_of(shape, e, i)
        lines.append(f"f, fv, fz{e}_{i}, zv{e}_{i}, zz = law_slopes({law}, s{e}, {z}, {side})")
        if shape.along:
            lines += _softened(e, i, shape, law, z)
        if shape.loaded or shape.along:
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
        if shape.along and shape.loaded:
            lines.append(f"zt{e}_{i} += stiffens{e}_{i} * grown{e}")
    if leans(shape):
        lines.append(f"lean = {leaning_of(e)}")
        lines += [f"{name}{e} *= lean" for name in ("f", "phi", "ft")]
        lines += [f"{name}{e}_{i} *= lean" for name in ("fz", "fp") for i in range(shape.states)]
    if shape.loaded:
        share = f" * share{e}" if shape.along else ""
        lines.append(f"ft{e} = n{e} * ft{e} + {own}.normal * normal[1]{share} * f{e}")
    else:
        lines.append(f"ft{e} *= n{e}")
    lines += [f"phi{e} *= n{e}", f"f{e} *= n{e}"]
    if shape.static:
        lines.append(f"fast{e} = min(-({own_push(shape, e)}) * phi{e}, 0.0)")
    return lines + (_placed(e, shape) if shape.along else [])


def _softened(e: int, i: int, shape: Shape, law: str, z: str) -> list[str]:
    """Of a contact whose normal force depends on the place, the slopes of the rate of a state: by the input
    and itself with the factor on them, by the speed of the place, by the place."""
    exponent = f"plant.elements[{e}].along.stiffness_exponent"
    call = f"rate({law}, s{e}, {z})" if shape.smooth else f"smooth_rate({law}, s{e}, {z}, side)"
    return [
        f"side = {'0.0' if shape.smooth else side_of(shape, e, i)}",
        f"stiffens{e}_{i} = ({exponent} - 1.0) * soft{e} * {call}[1]",
        f"zv{e}_{i} *= soft{e}",
        f"zz *= soft{e}",
        f"zw{e}_{i} = -part{e} * steep{e} * {z}",
        f"zx{e}_{i} = stiffens{e}_{i} * steep{e} - part{e} * curved{e} * q[{2 * place_of(shape) + 1}] * {z}",
        f"zx{e}_{i} *= per_g",
        f"zw{e}_{i} += zx{e}_{i}",
    ]


def _placed(e: int, shape: Shape) -> list[str]:
    """What the speed V of the place adds to the output within a step, and the residual of its position, for
    X = (r + V) per_g; the element's own push on V goes into its slope."""
    m = place_of(shape)
    by_speed = [f"fp{e}_{i} * zw{e}_{i}" for i in range(shape.states)]
    by_place = [f"fp{e}_{i} * zx{e}_{i}" for i in range(shape.states)]
    return [
        f"chi = f{e} * steep{e} * per_g",
        f"psi{e} = {sum_of(['chi', *by_speed])}",
        f"psx{e} = {sum_of(['chi', *by_place])}",
        f"kappa{e} = 1.0 / (1.0 - psi{e} * plant.elements[{e}].push[{m}] * D{m})",
        f"phi{e} *= kappa{e}",
    ]


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
        if m in present(shape.position):
            terms.append(f"plant.elements[{i}].position[{m}] * {push} * per_g")
    if j in present(layout.elements[i].feed):
        terms.append(f"plant.elements[{i}].feed[{j}]")
    return sum_of(terms)


def _pivots(layout: Layout) -> list[str]:
    """The matrix that is left of the elements, factored in place: U over the inverse pivots P and L."""
    count = len(layout.elements)
    lines = [
        f"X{e}_{m} = plant.elements[{e}].push[{m}] * D{m}"
        for e, shape in enumerate(layout.elements)
        for m in present(shape.push)
    ]
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
    twice = [
        k for k in static_elements(layout) if len(static_elements(layout)) > 1
    ]  # may be held by another contact too
    lines += [f"S{k} = abs(A{k}_{k})" for k in twice]
    for k in range(count):
        scale = f"abs(A{k}_{k})"
        if k in twice:
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
        names += [f"X{i}_{m}" for m in present(layout.elements[i].push)]
        along = layout.elements[i].along
        names += [f"psi{i}", f"psx{i}", f"kappa{i}"] if along else []
        for k in range(layout.elements[i].states):
            names += [f"fp{i}_{k}", f"zv{i}_{k}", f"pz{i}_{k}"]
            names += [f"zw{i}_{k}", f"zx{i}_{k}"] if along else []
    return names


def factor(layout: Layout) -> Text:
    for shape in layout.elements:
        if shape.along and sum(one.push[place_of(shape)] for one in layout.elements) > 1:
            raise ValueError(
                f"mode {place_of(shape)}, along which a load changes, is pushed by another element"
            )
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
        for m in present(shape.push):
            lines.append(f"t{m} += plant.elements[{e}].push[{m}] * ft{e}")
    lines += holding(
        layout,
        lambda e: f"plant.elements[{e}].drive_rate * u[3]" if layout.elements[e].drive_rate else "0.0",
        "t",
        "ft",
    )
    lines += _pivots(layout)
    for e, shape in enumerate(layout.elements):
        weight = sum_of(
            f"abs(plant.elements[{e}].push[{m}] * plant.elements[{e}].velocity[{m}])"
            for m in present(shape.push)
            if shape.velocity[m]
        )
        for i in range(shape.states):
            made = f"abs(fz{e}_{i}) * ({weight}) / (plant.rate * plant.rate)"
            lines.append(f"w{e}_{i} = {made if shape.smooth else f'max(1.0, {made})'}")
    by_time = [entry for m in range(layout.modes) for entry in ("0.0", f"t{m}")]
    by_time += [f"zt{e}_{i}" for e, shape in enumerate(layout.elements) for i in range(shape.states)]
    weights = [f"w{e}_{i}" for e, shape in enumerate(layout.elements) for i in range(shape.states)]
    fast = [f"fast{e}" for e in range(len(layout.elements))]
    kept = tuple_of(_kept(layout))
    return Text(lines, f"{kept}, {tuple_of(by_time)}, {padded(weights)}, {padded(fast)}")


def solved(layout: Layout) -> Text:
    count, first = len(layout.elements), layout.first
    names = _kept(layout)
    lines = [f"{', '.join(names)}, = w"]
    for m in range(layout.modes):
        lines.append(f"x{m} = (r[{2 * m + 1}] - K{m} * r[{2 * m}]) * D{m}")
    for e, shape in enumerate(layout.elements):
        position = [
            f"plant.elements[{e}].position[{m}] * (r[{2 * m}] + x{m}) * per_g"
            for m in present(shape.position)
        ]
        lines.append(f"b{e} = {sum_of([*along_terms(shape, e, lambda m: f'x{m}', None), *position])}")
        rho = [f"fp{e}_{i} * r[{first[e] + i}]" for i in range(shape.states)]
        if shape.along:
            m = place_of(shape)
            rho += [f"psi{e} * x{m}", f"psx{e} * r[{2 * m}]"]
        lines.append(f"rho{e} = {sum_of(rho)}")
        lines += [f"rho{e} *= kappa{e}"] if shape.along else []
        if shape.static:  # a held contact keeps the rate of its input
            kept = sum_of(along_terms(shape, e, lambda m: f"r[{2 * m + 1}]", None))
            lines.append(f"b{e} -= 0.0 if sides[{e}] != 0.0 else ({kept}) * per_g")
    for i in range(count):
        driven = [j for j, shape in enumerate(layout.elements) if shape.states or shape.along]
        fed = [f"H{i}_{j} * rho{j}" for j in driven]
        lines.append(f"b{i} = {sum_of([f'b{i}', *fed])}")
    for i in range(count):
        lines += [f"b{i} -= A{i}_{j} * b{j}" for j in range(i)]
    for i in range(count - 1, -1, -1):
        rest = "".join(f" - A{i}_{j} * b{j}" for j in range(i + 1, count))
        lines.append(f"b{i} = (b{i}{rest}) * P{i}")
    for e, shape in enumerate(layout.elements):
        lines.append(
            f"f{e} = (phi{e} * b{e} + rho{e} if sides[{e}] != 0.0 else b{e})"
            if shape.static
            else f"f{e} = phi{e} * b{e} + rho{e}"
        )
        for m in present(shape.push):
            lines.append(f"x{m} += X{e}_{m} * f{e}")
    for e in static_elements(layout):
        kept = sum_of(along_terms(layout.elements[e], e, lambda m: f"r[{2 * m + 1}]", None))
        lines += pin(layout, e, "x", f"({kept}) * per_g")
    entries = [entry for m in range(layout.modes) for entry in (f"(r[{2 * m}] + x{m}) * per_g", f"x{m}")]
    for e, shape in enumerate(layout.elements):
        for i in range(shape.states):
            made = f"r[{first[e] + i}] + zv{e}_{i} * b{e}"
            if shape.along:
                m = place_of(shape)
                made += f" + zw{e}_{i} * x{m} + zx{e}_{i} * r[{2 * m}]"
            entries.append(f"({made}) * pz{e}_{i}")
    return Text(lines, tuple_of(entries))


SOURCES: dict[str, Callable[[Layout], Text]] = {made.__name__: made for made in (slope, factor, solved)}
