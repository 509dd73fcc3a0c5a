# ruff: noqa: E501 (lines of C)
"""Lines of the engine's C that the mutation check leaves out: see `mutate_c`."""

# A wrong sign changes no answer: which size follows a plant (any that fits gives the same numbers), the offset of
# a difference, a sum that only lets a NaN through, memory given back, one instant read from two places, how much is
# rounding, the sign of a matrix of which the norm is wanted, the quicker way to a root that bisection finds too, an index
# below those that callers ask for, a count that is only compared with itself.
SAME = {
    "compose.h": ("if (P->element[e].states > LARGEST_STATES - P->states)",),
    "charging.c": (
        "real_t slack = R(1e-9) * tolerance + R(1e3) * CHARGE_ROUNDING * (r_abs(target) + r_abs(now->u));",
        "to_end = made.to_end > R(0.0);",
        "struct charge now = {state[0], state[1], state[2] > R(0.0)};",
    ),
    "duhem.c": ("return (0 <= i && i < count) ? packaged_duhem[i] : NULL;",),
    "packaged.c": ("return (0 <= i && i < count) ? packaged_law[i] : NULL;",),
    "elements.inl": (
        "real_t dv = r_copysign(RESOLVES(1e-5, 1e-3) * r_abs(at) + RESOLVES(1e-11, 1e-6), of->side);",
        "real_t dz = r_copysign(RESOLVES(1e-5, 1e-3) * r_abs(z) + RESOLVES(1e-15, 1e-12), z);",
    ),
    "engine.c": (
        "if (!P->plain || (P->statics > 0 && P->statics < P->elements))",
        "return 10 * P->modes + P->elements + (P->statics > 0 ? STATICS : 0);",
        "size = size_of(&near->plants[p]) == size ? size : 0;",
    ),
    "kinematics.inl": (
        "sum += r[c];",
        "return largest + R(0.0) * sum;",
    ),
    "linear.h": ("total += (a[i * n + k] / norm) * (a[k * n + j] / norm);",),
    "motion.c": (
        "real_t size = r_abs(z), off = r_min(R(1e-5) * size, r_max(tolerance, R(1e-9) * size)) + R(1e-15);",
    ),
    "mover.h": ("m->entered += 1;",),
    "near.inl": (
        "while (row + 1 < of->log->filled && t > (near->drives == NULL ? log_row(of->log, row)[LOG_END]",
    ),
    "periods.inl": ("if (J != NULL) {",),
    "ways.h": (
        "while (high - low > WAYS_INSTANT * (r_abs(high) + r_abs(low))) {",
        "real_t newton = u[SLOPE] != R(0.0) ? t - (u[VALUE] - value) / u[SLOPE] : R(INFINITY);",
        "if (u[VALUE] == value || r_abs(newton - t) <= WAYS_INSTANT * r_abs(t) || high - low <= WAYS_INSTANT * r_abs(high))",
        "t = low < newton && newton < high ? newton : R(0.5) * (low + high);",
    ),
}

# Not noticed yet: into how many cubics a piezo's pieces are cut, and a turn within rounding, which is rare.
NOT_NOTICED = {
    "creep.c": ("real_t third = (R(2.0) * c[2] - curvature) / tau;",),
    "duhem.c": ("real_t error = r_abs(*h + s * (begins + s * (square + s * cube)) - exact[k]);",),
    "run.inl": ("if (w->cut.why == STOPS && w->cut.fraction <= ROOT_EXACT && !OF(is_static)(w->P, e)) {",),
}
