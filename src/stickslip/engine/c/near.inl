/* Neighbours of a trajectory: slightly different plants or states, which are integrated with exactly the trajectory's
 * steps. Included once per size, after `run.inl`.
 *
 * The difference of two states, divided by the difference of their causes, is a derivative. Steps, cuts and sides of v
 * = 0 are those of the trajectory itself, so the error control adds no noise to the derivative. It is as smooth as the
 * equations, with relative differences of 1e-6, whatever the tolerance. */

#ifndef NEAR_CONSTANTS
#define NEAR_CONSTANTS
/* Trace of a step of a neighbour: its start and length, the sampled state at both ends, and the continuous
 * extension. */
enum { TRACE_START, TRACE_LENGTH, TRACE_OLD, TRACE_NEW, TRACE_ROWS, TRACE = TRACE_ROWS + 3 };
/* Fraction by which a state is moved beyond its bound in order to test whether it is on the bound. */
#define BEYOND_BOUND R(1e-9)
/* Factor on a state at its bound that gives a state which is certainly beyond the bound. */
#define FAR_BEYOND R(1e3)
#endif

/* Set `net` to the displacements of positions without stiffness since `begun`, if they exceed `apart`, and to 0 for all
 * other states. */
static void OF(gone)(const struct plant *P, const real_t *q, const real_t *begun, real_t apart, real_t *net)
{
    for (int c = 0; c < STATES(P); c++)
        net[c] = R(0.0);
    for (int m = 0; m < MODES(P); m++)
        if (P->mode[m].stiffness == R(0.0) && r_abs(q[2 * m] - begun[2 * m]) > apart)
            net[2 * m] = q[2 * m] - begun[2 * m];
}

struct OF(neighbours) {
    const struct stickslip_near *of; /* NULL: there are no neighbours */
    real_t *begun;                   /* [count, states], states at the start of the period */
    real_t *traces;                  /* [count, rows of the log, TRACE] */
};

/* Return plant, state and trace of neighbour p. */
static inline const struct plant *OF(near_plant)(const struct OF(neighbours) *N, int64_t p)
{
    return &N->of->plants[p];
}

static inline real_t *OF(near_state)(const struct OF(neighbours) *N, int64_t p)
{
    return N->of->states + p * STATES(OF(near_plant)(N, p));
}

static inline real_t *OF(trace)(const struct OF(neighbours) *N, int64_t p, int64_t row)
{
    return N->traces + (p * LOG_ROWS + row) * TRACE;
}

/* Store the states of all neighbours at the start of a period. */
static void OF(mark)(const struct OF(neighbours) *N)
{
    for (int64_t p = 0; p < N->of->count; p++) {
        const struct plant *P = OF(near_plant)(N, p);
        OF(copy)(P, OF(near_state)(N, p), N->begun + p * STATES(P));
    }
}

/* Set start and length of a step of neighbour p, at the same fraction of the neighbour's own segment. */
static void OF(own_step)(const struct table *drive, const struct stickslip_near *near, int64_t p, int64_t i, real_t t,
                         real_t h, real_t *trace)
{
    trace[TRACE_START] = t;
    trace[TRACE_LENGTH] = h;
    if (near->drives == NULL)
        return;
    const real_t *own = near->drives[p].start;
    real_t stop = near->end, own_stop = near->ends[p];
    if (table_next_has_begun(drive, i, near->end)) {
        stop = drive->start[i + 1];
        own_stop = own[i + 1];
    }
    real_t scale = (own_stop - own[i]) / (stop - drive->start[i]);
    trace[TRACE_START] = own[i] + (t - drive->start[i]) * scale;
    trace[TRACE_LENGTH] = h * scale;
}

/* Put each internal state of a neighbour on its bound if the trajectory's state, q, is on its bound. Otherwise the
 * neighbour would meet its bound within a step, which is not cut there. */
static void OF(settle_alike)(const struct plant *P, const real_t *q, const struct plant *own, real_t *other)
{
    for (int e = 0; e < ELEMENTS(P); e++) {
        const struct element *E = &P->element[e], *O = &own->element[e];
        if (!OF(is_contact)(P, e) || E->law->project == NULL)
            continue;
        for (int i = 0; i < STATES_OF(P, e); i++) {
            int c = FIRST(P, e) + i;
            real_t ahead = q[c] + BEYOND_BOUND * q[c];
            if (E->law->project(parameters_of(E, i), ahead) != ahead)
                other[c] = O->law->project(parameters_of(O, i), FAR_BEYOND * q[c]);
        }
    }
}

/* A logged step with the drive and the normal force at its nodes. */
struct OF(logged) {
    const struct plant *P;
    const real_t *row;
    int64_t i, j;                    /* indices of the segments of drive and load */
    real_t local, fraction;
    struct OF(regime) on;
    real_t end[ROOM_STATES];         /* trajectory's state at the end of the step */
    struct OF(step) step;            /* the step of a neighbour */
};

/* Take a logged step with neighbour p. */
static void OF(take_alike)(struct OF(logged) *L, const struct table *load, const struct OF(neighbours) *N, int64_t p,
                           real_t *trace)
{
    const struct plant *P = OF(near_plant)(N, p);
    struct OF(step) *S = &L->step;
    real_t *q = OF(near_state)(N, p), end[ROOM_STATES];
    if (N->of->drives != NULL) {
        table_at_nodes(&N->of->drives[p], L->i, trace[TRACE_START], trace[TRACE_LENGTH], S->u);
        table_at_nodes(load, L->j, trace[TRACE_START], trace[TRACE_LENGTH], S->normal);
    }
    if (L->row[LOG_FRACTION] == LAUNCHED) {
        const real_t *states = OF(logged_states)(P, L->row);
        for (int c = 0; c < STATES(P); c++) {
            S->next[c] = q[c] + states[c + STATES(P)] - states[c];
            for (int k = 0; k < 3; k++)
                S->rows[k][c] = states[c + (2 + k) * STATES(P)];
        }
    } else {
        OF(take)(P, &L->on, trace[TRACE_LENGTH], q, S);
    }
    int64_t column = N->of->column;
    trace[TRACE_OLD] = q[column];
    trace[TRACE_NEW] = S->next[column];
    for (int k = 0; k < 3; k++)
        trace[TRACE_ROWS + k] = S->rows[k][column];
    OF(at)(P, L->fraction, q, S, end);
    OF(settle)(P, end, S->u[AT_END], L->local);
    OF(settle_alike)(L->P, L->end, P, end);
    OF(copy)(P, end, q);
}

/* Take the logged steps with each neighbour. */
static void OF(replay)(const struct OF(walk) *w, const struct OF(neighbours) *N)
{
    const struct log *log = w->log;
    struct OF(logged) L = {.P = w->P, .local = w->local};
    if (log->filled > 0) {
        L.i = table_segment_of(w->drive, log_row(log, 0)[LOG_START]);
        L.j = table_segment_of(w->load, log_row(log, 0)[LOG_START]);
    }
    for (int r = 0; r < log->filled && (w->stop == NULL || *w->stop == 0); r++) {
        L.row = log_row(log, r);
        real_t t = L.row[LOG_START], h = L.row[LOG_LENGTH];
        OF(get_regime)(w->P, L.row + LOG_SIDES, &L.on);
        OF(advance_segment)(w->drive, t, &L.i);
        table_at_nodes(w->drive, L.i, t, h, L.step.u);
        table_at_nodes(w->load, L.j, t, h, L.step.normal);
        L.fraction = r_min(L.row[LOG_FRACTION], R(1.0));
        OF(logged_at)(w->P, L.row, L.fraction, L.end);
        OF(settle)(w->P, L.end, L.step.u[AT_END], w->local);
        for (int64_t p = 0; p < N->of->count; p++) {
            OF(own_step)(w->drive, N->of, p, L.i, t, h, OF(trace)(N, p, r));
            OF(take_alike)(&L, w->load, N, p, OF(trace)(N, p, r));
        }
        while (table_next_has_begun(w->load, L.j, L.row[LOG_END])) {
            L.j++;
            real_t ratio = load_ratio(w->load, L.j, w->load->start[L.j]);
            for (int64_t p = 0; p < N->of->count; p++)
                OF(unload)(OF(near_plant)(N, p), OF(near_state)(N, p), ratio);
        }
    }
}

/* Move the neighbours on by their net displacement over a number of repeated periods. */
static void OF(carry)(const struct OF(neighbours) *N, int64_t periods)
{
    for (int64_t p = 0; p < N->of->count; p++) {
        const struct plant *P = OF(near_plant)(N, p);
        real_t net[ROOM_STATES], *q = OF(near_state)(N, p);
        OF(gone)(P, q, N->begun + p * STATES(P), R(0.0), net);
        for (int c = 0; c < STATES(P); c++)
            q[c] += (real_t)periods * net[c];
    }
}

/* Fill the positions of the neighbours up to `t_end` from their traces. The traces are of the period that started with
 * segment `first` of the drive; the period repeats from segment `now` on, `shift` [s] later, after `periods` periods,
 * in each of which a neighbour moves on by its own net step. */
static void OF(read_traces)(const struct OF(reading) *of, const struct OF(neighbours) *N, int64_t first, int64_t now,
                            real_t shift, int64_t periods, real_t t_end)
{
    const struct stickslip_near *near = N->of;
    for (int64_t p = 0; p < near->count && of->log->filled > 0; p++) {
        int64_t c = near->column;
        real_t own_shift = shift;
        if (near->drives != NULL)
            own_shift = near->drives[p].start[now] - near->drives[p].start[first];
        real_t begun = N->begun[p * STATES(OF(near_plant)(N, p)) + c];
        real_t move = (real_t)periods * (OF(near_state)(N, p)[c] - begun);
        int row = 0;
        for (int64_t k = of->next; k < of->count && of->times[k] <= t_end; k++) {
            real_t t = of->times[k] - own_shift;
            while (row + 1 < of->log->filled && t > (near->drives == NULL ? log_row(of->log, row)[LOG_END]
                                                                          : OF(trace)(N, p, row + 1)[TRACE_START]))
                row++;
            const real_t *trace = OF(trace)(N, p, row), *rows = trace + TRACE_ROWS;
            real_t theta = (t - trace[TRACE_START]) / trace[TRACE_LENGTH];
            near->positions[p * of->count + k] =
                OF(extended)(theta, trace[TRACE_OLD], trace[TRACE_NEW], rows[0], rows[1], rows[2]) + move;
        }
    }
}
