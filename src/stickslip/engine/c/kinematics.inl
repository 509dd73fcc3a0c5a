/* Further functions of a plant: size of an error, bounds of states, jumps of the load, accelerations, branches, sampled
 * elements. Included once per size, after `system.inl`. */

static inline bool OF(is_contact)(const struct plant *P, int e)
{
    return !RARE(P->element[e].law->smooth);
}

static inline void OF(copy)(const struct plant *P, const real_t *from, real_t *to)
{
    for (int c = 0; c < STATES(P); c++)
        to[c] = from[c];
}

/* Set a vector to the initial value of a sum. */
static inline void OF(clear)(const struct plant *P, real_t *q)
{
    for (int c = 0; c < STATES(P); c++)
        q[c] = NOTHING_YET;
}

/* Return the size of an error vector: its largest entry, converted to metres; NaN if an entry is NaN. `weights` convert
 * the internal states. */
HOT real_t OF(size)(const struct plant *P, const real_t *r, const real_t *weights)
{
    real_t fastest = R(0.0), largest = R(0.0), sum = R(0.0);
    for (int m = 0; m < MODES(P); m++) {
        fastest = r_max(fastest, r_abs(r[2 * m + 1]));
        largest = r_max(largest, r_abs(r[2 * m]));
    }
    largest = r_max(fastest / P->rate, largest);
    for (int c = 2 * MODES(P); c < STATES(P); c++)
        largest = r_max(largest, r_abs(r[c]) * weights[c]);
    for (int c = 0; c < STATES(P); c++)
        sum += r[c];
    return largest + R(0.0) * sum;
}

/* Put each internal state on its bound if it moves towards the bound and is within `local` [m] of it. */
static inline void OF(settle)(const struct plant *P, real_t *q, const real_t *u, real_t local)
{
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e];
        if (!OF(is_contact)(P, e) || E->law->project == NULL || STATES_OF(P, e) == 0)
            continue;
        real_t towards = OF(speed)(P, e, q, u) > R(0.0) ? local : -local;
        for (int i = 0; i < STATES_OF(P, e); i++) {
            real_t *z = &q[FIRST(P, e) + i];
            *z = bounded(E->law, parameters_of(E, i), *z, towards);
        }
    }
}

/* Return the largest jump of slope of a contact's state rates at v = 0, times the speed `beyond` [m/s]. */
static inline real_t OF(kink)(const struct plant *P, int e, const real_t *q, real_t beyond)
{
    const struct element *E = &P->element[e];
    real_t most = R(0.0);
    if (OF(is_contact)(P, e))
        for (int i = 0; i < STATES_OF(P, e); i++)
            most = r_max(most, reversal_kink(E->law, parameters_of(E, i), q[FIRST(P, e) + i], beyond));
    return most;
}

/* Bring the input of contact e to a speed, by an impulse of the contact on its bodies. */
static void OF(bring)(const struct plant *P, real_t *q, const real_t *u, int e, real_t speed)
{
    const struct element *E = &P->element[e];
    real_t gives = OF(own_push)(P, e);
    if (OF(is_contact)(P, e) && gives != R(0.0)) {
        real_t impulse = (speed - OF(speed)(P, e, q, u)) / gives;
        for (int m = 0; m < MODES(P); m++)
            q[2 * m + 1] += E->push[m] * impulse;
    }
    if (OF(is_static)(P, e))
        OF(pin)(P, e, speed - OF(driven)(P, e, u), q + 1, 2);
}

/* Put the bodies of held contacts at the same relative positions as in the state `begun`, and at relative rest, without
 * rounding errors. */
static void OF(ride)(const struct plant *P, const struct OF(regime) *on, real_t *q, const real_t *u,
                     const real_t *begun, const real_t *u_begun)
{
    for (int e = 0; e < ELEMENTS(P); e++) {
        if (!OF(is_held)(P, on, e))
            continue;
        const struct element *E = &P->element[e];
        real_t kept = R(0.0);
        for (int m = 0; m < MODES(P); m++)
            kept += E->velocity[m] * begun[2 * m];
        OF(pin)(P, e, kept + E->drive_rate * (u_begun[VALUE] - u[VALUE]), q, 2);
        OF(pin)(P, e, -OF(driven)(P, e, u), q + 1, 2);
    }
}

/* Return the largest force of a static contact at rest [N, or N m]. */
static inline real_t OF(breakaway)(const struct plant *P, int e, const real_t *q, const real_t *normal)
{
    const struct element *E = &P->element[e];
    struct OF(loading) load = OF(loading)(P, e, q, normal);
    return E->law->breakaway(E->parameters) * load.n;
}

/* Reduce the internal states of loaded elements after a jump of the load; `ratio` is the load before over the load
 * after. */
static void OF(unload)(const struct plant *P, real_t *q, real_t ratio)
{
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e];
        if (!RARE(E->loaded))
            continue;
        real_t factor = E->along != NULL ? ss_kept(E->along, ratio) : r_min(ratio, R(1.0));
        for (int c = FIRST(P, e); c < FIRST(P, e) + STATES_OF(P, e); c++)
            q[c] *= factor;
    }
}

/* Return the largest derivative of a mode's acceleration by the drive. */
static real_t OF(strongest_drive)(const struct plant *P)
{
    real_t most = R(0.0);
    for (int m = 0; m < MODES(P); m++)
        most = r_max(most, r_abs(P->mode[m].drive));
    return most;
}

/* Return the largest acceleration of a mode, plus the change that the drive's slope causes within the time 1/rate,
 * m/s^2. */
static real_t OF(unrest)(const struct plant *P, const real_t *dq, const real_t *u)
{
    real_t most = R(0.0);
    for (int m = 0; m < MODES(P); m++)
        most = r_max(most, r_abs(dq[2 * m + 1]));
    return most + OF(strongest_drive)(P) * r_abs(u[SLOPE]) / P->rate;
}

/* Return the change of acceleration within the time 1/rate that is caused by a change u of the drive and its
 * derivatives, m/s^2; infinite if an element's body follows the drive. */
static real_t OF(jolt)(const struct plant *P, const real_t *u)
{
    for (int e = 0; e < ELEMENTS(P); e++)
        if (RARE(P->element[e].follows))
            return R(INFINITY);
    real_t later = (r_abs(u[SLOPE]) + r_abs(u[CURVATURE]) / P->rate) / P->rate;
    return OF(strongest_drive)(P) * (r_abs(u[VALUE]) + later);
}

/* Choose the branch of each internal state, from the contact's speed and its growth by dq. */
static void OF(choose_branches)(const struct plant *P, struct OF(regime) *on, const real_t *q, const real_t *u,
                                const real_t *dq)
{
    const real_t u_rates[2] = {u[SLOPE], u[CURVATURE]};
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e];
        if (E->law->choose == NULL)
            continue;
        on->side[e] = on->side[e] > R(0.0) ? R(1.0) : R(-1.0);
        real_t v = OF(speed)(P, e, q, u), growth = on->side[e] * OF(speed)(P, e, dq, u_rates);
        for (int i = 0; i < STATES_OF(P, e); i++) {
            int c = FIRST(P, e) + i;
            on->branch[c] = (unsigned char)E->law->choose(parameters_of(E, i), r_abs(v), growth, on->side[e] * q[c]);
        }
    }
}

/* Return true if all internal states are still on their branches. */
static bool OF(branches_hold)(const struct plant *P, const struct OF(regime) *on, const real_t *q, const real_t *u,
                              const real_t *dq)
{
    const real_t u_rates[2] = {u[SLOPE], u[CURVATURE]};
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e];
        if (E->law->left == NULL)
            continue;
        real_t side = on->side[e], speed = side * OF(speed)(P, e, q, u), growth = side * OF(speed)(P, e, dq, u_rates);
        for (int i = 0; i < STATES_OF(P, e); i++) {
            int c = FIRST(P, e) + i;
            if (!(E->law->left(parameters_of(E, i), speed, growth, side * q[c], on->branch[c]) >= R(0.0)))
                return false;
        }
    }
    return true;
}

static inline real_t OF(tick_period)(const struct element *E)
{
    return E->parameters[E->law->period];
}

/* Return the time of the next tick of a sampled element after t, s; infinite if there is no sampled element. */
static inline real_t OF(next_tick)(const struct plant *P, real_t t)
{
    real_t at = R(INFINITY);
    if (RARE(P->sampled))
        for (int e = 0; e < ELEMENTS(P); e++)
            if (P->element[e].law->tick != NULL) {
                real_t period = OF(tick_period)(&P->element[e]);
                at = r_min(at, (r_floor(t / period + R(1e-9)) + R(1.0)) * period);
            }
    return at;
}

/* Update the states of the sampled elements that have a tick at t. */
static void OF(tick)(const struct plant *P, real_t *q, const real_t *u, real_t t)
{
    real_t input[ROOM_ELEMENTS];
    for (int e = 0; e < ELEMENTS(P); e++)
        input[e] = OF(speed)(P, e, q, u);
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e];
        if (E->law->tick == NULL)
            continue;
        real_t n = t / OF(tick_period)(E);
        if (r_abs(n - r_rint(n)) < R(1e-6))
            q[FIRST(P, e)] = E->law->tick(E->parameters, input[e], q[FIRST(P, e)]);
    }
}
