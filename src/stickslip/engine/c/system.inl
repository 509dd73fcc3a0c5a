/* Linear system of a step. Included once per size, after `equations.inl`. */

/* Factors of W = 1/(h gamma) - J with the bodies eliminated, for `solve`; per_g is h gamma. */
struct OF(system) {
    real_t per_g;
    real_t D[ROOM_MODES], K[ROOM_MODES];             /* of each mode: inverse pivot, stiffness times per_g */
    /* of each element: derivative of the output by the input within the step; inverse pivot */
    real_t phi[ROOM_ELEMENTS], pivot[ROOM_ELEMENTS];
    real_t H[ROOM_ELEMENTS][ROOM_ELEMENTS];          /* effect of output j on input i */
    real_t A[ROOM_ELEMENTS][ROOM_ELEMENTS];          /* matrix of the elements, factored in place */
    real_t X[ROOM_ELEMENTS][ROOM_MODES];             /* effect of an output on the velocity of a mode */
    /* for a normal force along the stroke, see `place` */
    real_t psi[ROOM_ELEMENTS], psx[ROOM_ELEMENTS], kappa[ROOM_ELEMENTS];
    real_t fp[ROOM_STATES], zv[ROOM_STATES], pz[ROOM_STATES], zw[ROOM_STATES], zx[ROOM_STATES];
};

/* Add the effect of a normal force that varies along the stroke: its change by speed and position of the place changes
 * the output within a step. */
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

/* Output of an element at the start of a step, and its derivatives. */
struct OF(linear) {
    real_t force, force_t;      /* force, and its partial derivative by time */
    real_t phi;                 /* derivative by the input, with the states eliminated */
    real_t fast;                /* relaxation rate of the fastest state, 1/s */
};

/* Compute the derivatives of a state's rate for a normal force that varies along the stroke: by the input and by the
 * state (times the softening factor), by the speed of the place, and by the place. Return the effect of a growing load
 * on the rate. */
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

/* Linearise the states of an element at the start of a step, and add their effect to the derivatives of the output.
 * `st` is the derivative of the element's input by time. */
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
        else if (RARE(1)) /* no effect; set, so that no compiler takes them as uninitialised */
            w->zx[c] = w->zw[c] = R(0.0);
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

/* Linearise an element at the start of a step. */
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
    if (RARE(E->along != NULL)) {
        OF(place)(P, e, &load, force[e], w);
    } else if (RARE(1)) { /* no effect; set, so that no compiler takes them as uninitialised */
        w->psi[e] = w->psx[e] = R(0.0);
        w->kappa[e] = R(1.0);
    }
}

/* Return the effect of the output of element j on the input of element i within a step. */
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

/* Factor the remaining matrix of the elements in place, into L and U, with inverse pivots. */
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
        bool twice = ELEMENTS(P) > 1 && STATIC(P->statics > 1) && OF(is_static)(P, k) && !(r_abs(w->A[k][k]) > R(1e-9) * size[k]);
        w->pivot[k] = twice ? R(0.0) : R(1.0) / w->A[k][k];
        for (int i = k + 1; i < ELEMENTS(P); i++) {
            w->A[i][k] *= w->pivot[k];
            for (int j = k + 1; j < ELEMENTS(P); j++)
                w->A[i][j] -= w->A[i][k] * w->A[k][j];
        }
    }
}

/* Set up and factor the linear system of a step. t: partial derivative of dq/dt by time. weights: factors that convert
 * errors of the internal states to metres. fast: relaxation rate of the fastest state of each element [1/s]. */
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
    if (STATIC(P->statics > 0))
        OF(hold)(P, on, u[THIRD], t + 1, 2, force_t);
    OF(factor_elements)(P, on, w);
}

/* Compute the elements' right-hand sides b, and the states' part of the outputs, rho. `x` has the velocities of the
 * modes without elements. */
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
        if (OF(is_held)(P, on, e)) /* the input of a held contact keeps its rate */
            b[e] -= OF(sliding)(P, e, r) * w->per_g;
    }
    for (int i = 0; i < ELEMENTS(P); i++)
        for (int j = 0; j < ELEMENTS(P); j++)
            b[i] += w->H[i][j] * rho[j];
}

/* Solve W x = r into `out`: eliminate the bodies, solve for the elements, then substitute back. */
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
    if (STATIC(P->statics > 0))
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
