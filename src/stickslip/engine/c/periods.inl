/* Trajectories of a plant: samples, and repeated periods. Included once per size, after `run.inl`.
 *
 * Under a periodic drive the motion becomes periodic. If two successive periods start in the same state, within a small
 * fraction of the tolerance, the following periods are copies of the last one, moved by its net step. */

#ifndef PERIODS_CONSTANTS
#define PERIODS_CONSTANTS
/* Two periods are equal if the difference of their first states, times the number of periods to come, is below this
 * fraction of the tolerance. */
#define SAME R(0.02)
/* Tolerance of a careful run, over the usual tolerance and the decay of a vibration per radian (CREEPING); and its
 * least value, over the usual tolerance. */
#define CREEPING (R(2.0) / LOCAL)
#define LEAST_CAREFUL R(1e-4)
#endif

/* A whole trajectory: the integration, the reading of its log, and its periods. */
struct OF(journey) {
    struct OF(walk) walk;
    struct OF(reading) read;
    real_t tolerance, t_end;
    struct cycle cycle;
    int64_t i;              /* index of the segment of the drive with which the next period starts */
    bool compared;          /* true if `before` contains a state a period ago */
    real_t before[ROOM_STATES], begun[ROOM_STATES]; /* states a period ago, and at the start of this period */
    real_t *resume;         /* a row of continuation, or NULL */
    struct OF(neighbours) near;
    bool ending;            /* true if a later end could have changed the run: the row of continuation must not change
                             * then */
};

/* Return the largest difference of two states, except in positions without stiffness, converted to metres. */
static real_t OF(drift_apart)(const struct plant *P, const real_t *q, const real_t *other)
{
    real_t far = R(0.0);
    for (int m = 0; m < MODES(P); m++) {
        far = r_max(far, r_abs(q[2 * m + 1] - other[2 * m + 1]) / P->rate);
        if (P->mode[m].stiffness != R(0.0))
            far = r_max(far, r_abs(q[2 * m] - other[2 * m]));
    }
    for (int c = 2 * MODES(P); c < STATES(P); c++)
        far = r_max(far, r_abs(q[c] - other[c]));
    return far;
}

/* Return true if the motion does not depend on the positions without stiffness, so that a period can repeat at another
 * place. */
static bool OF(same_anywhere)(const struct plant *P)
{
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e];
        if (E->positioned || E->law->tick != NULL || (E->along != NULL && !ss_uniform(E->along)))
            return false;
    }
    return true;
}

/* Return the least decay per radian of a vibration on the bristles of a sticking contact; at least the decay by e
 * within the time `lasts` [s], at most 1. */
static real_t OF(decay)(const struct plant *P, real_t lasts)
{
    real_t least = R(1.0);
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e];
        if (!OF(is_contact)(P, e) || STATES_OF(P, e) == 0 || (E->felt & E->pushed) == 0)
            continue;
        real_t p = -OF(own_push)(P, e) * E->normal, k = R(0.0), c = R(0.0);
        real_t soft = E->along != NULL ? ss_softening(E->along, E->normal) : R(1.0);
        for (int i = 0; i < STATES_OF(P, e); i++) {
            struct bristle of = {E->law, parameters_of(E, i), R(1.0), 0};
            struct law_slopes slopes = OF(slopes_of)(&of, R(0.0), R(0.0));
            k += p * slopes.force_z * slopes.rate_v * soft;
            c += p * slopes.force_v;
        }
        if (k > R(0.0))
            least = r_min(least, r_max(R(0.5) * c, R(1.0) / lasts) / r_sqrt(k));
    }
    return least;
}

/* Return the tolerance for steps that resolve small vibrations of sticking contacts. Under a load, a contact creeps by
 * up to 2/pi times the amplitude of a vibration per radian (docs/decisions/error-estimate.md). A small vibration with
 * little decay so moves the contact far. */
static real_t OF(careful_tolerance)(const struct plant *P, real_t lasts, real_t tolerance)
{
    return tolerance * r_min(R(1.0), r_max(CREEPING * OF(decay)(P, lasts), LEAST_CAREFUL));
}

/* Read the log of the period that started with segment `first` of the drive, and fill samples up to `t_end`. The log
 * applies to a period `shift` [s] later, `periods` periods later, in which the state is moved by `move`. */
static void OF(read)(struct OF(journey) *J, int64_t first, real_t shift, int64_t periods, const real_t *move, real_t t_end)
{
    if (WATCHED(J->near.of != NULL))
        OF(read_traces)(&J->read, &J->near, first, J->i, shift, periods, t_end);
    if (WATCHED(J->read.account != NULL))
        OF(read_account)(&J->read, shift, t_end);
    if (WATCHED(J->read.log->filled > 0))
        OF(read_samples)(&J->read, shift, move, t_end);
}

/* Integrate to `stop`; read and empty the log whenever it is full. Return an outcome; `flushed` is true if the log does
 * not contain the whole span. */
static int OF(run_and_read)(struct OF(journey) *J, real_t stop, bool *flushed)
{
    real_t still[ROOM_STATES] = {0};
    *flushed = false;
    for (;;) {
        int outcome = OF(run)(&J->walk, stop);
        if (WATCHED(J->near.of != NULL))
            OF(replay)(&J->walk, &J->near);
        if (J->walk.stop != NULL && *J->walk.stop != 0)
            return STOPPED;
        OF(read)(J, J->i, R(0.0), 0, still, J->walk.t);
        if (outcome != LOG_FULL)
            return outcome;
        *flushed = true;
    }
}

/* Copy the last period `left` times. A displacement that may be the rest of a transient, by which the period differs
 * from the previous one (`apart`), is not repeated: a sticking contact does not creep by it. With neighbours it is
 * repeated, because derivatives must not jump. */
static void OF(copy_periods)(struct OF(journey) *J, int64_t left, real_t apart, real_t period_start)
{
    struct OF(walk) *w = &J->walk;
    const struct table *drive = w->drive;
    real_t net[ROOM_STATES], moved[ROOM_STATES];
    int64_t begins = J->i - J->cycle.segments;
    OF(gone)(w->P, w->q, J->begun, WATCHED(J->near.of != NULL) ? R(0.0) : R(2.0) * apart, net);
    for (int64_t p = 1; p <= left; p++) {
        int64_t after = J->i + J->cycle.segments;
        real_t end = table_next_break(drive, after - 1, J->t_end);
        for (int c = 0; c < STATES(w->P); c++)
            moved[c] = (real_t)p * net[c];
        OF(read)(J, begins, drive->start[J->i] - period_start, p, moved, end);
        J->i = after;
        w->t = end;
    }
    for (int c = 0; c < STATES(w->P); c++)
        w->q[c] += (real_t)left * net[c];
    if (WATCHED(J->near.of != NULL))
        OF(carry)(&J->near, left);
    J->ending = true;
}

/* Finish a whole period; if the drive repeats it and the motion is periodic, copy it. */
static void OF(end_period)(struct OF(journey) *J, real_t period_start, real_t stop, bool flushed)
{
    struct OF(walk) *w = &J->walk;
    const struct table *drive = w->drive;
    J->i += J->cycle.segments;
    if (J->compared && !flushed) {
        int64_t left = count_repeats(drive, w->load, J->i, J->cycle, stop - period_start, J->t_end);
        /* A later end could have changed the run, unless the drive changes here. */
        bool last = table_next_break(drive, J->i + J->cycle.segments - 1, J->t_end) >= J->t_end;
        J->ending = J->ending || (left == 0 && last);
        real_t apart = OF(drift_apart)(w->P, w->q, J->before);
        if (left > 0 && (real_t)left * apart <= SAME * J->tolerance)
            OF(copy_periods)(J, left, apart, period_start);
    }
    J->compared = true;
    OF(copy)(w->P, w->q, J->before);
}

/* Integrate the trajectory to its end, period by period where drive and load repeat. Return an outcome. */
static int OF(follow)(struct OF(journey) *J)
{
    struct OF(walk) *w = &J->walk;
    const struct table *drive = w->drive;
    while (w->t < J->t_end) {
        int64_t n = J->cycle.segments, next = J->i < J->cycle.first ? J->cycle.first : J->i + n;
        real_t stop = n > 0 ? table_next_break(drive, next - 1, J->t_end) : J->t_end, period_start = w->t;
        bool flushed;
        if (WATCHED(J->resume != NULL) && n > 0 && !J->ending)
            OF(store)(w->P, J->resume, w->t, w->h, w->fresh, J->compared, &w->on, w->q, J->before);
        OF(copy)(w->P, w->q, J->begun);
        if (WATCHED(J->near.of != NULL))
            OF(mark)(&J->near);
        int outcome = OF(run_and_read)(J, stop, &flushed);
        if (outcome != DONE)
            return outcome;
        if (J->i < J->cycle.first)
            J->i = next;
        else if (stop < J->t_end)
            OF(end_period)(J, period_start, stop, flushed);
    }
    return DONE;
}

/* Continue from the row of continuation. */
static void OF(take_up)(struct OF(journey) *J)
{
    struct OF(walk) *w = &J->walk;
    const real_t *row = J->resume;
    w->t = row[RESUME_TIME];
    w->h = row[RESUME_STEP];
    w->fresh = row[RESUME_FRESH] > R(0.0);
    J->compared = row[COMPARED] > R(0.0);
    const real_t *states = row + RESUME_SIDES + OF(get_regime)(w->P, row + RESUME_SIDES, &w->on);
    OF(copy)(w->P, states, w->q);
    OF(copy)(w->P, states + STATES(w->P), J->before);
}

/* Set the start of a trajectory: from the task, or from the row of continuation. */
static void OF(depart)(struct OF(journey) *J)
{
    struct OF(walk) *w = &J->walk;
    const struct plant *P = w->P;
    bool resumed = WATCHED(J->resume != NULL) && J->resume[VALID] > R(0.0);
    OF(copy)(P, w->q, J->before);
    if (resumed)
        OF(take_up)(J);
    if (OF(same_anywhere)(P))
        J->cycle = cycle_of(w->drive, w->load);
    J->i = table_segment_of(w->drive, w->t);
    if (P->sampled && !resumed) {
        real_t u[DERIVATIVES];
        table_at(w->drive, J->i, w->t, u);
        OF(tick)(P, w->q, u, w->t);
    }
    if (WATCHED(J->resume != NULL) && !resumed)
        OF(store)(P, J->resume, w->t, w->h, true, false, &w->on, w->q, w->q);
    w->resume = J->cycle.segments > 0 ? NULL : J->resume;
}

/* Integrate the task's trajectory; J must be zero except for its neighbours. Return an outcome. */
static int OF(travel)(struct OF(journey) *J, struct log *log, const struct stickslip_task *task,
                      struct stickslip_result *result)
{
    const struct plant *P = task->plant;
    struct OF(walk) *w = &J->walk;
    real_t tolerance = task->tolerance;
    if (task->careful)
        tolerance = OF(careful_tolerance)(P, task->end - task->begin, tolerance);
    *w = (struct OF(walk)){.P = P, .drive = task->drive, .load = task->load, .t = task->begin, .h = R(INFINITY),
                           .fresh = true, .local = LOCAL * tolerance, .max_steps = task->max_steps, .log = log,
                           .stop = task->stop};
    J->read = (struct OF(reading)){.P = P, .drive = task->drive, .load = task->load, .log = log,
                                   .times = task->times, .count = task->count,
                                   .columns = STATES(P) + (ELEMENTS(P) > 0 ? ELEMENTS(P) : 1),
                                   .samples = task->samples, .account = task->account};
    J->tolerance = tolerance;
    J->t_end = task->end;
    J->resume = task->resume;
    OF(copy)(P, task->state, w->q);
    OF(depart)(J);
    int outcome = OF(follow)(J);
    OF(copy)(P, w->q, task->state);
    *result = (struct stickslip_result){w->t, w->accepted, w->rejected};
    return outcome == DONE && J->read.no_number ? NO_NUMBER : outcome;
}

#ifndef STICKSLIP_GPU /* on a GPU, each thread has memory of its own */
/* Allocate memory for neighbours. Return false if there is none. */
static bool OF(make_room)(struct OF(neighbours) *N, const struct stickslip_near *near, int64_t states)
{
    size_t count = (size_t)near->count + 1; /* not 0, because malloc(0) may return NULL */
    N->of = near;
    N->begun = malloc(count * (size_t)states * sizeof *N->begun);
    N->traces = malloc(count * LOG_ROWS * TRACE * sizeof *N->traces);
    return N->begun != NULL && N->traces != NULL;
}

/* Integrate one trajectory, with neighbours or NULL; see `stickslip_integrate`. */
static int OF(integrate)(const struct stickslip_task *task, const struct stickslip_near *near,
                         struct stickslip_result *result)
{
    const struct plant *P = task->plant;
    struct log log = {.rows = task->count > 0 || (near != NULL && near->count > 0) ? LOG_ROWS : 0,
                      .columns = OF(log_columns)(P)};
    struct OF(journey) *J = calloc(1, sizeof *J);
    if (log.rows > 0)
        log.values = malloc((size_t)log.rows * (size_t)log.columns * sizeof *log.values);
    int outcome = NO_MEMORY;
    bool room = J != NULL && (log.rows == 0 || log.values != NULL);
    if (room && near != NULL)
        room = OF(make_room)(&J->near, near, STATES(P));
    if (room)
        outcome = OF(travel)(J, &log, task, result);
    free(log.values);
    if (J != NULL) {
        free(J->near.begun);
        free(J->near.traces);
    }
    free(J);
    return outcome;
}
#endif
