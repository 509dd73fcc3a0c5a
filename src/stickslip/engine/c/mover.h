/* State machine that moves to a position from anywhere and holds it: stickslip.control.Mover. Call `mover_begin` once,
 * at rest. At each update call `mover_before`; if it returns true, also call the regulator, and then `mover_after` with
 * the regulator's voltage. SI units: V, and m, or rad for a rotary actuator. */
#ifndef STICKSLIP_MOVER_H
#define STICKSLIP_MOVER_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* Number of steps in succession without progress after which a move is given up. */
#define MOVER_PATIENCE 20
/* Number of times that a move starts again without having been at the target in between. */
#define MOVER_ATTEMPTS 20
/* Largest distance of the piezo from the middle of its range after steps, as a fraction of half the range. */
#define MOVER_CLOSE 0.5
/* The same if the piezo is to be centred. */
#define MOVER_CENTRED 0.15

typedef enum {
    MOVER_REST,
    MOVER_RETURN,   /* the piezo moves, with a sticking contact, to the voltage at which steps start */
    MOVER_STEP,     /* full steps; the last one may be smaller */
    MOVER_WAIT,     /* pause until vibrations have decayed */
    MOVER_RECENTRE, /* the piezo slips to the middle of its range */
    MOVER_SCAN,     /* the piezo moves to the target, with a sticking contact */
    MOVER_HOLD
} mover_phase;

typedef enum {
    MOVER_FINE,
    MOVER_OUT_OF_REACH, /* target not reached in MOVER_ATTEMPTS attempts */
    MOVER_LOST          /* MOVER_PATIENCE steps in succession without progress: an end stop, or lost steps */
} mover_error;

/* Step sizes in one direction: a table, and a factor that is learnt from the steps made. */
typedef struct {
    const double *sizes;           /* [points], step sizes at the table's voltages, m, from 0 on */
    double factor;                 /* factor on the table's sizes, by least squares */
    double squares, products;      /* sums from which the factor is computed, m^2 */
} mover_way;

typedef struct {
    int64_t points;
    const double *voltages;        /* [points], step amplitudes, V, ascending from 0 */
    double learning;               /* weight of a new step in the sums; 0: nothing is learnt */
    mover_way ways[2];             /* forward, backward */
} mover_table;

typedef struct {
    arrival_plan arrival;          /* test of arrival; it contains the gain of the piezo */
    double rate;                   /* rate of the updates, Hz */
    double low, high, middle;      /* ends and middle of the piezo's range, V */
    double least, most;            /* ends of the part of the range that is used to hold a position, V */
    double start;                  /* voltage at rest, V */
    double amplitude;              /* amplitude of full steps, V */
    double share_lost;             /* fraction of the expected distance below which a step counts as lost */
    double nearby;                 /* largest distance of targets that are first tried by the piezo from mid-range,
                                    * without steps, m */
    double along;                  /* largest voltage change per update by which the piezo follows a moving target
                                    * without a scan, V */
    double holding;                /* time at the target after which the move is done, s */
    int64_t period, rise;          /* number of updates of a step, and of its slow rise */
    int64_t slipping;
    const double *slip;            /* [slipping], fraction of the voltage that is left at each update after the rise */
    int64_t pause, scanning;       /* number of updates of the pause after the last step, and of a scan or a return */
    mover_table table;             /* initial step sizes */
} mover_plan;

typedef struct {
    const mover_plan *plan;
    mover_phase phase;
    int64_t entered;               /* number of phases that have started */
    mover_error error;
    double goal, voltage;          /* target, m, NAN before the first one; drive voltage, V */
    double wanted;                 /* position that the regulator must reach at this update, m */
    bool begins;                   /* the regulator must start anew, at `voltage` and the position `before` */
    int64_t steps, lost;           /* numbers of steps made, and of lost ones among them */
    bool settled, done;            /* true if the position was at the target; true if it has stayed there for
                                    * `holding` */
    double settled_at;             /* time of arrival, s */
    int64_t steps_wanted;          /* set by the caller: make this number of full steps (backward if negative), and hold
                                    * there */
    bool centre_wanted;            /* set by the caller: while holding, bring the piezo to mid-range at the same
                                    * target */
    mover_table table;             /* present step sizes, with what was learnt */
    double from, to, amplitude, before, close;
    int64_t tick, count, lost_now, attempts, jogs;
    bool jogging, first;
    arrival there;                 /* statistics of the readings at the target */
    bool noisy;                    /* true if the sensor's noise is large compared with the tolerance */
    int direction;                 /* direction of steps, 1 or -1 */
} mover;

/* Return the distance [m] of a step with an amplitude [V] in a direction, 1 or -1. */
MOVER_API double mover_size(const mover_table *s, double volts, int direction)
{
    const mover_way *way = &s->ways[direction > 0 ? 0 : 1];
    const double *x = s->voltages, *y = way->sizes;
    int64_t k = s->points - 1;
    while (k > 0 && volts < x[k])
        --k;
    if (volts <= x[k] || k == s->points - 1)
        return way->factor * y[k];
    return way->factor * ((y[k + 1] - y[k]) / (x[k + 1] - x[k]) * (volts - x[k]) + y[k]);
}

/* Return the amplitude [V] of a step over a distance [m]; the largest of the table if no step goes that far. */
MOVER_API double mover_voltage_for(const mover_table *s, double distance, int direction)
{
    const mover_way *way = &s->ways[direction > 0 ? 0 : 1];
    const double *x = s->voltages, *y = way->sizes;
    const double wanted = distance / way->factor;
    double share;
    int64_t k = 2;
    while (k < s->points && y[k] < wanted)
        ++k;
    if (k == s->points)
        return x[k - 1];
    share = (wanted - y[k - 1]) / fmax(y[k] - y[k - 1], 1e-300);
    return x[k - 1] + fmin(fmax(share, 0.0), 1.0) * (x[k] - x[k - 1]);
}

/* Learn the factor on the step sizes from a step with an amplitude [V] that moved by a distance [m] in its
 * direction. */
MOVER_API void mover_learn(mover_table *s, double volts, int direction, double distance)
{
    mover_way *way = &s->ways[direction > 0 ? 0 : 1];
    const double told = mover_size(s, volts, direction) / way->factor, kept = 1.0 - s->learning;
    if (!(told > 0.0) || s->learning == 0.0)
        return;
    way->squares = kept * way->squares + told * told;
    way->products = kept * way->products + told * distance;
    way->factor = fmin(fmax(way->products / way->squares, 0.1), 10.0);
}

MOVER_API void mover_begin(mover *m, const mover_plan *plan)
{
    const mover fresh = {
        .plan = plan, .goal = NAN, .wanted = NAN, .voltage = plan->start, .table = plan->table, .from = plan->start,
        .to = plan->start, .amplitude = plan->amplitude, .close = MOVER_CLOSE, .first = true, .direction = 1};
    *m = fresh;
    arrival_begin(&m->there);
}

/* Return a smooth transition from 0 to 1 for a fraction of time, with minimum jerk. */
static inline double mover_smooth(double share)
{
    const double s = fmin(share, 1.0);
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
}

static inline void mover_enter(mover *m, mover_phase phase)
{
    m->phase = phase;
    m->entered += 1;
    m->count = 0;
}

/* Start the return of the piezo to the voltage at which steps start. */
static inline void mover_return(mover *m)
{
    m->from = m->voltage;
    m->to = m->direction > 0 ? m->plan->low : m->plan->high;
    mover_enter(m, MOVER_RETURN);
}

/* Start one or two steps after which the piezo is at the goal near the middle of its range. */
static inline void mover_centre(mover *m)
{
    m->close = MOVER_CENTRED;
    m->direction = m->voltage > m->plan->middle ? 1 : -1;
    mover_return(m);
}

/* Return the fraction of a voltage that is left `count` updates after the rise, while it slips. */
static inline double mover_left(const mover *m, int64_t count)
{
    return count <= m->plan->slipping ? m->plan->slip[count - 1] : 0.0;
}

static inline bool mover_within(const mover *m, double volts)
{
    return m->plan->least <= volts && volts <= m->plan->most;
}

static inline void mover_scan(mover *m, double measured)
{
    m->before = measured;
    m->begins = true;
    arrival_forget(&m->there);
    mover_enter(m, MOVER_SCAN);
}

/* Start the move to the goal: by the piezo alone if its range suffices, else by steps. */
static inline void mover_go(mover *m, double measured)
{
    const mover_plan *p = m->plan;
    const double needed = m->voltage + (m->goal - measured) / p->arrival.gain;
    if (mover_within(m, needed)) {
        mover_scan(m, measured);
        return;
    }
    m->attempts += 1;
    if (m->attempts > MOVER_ATTEMPTS) {
        m->error = MOVER_OUT_OF_REACH;
        return;
    }
    if (m->attempts == 1 && fabs(m->goal - measured) <= p->nearby) {
        m->from = m->voltage;
        m->to = p->middle;
        mover_enter(m, MOVER_RECENTRE);
        return;
    }
    m->direction = needed > p->middle ? 1 : -1; /* direction that remains when the piezo is in the middle */
    mover_return(m);
}

static inline void mover_take_step(mover *m, double amplitude, double measured)
{
    m->amplitude = amplitude;
    if (m->phase != MOVER_STEP) {
        mover_enter(m, MOVER_STEP);
        m->first = true;
    }
    m->before = measured;
    m->count = 0;
}

/* Start the next step, a full one or one over the missing distance, or end the steps. */
static inline void mover_next_step(mover *m, double measured)
{
    const mover_plan *p = m->plan;
    const double d = (double)m->direction, gain = p->arrival.gain;
    double missing, full;
    if (m->jogging) {
        m->jogs -= 1;
        if (m->jogs < 0)
            mover_enter(m, MOVER_WAIT);
        else
            mover_take_step(m, p->amplitude, measured);
        return;
    }
    missing = d * (m->goal - measured) - d * gain * (p->middle - m->voltage);
    full = mover_size(&m->table, p->amplitude, m->direction);
    if (missing < fmin(m->close * (p->most - p->middle) * gain, 0.5 * full)) {
        m->close = MOVER_CLOSE;
        mover_enter(m, MOVER_WAIT);
        return;
    }
    mover_take_step(m, missing >= full ? p->amplitude : mover_voltage_for(&m->table, missing, m->direction), measured);
}

/* Compute the voltage within a step: it changes slowly by the amplitude, returns at once, and pauses. After the step,
 * count it as lost or learn from it. */
static inline void mover_stepping(mover *m, double measured)
{
    const mover_plan *p = m->plan;
    const double d = (double)m->direction;
    double part, went;
    part = m->count <= p->rise ? (double)m->count / (double)p->rise : mover_left(m, m->count - p->rise);
    m->voltage = m->to + d * m->amplitude * part;
    if (m->count < p->period)
        return;
    m->steps += 1;
    went = d * (measured - m->before);
    if (went < p->share_lost * mover_size(&m->table, m->amplitude, m->direction)) {
        m->lost += 1;
        m->lost_now += 1;
        if (m->lost_now >= MOVER_PATIENCE) {
            m->error = MOVER_LOST;
            return;
        }
    } else {
        m->lost_now = 0;
        if (!m->first) /* the first step of a series is shorter: its bristles were bent in the other direction */
            mover_learn(&m->table, m->amplitude, m->direction, went);
    }
    m->first = false;
    mover_next_step(m, measured);
}

/* Continue after the pause: by the piezo if its range suffices, else by more steps. */
static inline void mover_choose(mover *m, double measured)
{
    if (m->jogging) { /* after steps, the piezo is at an end of its range and cannot hold */
        m->jogging = false;
        m->goal = measured;
        mover_centre(m);
    } else {
        mover_go(m, measured);
    }
}

/* Return true if the target moves so little that the piezo can follow it at once. */
static inline bool mover_follows(const mover *m, double target)
{
    const double moved = (target - m->goal) / m->plan->arrival.gain;
    return fabs(moved) <= m->plan->along && mover_within(m, m->voltage + moved);
}

/* Take new requests: a number of steps, centring of the piezo, or another target. */
static inline void mover_hears(mover *m, double measured, double target)
{
    if (m->steps_wanted != 0) {
        m->jogging = true;
        m->jogs = m->steps_wanted > 0 ? m->steps_wanted : -m->steps_wanted;
        m->direction = m->steps_wanted > 0 ? 1 : -1;
        m->steps_wanted = 0;
        m->settled = false;
        mover_return(m);
    } else if (m->jogging) {
        ; /* a new target waits until the requested steps are made */
    } else if (m->centre_wanted && m->phase == MOVER_HOLD) {
        m->centre_wanted = m->settled = false;
        mover_centre(m);
    } else if (target != m->goal && m->phase == MOVER_HOLD && mover_follows(m, target)) {
        m->goal = target;
    } else if (target != m->goal) {
        m->goal = target;
        m->attempts = 0;
        m->settled = false;
        mover_go(m, measured);
    }
}

/* Decide what an update does, for a measured and a wanted position [m]; `tick` is the number of the update. Return true
 * if the regulator must move to the position `wanted`, and `mover_after` must be given the regulator's voltage. If
 * false, the output is `voltage`. After an `error` the voltage stays. */
MOVER_API bool mover_before(mover *m, double measured, double target, int64_t tick)
{
    const mover_plan *p = m->plan;
    m->tick = tick;
    if (m->error == MOVER_FINE)
        mover_hears(m, measured, target);
    if (m->error != MOVER_FINE)
        return false;
    if (m->phase != MOVER_HOLD)
        m->count += 1;
    switch (m->phase) {
    case MOVER_HOLD:
        m->wanted = m->goal;
        return true;
    case MOVER_SCAN:
        m->wanted = m->before + mover_smooth((double)m->count / (double)p->scanning) * (m->goal - m->before);
        if (m->count >= p->scanning)
            mover_enter(m, MOVER_HOLD);
        return true;
    case MOVER_STEP:
        mover_stepping(m, measured);
        return false;
    case MOVER_RETURN:
        m->voltage = m->from + mover_smooth((double)m->count / (double)p->scanning) * (m->to - m->from);
        if (m->count >= p->scanning)
            mover_next_step(m, measured);
        return false;
    case MOVER_RECENTRE:
        m->voltage = m->to + (m->from - m->to) * mover_left(m, m->count);
        break;
    case MOVER_REST:
    case MOVER_WAIT:
        break;
    }
    if (m->count >= p->pause)
        mover_choose(m, measured);
    return false;
}

/* Take over the regulator's voltage [V]; test whether the position has arrived, and start again if the piezo's range is
 * used up. */
MOVER_API void mover_after(mover *m, double measured, double volts)
{
    const mover_plan *p = m->plan;
    const double given = m->voltage;
    m->voltage = volts;
    if (m->phase != MOVER_HOLD)
        return;
    if (arrival_sees(&m->there, &p->arrival, measured, m->goal, given) && !m->settled) {
        m->settled = true;
        m->settled_at = (double)(m->tick - ARRIVAL_BATCHES * p->arrival.batch + 1) / p->rate;
        m->attempts = 0;
    }
    if (m->there.noise2 > ARRIVAL_NOISY * ARRIVAL_NOISY * p->arrival.tolerance * p->arrival.tolerance)
        m->noisy = true;
    if (m->settled && (double)m->tick / p->rate - m->settled_at >= p->holding)
        m->done = true;
    if (!(p->low < m->voltage && m->voltage < p->high))
        mover_go(m, measured);
}

#endif
