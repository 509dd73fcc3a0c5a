/* From anywhere to a position, and hold it: the state machine of stickslip.control.Mover, with the same
   operations in the same order. mover_begin once, at rest, then mover_step at each update. SI: V, m (rad). */
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

typedef struct {
    regulator loop;
    mover_phase phase;
    mover_error error;
    double goal, voltage;          /* m, NaN before it was told; V */
    long steps, lost;              /* made, and of them those that led nowhere */
    bool settled, done;            /* it was at the target; it stayed there for MOVER_HOLDING */
    double settled_at;             /* s */
    long steps_wanted;             /* set to make so many full steps, backward below 0, and hold there */
    bool centre_wanted;            /* set to have the piezo in mid-range when it holds, at the same target */
    double learnt[2][3];           /* forward, backward: factor on the table, and the sums that it is from */
    double from, to, amplitude, before, close;
    long count, lost_now, attempts, jogs;
    bool jogging, first;
    arrival there;                 /* what the readings at the target say */
    bool noisy;                    /* the noise is large against the tolerance */
    int direction;                 /* 1 or -1 */
} mover;

static inline void mover_begin(mover *m)
{
    int way, k;
    regulator_begin(&m->loop, 0.0, 0.0);
    m->phase = MOVER_REST;
    m->error = MOVER_FINE;
    m->goal = NAN;
    m->voltage = m->from = m->to = MOVER_START;
    m->steps = m->lost = m->steps_wanted = m->jogs = 0;
    m->settled = m->done = m->centre_wanted = m->jogging = false;
    m->settled_at = m->before = 0.0;
    m->amplitude = MOVER_AMPLITUDE;
    m->close = MOVER_CLOSE;
    m->count = m->lost_now = m->attempts = 0;
    m->there.offset = m->there.doubt2 = m->there.noise2 = NAN;
    m->noisy = false;
    arrival_begin(&m->there);
    m->first = true;
    m->direction = 1;
    for (way = 0; way < 2; ++way)
        for (k = 0; k < 3; ++k)
            m->learnt[way][k] = mover_learnt[way][k];
}

/* The distance [m] of a step of an amplitude [V]. */
static inline double mover_size(const mover *m, double volts)
{
    const int way = m->direction > 0 ? 0 : 1;
    const double *x = mover_voltages, *y = mover_steps[way];
    double found;
    int k = MOVER_POINTS - 1;
    if (volts >= x[k]) {
        found = y[k];
    } else if (volts < x[0]) {
        found = y[0];
    } else {
        while (volts < x[k])
            --k;
        found = volts == x[k] ? y[k] : (y[k + 1] - y[k]) / (x[k + 1] - x[k]) * (volts - x[k]) + y[k];
    }
    return m->learnt[way][0] * found;
}

/* The amplitude [V] of a step of a distance [m]; the greatest where none goes so far. */
static inline double mover_voltage_for(const mover *m, double distance)
{
    const int way = m->direction > 0 ? 0 : 1;
    const double *x = mover_voltages + 1, *y = mover_steps[way] + 1;
    const double wanted = distance / m->learnt[way][0];
    double rise, share;
    int k = 0;
    while (k < MOVER_POINTS - 1 && y[k] < wanted)
        ++k;
    if (k == 0)
        k = 1;
    if (k == MOVER_POINTS - 1)
        return x[k - 1];
    rise = y[k] - y[k - 1];
    share = (wanted - y[k - 1]) / (rise > 1e-300 ? rise : 1e-300);
    share = share > 0.0 ? share : 0.0;
    share = share < 1.0 ? share : 1.0;
    return x[k - 1] + share * (x[k] - x[k - 1]);
}

/* A step of an amplitude [V] went so far [m]. */
static inline void mover_learn(mover *m, double volts, double distance)
{
    double *own = m->learnt[m->direction > 0 ? 0 : 1];
    const double told = mover_size(m, volts) / own[0], kept = 1.0 - MOVER_LEARNING;
    double factor;
    if (!(told > 0.0) || MOVER_LEARNING == 0.0)
        return;
    own[1] = kept * own[1] + told * told;
    own[2] = kept * own[2] + told * distance;
    factor = own[2] / own[1];
    factor = factor > 0.1 ? factor : 0.1;
    own[0] = factor < 10.0 ? factor : 10.0;
}

/* From 0 to 1 with the least jerk. */
static inline double mover_smooth(double share)
{
    const double s = share < 1.0 ? share : 1.0;
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
}

static inline void mover_enter(mover *m, mover_phase phase)
{
    m->phase = phase;
    m->count = 0;
}

/* The piezo goes to where steps begin. */
static inline void mover_return(mover *m)
{
    m->from = m->voltage;
    m->to = m->direction > 0 ? MOVER_LOW : MOVER_HIGH;
    mover_enter(m, MOVER_RETURN);
}

/* A step or two, after which the piezo is at the goal in the middle of its range. */
static inline void mover_centre(mover *m)
{
    m->close = MOVER_CENTRED;
    m->direction = m->voltage > MOVER_MIDDLE ? 1 : -1;
    mover_return(m);
}

/* What is left of a voltage that slips, after so many updates. */
static inline double mover_left(long count)
{
    return count <= MOVER_SLIPPING ? mover_slip[count - 1] : 0.0;
}

static inline bool mover_within(double volts)
{
    return MOVER_LEAST <= volts && volts <= MOVER_MOST;
}

static inline void mover_scan(mover *m, double measured)
{
    m->before = measured;
    arrival_begin(&m->there);
    regulator_begin(&m->loop, m->voltage, measured);
    mover_enter(m, MOVER_SCAN);
}

/* With the piezo alone if it reaches, else by steps. */
static inline void mover_go(mover *m, double measured)
{
    const double needed = m->voltage + (m->goal - measured) / MOVER_GAIN;
    if (mover_within(needed)) {
        mover_scan(m, measured);
        return;
    }
    m->attempts += 1;
    if (m->attempts > MOVER_ATTEMPTS) {
        m->error = MOVER_OUT_OF_REACH;
        return;
    }
    if (m->attempts == 1 && fabs(m->goal - measured) <= MOVER_NEAR) {
        m->from = m->voltage;
        m->to = MOVER_MIDDLE;
        mover_enter(m, MOVER_RECENTRE);
        return;
    }
    m->direction = needed > MOVER_MIDDLE ? 1 : -1;
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
    const double d = (double)m->direction;
    double missing, full, near;
    if (m->jogging) {
        m->jogs -= 1;
        if (m->jogs < 0)
            mover_enter(m, MOVER_WAIT);
        else
            mover_take_step(m, MOVER_AMPLITUDE, measured);
        return;
    }
    missing = d * (m->goal - measured) - d * MOVER_GAIN * (MOVER_MIDDLE - m->voltage);
    full = mover_size(m, MOVER_AMPLITUDE);
    near = m->close * (MOVER_MOST - MOVER_MIDDLE) * MOVER_GAIN;
    if (missing < (near < 0.5 * full ? near : 0.5 * full)) {
        m->close = MOVER_CLOSE;
        mover_enter(m, MOVER_WAIT);
        return;
    }
    mover_take_step(m, missing >= full ? MOVER_AMPLITUDE : mover_voltage_for(m, missing), measured);
}

/* A step goes slowly by its amplitude and back at once; then it rests. */
static inline void mover_stepping(mover *m, double measured)
{
    const double d = (double)m->direction;
    double part, went;
    m->count += 1;
    part = m->count <= MOVER_RISE ? (double)m->count / (double)MOVER_RISE : mover_left(m->count - MOVER_RISE);
    m->voltage = m->to + d * m->amplitude * part;
    if (m->count < MOVER_PERIOD)
        return;
    m->steps += 1;
    went = d * (measured - m->before);
    if (went < MOVER_SHARE_LOST * mover_size(m, m->amplitude)) {
        m->lost += 1;
        m->lost_now += 1;
        if (m->lost_now >= MOVER_PATIENCE) {
            m->error = MOVER_LOST;
            return;
        }
    } else {
        m->lost_now = 0;
        if (!m->first) /* that of a walk goes short: its contact was bent the other way */
            mover_learn(m, m->amplitude, went);
    }
    m->first = false;
    mover_next_step(m, measured);
}

/* After the pause: the piezo if it reaches, else more steps. */
static inline void mover_choose(mover *m, double measured)
{
    if (m->jogging) {
        m->jogging = false;
        m->goal = measured;
        mover_centre(m);
    } else if (mover_within(m->voltage + (m->goal - measured) / MOVER_GAIN)) {
        mover_scan(m, measured);
    } else {
        mover_go(m, measured);
    }
}

/* By the regulator; looks whether it is there, and whether the range is used up. */
static inline void mover_regulated(mover *m, double measured, long tick)
{
    const double given = m->voltage;
    double wanted = m->goal;
    bool there;
    if (m->phase == MOVER_SCAN) {
        m->count += 1;
        wanted = m->before + mover_smooth((double)m->count / (double)MOVER_SCANNING) * (m->goal - m->before);
        if (m->count >= MOVER_SCANNING)
            mover_enter(m, MOVER_HOLD);
    }
    m->voltage = regulator_step(&m->loop, measured, wanted);
    if (m->phase != MOVER_HOLD)
        return;
    there = arrival_sees(&m->there, measured, m->goal, given);
    if (there && !m->settled) {
        m->settled = true;
        m->settled_at = (double)(tick - MOVER_BATCHES * MOVER_BATCH + 1) / MOVER_RATE;
        m->attempts = 0;
    }
    if (m->there.noise2 > MOVER_NOISY * MOVER_NOISY * MOVER_TOLERANCE * MOVER_TOLERANCE)
        m->noisy = true;
    if (m->settled && (double)tick / MOVER_RATE - m->settled_at >= MOVER_HOLDING)
        m->done = true;
    if (!(MOVER_LOW < m->voltage && m->voltage < MOVER_HIGH))
        mover_go(m, measured);
}

/* Whether a target moves so little that the piezo just goes along. */
static inline bool mover_follows(const mover *m, double target)
{
    const double moved = (target - m->goal) / MOVER_GAIN;
    return fabs(moved) <= MOVER_ALONG && mover_within(m->voltage + moved);
}

/* The voltage [V] for a measured and a wanted position [m]; `tick` counts the updates. After an `error` it stays. */
static inline double mover_step(mover *m, double measured, double target, long tick)
{
    mover_phase phase;
    if (m->error != MOVER_FINE)
        return m->voltage;
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
    phase = m->phase;
    if (phase == MOVER_HOLD || phase == MOVER_SCAN) {
        mover_regulated(m, measured, tick);
    } else if (phase == MOVER_STEP) {
        mover_stepping(m, measured);
    } else if (phase == MOVER_RETURN) {
        m->count += 1;
        m->voltage = m->from + mover_smooth((double)m->count / (double)MOVER_SCANNING) * (m->to - m->from);
        if (m->count >= MOVER_SCANNING)
            mover_next_step(m, measured);
    } else {
        m->count += 1;
        if (phase == MOVER_RECENTRE)
            m->voltage = m->to + (m->from - m->to) * mover_left(m->count);
        if (m->count >= MOVER_PAUSE)
            mover_choose(m, measured);
    }
    return m->voltage;
}

#endif
