/* Start of contacts: their sides at a time, and the first moment of a slip. Included once per size, after
 * `step.inl`. */

#ifndef STARTING_CONSTANTS
#define STARTING_CONSTANTS
/* Sliding speed [m/s] below which a contact counts as at rest: the rounding error of the drive's slope. */
#define STILL RESOLVES(1e-12, 1e-8)
/* A law has no finite slope at rest if its force falls more than STEEPER times as steeply up to RESOLVED as up to STEEP
 * [m/s]. */
#define STEEP RESOLVES(1e-11, 2e-4)
#define STEEPER R(2.0)
/* Duration of the first moment of a slip: MOMENT times the time in which the acceleration moves a position by the local
 * error; at most LONGEST_MOMENT over the plant's rate. */
#define MOMENT R(0.1)
#define LONGEST_MOMENT R(1e-2)
/* Relative accuracy of the speed at the end of this moment, and largest number of iterations. */
#define LAUNCH_FOUND RESOLVES(1e-5, 1e-4)
#define LAUNCH_ITERATIONS 200
#endif

/* Motion at a time: largest acceleration [m/s^2] and largest sliding speed [m/s]. */
struct OF(onset) {
    real_t change, speed;
};

/* Let held contacts slide if their friction cannot carry the load: one after the other, first the one with the largest
 * excess of force. */
static void OF(let_go)(const struct plant *P, const real_t *q, const real_t *u, const real_t *normal, real_t share,
                       struct OF(regime) *on, real_t *dq, real_t *force)
{
    for (int turn = 0; turn < ELEMENTS(P); turn++) {
        real_t most = R(0.0);
        int loose = -1;
        for (int e = 0; e < ELEMENTS(P); e++) {
            if (!OF(is_held)(P, on, e))
                continue;
            real_t excess = r_abs(force[e]) - share * OF(breakaway)(P, e, q, normal);
            if (excess > most) {
                most = excess;
                loose = e;
            }
        }
        if (loose < 0)
            return;
        on->side[loose] = r_copysign(R(1.0), force[loose]);
        OF(slope)(P, on, q, u, normal, dq, force);
    }
}

/* Determine the sides of the contacts at a time. A contact slides to the side of its speed or, at rest, of its
 * acceleration. A set-valued contact at rest is held if the fraction `share` of its breakaway force suffices. Return
 * the motion. */
static struct OF(onset) OF(start)(const struct plant *P, const real_t *q, const real_t *u, const real_t *normal,
                                   real_t share, struct OF(regime) *on)
{
    const real_t u_rates[2] = {u[SLOPE], u[CURVATURE]};
    real_t dq[ROOM_STATES], force[ROOM_ELEMENTS], v[ROOM_ELEMENTS], fastest = R(0.0);
    for (int c = 0; c < STATES(P); c++)
        on->branch[c] = 0;
    for (int e = 0; e < ELEMENTS(P); e++) {
        v[e] = OF(speed)(P, e, q, u);
        if (OF(is_contact)(P, e))
            fastest = r_max(fastest, r_abs(v[e]));
        if (r_abs(v[e]) > STILL)
            on->side[e] = r_copysign(R(1.0), v[e]);
        else
            on->side[e] = OF(is_static)(P, e) ? R(0.0) : R(1.0);
    }
    OF(slope)(P, on, q, u, normal, dq, force);
    if (STATIC(P->statics > 0))
        OF(let_go)(P, q, u, normal, share, on, dq, force);
    for (int e = 0; e < ELEMENTS(P); e++)
        if (!OF(is_static)(P, e) && !(r_abs(v[e]) > STILL))
            on->side[e] = OF(speed)(P, e, dq, u_rates) < R(0.0) ? R(-1.0) : R(1.0);
    return (struct OF(onset)){OF(unrest)(P, dq, u), fastest};
}

/* Return the first set-valued contact that starts to slide and has no speed yet; -1 if there is none. */
static int OF(letting_go)(const struct plant *P, const struct OF(regime) *on, const real_t *q, const real_t *u)
{
    for (int e = 0; e < ELEMENTS(P); e++)
        if (OF(is_static)(P, e) && on->side[e] != R(0.0) && !(r_abs(OF(speed)(P, e, q, u)) > STILL))
            return e;
    return -1;
}

/* Return the acceleration of contact e in its direction of sliding, m/s^2; set dq. */
static real_t OF(pull)(const struct plant *P, const struct OF(regime) *on, int e, const real_t *q, const real_t *u,
                       const real_t *normal, real_t *dq)
{
    const real_t u_rates[2] = {u[SLOPE], u[CURVATURE]};
    real_t force[ROOM_ELEMENTS];
    OF(slope)(P, on, q, u, normal, dq, force);
    return on->side[e] * OF(speed)(P, e, dq, u_rates);
}

/* Return this acceleration for another speed of the contact. */
static real_t OF(pull_at)(const struct plant *P, const struct OF(regime) *on, int e, real_t speed, const real_t *q,
                          const real_t *u, const real_t *normal)
{
    real_t there[ROOM_STATES], dq[ROOM_STATES];
    OF(copy)(P, q, there);
    OF(bring)(P, there, u, e, on->side[e] * speed);
    return OF(pull)(P, on, e, there, u, normal, dq);
}

/* Return true if the force of contact e falls ever more steeply towards rest, so that its slope at rest is not
 * finite. */
static bool OF(falls_from_rest)(const struct plant *P, const struct OF(regime) *on, int e, const real_t *q,
                                const real_t *u, const real_t *normal)
{
    real_t rest = OF(pull_at)(P, on, e, R(0.0), q, u, normal);
    real_t near = (OF(pull_at)(P, on, e, RESOLVED, q, u, normal) - rest) / RESOLVED;
    real_t far = (OF(pull_at)(P, on, e, STEEP, q, u, normal) - rest) / STEEP;
    return near > r_max(STEEPER * far, P->rate);
}

/* Launch of contact e from the state q at rest. The function below computes the state `lasts` [s] later, with the
 * slopes dq and the contact at `speed`; it returns the contact's acceleration there, and sets `slopes` to dq/dt. */
struct OF(launch) {
    const struct plant *P;
    const struct OF(regime) *on;
    const struct table *drive, *load;
    int64_t i, j;
    int e;
    const real_t *q;
};

static real_t OF(after)(const struct OF(launch) *of, real_t t, real_t lasts, const real_t *dq, real_t speed, real_t *end,
                        real_t *slopes)
{
    real_t u[DERIVATIVES], normal[DERIVATIVES];
    table_at(of->drive, of->i, t + lasts, u);
    table_at(of->load, of->j, t + lasts, normal);
    for (int c = 0; c < STATES(of->P); c++)
        end[c] = of->q[c] + lasts * dq[c];
    OF(bring)(of->P, end, u, of->e, of->on->side[of->e] * speed);
    return OF(pull)(of->P, of->on, of->e, end, u, normal, slopes);
}

/* Compute the state a moment after contact e starts to slide, into `end`. Return the duration of this moment, s, at
 * most `longest`; 0 if a usual step can start at rest.
 *
 * It cannot if the slope of the law at rest is infinite: the contact could as well stay at rest, and the linear system
 * of a step has the wrong sign unless the step is shorter than the time constant of the growth. With the acceleration a
 * of the contact within the moment t_1, the speed is assumed to be a power of time, v = v_1 (t/t_1)^p, v_1 = a(t_1,
 * v_1) t_1/p, p = 1 + log2(a(t_1)/a(t_1/2)). This is exact for each cause alone: friction that falls as a power of the
 * speed, and a drive that pulls more and more. `moment` is extended until the speed exceeds rounding errors. */
static real_t OF(launched)(const struct OF(launch) *of, real_t t, real_t moment, real_t longest, real_t *end)
{
    const struct plant *P = of->P;
    real_t dq[ROOM_STATES], middle[ROOM_STATES], slopes[ROOM_STATES], last[ROOM_STATES];
    real_t u[DERIVATIVES], normal[DERIVATIVES], v = R(0.0), p = R(2.0);
    table_at(of->drive, of->i, t, u);
    table_at(of->load, of->j, t, normal);
    if (!OF(falls_from_rest)(P, of->on, of->e, of->q, u, normal))
        return R(0.0);
    OF(pull)(P, of->on, of->e, of->q, u, normal, dq);
    moment = r_min(moment, longest);
    for (int iteration = 0; iteration < LAUNCH_ITERATIONS; iteration++) {
        real_t begins = OF(after)(of, t, R(0.5) * moment, dq, v * r_pow(R(0.5), p), middle, slopes);
        real_t pull = OF(after)(of, t, moment, slopes, v, end, last);
        if (!(begins > R(0.0) && pull > R(0.0)))
            return R(0.0);
        real_t before = v;
        p = r_max(R(1.0) + r_log(pull / begins) / r_log(R(2.0)), R(0.5));
        v = moment * pull / p;
        if (r_abs(v - before) <= LAUNCH_FOUND * v) {
            if (v >= RESOLVED || R(4.0) * moment > longest)
                break;
            moment = R(4.0) * moment;
            v = v * r_pow(R(4.0), p);
        }
    }
    return moment;
}
