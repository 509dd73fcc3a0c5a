/* Test of arrival at a target by the mean of the position readings and its uncertainty. Equations:
 * stickslip.control.arrival. For a rotary actuator m is rad. */
#ifndef STICKSLIP_ARRIVAL_H
#define STICKSLIP_ARRIVAL_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* B, number of batches of readings: few, for a short test, but enough that Student's t is near its limit. */
#define ARRIVAL_BATCHES 8
/* t: 97.5 % quantile of Student's t with ARRIVAL_BATCHES - 1 degrees of freedom. */
#define ARRIVAL_STUDENT 2.3646
/* z: number of standard deviations of the moving position that must lie within the tolerance. */
#define ARRIVAL_SPREAD 2.0
/* Fraction of the tolerance above which the standard deviation of the sensor's noise is reported. */
#define ARRIVAL_NOISY (1.0 / 3.0)

typedef struct {
    double gain;                   /* displacement per voltage of the piezo, m/V */
    double tolerance;              /* largest distance from the target, m */
    int64_t batch;                    /* number of updates of a batch */
} arrival_plan;

typedef struct {
    double rows[ARRIVAL_BATCHES][5]; /* sums over each batch of e, p, e^2, p^2 and (e - previous e)^2; e: reading minus
                                      * target, p: displacement by the piezo since the first reading, m */
    int64_t batch, ticks, batches;
    bool judging;                  /* true after the first reading since the motion started */
    double start, last;
    double offset;                 /* mean of the readings minus the target, m; NAN at first */
    double doubt2, noise2;         /* squares, m^2: of the uncertainty of the position about this mean, and of the
                                    * noise's standard deviation */
} arrival;

/* Forget the readings, because a new motion starts; the last results stay. */
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

/* Compute mean, noise and uncertainty from all batches. Return true if the position is within the tolerance. */
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

/* Take a position reading [m] at a drive voltage [V]. Return true if a batch has just ended, and all batches show the
 * position to be at the goal [m]. */
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
