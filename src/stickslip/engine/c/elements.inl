/* Elements of a plant: their laws on one side of v = 0, their inputs, and the normal force on them.
 *
 * Included once per size, with these macros:
 *   OF(name)               name of this size's function or struct
 *   HOT                    specifiers of functions that each stage of a step calls
 *   UNROLL                 pragma before the loop over stages
 *   ROOM_MODES, ROOM_ELEMENTS, ROOM_STATES   dimensions of arrays, at least 1
 *   MODES(P), ELEMENTS(P), STATES(P)         numbers of modes, of elements, and of entries of the state
 *   STATES_OF(P, e), FIRST(P, e)             number of internal states of element e, and index of the first one
 *   STATIC(test)           test for static laws; constant 0 or 1 if plants of this size have none, or no other laws
 *   RARE(test)             test for a rare feature; constant 0 if plants of this size only have contacts with a constant
 *                          normal force, so that the compiler removes the code of the feature
 *   WATCHED(test)          test for results of single steps; constant 0 if there are no samples, neighbours or row of
 *                          continuation */

#ifndef NOTHING_YET
/* Initial value of a sum. Adding -0 changes no number, not even +0, so a compiler can drop the addition. */
#define NOTHING_YET R(-0.0)
#endif

/* State of the contacts: the side of v = 0 of each element (0: held, a static law at rest), and the branch of each
 * internal state. */
struct OF(regime) {
    real_t side[ROOM_ELEMENTS];
    unsigned char branch[ROOM_STATES];
};

/* Effect of the normal force on an element: `n`, factor on its force; `fresh`, rate of newly loaded contact [1/s], and
 * `fresh_t`, its derivative by time; `soft`, factor on the rates of the states. The other fields are for a normal force
 * that varies along the stroke. */
struct OF(loading) {
    real_t n, fresh, fresh_t, soft;
    real_t part, grown;
    ss_along_result along;
};

HOT bool OF(is_static)(const struct plant *P, int e)
{
    return STATIC(P->element[e].law->breakaway != NULL);
}

HOT bool OF(is_held)(const struct plant *P, const struct OF(regime) *on, int e)
{
    return OF(is_static)(P, e) && on->side[e] == R(0.0);
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

/* Compute the law's equation on the branch of the state. */
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

/* Compute force and rate on one side of v = 0. For v of the other sign they are continued by reflection in the point v
 * = 0, which keeps value and slope. So the kink of |v| never enters a step; the step is cut at the reversal
 * afterwards. */
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

/* Compute partial derivatives by one-sided differences: in v away from v = 0, and in z away from a bound. */
HOT struct law_slopes OF(slopes_of)(const struct bristle *of, real_t v, real_t z)
{
    real_t at = RARE(of->law->smooth) ? v : r_copysign(v, of->side);
    real_t dv = r_copysign(RESOLVES(1e-5, 1e-3) * r_abs(at) + RESOLVES(1e-11, 1e-6), of->side);
    real_t dz = r_copysign(RESOLVES(1e-5, 1e-3) * r_abs(z) + RESOLVES(1e-15, 1e-12), z);
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

/* Return the part of an element's input that comes from the modes' velocities. */
HOT real_t OF(sliding)(const struct plant *P, int e, const real_t *q)
{
    real_t s = NOTHING_YET;
    for (int m = 0; m < MODES(P); m++)
        s += P->element[e].velocity[m] * q[2 * m + 1];
    return s;
}

/* Return the part of an element's input that is linear in the plant's state: from velocities and positions of the
 * modes. */
HOT real_t OF(relative_speed)(const struct plant *P, int e, const real_t *q)
{
    const struct element *E = &P->element[e];
    real_t s = OF(sliding)(P, e, q);
    if (RARE(E->positioned))
        for (int m = 0; m < MODES(P); m++)
            s += E->position[m] * q[2 * m];
    return s;
}

/* Return the part of an element's input that comes from the drive and its slope. */
HOT real_t OF(driven)(const struct plant *P, int e, const real_t *u)
{
    const struct element *E = &P->element[e];
    return RARE(1) ? E->drive * u[VALUE] + E->drive_rate * u[SLOPE] : R(0.0);
}

/* Return an element's input, without the part that other elements feed into it. */
HOT real_t OF(speed)(const struct plant *P, int e, const real_t *q, const real_t *u)
{
    real_t s = OF(relative_speed)(P, e, q);
    return RARE(1) ? s + OF(driven)(P, e, u) : s;
}

/* Return the part of an element's input that comes from the outputs of earlier elements. */
HOT real_t OF(fed)(const struct plant *P, int e, const real_t *output)
{
    real_t s = NOTHING_YET;
    if (RARE(P->element[e].fed))
        for (int i = 0; i < e && i < ROOM_ELEMENTS - 1; i++)
            s += P->element[e].feed[i] * output[i];
    return s;
}

/* Return the rate of change of an element's input per unit of its own output, through the bodies that it pushes. */
HOT real_t OF(own_push)(const struct plant *P, int e)
{
    real_t s = R(0.0);
    for (int m = 0; m < MODES(P); m++)
        s += P->element[e].velocity[m] * P->element[e].push[m];
    return s;
}

/* Compute the effect of a normal force that varies along the stroke, at the state q. */
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
