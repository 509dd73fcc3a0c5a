/* Log of the steps: its rows, and rows of continuation. Included once per size, after `walk.inl`. */

/* Return the number of internal states whose branches are stored. */
static inline int OF(branches)(const struct plant *P)
{
    return RARE(P->branched) ? STATES(P) - 2 * MODES(P) : 0;
}

static inline int OF(log_columns)(const struct plant *P)
{
    return LOG_SIDES + ELEMENTS(P) + OF(branches)(P) + 5 * STATES(P);
}

static inline int OF(resume_columns)(const struct plant *P)
{
    return RESUME_SIDES + ELEMENTS(P) + OF(branches)(P) + 2 * STATES(P);
}

/* Store the sides and branches of the contacts in a row; return how many numbers they take. */
static inline int OF(put_regime)(const struct plant *P, const struct OF(regime) *on, real_t *row)
{
    for (int e = 0; e < ELEMENTS(P); e++)
        row[e] = on->side[e];
    for (int c = 0; c < OF(branches)(P); c++)
        row[ELEMENTS(P) + c] = (real_t)on->branch[2 * MODES(P) + c];
    return ELEMENTS(P) + OF(branches)(P);
}

static inline int OF(get_regime)(const struct plant *P, const real_t *row, struct OF(regime) *on)
{
    for (int e = 0; e < ELEMENTS(P); e++)
        on->side[e] = row[e];
    for (int c = 0; c < STATES(P); c++)
        on->branch[c] = 0;
    for (int c = 0; c < OF(branches)(P); c++)
        on->branch[2 * MODES(P) + c] = (unsigned char)row[ELEMENTS(P) + c];
    return ELEMENTS(P) + OF(branches)(P);
}

/* Store a time with its state in a row of continuation. */
static void OF(store)(const struct plant *P, real_t *row, real_t t, real_t h, bool fresh, bool compared,
                      const struct OF(regime) *on, const real_t *q, const real_t *before)
{
    row[VALID] = R(1.0);
    row[RESUME_TIME] = t;
    row[RESUME_STEP] = h;
    row[RESUME_FRESH] = fresh ? R(1.0) : R(0.0);
    row[COMPARED] = compared ? R(1.0) : R(0.0);
    real_t *states = row + RESUME_SIDES + OF(put_regime)(P, on, row + RESUME_SIDES);
    OF(copy)(P, q, states);
    OF(copy)(P, before, states + STATES(P));
}

/* Append the accepted step to the log. */
static void OF(record)(struct OF(walk) *w, real_t t_new)
{
    const struct plant *P = w->P;
    real_t *row = w->log->values + (int64_t)w->log->filled++ * w->log->columns;
    row[LOG_START] = w->t;
    row[LOG_LENGTH] = w->tried_h;
    row[LOG_END] = t_new;
    row[LOG_FRACTION] = w->leapt ? LAUNCHED : w->cut.fraction;
    real_t *states = row + LOG_SIDES + OF(put_regime)(P, &w->on, row + LOG_SIDES);
    OF(copy)(P, w->q, states);
    OF(copy)(P, w->step.next, states + STATES(P));
    for (int k = 0; k < 3; k++)
        OF(copy)(P, w->step.rows[k], states + (2 + k) * STATES(P));
}
