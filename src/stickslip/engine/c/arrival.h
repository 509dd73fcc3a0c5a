/* Arrival at a target, judged by the mean of the readings and its uncertainty. The equations: stickslip.control.arrival. */
#ifndef STICKSLIP_ARRIVAL_H
#define STICKSLIP_ARRIVAL_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define ARRIVAL_BATCHES 8 /* B, of updates: few enough for a short dwell, and Student's t is near its limit */
#define ARRIVAL_STUDENT 2.3646 /* t: 97.5 % quantile of Student's t with ARRIVAL_BATCHES - 1 degrees of freedom */
#define ARRIVAL_SPREAD 2.0 /* z: standard deviations of the moving position that must be within the tolerance */
#define ARRIVAL_NOISY (1.0 / 3.0) /* share of the tolerance above which the sensor's noise is reported */

typedef struct {
    double gain;                   /* m/V, of the piezo */
    double tolerance;              /* m */
    int64_t batch;                    /* updates of a batch */
} arrival_plan;

typedef struct {
    double rows[ARRIVAL_BATCHES][5]; /* sums over each batch of e, p, e^2, p^2 and (e - previous e)^2 */
    int64_t batch, ticks, batches;
    bool judging;                  /* whether a reading was taken since the motion began */
    double start, last;
    double offset;                 /* m: mean of the readings from the target; NAN at first */
    double doubt2, noise2;         /* m^2: squares of how far the position may be off that, and of the noise */
} arrival;

/* Forget the readings, but not what they said: the motion begins again. */
static inline void arrival_forget(arrival *a)
{
    const arrival fresh = {.offset = a->offset, .doubt2 = a->doubt2, .noise2 = a->noise2};
    *a = fresh;
}

MOVER_API void arrival_begin(arrival *a)
{
    a->offset = a->doubt2 = a->noise2 = NAN;
    arrival_forget(a);
}

/* Whether the position is at the target, by all batches. */
static inline bool arrival_judged(arrival *a, const arrival_plan *plan)
{
    const double size = (double)plan->batch, count = (double)(ARRIVAL_BATCHES * plan->batch);
    double sums[5] = {0.0, 0.0, 0.0, 0.0, 0.0}, squares = 0.0;
    double mean, moved, apart, alike, wandering, error, left;
    int j, k;
    for (j = 0; j < ARRIVAL_BATCHES; ++j)
        for (k = 0; k < 5; ++k)
            sums[k] += a->rows[j][k];
    mean = sums[0] / count;
    moved = sums[1] / count;
    for (j = 0; j < ARRIVAL_BATCHES; ++j) {
        apart = (a->rows[j][0] - a->rows[j][1]) / size - (mean - moved);
        squares += apart * apart;
    }
    a->noise2 = 0.5 * sums[4] / count;
    alike = fmax(sums[2] / count - mean * mean - a->noise2, 0.0);
    wandering = fmax(sums[3] / count - moved * moved, 0.0);
    error = ARRIVAL_STUDENT * ARRIVAL_STUDENT * squares / ((double)ARRIVAL_BATCHES * ((double)ARRIVAL_BATCHES - 1.0));
    a->offset = mean;
    a->doubt2 = error + ARRIVAL_SPREAD * ARRIVAL_SPREAD * (wandering + alike);
    left = plan->tolerance - fabs(mean);
    return left >= 0.0 && a->doubt2 <= left * left;
}

/* Take a reading [m] under a voltage [V]; whether a batch has ended with the position at the goal. */
MOVER_API bool arrival_sees(arrival *a, const arrival_plan *plan, double measured, double goal, double volts)
{
    const double off = measured - goal;
    double moved = plan->gain * volts - goal, *row = a->rows[a->batch];
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
    if (a->ticks < plan->batch)
        return false;
    a->ticks = 0;
    a->batch = (a->batch + 1) % ARRIVAL_BATCHES;
    a->batches = a->batches < ARRIVAL_BATCHES ? a->batches + 1 : ARRIVAL_BATCHES;
    there = a->batches == ARRIVAL_BATCHES && arrival_judged(a, plan);
    for (k = 0; k < 5; ++k)
        a->rows[a->batch][k] = 0.0;
    return there;
}

#endif
