# ruff: noqa: E501 (lines of C)
"""Lines of the engine's C that the mutation check leaves out: see `mutate_c`."""

# A wrong sign changes no answer: which size follows a plant (any that fits gives the same numbers), the offset of
# a difference, a sum that only lets a NaN through, memory given back, one instant read from two places.
SAME = {
    "compose.h": ("if (P->element[e].states > LARGEST_STATES - P->states)",),
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
    "near.inl": (
        "while (row + 1 < of->log->filled && t > (near->drives == NULL ? log_row(of->log, row)[LOG_END]",
    ),
    "periods.inl": ("if (J != NULL) {",),
}

# Not noticed yet. Continuation where periods repeat, a load that starts with the drive but for rounding,
# cubics in fixed sizes, orbits of several members and long searches need tests of their own; each removes its lines here.
NOT_NOTICED = {
    "kinematics.inl": ("real_t later = (r_abs(u[SLOPE]) + r_abs(u[CURVATURE]) / P->rate) / P->rate;",),
    "linear.h": (
        "pivot(n, k, k < bodies ? bodies : n, a, x, order);",
        "total += (a[i * n + k] / norm) * (a[k * n + j] / norm);",
    ),
    "reading.inl": (
        "table_at(of->drive, own, row[LOG_START] + shift, u_begun);",
        "while (row + 1 < of->log->filled && t - shift > log_row(of->log, row)[LOG_END])",
        "real_t inside = R(0.5) * (step[LOG_START] + step[LOG_END]) + shift;",
        "real_t stop = r + 1 == of->log->filled ? t_end : r_min(row[LOG_END] + shift, t_end);",
    ),
    "near.inl": ("if (log->filled > 0) {",),
    "orbits.c": (
        "outcome = own > outcome ? own : outcome;",
        "A.periods += of->smooth ? 2 : O->n;",
        "further += c != of->column ? O->of_step[c] * O->change[c] : R(0.0);",
        "bool again = S->found && apart(O, O->r, O->kept) <= S->near;",
        "S->most = S->count + SOUGHT < O->of->max_periods ? S->count + SOUGHT : O->of->max_periods;",
        "struct attempt A = newton(O, S.level, of->max_periods - S.count);",
        "if (!S.found && !A.far && patience > ANCHORED * PATIENCE && A.moved < R(INFINITY)) {",
        "S.best.error = r_max(S.best.error, r_abs(S.walked - S.best.step));",
        "bool enough = compared && A.found.error <= tolerance && A.level <= FINER * before.level &&",
        "*matrices[k] = O->memory + n * (count + k * n);",
        "O->q = of->states + m * O->n;",
        "O->J = of->jacobians + m * O->n * O->n;",
    ),
    "periods.inl": (
        "if (!OF(is_contact)(P, e) || STATES_OF(P, e) == 0 || (E->felt & E->pushed) == 0)",
        "real_t p = -OF(own_push)(P, e) * E->normal, k = R(0.0), c = R(0.0);",
        "k += p * slopes.force_z * slopes.rate_v * soft;",
        "if (k > R(0.0))",
        "if (WATCHED(J->resume != NULL) && n > 0 && !J->ending)",
        "if (n > 0 && ((J->i >= first && (J->i - first) % n != 0) || w->drive->start[J->i] != w->t))",
        "struct log log = {.rows = task->count > 0 || (near != NULL && near->count > 0) ? LOG_ROWS : 0,",
        "tolerance = OF(careful_tolerance)(P, task->end - task->begin, tolerance);",
    ),
    "run.inl": (
        "if (!WATCHED(w->resume != NULL) || w->t_break != t_end || !(w->h > R(0.1) * left))",
        "if (WATCHED(w->log->rows > 0) && w->log->filled == w->log->rows)",
        "w->moment = MOMENT * w->local / r_max(found.change / P->rate + found.speed, R(1e-300));",
        "if (w->resume[INFLUENCED] != t_end && w->turned == 0 && w->forced < 0 && w->launch < 0 && !w->refused)",
        "real_t longest = r_min(LONGEST_MOMENT / w->P->rate, R(0.1) * (w->t_break - w->t));",
        "if (w->cut.why == STOPS && w->cut.fraction <= ROOT_EXACT && !OF(is_static)(w->P, e)) {",
        "w->on.side[e] = -w->on.side[e];",
        "if (w->accepted + w->rejected >= tried + STANDING) {",
        "if (w->t - passed <= R(STANDING) * RESOLVED_TIME * r_max(r_abs(w->t), R(1e-3)))",
        "tried = w->accepted + w->rejected;",
    ),
}
