/* The equations of motion and their linear system within a step; see `stickslip/plant/system.py`.
 *
 * Included once per size, with these macros:
 *   OF(name)               name of this size's function or struct
 *   HOT                    specifiers of functions that every stage of a step calls
 *   UNROLL                 pragma before the loop over stages
 *   ROOM_MODES, ROOM_ELEMENTS, ROOM_STATES   dimensions of arrays, at least 1
 *   MODES(P), ELEMENTS(P), STATES(P)         numbers of modes, elements, entries of the state
 *   STATES_OF(P, e), FIRST(P, e)             number of internal states of element e, and the first one's place
 *   RARE(test)             the test; 0 where plants of this size have nothing but bristle contacts without a varying
 *                          normal force, so that a compiler removes what the test guards */

#ifndef NOTHING_YET
/* Where a sum starts: -0 changes nothing that is added to it, not even +0, so that a compiler drops the addition. */
#define NOTHING_YET R(-0.0)
#endif

/* How the contacts slide: the side of v = 0 of each element (0: held), and the branch of each internal state. */
struct OF(regime) {
    real_t side[ROOM_ELEMENTS];
    unsigned char branch[ROOM_STATES];
};

/* W = 1/(h gamma) - J, with the bodies eliminated: what `solve` needs. */
struct OF(system) {
    real_t per_g;
    real_t D[ROOM_MODES], K[ROOM_MODES];             /* of each mode: inverse pivot, stiffness times per_g */
    real_t phi[ROOM_ELEMENTS], pivot[ROOM_ELEMENTS]; /* slope of an output within the step; inverse pivots */
    real_t H[ROOM_ELEMENTS][ROOM_ELEMENTS];          /* what output j does to input i */
    real_t A[ROOM_ELEMENTS][ROOM_ELEMENTS];          /* the elements' matrix, factored in place */
    real_t X[ROOM_ELEMENTS][ROOM_MODES];             /* what an output does to the velocity of a mode */
    real_t psi[ROOM_ELEMENTS], psx[ROOM_ELEMENTS], kappa[ROOM_ELEMENTS]; /* of the place, see `place` */
    real_t fp[ROOM_STATES], zv[ROOM_STATES], pz[ROOM_STATES], zw[ROOM_STATES], zx[ROOM_STATES];
};

/* The normal force on an element: factor n; what is newly loaded, 1/s, with its derivative by time; factor on the rates
 * of the states. The rest is needed along a stroke. */
struct OF(loading) {
    real_t n, fresh, fresh_t, soft;
    real_t part, grown;
    ss_along_result along;
};

HOT bool OF(is_static)(const struct plant *P, int e)
{
    return RARE(P->element[e].law->breakaway != NULL);
}

HOT bool OF(is_held)(const struct plant *P, const struct OF(regime) *on, int e)
{
    return OF(is_static)(P, e) && on->side[e] == R(0.0);
}

HOT bool OF(feels)(const struct element *E, int m)
{
    return (E->felt >> m & 1u) != 0;
}

HOT bool OF(pushes)(const struct element *E, int m)
{
    return (E->pushed >> m & 1u) != 0;
}

HOT struct bristle OF(bristle)(const struct plant *P, const struct OF(regime) *on, int e, int i)
{
    const struct element *E = &P->element[e];
    return (struct bristle){
        .law = E->law,
        .p = parameters_of(E, i),
        .side = RARE(E->law->smooth) ? R(0.0) : on->side[e],
        .branch = on->branch[FIRST(P, e) + i],
    };
}

/* The law's equation, on the state's branch. */
HOT void OF(rate_on)(const struct bristle *of, real_t v, real_t z, real_t *force, real_t *dz)
{
    if (!RARE(of->law->branch_rate != NULL)) {
        of->law->rate(of->p, v, z, force, dz);
        return;
    }
    real_t sign = r_copysign(R(1.0), of->side);
    of->law->branch_rate(of->p, r_abs(v), sign * z, of->branch, force, dz);
    *force *= sign;
    *dz *= sign;
}

/* Force and rate on one side of v = 0, continued beyond it by reflection in the point v = 0, which keeps value and slope:
 * the kink of |v| never enters a step, which is cut at the reversal afterwards. */
HOT void OF(smooth_rate)(const struct bristle *of, real_t v, real_t z, real_t *force, real_t *dz)
{
    if (RARE(of->law->smooth)) {
        of->law->rate(of->p, v, z, force, dz);
        return;
    }
    OF(rate_on)(of, r_copysign(v, of->side), z, force, dz);
    if (v * of->side >= R(0.0))
        return;
    real_t force_0, dz_0;
    OF(rate_on)(of, R(0.0), z, &force_0, &dz_0);
    *force = R(2.0) * force_0 - *force;
    *dz = R(2.0) * dz_0 - *dz;
}

/* Slopes by one-sided differences: outwards in v from the side of v = 0, and off a bound on z. */
HOT struct law_slopes OF(slopes_of)(const struct bristle *of, real_t v, real_t z)
{
    real_t at = RARE(of->law->smooth) ? v : r_copysign(v, of->side);
    real_t dv = r_copysign(R(1e-5) * r_abs(at) + R(1e-11), of->side);
    real_t dz = r_copysign(R(1e-5) * r_abs(z) + R(1e-15), z);
    real_t force, rate, force_v, rate_v, force_z, rate_z;
    OF(rate_on)(of, at, z, &force, &rate);
    OF(rate_on)(of, at + dv, z, &force_v, &rate_v);
    OF(rate_on)(of, at, z + dz, &force_z, &rate_z);
    return (struct law_slopes){
        .force = force,
        .force_v = (force_v - force) / dv,
        .force_z = (force_z - force) / dz,
        .rate_v = (rate_v - rate) / dv,
        .rate_z = (rate_z - rate) / dz,
    };
}

/* The part of an element's input that the modes' velocities make. */
HOT real_t OF(sliding)(const struct plant *P, int e, const real_t *q)
{
    real_t s = NOTHING_YET;
    for (int m = 0; m < MODES(P); m++)
        s += P->element[e].velocity[m] * q[2 * m + 1];
    return s;
}

/* The part of an element's input that is linear in the state. */
HOT real_t OF(relative_speed)(const struct plant *P, int e, const real_t *q)
{
    const struct element *E = &P->element[e];
    real_t s = OF(sliding)(P, e, q);
    if (RARE(E->positioned))
        for (int m = 0; m < MODES(P); m++)
            s += E->position[m] * q[2 * m];
    return s;
}

/* The part of an element's input that the drive makes. */
HOT real_t OF(driven)(const struct plant *P, int e, const real_t *u)
{
    const struct element *E = &P->element[e];
    return RARE(1) ? E->drive * u[VALUE] + E->drive_rate * u[SLOPE] : R(0.0);
}

/* An element's input, without what other elements feed into it. */
HOT real_t OF(speed)(const struct plant *P, int e, const real_t *q, const real_t *u)
{
    real_t s = OF(relative_speed)(P, e, q);
    return RARE(1) ? s + OF(driven)(P, e, u) : s;
}

/* What the outputs of earlier elements feed into an element's input. */
HOT real_t OF(fed)(const struct plant *P, int e, const real_t *output)
{
    real_t s = NOTHING_YET;
    if (RARE(P->element[e].fed))
        for (int i = 0; i < e; i++)
            s += P->element[e].feed[i] * output[i];
    return s;
}

/* What the output of an element does to the rate of its own input, through the bodies that it pushes. */
HOT real_t OF(own_push)(const struct plant *P, int e)
{
    real_t s = R(0.0);
    for (int m = 0; m < MODES(P); m++)
        s += P->element[e].velocity[m] * P->element[e].push[m];
    return s;
}

/* The normal force of an element that changes along the stroke. */
static void OF(load_along)(const struct element *E, const real_t *q, const real_t *normal, struct OF(loading) *made)
{
    made->along = ss_along(E->along, q[2 * E->place]);
    made->n *= made->along.share;
    made->grown = E->loaded && normal[VALUE] > R(0.0) ? normal[SLOPE] / normal[VALUE] : R(0.0);
    real_t grows = made->grown + made->along.steep * q[2 * E->place + 1];
    made->part = grows > R(0.0) ? R(1.0) : R(1.0) - E->along->stiffness_exponent;
    made->fresh = made->part * grows;
    made->soft = ss_softening(E->along, made->n);
    if (E->loaded && normal[VALUE] > R(0.0))
        made->fresh_t = made->part * (normal[CURVATURE] / normal[VALUE] - made->grown * made->grown);
}

HOT struct OF(loading) OF(loading)(const struct plant *P, int e, const real_t *q, const real_t *normal)
{
    const struct element *E = &P->element[e];
    struct OF(loading) made = {.n = E->normal, .soft = R(1.0)};
    if (RARE(E->loaded))
        made.n *= normal[VALUE];
    if (RARE(E->along != NULL)) {
        OF(load_along)(E, q, normal, &made);
    } else if (RARE(E->loaded) && normal[SLOPE] > R(0.0) && normal[VALUE] > R(0.0)) {
        made.fresh = normal[SLOPE] / normal[VALUE];
        made.fresh_t = normal[CURVATURE] / normal[VALUE] - made.fresh * made.fresh;
    }
    return made;
}

/* A held contact moves the last of its bodies exactly as the others, to the last bit: true rest. `kept`: the rate of its
 * input that the bodies' velocities make; x: those of the modes, `stride` apart. */
static void OF(pin)(const struct plant *P, int e, real_t kept, real_t *x, int stride)
{
    const struct element *E = &P->element[e];
    if (E->pinned < 0)
        return;
    for (int m = 0; m < MODES(P); m++)
        if (m != E->pinned)
            kept -= E->velocity[m] * x[m * stride];
    x[E->pinned * stride] = kept / E->velocity[E->pinned];
}

/* Gauss's elimination of the held contacts; what is held twice over is held by the first. */
static void OF(eliminate)(const struct plant *P, int count, real_t A[ROOM_ELEMENTS][ROOM_ELEMENTS], real_t *b)
{
    real_t pivot[ROOM_ELEMENTS], size[ROOM_ELEMENTS];
    for (int k = 0; k < count; k++)
        size[k] = r_abs(A[k][k]);
    for (int k = 0; k < count; k++) {
        bool resolved = P->statics == 1 || r_abs(A[k][k]) > R(1e-9) * size[k];
        pivot[k] = resolved ? R(1.0) / A[k][k] : R(0.0);
        for (int i = k + 1; i < count; i++) {
            real_t share = A[i][k] * pivot[k];
            for (int j = k + 1; j < count; j++)
                A[i][j] -= share * A[k][j];
            b[i] -= share * b[k];
        }
    }
    for (int k = count - 1; k >= 0; k--) {
        for (int j = k + 1; j < count; j++)
            b[k] -= A[k][j] * b[j];
        b[k] *= pivot[k];
    }
}

/* Adds the forces that keep the held contacts at rest. x: accelerations of the modes (or what they change by in time),
 * `stride` apart; u_rate: the derivative of the drive whose share d' they must cancel. */
static void OF(hold)(const struct plant *P, const struct OF(regime) *on, real_t u_rate, real_t *x, int stride,
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

/* The output of an element before its normal force, and the rates of its states. */
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

/* dq/dt, and the outputs of the elements. u, normal: drive and load with their derivatives by time. */
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
    if (RARE(P->statics > 0))
        OF(hold)(P, on, u[CURVATURE], dq + 1, 2, force);
}

/* What the speed and position of the place, along which a normal force changes, add to the output within a step. */
static void OF(place)(const struct plant *P, int e, const struct OF(loading) *load, real_t force, struct OF(system) *w)
{
    const struct element *E = &P->element[e];
    real_t chi = force * load->along.steep * w->per_g;
    w->psi[e] = w->psx[e] = chi;
    for (int c = FIRST(P, e); c < FIRST(P, e) + STATES_OF(P, e); c++) {
        w->psi[e] += w->fp[c] * w->zw[c];
        w->psx[e] += w->fp[c] * w->zx[c];
    }
    w->kappa[e] = R(1.0) / (R(1.0) - w->psi[e] * E->push[E->place] * w->D[E->place]);
    w->phi[e] *= w->kappa[e];
}

/* The output of an element at the start of a step, its slopes, and its derivative by time. */
struct OF(linear) {
    real_t force, force_t;      /* force, its partial derivative by time */
    real_t phi;                 /* slope by the input, with the states eliminated */
    real_t fast;                /* 1/s, how fast the fastest state relaxes */
};

/* The slopes of a state's rate where the normal force changes along the stroke: by the input and by itself with the
 * factor on them, by the speed of the place, by the place. Returns what a growing load does to the rate. */
static real_t OF(soften)(const struct element *E, const struct bristle *of, const struct OF(loading) *load, real_t s,
                         real_t z, const real_t *q, int c, struct law_slopes *slopes, struct OF(system) *w)
{
    real_t force, rate;
    OF(smooth_rate)(of, s, z, &force, &rate);
    real_t stiffens = (E->along->stiffness_exponent - R(1.0)) * load->soft * rate;
    real_t speed = q[2 * E->place + 1], steep = load->along.steep;
    slopes->rate_v *= load->soft;
    slopes->rate_z *= load->soft;
    w->zx[c] = (stiffens * steep - load->part * load->along.curved * speed * z) * w->per_g;
    w->zw[c] = w->zx[c] - load->part * steep * z;
    return stiffens;
}

/* The states of an element at the start of a step, into its output's slopes. st: its input's derivative by time. */
HOT void OF(linearise_states)(const struct plant *P, const struct OF(regime) *on, int e, real_t s, real_t st,
                                        const real_t *q, const struct OF(loading) *load, struct OF(system) *w,
                                        real_t *t, struct OF(linear) *made)
{
    const struct element *E = &P->element[e];
    real_t g = R(1.0) / w->per_g;
    for (int i = 0; i < STATES_OF(P, e); i++) {
        int c = FIRST(P, e) + i;
        real_t z = q[c], stiffens = R(0.0);
        struct bristle of = OF(bristle)(P, on, e, i);
        struct law_slopes slopes = OF(slopes_of)(&of, s, z);
        if (RARE(E->along != NULL))
            stiffens = OF(soften)(E, &of, load, s, z, q, c, &slopes, w);
        real_t zz = RARE(1) ? slopes.rate_z - load->fresh : slopes.rate_z;
        made->force += slopes.force;
        made->force_t += slopes.force_v * st;
        made->fast = r_max(made->fast, -zz);
        w->zv[c] = slopes.rate_v;
        w->pz[c] = R(1.0) / (g - zz);
        made->phi += slopes.force_v + slopes.force_z * slopes.rate_v * w->pz[c];
        t[c] = slopes.rate_v * st;
        if (RARE(E->loaded))
            t[c] += stiffens * load->grown - load->fresh_t * z;
        w->fp[c] = slopes.force_z * load->n;
    }
}

/* An element at the start of a step. */
HOT void OF(linearise)(const struct plant *P, const struct OF(regime) *on, int e, const real_t *q,
                                 const real_t *u, const real_t *normal, struct OF(system) *w, real_t *t,
                                 real_t *force, real_t *force_t, real_t *weights, real_t *fast)
{
    const struct element *E = &P->element[e];
    struct OF(loading) load = OF(loading)(P, e, q, normal);
    struct OF(linear) made = {.force = NOTHING_YET, .force_t = NOTHING_YET, .phi = NOTHING_YET};
    real_t s = OF(speed)(P, e, q, u) + OF(fed)(P, e, force), st = OF(fed)(P, e, force_t), lean = R(1.0);
    if (RARE(1))
        st += E->drive * u[SLOPE] + E->drive_rate * u[CURVATURE];
    if (OF(is_static)(P, e) && on->side[e] != R(0.0)) {
        static_slope(E, s, on->side[e], &made.force, &made.phi);
        made.force_t = made.phi * st;
    }
    OF(linearise_states)(P, on, e, s, st, q, &load, w, t, &made);
    if (RARE(E->along != NULL) && !OF(is_static)(P, e))
        lean = ss_leaning(E->along, made.force);
    made.force *= lean;
    made.phi *= lean;
    made.force_t *= lean * load.n;
    if (RARE(E->loaded))
        made.force_t += E->normal * normal[SLOPE] * (E->along != NULL ? load.along.share : R(1.0)) * made.force;
    w->phi[e] = made.phi * load.n;
    force[e] = made.force * load.n;
    force_t[e] = made.force_t;
    fast[e] = OF(is_static)(P, e) ? r_min(-OF(own_push)(P, e) * w->phi[e], R(0.0)) : made.fast;

    real_t weight = NOTHING_YET;
    for (int m = 0; m < MODES(P); m++)
        weight += r_abs(E->push[m] * E->velocity[m]);
    for (int c = FIRST(P, e); c < FIRST(P, e) + STATES_OF(P, e); c++) {
        real_t fz = RARE(1) ? w->fp[c] * lean : w->fp[c];
        real_t as_position = r_abs(fz) * weight / (P->rate * P->rate);
        weights[c] = RARE(E->law->smooth) ? as_position : r_max(R(1.0), as_position);
        w->fp[c] = fz * w->pz[c];
    }
    if (RARE(E->along != NULL))
        OF(place)(P, e, &load, force[e], w);
}

/* What the output of element j does to the input of element i within a step. */
HOT real_t OF(crossed)(const struct plant *P, int i, int j, const struct OF(system) *w)
{
    const struct element *E = &P->element[i];
    real_t sum = NOTHING_YET;
    for (int m = 0; m < MODES(P); m++) {
        sum += E->velocity[m] * w->X[j][m];
        if (RARE(E->positioned))
            sum += E->position[m] * w->X[j][m] * w->per_g;
    }
    if (RARE(E->fed) && j < i)
        sum += E->feed[j];
    return sum;
}

/* Factors the matrix that is left of the elements, in place: U over the inverse pivots and L. */
HOT void OF(factor_elements)(const struct plant *P, const struct OF(regime) *on, struct OF(system) *w)
{
    real_t size[ROOM_ELEMENTS];
    for (int e = 0; e < ELEMENTS(P); e++)
        for (int m = 0; m < MODES(P); m++)
            w->X[e][m] = P->element[e].push[m] * w->D[m];
    for (int i = 0; i < ELEMENTS(P); i++) {
        for (int j = 0; j < ELEMENTS(P); j++) {
            real_t one = i == j && !OF(is_held)(P, on, i) ? R(1.0) : R(0.0);
            w->H[i][j] = OF(crossed)(P, i, j, w);
            w->A[i][j] = one - w->H[i][j] * (OF(is_held)(P, on, j) ? R(1.0) : w->phi[j]);
        }
        size[i] = r_abs(w->A[i][i]);
    }
    for (int k = 0; k < ELEMENTS(P); k++) {
        bool twice = RARE(P->statics > 1) && OF(is_static)(P, k) && !(r_abs(w->A[k][k]) > R(1e-9) * size[k]);
        w->pivot[k] = twice ? R(0.0) : R(1.0) / w->A[k][k];
        for (int i = k + 1; i < ELEMENTS(P); i++) {
            w->A[i][k] *= w->pivot[k];
            for (int j = k + 1; j < ELEMENTS(P); j++)
                w->A[i][j] -= w->A[i][k] * w->A[k][j];
        }
    }
}

/* The linear system of a step; t: partial derivative of dq/dt by time; weights: of an error of each internal state [m];
 * fast: how fast the fastest state of each element relaxes [1/s]. */
HOT void OF(factor)(const struct plant *P, const struct OF(regime) *on, const real_t *q, const real_t *u,
                              const real_t *normal, real_t per_g, struct OF(system) *w, real_t *t, real_t *weights,
                              real_t *fast)
{
    real_t force[ROOM_ELEMENTS], force_t[ROOM_ELEMENTS], g = R(1.0) / per_g;
    w->per_g = per_g;
    for (int m = 0; m < MODES(P); m++) {
        const struct mode *M = &P->mode[m];
        w->K[m] = M->stiffness * per_g;
        w->D[m] = R(1.0) / (g + M->damping + w->K[m]);
        t[2 * m] = R(0.0);
        t[2 * m + 1] = M->drive * u[SLOPE];
    }
    for (int e = 0; e < ELEMENTS(P); e++) {
        OF(linearise)(P, on, e, q, u, normal, w, t, force, force_t, weights, fast);
        for (int m = 0; m < MODES(P); m++)
            t[2 * m + 1] += P->element[e].push[m] * force_t[e];
    }
    if (RARE(P->statics > 0))
        OF(hold)(P, on, u[THIRD], t + 1, 2, force_t);
    OF(factor_elements)(P, on, w);
}

/* The elements' right-hand sides b, and what the states make of the outputs, rho. x: velocities of the free modes. */
HOT void OF(reduce)(const struct plant *P, const struct OF(regime) *on, const struct OF(system) *w,
                              const real_t *r, const real_t *x, real_t *b, real_t *rho)
{
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e];
        b[e] = rho[e] = NOTHING_YET;
        for (int m = 0; m < MODES(P); m++)
            b[e] += E->velocity[m] * x[m];
        if (RARE(E->positioned))
            for (int m = 0; m < MODES(P); m++)
                b[e] += E->position[m] * (r[2 * m] + x[m]) * w->per_g;
        for (int c = FIRST(P, e); c < FIRST(P, e) + STATES_OF(P, e); c++)
            rho[e] += w->fp[c] * r[c];
        if (RARE(E->along != NULL)) {
            rho[e] += w->psi[e] * x[E->place] + w->psx[e] * r[2 * E->place];
            rho[e] *= w->kappa[e];
        }
        if (OF(is_held)(P, on, e)) /* a held contact keeps the rate of its input */
            b[e] -= OF(sliding)(P, e, r) * w->per_g;
    }
    for (int i = 0; i < ELEMENTS(P); i++)
        for (int j = 0; j < ELEMENTS(P); j++)
            b[i] += w->H[i][j] * rho[j];
}

/* x of W x = r: bodies eliminated, then elements against each other, and back. */
HOT void OF(solve)(const struct plant *P, const struct OF(regime) *on, const struct OF(system) *w,
                             const real_t *r, real_t *out)
{
    real_t x[ROOM_MODES], b[ROOM_ELEMENTS], rho[ROOM_ELEMENTS];
    for (int m = 0; m < MODES(P); m++)
        x[m] = (r[2 * m + 1] - w->K[m] * r[2 * m]) * w->D[m];
    OF(reduce)(P, on, w, r, x, b, rho);
    for (int i = 0; i < ELEMENTS(P); i++)
        for (int j = 0; j < i; j++)
            b[i] -= w->A[i][j] * b[j];
    for (int i = ELEMENTS(P) - 1; i >= 0; i--) {
        for (int j = i + 1; j < ELEMENTS(P); j++)
            b[i] -= w->A[i][j] * b[j];
        b[i] *= w->pivot[i];
    }
    for (int e = 0; e < ELEMENTS(P); e++) {
        real_t f = OF(is_held)(P, on, e) ? b[e] : w->phi[e] * b[e] + rho[e];
        for (int m = 0; m < MODES(P); m++)
            x[m] += w->X[e][m] * f;
    }
    if (RARE(P->statics > 0))
        for (int e = 0; e < ELEMENTS(P); e++)
            if (OF(is_held)(P, on, e))
                OF(pin)(P, e, OF(sliding)(P, e, r) * w->per_g, x, 1);
    for (int m = 0; m < MODES(P); m++) {
        out[2 * m] = (r[2 * m] + x[m]) * w->per_g;
        out[2 * m + 1] = x[m];
    }
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e];
        for (int c = FIRST(P, e); c < FIRST(P, e) + STATES_OF(P, e); c++) {
            real_t made = r[c] + w->zv[c] * b[e];
            if (RARE(E->along != NULL))
                made += w->zw[c] * x[E->place] + w->zx[c] * r[2 * E->place];
            out[c] = made * w->pz[c];
        }
    }
}
