/* Arrival at a target, judged by the mean of the readings and its uncertainty: stickslip.control.Arrival, with the
   same operations in the same order. */
typedef struct {
    double rows[MOVER_BATCHES][5]; /* of each batch the sums of e, p, e^2, p^2 and (e - e before)^2 */
    long batch, ticks, batches;
    bool judging;                  /* whether a reading was taken since the motion began */
    double start, last;
    double offset;                 /* m: mean of the readings from the target; NAN at first */
    double doubt2, noise2;         /* m^2: squares of how far the position may be off that, and of the noise */
} arrival;

/* Forget the readings: the motion begins anew. */
static inline void arrival_begin(arrival *a)
{
    int j, k;
    for (j = 0; j < MOVER_BATCHES; ++j)
        for (k = 0; k < 5; ++k)
            a->rows[j][k] = 0.0;
    a->batch = a->ticks = a->batches = 0;
    a->judging = false;
    a->start = a->last = 0.0;
}

static inline double arrival_positive(double value)
{
    return value > 0.0 ? value : 0.0;
}

/* Whether the position is at the target, by all batches. */
static inline bool arrival_judged(arrival *a)
{
    const double size = (double)MOVER_BATCH, count = (double)(MOVER_BATCHES * MOVER_BATCH);
    double sums[5] = {0.0, 0.0, 0.0, 0.0, 0.0}, squares = 0.0;
    double mean, moved, apart, alike, wandering, error, left;
    int j, k;
    for (j = 0; j < MOVER_BATCHES; ++j)
        for (k = 0; k < 5; ++k)
            sums[k] += a->rows[j][k];
    mean = sums[0] / count;
    moved = sums[1] / count;
    for (j = 0; j < MOVER_BATCHES; ++j) {
        apart = (a->rows[j][0] - a->rows[j][1]) / size - (mean - moved);
        squares += apart * apart;
    }
    a->noise2 = 0.5 * sums[4] / count;
    alike = arrival_positive(sums[2] / count - mean * mean - a->noise2);
    wandering = arrival_positive(sums[3] / count - moved * moved);
    error = MOVER_STUDENT * MOVER_STUDENT * squares / ((double)MOVER_BATCHES * ((double)MOVER_BATCHES - 1.0));
    a->offset = mean;
    a->doubt2 = error + MOVER_SPREAD * MOVER_SPREAD * (wandering + alike);
    left = MOVER_TOLERANCE - fabs(mean);
    return left >= 0.0 && a->doubt2 <= left * left;
}

/* Whether a batch has ended with the position at the goal, for a reading [m] under a voltage [V]. */
static inline bool arrival_sees(arrival *a, double measured, double goal, double volts)
{
    const double off = measured - goal;
    double moved = MOVER_GAIN * volts - goal, *row = a->rows[a->batch];
    bool there;
    int k;
    if (!a->judging) {
        a->judging = true;
        a->start = moved;
        a->last = off;
    }
    moved = moved - a->start;
    row[0] += off;
    row[1] += moved;
    row[2] += off * off;
    row[3] += moved * moved;
    row[4] += (off - a->last) * (off - a->last);
    a->last = off;
    a->ticks += 1;
    if (a->ticks < MOVER_BATCH)
        return false;
    a->ticks = 0;
    a->batch = (a->batch + 1) % MOVER_BATCHES;
    a->batches = a->batches < MOVER_BATCHES ? a->batches + 1 : MOVER_BATCHES;
    there = a->batches == MOVER_BATCHES && arrival_judged(a);
    for (k = 0; k < 5; ++k)
        a->rows[a->batch][k] = 0.0;
    return there;
}

