/* Samples, and the work of the drive, read from the log of steps. Included once per size, after `run.inl`. Steps do not
 * depend on the sample times: samples cost no steps and change none. */

/* Return the states in the row of a logged step. */
static inline const real_t *OF(logged_states)(const struct plant *P, const real_t *row)
{
    return row + LOG_SIDES + ELEMENTS(P) + OF(branches)(P);
}

/* Compute the state at a fraction theta of a logged step. */
static inline void OF(logged_at)(const struct plant *P, const real_t *row, real_t theta, real_t *out)
{
    const real_t *states = OF(logged_states)(P, row);
    real_t rest = R(1.0) - theta;
    int n = STATES(P);
    for (int c = 0; c < n; c++) {
        real_t inner = states[c + 2 * n] + theta * (states[c + 3 * n] + theta * states[c + 4 * n]);
        out[c] = rest * states[c] + theta * (states[c + n] + rest * inner);
    }
}

/* Reading of a log: the plant, drive and load, and the arrays to fill. */
struct OF(reading) {
    const struct plant *P;
    const struct table *drive, *load;
    const struct log *log;
    const real_t *times;    /* times of the samples, s, ascending */
    int64_t count, next;    /* number of times; index of the first one that is not filled yet */
    int columns;            /* number of columns of `samples` */
    real_t *samples;        /* [count, columns]: states, then outputs of the elements */
    real_t *account;        /* [count, TERMS], or NULL */
    bool no_number;         /* true if a sample contains infinity or NaN */
    real_t work[TERMS];     /* integrals up to now, see `add_work` */
};

/* Fill the sample at the time t from a row of the log. i, j: segments of drive and load that contain t; own, loaded:
 * segments in which the step lies. */
static void OF(sample)(const struct OF(reading) *of, const real_t *row, real_t shift, const real_t *move, real_t t,
                       int64_t i, int64_t j, int64_t own, int64_t loaded, real_t *out)
{
    const struct plant *P = of->P;
    struct OF(regime) on;
    real_t q[ROOM_STATES], dq[ROOM_STATES], force[ROOM_ELEMENTS];
    real_t u[DERIVATIVES], u_begun[DERIVATIVES], normal[DERIVATIVES];
    OF(get_regime)(P, row + LOG_SIDES, &on);
    OF(logged_at)(P, row, (t - shift - row[LOG_START]) / row[LOG_LENGTH], q);
    if (STATIC(P->statics > 0)) {
        table_at(of->drive, own, t, u);
        table_at(of->drive, own, row[LOG_START] + shift, u_begun);
        OF(ride)(P, &on, q, u, OF(logged_states)(P, row), u_begun);
    }
    table_at(of->drive, i, t, u);
    table_at(of->load, j, t, normal);
    if (j > loaded)
        OF(unload)(P, q, load_ratio(of->load, j, t));
    if (i != own || j != loaded) {
        OF(start)(P, q, u, normal, R(1.0), &on);
        if (RARE(P->branched))
            OF(put_on_branches)(P, &on, q, u, normal);
    }
    OF(slope)(P, &on, q, u, normal, dq, force);
    for (int c = 0; c < STATES(P); c++)
        out[c] = q[c] + move[c];
    for (int e = 0; e < ELEMENTS(P); e++)
        out[STATES(P) + e] = force[e];
    if (ELEMENTS(P) == 0)
        out[STATES(P)] = R(0.0);
}

static inline void OF(advance_segment)(const struct table *table, real_t t, int64_t *i)
{
    while (table_next_has_begun(table, *i, t))
        (*i)++;
}

/* Fill the samples up to `t_end` from the log, for a period `shift` [s] later and displaced by `move`. At a jump of
 * drive or load, the sample has the values after it. */
static void OF(read_samples)(struct OF(reading) *of, real_t shift, const real_t *move, real_t t_end)
{
    int row = 0;
    int64_t i = 0, j = 0, own = 0, loaded = 0;
    for (; of->next < of->count && of->times[of->next] <= t_end; of->next++) {
        real_t t = of->times[of->next];
        while (row + 1 < of->log->filled && t - shift > log_row(of->log, row)[LOG_END])
            row++;
        const real_t *step = log_row(of->log, row);
        /* The middle of the step lies in the step's segments; a sample at its end may belong to the next ones. */
        real_t inside = R(0.5) * (step[LOG_START] + step[LOG_END]) + shift;
        OF(advance_segment)(of->drive, t, &i);
        OF(advance_segment)(of->load, t, &j);
        OF(advance_segment)(of->drive, inside, &own);
        OF(advance_segment)(of->load, inside, &loaded);
        real_t *out = of->samples + of->next * of->columns;
        OF(sample)(of, step, shift, move, t, i, j, own, loaded, out);
        for (int c = 0; c < of->columns; c++)
            of->no_number = of->no_number || !r_isfinite(out[c]);
    }
}

/* Add a part of a step to the account, by Gauss-Legendre quadrature on the continuous extension: the integrals of sum
 * b_m u q'_m and of sum c_m q'_m^2 (both per unit of mass), of sum f_e s_e (output times input of the elements), and of
 * sum f_e q'_last. */
static void OF(add_work)(struct OF(reading) *of, const real_t *row, real_t shift, real_t low, real_t high, int64_t i,
                         int64_t j)
{
    const struct plant *P = of->P;
    struct OF(regime) on;
    real_t h = row[LOG_LENGTH], *work = of->work;
    OF(get_regime)(P, row + LOG_SIDES, &on);
    for (int g = 0; g < GAUSS; g++) {
        real_t q[ROOM_STATES], dq[ROOM_STATES], force[ROOM_ELEMENTS], u[DERIVATIVES], normal[DERIVATIVES];
        real_t theta = low + (high - low) * GAUSS_NODES[g], weight = GAUSS_WEIGHTS[g] * (high - low) * h;
        real_t t = row[LOG_START] + shift + theta * h;
        OF(logged_at)(P, row, theta, q);
        table_at(of->drive, i, t, u);
        table_at(of->load, j, t, normal);
        OF(slope)(P, &on, q, u, normal, dq, force);
        for (int m = 0; m < MODES(P); m++) {
            real_t speed = q[2 * m + 1];
            work[0] += weight * P->mode[m].drive * u[VALUE] * speed;
            work[1] += weight * P->mode[m].damping * speed * speed;
        }
        for (int e = 0; e < ELEMENTS(P); e++) {
            work[2] += weight * force[e] * OF(speed)(P, e, q, u);
            work[3] += weight * force[e] * q[2 * MODES(P) - 1];
        }
    }
}

/* Add the work of a step from the fraction `done` to the fraction theta, if theta is larger. */
static void OF(work_until)(struct OF(reading) *of, const real_t *row, real_t shift, real_t theta, real_t *done, int64_t i,
                           int64_t j)
{
    if (theta > *done) {
        OF(add_work)(of, row, shift, *done, theta, i, j);
        *done = theta;
    }
}

/* Fill the account of the drive's work at the samples from the next one on, up to `t_end`. */
static void OF(read_account)(struct OF(reading) *of, real_t shift, real_t t_end)
{
    int64_t i = 0, j = 0, k = of->next;
    for (int r = 0; r < of->log->filled; r++) {
        const real_t *row = log_row(of->log, r);
        real_t start = row[LOG_START] + shift, h = row[LOG_LENGTH], done = R(0.0);
        if (start >= t_end)
            break;
        real_t inside = start + R(0.5) * (row[LOG_END] - row[LOG_START]);
        OF(advance_segment)(of->drive, inside, &i);
        OF(advance_segment)(of->load, inside, &j);
        /* The last step ends at the end of the period, however the shift is rounded. */
        real_t stop = r + 1 == of->log->filled ? t_end : r_min(row[LOG_END] + shift, t_end);
        for (; k < of->count && of->times[k] <= stop; k++) {
            OF(work_until)(of, row, shift, (of->times[k] - start) / h, &done, i, j);
            for (int c = 0; c < TERMS; c++)
                of->account[k * TERMS + c] = of->work[c];
        }
        OF(work_until)(of, row, shift, (stop - start) / h, &done, i, j);
    }
}
