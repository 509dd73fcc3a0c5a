/* Equations of motion, see `stickslip/simulation/plant/system.py`. Included once per size, after `elements.inl`. */

/* Set the velocity (or acceleration) of the last body of a held contact from the other bodies, so that the contact
 * rests without rounding errors. `kept` is the required sum of these values, weighted as in the contact's input; `x`
 * has the values of the modes, `stride` entries apart. */
HOT void OF(pin)(const struct plant *P, int e, real_t kept, real_t *x, int stride)
{
    const struct element *E = &P->element[e];
    if (E->pinned < 0)
        return;
    for (int m = 0; m < MODES(P); m++)
        if (m != E->pinned)
            kept -= E->velocity[m] * x[m * stride];
    x[E->pinned * stride] = kept / E->velocity[E->pinned];
}

/* Solve A b' = b in place by Gaussian elimination, for the forces of the held contacts. A contact that other held
 * contacts already fix gets no force. */
HOT void OF(eliminate)(const struct plant *P, int count, real_t A[ROOM_ELEMENTS][ROOM_ELEMENTS], real_t *b)
{
    real_t size[ROOM_ELEMENTS];
    for (int k = 0; k < count; k++)
        size[k] = r_abs(A[k][k]);
    for (int k = 0; k < count; k++) {
        bool resolved = P->statics == 1 || r_abs(A[k][k]) > R(1e-9) * size[k];
        A[k][k] = resolved ? R(1.0) / A[k][k] : R(0.0); /* from here on the inverse of the pivot */
        for (int i = k + 1; i < count; i++) {
            real_t share = A[i][k] * A[k][k];
            for (int j = k + 1; j < count; j++)
                A[i][j] -= share * A[k][j];
            b[i] -= share * b[k];
        }
    }
    for (int k = count - 1; k >= 0; k--) {
        for (int j = k + 1; j < count; j++)
            b[k] -= A[k][j] * b[j];
        b[k] *= A[k][k];
    }
}

/* Add the forces that keep the held contacts at rest. `x` has the accelerations of the modes (or their derivatives by
 * time), `stride` entries apart; `u_rate` is the derivative of the drive whose part in the input, by drive_rate, the
 * forces must balance. */
HOT void OF(hold)(const struct plant *P, const struct OF(regime) *on, real_t u_rate, real_t *x, int stride,
                  real_t *force)
{
    int held[ROOM_ELEMENTS], count = 0;
    real_t A[ROOM_ELEMENTS][ROOM_ELEMENTS], b[ROOM_ELEMENTS];
    for (int e = 0; e < ELEMENTS(P); e++)
        if (OF(is_held)(P, on, e))
            held[count++] = e;
    for (int i = 0; i < count; i++) {
        const struct element *E = &P->element[held[i]];
        real_t rate = R(0.0);
        for (int m = 0; m < MODES(P); m++)
            rate += E->velocity[m] * x[m * stride];
        b[i] = -(rate + E->drive_rate * u_rate);
        for (int j = 0; j < count; j++) {
            A[i][j] = R(0.0);
            for (int m = 0; m < MODES(P); m++)
                A[i][j] += E->velocity[m] * P->element[held[j]].push[m];
        }
    }
    OF(eliminate)(P, count, A, b);
    for (int i = 0; i < count; i++) {
        force[held[i]] += b[i];
        for (int m = 0; m < MODES(P); m++)
            x[m * stride] += P->element[held[i]].push[m] * b[i];
    }
    for (int i = 0; i < count; i++)
        OF(pin)(P, held[i], -(P->element[held[i]].drive_rate * u_rate), x, stride);
}

/* Return the output of an element before the factor of the normal force; set the rates of its states. */
HOT real_t OF(output)(const struct plant *P, const struct OF(regime) *on, int e, real_t s, const real_t *q,
                                const struct OF(loading) *load, real_t *rates)
{
    real_t f = NOTHING_YET;
    if (OF(is_static)(P, e) && on->side[e] != R(0.0)) {
        struct bristle of = {P->element[e].law, P->element[e].parameters, on->side[e], 0};
        real_t none;
        OF(smooth_rate)(&of, s, on->side[e], &f, &none);
    }
    for (int i = 0; i < STATES_OF(P, e); i++) {
        struct bristle of = OF(bristle)(P, on, e, i);
        real_t z = q[FIRST(P, e) + i], part, dz;
        OF(smooth_rate)(&of, s, z, &part, &dz);
        f += part;
        rates[i] = RARE(1) ? dz * load->soft - load->fresh * z : dz;
    }
    return f;
}

/* Compute dq/dt and the outputs of the elements. `u` and `normal` are drive and load with their derivatives by time. */
HOT void OF(slope)(const struct plant *P, const struct OF(regime) *on, const real_t *q, const real_t *u,
                             const real_t *normal, real_t *dq, real_t *force)
{
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e];
        struct OF(loading) load = OF(loading)(P, e, q, normal);
        real_t s = OF(speed)(P, e, q, u) + OF(fed)(P, e, force);
        real_t f = OF(output)(P, on, e, s, q, &load, dq + FIRST(P, e)) * load.n;
        if (RARE(E->along != NULL) && !OF(is_static)(P, e))
            f *= ss_leaning(E->along, f);
        force[e] = f;
    }
    for (int m = 0; m < MODES(P); m++) {
        const struct mode *M = &P->mode[m];
        real_t a = M->drive * u[VALUE] + M->acceleration - M->damping * q[2 * m + 1] - M->stiffness * q[2 * m];
        for (int e = 0; e < ELEMENTS(P); e++)
            a += P->element[e].push[m] * force[e];
        dq[2 * m] = q[2 * m + 1];
        dq[2 * m + 1] = a;
    }
    if (STATIC(P->statics > 0))
        OF(hold)(P, on, u[CURVATURE], dq + 1, 2, force);
}
