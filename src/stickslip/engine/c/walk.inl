/* A running integration: its data, and the events within a step. Included once per size, after `starting.inl`. */

#ifndef WALK_CONSTANTS
#define WALK_CONSTANTS
/* Local error allowed in each step, as a fraction of the tolerance (docs/decisions/integrator.md). */
#define LOCAL R(0.05)
/* Largest effect of a kink over which a step is not cut, as a fraction of the local error. */
#define KINK R(0.005)
/* A step that is longer than CUT_STIFF relaxation times of a contact's bristle (fast sliding) is cut where the sliding
 * velocity has fallen to the fraction SLOWED. The bristle becomes less stiff there, and the error estimates would not
 * see it stick. */
#define CUT_STIFF R(5.0)
#define SLOWED R(0.5)
/* A jump of the drive's value below this fraction of the change by the jump of its slope within 1/rate is a rounding
 * error. */
#define ROUNDED R(1e-3)
/* Factors on the breakaway force, with a margin for rounding errors. LETS_GO: a contact that has just started to slide
 * is held only below this. HOLDS: a contact that cannot slide is held up to this. FORCED: a contact held in this way
 * lets go above this. */
#define LETS_GO (R(1.0) - RESOLVES(1e-9, 1e-5))
#define HOLDS (R(1.0) + RESOLVES(1e-9, 1e-5))
#define FORCED (R(1.0) + RESOLVES(1e-8, 1e-4))
/* Number of points in a step at which forces of held contacts, and branches, are checked; number of bisections for the
 * time of the event. */
#define CHECKS 8
#define END_HALVINGS 52

/* Reasons for which a step ends early: nothing, a contact slows down, reverses, or starts to slide. */
enum why { NOTHING, SLOWS, STOPS, BREAKS };

/* Events that are searched within a step: held contacts that start to slide, or laws that leave their branch. */
enum end_of { HELD, BRANCHES };

/* Early end of a step: its fraction, the contact, and the reason. A negative fraction: the contact slid to the other
 * side from the start. */
struct cut {
    real_t fraction;
    int which;
    enum why why;
};
#endif

struct OF(walk) {
    const struct plant *P;
    const struct table *drive, *load;
    int64_t i, j;                   /* indices of the segments of drive and load */
    real_t t, h;                    /* present time, and length of the next step, s */
    real_t q[ROOM_STATES];
    struct OF(regime) on;
    bool fresh;                     /* true if the sides must still be determined */
    real_t local;                   /* allowed local error, m */
    int64_t accepted, rejected, max_steps;
    struct log *log;
    real_t *resume;                 /* row that stores a point of continuation, or NULL */
    const volatile int32_t *stop;   /* the run stops as soon as this is not 0; or NULL */
    /* The attempted step. */
    struct OF(step) step;
    real_t tried_h, t_break;        /* its length; time at which it must end at the latest, s */
    bool last;                      /* true if the step ends at t_break */
    bool leapt;                     /* true if it is no step, but the first moment of a slip */
    struct cut cut;
    /* Results of earlier attempts that affect the next one. */
    int turned, forced, launch;     /* number of reversed sides; contact held by force; contact to be launched (-1:
                                     * none) */
    bool refused;                   /* true if the previous attempt was rejected */
    real_t share, moment;           /* fraction of the breakaway force that holds; first moment of a launch, s */
};

static inline void OF(drive_at)(const struct OF(walk) *w, real_t t, real_t *u)
{
    table_at(w->drive, w->i, t, u);
}

static inline void OF(load_at)(const struct OF(walk) *w, real_t t, real_t *normal)
{
    table_at(w->load, w->j, t, normal);
}

/* Compute the sliding speed of contact e within the attempted step, as a polynomial of the fraction of the step. */
static inline void OF(polynomial)(const struct OF(walk) *w, int e, real_t *a)
{
    const struct plant *P = w->P;
    const struct OF(step) *S = &w->step;
    real_t v = OF(relative_speed)(P, e, w->q), v_new = OF(relative_speed)(P, e, S->next), r[3];
    for (int row = 0; row < 3; row++)
        r[row] = OF(relative_speed)(P, e, S->rows[row]);
    a[0] = v;
    a[1] = v_new - v + r[0];
    a[2] = r[1] - r[0];
    a[3] = r[2] - r[1];
    a[4] = -r[2];
    if (RARE(P->follows)) { /* add the drive's slope, interpolated to the same order */
        real_t h = w->tried_h, share = P->element[e].drive_rate;
        real_t d0 = S->u[AT_START][SLOPE], d1 = h * S->u[AT_START][CURVATURE];
        real_t end = S->u[AT_END][SLOPE] - d0 - d1, turn = h * S->u[AT_END][CURVATURE] - d1;
        real_t middle = S->u[AT_MIDDLE][SLOPE] - d0 - R(0.5) * d1;
        real_t d2 = R(16.0) * middle - R(5.0) * end + turn, d3 = R(4.0) * end - turn - R(2.0) * d2;
        a[0] += share * d0;
        a[1] += share * d1;
        a[2] += share * d2;
        a[3] += share * d3;
        a[4] += share * (end - d2 - d3);
    }
}

/* Return the error, over the local error, of continuing a contact smoothly beyond its reversal for `lasts` [s], up to a
 * speed [m/s]. */
static real_t OF(kink_error)(const struct OF(walk) *w, int e, real_t lasts, real_t speed)
{
    real_t kink = OF(is_static)(w->P, e) ? r_abs(speed) : OF(kink)(w->P, e, w->step.next, r_abs(speed));
    return lasts * kink / w->local;
}

/* Return the cut at the reversal of a contact whose speed has another sign in the middle or at the end of the step. */
static struct cut OF(cut_at_reversal)(const struct OF(walk) *w, int e, const real_t *a, real_t v, real_t v_middle,
                                      real_t v_new)
{
    real_t side = w->on.side[e], low = R(0.0), high = R(0.5);
    if (v_middle * side > R(0.0)) {
        low = R(0.5);
        high = R(1.0);
    }
    bool forward = v * side > R(0.0) || low > R(0.0);
    if (!forward)
        low = most_speed(side, a);
    real_t theta = speed_reached(R(0.0), low, high, side, a);
    if (!forward && !(OF(kink_error)(w, e, theta * w->tried_h, speed_at(low, a)) > KINK))
        return (struct cut){R(-1.0), e, STOPS};
    real_t beyond = r_max(r_abs(v_new), r_abs(v_middle));
    if (OF(is_static)(w->P, e) || OF(kink_error)(w, e, (R(1.0) - theta) * w->tried_h, beyond) > KINK)
        return (struct cut){theta, e, STOPS};
    return (struct cut){R(1.0), e, NOTHING};
}

/* Return the cut at the reversal of a contact that slides back for a moment only, between the times at which its speed
 * is known. */
static struct cut OF(cut_at_dip)(const struct OF(walk) *w, int e, const real_t *a, real_t v)
{
    real_t side = w->on.side[e], low = least_speed(side, a);
    if (!(low < R(1.0) && speed_at(low, a) * side < R(0.0)))
        return (struct cut){R(1.0), e, NOTHING};
    /* The contact slides forward in the middle of the step, and so before a late minimum, whatever rounding shows at
     * the start. */
    bool late = low > R(0.5);
    real_t turns = speed_reached(R(0.0), late ? R(0.5) : R(0.0), low, side, a);
    if (!(OF(kink_error)(w, e, R(2.0) * (low - turns) * w->tried_h, speed_at(low, a)) > KINK))
        return (struct cut){R(1.0), e, NOTHING};
    if (!(late || v * side > R(0.0)))
        return (struct cut){R(-1.0), e, STOPS};
    return (struct cut){turns, e, STOPS};
}

/* Return the cut of the attempted step by contact e. */
static inline struct cut OF(cut_of)(const struct OF(walk) *w, int e, const real_t *middle)
{
    const struct plant *P = w->P;
    const struct OF(step) *S = &w->step;
    real_t side = w->on.side[e], v = OF(speed)(P, e, w->q, S->u[AT_START]);
    real_t v_new = OF(speed)(P, e, S->next, S->u[AT_END]), v_middle = OF(speed)(P, e, middle, S->u[AT_MIDDLE]);
    real_t a[COEFFICIENTS];
    OF(polynomial)(w, e, a);
    if (S->fast[e] > CUT_STIFF && v_new * side < SLOWED * v * side)
        return (struct cut){speed_reached(SLOWED * v * side, R(0.0), R(1.0), side, a), e, SLOWS};
    if (v_new * side < R(0.0) || v_middle * side < R(0.0))
        return OF(cut_at_reversal)(w, e, a, v, v_middle, v_new);
    return OF(cut_at_dip)(w, e, a, v);
}

/* Return the earliest cut of the attempted step by a contact. */
static inline struct cut OF(find_cut)(const struct OF(walk) *w)
{
    struct cut first = {R(1.0), 0, NOTHING};
    real_t middle[ROOM_STATES];
    OF(at)(w->P, R(0.5), w->q, &w->step, middle);
    for (int e = 0; e < ELEMENTS(w->P); e++) {
        if (w->on.side[e] == R(0.0) || !OF(is_contact)(w->P, e))
            continue;
        struct cut cut = OF(cut_of)(w, e, middle);
        if (cut.fraction < R(0.0))
            return cut;
        if (cut.fraction < first.fraction)
            first = cut;
    }
    return first;
}

/* Compute state, drive, normal force, dq/dt and forces at the fraction theta of the attempted step. */
HOT void OF(inspect)(const struct OF(walk) *w, real_t theta, real_t *q, real_t *u, real_t *normal, real_t *dq,
                     real_t *force)
{
    OF(at)(w->P, theta, w->q, &w->step, q);
    OF(drive_at)(w, w->t + theta * w->tried_h, u);
    OF(load_at)(w, w->t + theta * w->tried_h, normal);
    OF(slope)(w->P, &w->on, q, u, normal, dq, force);
}

/* Return true if, at the fraction theta of the step, a held contact needs more than the fraction `share` of its
 * breakaway force (HELD), or a law has left its branch (BRANCHES). */
static bool OF(ended)(const struct OF(walk) *w, real_t theta, enum end_of what, real_t share)
{
    real_t q[ROOM_STATES], dq[ROOM_STATES], force[ROOM_ELEMENTS], u[DERIVATIVES], normal[DERIVATIVES];
    OF(inspect)(w, theta, q, u, normal, dq, force);
    if (what == BRANCHES)
        return !OF(branches_hold)(w->P, &w->on, q, u, dq);
    for (int e = 0; e < ELEMENTS(w->P); e++)
        if (OF(is_held)(w->P, &w->on, e) && r_abs(force[e]) > share * OF(breakaway)(w->P, e, q, normal))
            return true;
    return false;
}

/* Return the fraction of the step, up to `most`, at which the first held contact starts to slide, or the first law
 * leaves its branch; 2 if there is none. */
static real_t OF(first_end)(const struct OF(walk) *w, enum end_of what, real_t share, real_t most)
{
    real_t low = R(0.0), high = R(2.0);
    for (int c = 1; c <= CHECKS; c++) {
        real_t theta = R(c) * most / R(CHECKS);
        if (OF(ended)(w, theta, what, share)) {
            high = theta;
            break;
        }
        low = theta;
    }
    if (high > R(1.0))
        return high;
    for (int k = 0; k < END_HALVINGS; k++) {
        real_t theta = R(0.5) * (low + high);
        if (OF(ended)(w, theta, what, share))
            high = theta;
        else
            low = theta;
    }
    return high;
}

/* Cut the attempted step where a held contact starts to slide or a law leaves its branch. Return true if the contacts
 * slow down at the cut. */
static bool OF(cut_at_ends)(struct OF(walk) *w)
{
    const struct plant *P = w->P;
    bool slows = w->cut.why == SLOWS, held = false;
    for (int e = 0; e < ELEMENTS(P); e++)
        held = held || OF(is_held)(P, &w->on, e);
    if (held) {
        real_t theta = OF(first_end)(w, HELD, w->forced >= 0 ? FORCED : R(1.0), R(1.0));
        if (theta < w->cut.fraction) {
            w->cut.fraction = theta;
            w->cut.why = BREAKS;
        }
    }
    if (RARE(P->branched)) {
        real_t theta = OF(first_end)(w, BRANCHES, R(0.0), w->cut.fraction);
        if (theta < w->cut.fraction) {
            w->cut.fraction = theta;
            w->cut.why = SLOWS;
            slows = false;
        }
    }
    return slows;
}

/* Return the length of the step over the relaxation time of contact e's bristles at the speed at which the step
 * ends. */
static real_t OF(unstable)(const struct OF(walk) *w, int e)
{
    const struct OF(step) *S = &w->step;
    real_t v = OF(speed)(w->P, e, w->q, S->u[AT_START]), v_new = OF(speed)(w->P, e, S->next, S->u[AT_END]);
    return S->fast[e] * r_abs(v_new) / r_max(r_abs(v), STILL);
}

/* Return true if the friction of contact e can carry the load at rest. */
static bool OF(can_be_held)(const struct OF(walk) *w, int e)
{
    const struct OF(step) *S = &w->step;
    struct OF(regime) on = w->on;
    real_t dq[ROOM_STATES], force[ROOM_ELEMENTS];
    on.side[e] = R(0.0);
    OF(slope)(w->P, &on, w->q, S->u[AT_START], S->normal[AT_START], dq, force);
    return r_abs(force[e]) <= HOLDS * OF(breakaway)(w->P, e, w->q, S->normal[AT_START]);
}

/* Return the length of the step over the time in which friction that falls with speed increases the speed by e. Beyond
 * 1/gamma the linear system of the step has the wrong sign, and the contact would slide the other way. */
static inline real_t OF(grown)(const struct OF(walk) *w)
{
    real_t most = R(0.0);
    for (int e = 0; e < ELEMENTS(w->P); e++)
        most = r_max(most, -w->step.fast[e]);
    return most;
}

/* Choose the branch of each internal state at a time. */
static void OF(put_on_branches)(const struct plant *P, struct OF(regime) *on, const real_t *q, const real_t *u,
                                const real_t *normal)
{
    real_t dq[ROOM_STATES], force[ROOM_ELEMENTS];
    OF(slope)(P, on, q, u, normal, dq, force);
    OF(choose_branches)(P, on, q, u, dq);
}

/* Update the sides of bristle contacts to their present direction of sliding. */
static inline void OF(turn)(struct OF(walk) *w, const real_t *u)
{
    for (int e = 0; e < ELEMENTS(w->P); e++)
        if (!OF(is_static)(w->P, e) && OF(speed)(w->P, e, w->q, u) * w->on.side[e] < -STILL)
            w->on.side[e] = -w->on.side[e];
}
