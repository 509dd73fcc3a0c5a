/* From anywhere to a position, and hold it: the state machine of stickslip.control.Mover. `mover_begin` once, at rest;
   then at each update `mover_before`, the regulator if that asks for it, and `mover_after`. SI: V, m (rad). */
#ifndef STICKSLIP_MOVER_H
#define STICKSLIP_MOVER_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define MOVER_PATIENCE 20  /* steps in a row that led nowhere, after which a move is given up */
#define MOVER_ATTEMPTS 20  /* times a move begins again without having been at the target in between */
#define MOVER_CLOSE 0.5    /* how near mid-range the piezo must come by steps, as a share of half of that range */
#define MOVER_CENTRED 0.15 /* the same where it is wanted in the middle */

typedef enum {
    MOVER_REST,
    MOVER_RETURN,   /* the piezo goes, sticking, to where steps begin */
    MOVER_STEP,     /* full steps, the last ones as far as is missing */
    MOVER_WAIT,     /* until they have died away */
    MOVER_RECENTRE, /* the piezo slips to the middle of its range */
    MOVER_SCAN,     /* to the target by the piezo */
    MOVER_HOLD
} mover_phase;

typedef enum {
    MOVER_FINE,
    MOVER_OUT_OF_REACH, /* not reached in MOVER_ATTEMPTS attempts */
    MOVER_LOST          /* MOVER_PATIENCE steps in a row led nowhere: an end stop, or lost steps */
} mover_error;

/* Steps in one direction: a table, and what was learnt since. */
typedef struct {
    const double *sizes;           /* [points], m, from 0 on */
    double factor;                 /* on the table, by least squares */
    double squares, products;      /* m^2: the sums that the factor is from */
} mover_way;

typedef struct {
    int64_t points;
    const double *voltages;        /* [points], V, ascending from 0 */
    double learning;               /* share of what was learnt that each step takes the place of */
    mover_way ways[2];             /* forward, backward */
} mover_table;

typedef struct {
    arrival_plan arrival;          /* the gain of the piezo, too */
    double rate;                   /* Hz, of the updates */
    double low, high, middle;      /* V: the piezo's range */
    double least, most;            /* V: the part of it that is used to hold */
    double start;                  /* V, at rest */
    double amplitude;              /* V, of full steps */
    double share_lost;             /* share of the expected way below which a step is lost */
    double nearby;                 /* m: such targets are tried from mid-range before steps are */
    double along;                  /* V in one update, up to which a moving target is followed without a scan */
    double holding;                /* s at the target, after which the move is done */
    int64_t period, rise;          /* updates of a step, and of its rise */
    int64_t slipping;
    const double *slip;            /* [slipping], what is left of a voltage after its rise */
    int64_t pause, scanning;       /* updates after the last step, and of a scan or a return */
    mover_table table;             /* with what is learnt at the start */
} mover_plan;

typedef struct {
    const mover_plan *plan;
    mover_phase phase;
    int64_t entered;               /* how often a phase began */
    mover_error error;
    double goal, voltage;          /* m, NAN before it was told; V */
    double wanted;                 /* m: where the regulator has to go at this update */
    bool begins;                   /* the regulator has to begin first, at `voltage` and the position `before` */
    int64_t steps, lost;           /* made, and of them those that led nowhere */
    bool settled, done;            /* it was at the target; it stayed there as long as wanted */
    double settled_at;             /* s */
    int64_t steps_wanted;          /* set to make so many full steps, backward below 0, and hold there */
    bool centre_wanted;            /* set to have the piezo in mid-range when it holds, at the same target */
    mover_table table;             /* with what is learnt by now */
    double from, to, amplitude, before, close;
    int64_t tick, count, lost_now, attempts, jogs;
    bool jogging, first;
    arrival there;                 /* what the readings at the target say */
    bool noisy;                    /* the noise is large against the tolerance */
    int direction;                 /* 1 or -1 */
} mover;

/* The distance [m] of a step of an amplitude [V] in a direction, 1 or -1. */
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

/* The amplitude [V] of a step of a distance [m]; the greatest where none goes so far. */
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

/* A step of an amplitude [V] went so far [m] in its direction. */
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

/* From 0 to 1 with the least jerk. */
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

/* The piezo goes to where steps begin. */
static inline void mover_return(mover *m)
{
    m->from = m->voltage;
    m->to = m->direction > 0 ? m->plan->low : m->plan->high;
    mover_enter(m, MOVER_RETURN);
}

/* A step or two, after which the piezo is at the goal in the middle of its range. */
static inline void mover_centre(mover *m)
{
    m->close = MOVER_CENTRED;
    m->direction = m->voltage > m->plan->middle ? 1 : -1;
    mover_return(m);
}

/* What is left of a voltage that slips, after so many updates. */
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

/* With the piezo alone if it reaches, else by steps. */
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
    m->direction = needed > p->middle ? 1 : -1; /* the way that is left when the piezo is in the middle */
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

/* One more step, as far as is missing, or none. */
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

/* A step goes slowly by its amplitude and back at once; then it rests. */
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
        if (!m->first) /* that of a walk goes short: its contact was bent the other way */
            mover_learn(&m->table, m->amplitude, m->direction, went);
    }
    m->first = false;
    mover_next_step(m, measured);
}

/* After the pause: the piezo if it reaches, else more steps. */
static inline void mover_choose(mover *m, double measured)
{
    if (m->jogging) { /* steps end where the piezo has no room to hold */
        m->jogging = false;
        m->goal = measured;
        mover_centre(m);
    } else {
        mover_go(m, measured);
    }
}

/* Whether a target moves so little that the piezo just goes along. */
static inline bool mover_follows(const mover *m, double target)
{
    const double moved = (target - m->goal) / m->plan->arrival.gain;
    return fabs(moved) <= m->plan->along && mover_within(m, m->voltage + moved);
}

/* What is new: steps or the middle of the range that are wanted, or another target. */
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
        ; /* the steps first */
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

/* Decide what an update does, for a measured and a wanted position [m]; `tick` counts the updates. True: the regulator goes
   to the position `wanted`, and `mover_after` is told its voltage. Else the voltage is `voltage`. After an `error` it stays. */
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

/* Take the regulator's voltage [V] over: is it there, and is the range used up? */
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
