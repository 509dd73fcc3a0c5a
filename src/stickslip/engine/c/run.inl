/* Integration of one trajectory of a plant with adaptive steps, from event to event. Included once per size, after
 * `log.inl`.
 *
 * Between breaks of drive and load the motion is smooth except in the contacts. A bristle's law has a kink where the
 * sliding velocity changes sign. A set-valued law has two modes: sliding in one direction until the velocity returns to
 * zero, and rest (held) until the force that rest requires exceeds the breakaway force. Each event is located on the
 * step's continuous extension, and the step is cut there. */

#ifndef RUN_CONSTANTS
#define RUN_CONSTANTS
/* Beyond a reversal the continued law is unstable, and rounding errors grow. A step that is cut in its first half is
 * repeated with a shorter step if the rest of it is longer than this many relaxation times of a bristle. */
#define UNSTABLE R(2.0)
/* Shortest step, as a fraction of the time; and number of successive attempts whose mean length must exceed it. */
#define RESOLVED_TIME RESOLVES(1e-15, 1e-9)
#define STANDING 500
/* Error, over the allowed one, of a step that slides although it should stop at once: far too large. */
#define MUST_SHRINK R(1e10)

/* Result of an attempted step: accepted, to be repeated, or the run fails because steps are too short or too many. */
enum verdict { ACCEPTED, AGAIN, GIVEN_UP_SHORT, GIVEN_UP_MANY };
#endif

/* Return the longest first step after a break or an event, from acceleration and sliding speed. If only the slope of
 * the drive jumps, the motion that this jump causes may allow a longer one. */
static real_t OF(first_step)(const struct OF(walk) *w, const real_t *u, struct OF(onset) found)
{
    const struct plant *P = w->P;
    const real_t *start = w->drive->start;
    real_t reach = found.change / (P->rate * P->rate) + found.speed / P->rate;
    real_t longest = reach > R(0.0) ? R(0.3) / P->rate * r_min(r_pow(w->local / reach, R(0.2)), R(1.0)) : R(INFINITY);
    bool loaded = w->j > 0 && w->t == w->load->start[w->j];
    if (!(w->i > 0 && start[w->i - 1] < w->t && w->t == start[w->i]) || loaded || P->sampled)
        return longest;
    real_t change[DERIVATIVES];
    table_at(w->drive, w->i - 1, w->t, change);
    for (int k = VALUE; k <= CURVATURE; k++)
        change[k] = u[k] - change[k];
    reach = OF(jolt)(P, change) / (P->rate * P->rate);
    if (r_abs(change[VALUE]) * P->rate <= ROUNDED * r_abs(change[SLOPE]))
        longest = r_max(longest, reach > R(0.0) ? r_pow(w->local / reach, R(0.2)) / P->rate : R(INFINITY));
    return longest;
}

/* Determine the sides of the contacts, and the length of the first step. */
static void OF(begin)(struct OF(walk) *w)
{
    const struct plant *P = w->P;
    real_t u[DERIVATIVES], normal[DERIVATIVES];
    OF(drive_at)(w, w->t, u);
    OF(load_at)(w, w->t, normal);
    struct OF(onset) found = OF(start)(P, w->q, u, normal, w->share, &w->on);
    if (w->forced >= 0) {
        w->on.side[w->forced] = R(0.0);
        w->h = r_min(w->h, R(1e-2) / P->rate);
    }
    w->h = r_min(w->h, OF(first_step)(w, u, found));
    w->turned = 0;
    w->fresh = false;
    w->share = R(1.0);
    w->launch = OF(letting_go)(P, &w->on, w->q, u);
    w->moment = MOMENT * w->local * P->rate / r_max(found.change, R(1e-300));
}

/* Store the last state before the end of the run had an influence on a step, from which a longer run can continue. */
static void OF(keep)(struct OF(walk) *w, real_t t_end, real_t left)
{
    if (!WATCHED(w->resume != NULL) || w->t_break != t_end || !(w->h > R(0.1) * left))
        return;
    if (w->resume[INFLUENCED] != t_end && w->turned == 0 && w->forced < 0 && w->launch < 0 && !w->refused)
        OF(store)(w->P, w->resume, w->t, w->h, false, false, &w->on, w->q, w->q);
    if (w->h > R(0.5) * left)
        w->resume[INFLUENCED] = t_end;
}

/* Choose the length of the next step: it ends at a break, or leaves room for another step before the break. */
static void OF(choose_length)(struct OF(walk) *w, real_t t_end)
{
    real_t next = r_min(table_next_break(w->drive, w->i, t_end), table_next_break(w->load, w->j, t_end));
    w->t_break = r_min(next, OF(next_tick)(w->P, w->t));
    real_t left = w->t_break - w->t;
    w->last = w->h >= left;
    OF(keep)(w, t_end, left);
    w->tried_h = w->last ? left : r_min(w->h, R(0.5) * left);
}

/* Replace a step that cannot start at rest by the first moment of a slip. */
static void OF(launch)(struct OF(walk) *w)
{
    w->leapt = false;
    if (w->launch < 0)
        return;
    struct OF(launch) of = {w->P, &w->on, w->drive, w->load, w->i, w->j, w->launch, w->q};
    real_t longest = r_min(LONGEST_MOMENT / w->P->rate, R(0.1) * (w->t_break - w->t));
    real_t lasts = OF(launched)(&of, w->t, w->moment, longest, w->step.next);
    if (!(lasts > R(0.0)))
        return;
    w->leapt = true;
    w->tried_h = lasts;
    w->last = false;
}

/* Compute the attempted step, and its error over the allowed one. */
static inline void OF(try)(struct OF(walk) *w)
{
    struct OF(step) *S = &w->step;
    OF(launch)(w);
    if (RARE(1))
        table_at_nodes(w->drive, w->i, w->t, w->tried_h, S->u);
    else
        table_values_at_nodes(w->drive, w->i, w->t, w->tried_h, S->u);
    if (RARE(w->P->loaded))
        table_at_nodes(w->load, w->j, w->t, w->tried_h, S->normal);
    if (RARE(w->P->branched))
        OF(put_on_branches)(w->P, &w->on, w->q, S->u[AT_START], S->normal[AT_START]);
    if (!w->leapt) {
        OF(take)(w->P, &w->on, w->tried_h, w->q, S);
        S->error /= w->local;
        if (STATIC(w->P->statics > 0)) {
            real_t grown = OF(grown)(w), grown_2 = grown * grown;
            S->error = r_max(S->error, grown_2 * grown_2 * grown);
        }
        return;
    }
    for (int c = 0; c < STATES(w->P); c++)
        S->rows[0][c] = S->rows[1][c] = S->rows[2][c] = R(0.0);
    for (int e = 0; e < ELEMENTS(w->P); e++)
        S->fast[e] = R(0.0);
    S->error = R(0.0);
}

/* Handle a set-valued contact that stops where it started, because its force is at the breakaway force: hold it by
 * force if the friction can carry the load, or else make the step shorter. Return true if it is held. */
static bool OF(stops_at_once)(struct OF(walk) *w)
{
    int e = w->cut.which;
    OF(bring)(w->P, w->q, w->step.u[AT_START], e, R(0.0));
    if (OF(can_be_held)(w, e)) {
        w->forced = e;
        w->fresh = true;
        return true;
    }
    w->step.error = MUST_SHRINK;
    return false;
}

/* Reject a step with too large an error; the next one is shorter. */
static enum verdict OF(refuse)(struct OF(walk) *w)
{
    real_t error = w->step.error;
    w->rejected++;
    w->refused = true;
    w->h = w->tried_h * (error < R(1e300) ? r_max(R(0.2), R(0.9) * r_pow(error, R(-0.2))) : R(0.1));
    if (w->h <= RESOLVED_TIME * r_max(r_abs(w->t), R(1e-3)))
        return GIVEN_UP_SHORT;
    return w->accepted + w->rejected >= w->max_steps ? GIVEN_UP_MANY : AGAIN;
}

/* Judge the attempted step. */
static inline enum verdict OF(judge)(struct OF(walk) *w)
{
    w->cut = (struct cut){R(1.0), 0, NOTHING};
    if (w->step.error <= R(1.0)) {
        w->cut = OF(find_cut)(w);
        if (w->cut.fraction < R(0.0) && OF(is_static)(w->P, w->cut.which) && OF(stops_at_once)(w)) {
            w->rejected++;
            return AGAIN;
        }
    }
    if (!(w->step.error <= R(1.0)))
        return OF(refuse)(w);
    int e = w->cut.which;
    if (w->cut.fraction < R(0.0) && w->turned < ELEMENTS(w->P)) {
        w->turned++;
        w->on.side[e] = -w->on.side[e];
        w->rejected++;
        return AGAIN;
    }
    w->cut.fraction = r_abs(w->cut.fraction);
    if (w->cut.why == STOPS && w->cut.fraction <= ROOT_EXACT && !OF(is_static)(w->P, e)) {
        /* Rounding errors reverse it at the start of the step; a shorter step shows to which side it slides. */
        w->rejected++;
        w->turned = 0;
        w->refused = true;
        w->h = R(0.25) * w->tried_h;
        return AGAIN;
    }
    if (w->cut.fraction < R(0.5) && (R(1.0) - w->cut.fraction) * OF(unstable)(w, e) > UNSTABLE) {
        w->rejected++;
        w->h = R(1.5) * w->cut.fraction * w->tried_h;
        return AGAIN;
    }
    return ACCEPTED;
}

/* Compute the state at the end of the step or at its cut, with held contacts at rest and internal states within their
 * bounds. Return the time. */
static inline real_t OF(finish)(struct OF(walk) *w, real_t *end, real_t *u_end)
{
    const struct OF(step) *S = &w->step;
    real_t t_new = w->last ? w->t_break : w->t + w->tried_h;
    if (w->cut.fraction < R(1.0)) {
        w->last = false;
        t_new = w->t + w->cut.fraction * w->tried_h;
        OF(at)(w->P, w->cut.fraction, w->q, S, end);
        OF(drive_at)(w, t_new, u_end);
        if (w->cut.why == STOPS)
            OF(bring)(w->P, end, u_end, w->cut.which, R(0.0));
    } else {
        OF(copy)(w->P, S->next, end);
        for (int k = 0; k < DERIVATIVES; k++)
            u_end[k] = S->u[AT_END][k];
    }
    if (STATIC(w->P->statics > 0))
        OF(ride)(w->P, &w->on, end, u_end, w->q, S->u[AT_START]);
    OF(settle)(w->P, end, u_end, w->local);
    return t_new;
}

/* Choose the length of the next step from the error of this one; `slows`: the contacts slow down at the cut. */
static inline void OF(lengthen)(struct OF(walk) *w, bool slows)
{
    real_t error = w->step.error;
    real_t factor = error > R(0.0) ? R(0.9) * r_pow(error, R(-0.2)) : R(6.0);
    real_t grown = w->tried_h * r_min(w->refused ? R(1.0) : R(6.0), factor);
    w->refused = false;
    if (slows) /* the next step slows down as quickly */
        grown = r_min(grown, R(2.0) * w->cut.fraction * w->tried_h);
    /* the length of a step that a break has cut short is no measure for the next */
    w->h = w->last ? r_max(w->h, grown) : grown;
}

/* Pass a break: go to the next segments of drive and load, and update sampled elements that have a tick. */
static void OF(pass_break)(struct OF(walk) *w)
{
    while (table_next_has_begun(w->drive, w->i, w->t)) {
        w->i++;
        w->fresh = true;
    }
    while (table_next_has_begun(w->load, w->j, w->t)) {
        w->j++;
        w->fresh = true;
        OF(unload)(w->P, w->q, load_ratio(w->load, w->j, w->t));
    }
    if (RARE(w->P->sampled)) {
        real_t u[DERIVATIVES];
        OF(drive_at)(w, w->t, u);
        OF(tick)(w->P, w->q, u, w->t);
        w->fresh = true;
    }
}

/* Advance by the accepted step, up to its cut. */
static inline void OF(advance)(struct OF(walk) *w)
{
    real_t end[ROOM_STATES], u_end[DERIVATIVES];
    bool slows = w->cut.why == SLOWS;
    if (STATIC(w->P->statics > 0) || RARE(w->P->branched))
        slows = OF(cut_at_ends)(w);
    w->accepted++;
    real_t t_new = OF(finish)(w, end, u_end);
    if (WATCHED(w->log->rows > 0))
        OF(record)(w, t_new);
    w->turned = 0;
    w->forced = w->launch = -1;
    if (w->cut.why == STOPS && !OF(is_static)(w->P, w->cut.which)) {
        w->on.side[w->cut.which] = -w->on.side[w->cut.which];
    } else if (w->cut.why == STOPS || w->cut.why == BREAKS) {
        w->fresh = true;
        w->share = w->cut.why == BREAKS ? LETS_GO : R(1.0);
    }
    OF(copy)(w->P, end, w->q);
    OF(turn)(w, u_end);
    w->t = t_new;
    OF(lengthen)(w, slows);
    if (w->last)
        OF(pass_break)(w);
}

/* Integrate to t_end, or until the log is full. Return an outcome. */
static int OF(run)(struct OF(walk) *w, real_t t_end)
{
    real_t passed = w->t;
    w->i = table_segment_of(w->drive, w->t);
    w->j = table_segment_of(w->load, w->t);
    w->turned = 0;
    w->forced = w->launch = -1;
    w->refused = false;
    w->share = R(1.0);
    w->log->filled = 0;
    for (int64_t tries = 1; w->t < t_end; tries++) {
        if (w->stop != NULL && *w->stop != 0)
            return STOPPED;
        if (tries % STANDING == 0) {
            if (w->t - passed <= R(STANDING) * RESOLVED_TIME * r_max(r_abs(w->t), R(1e-3)))
                return STEP_TOO_SMALL;
            passed = w->t;
        }
        if (w->fresh)
            OF(begin)(w);
        OF(choose_length)(w, t_end);
        OF(try)(w);
        enum verdict verdict = OF(judge)(w);
        if (verdict == AGAIN)
            continue;
        if (verdict != ACCEPTED)
            return verdict == GIVEN_UP_SHORT ? STEP_TOO_SMALL : TOO_MANY_STEPS;
        OF(advance)(w);
        if (w->accepted + w->rejected >= w->max_steps)
            return TOO_MANY_STEPS;
        if (WATCHED(w->log->rows > 0) && w->log->filled == w->log->rows)
            return LOG_FULL;
    }
    return DONE;
}
