/* Monotone sections ("ways") of a drive: turning points of a segment, and the times at which it reaches a value. */
#ifndef STICKSLIP_WAYS_H
#define STICKSLIP_WAYS_H

#include "table.h"

/* Number of samples per radian of the fastest harmonic in the search for turning points: 8 / pi. */
#define WAYS_LOOKS R(2.5464790894703255)
/* Relative accuracy of a time. */
#define WAYS_INSTANT R(4e-16)

/* Return u at the time t by the formula of segment i. */
static inline real_t value_at(const struct table *drive, int64_t i, real_t t)
{
    real_t u[DERIVATIVES];
    table_at(drive, i, t, u);
    return u[VALUE];
}

/* Return the end of segment i, at most `end`, and never before the segment's start. */
static inline real_t way_end(const struct table *drive, int64_t i, real_t end)
{
    return table_next_break(drive, i, r_max(end, drive->start[i]));
}

/* Return the time between low and high at which a derivative of segment i has just changed from the sign of `sign`, by
 * bisection. */
static inline real_t changes(const struct table *drive, int64_t i, real_t low, real_t high, real_t sign, int derivative)
{
    real_t u[DERIVATIVES];
    while (high - low > WAYS_INSTANT * (r_abs(high) + r_abs(low))) {
        real_t middle = R(0.5) * (low + high);
        if (middle <= low || middle >= high)
            break;
        table_at(drive, i, middle, u);
        if (u[derivative] * sign > R(0.0))
            low = middle;
        else
            high = middle;
    }
    return high;
}

/* Return the largest angular frequency of the harmonics of segment i within a time from the segment's start. */
static inline real_t fastest_within(const struct table *drive, int64_t i, real_t time)
{
    real_t fastest = R(0.0);
    for (int64_t row = drive->first[i]; row < drive->first[i + 1]; row++)
        fastest = r_max(fastest, r_abs(drive->harmonic[row][1]) + R(2.0) * r_abs(drive->harmonic[row][3]) * time);
    return fastest;
}

/* Return the first time between a and b at which segment i turns; b if it does not. */
static inline real_t turning(const struct table *drive, int64_t i, real_t a, real_t b)
{
    const real_t *c = drive->polynomial[i];
    if (drive->first[i + 1] == drive->first[i] && c[2] == R(0.0) && c[3] == R(0.0))
        return b;
    real_t u[DERIVATIVES];
    int64_t looks = r_whole(r_max(R(8.0), r_ceil(WAYS_LOOKS * fastest_within(drive, i, b - drive->start[i]) * (b - a))));
    real_t step = (b - a) / (real_t)looks;
    table_at(drive, i, a, u);
    real_t left = a, bent = u[CURVATURE], sign = u[SLOPE] != R(0.0) ? u[SLOPE] : bent;
    for (int64_t k = 1; k <= looks; k++) {
        real_t t = k == looks ? b : a + (real_t)k * step;
        table_at(drive, i, t, u);
        if (sign == R(0.0)) {
            sign = u[SLOPE];
        } else if (u[SLOPE] * sign < R(0.0)) {
            return changes(drive, i, left, t, sign, SLOPE);
        } else if (bent * sign < R(0.0) && u[CURVATURE] * sign > R(0.0)) { /* between two samples it may turn twice */
            real_t flattest = changes(drive, i, left, t, bent, CURVATURE), there[DERIVATIVES];
            table_at(drive, i, flattest, there);
            if (there[SLOPE] * sign < R(0.0))
                return changes(drive, i, left, flattest, sign, SLOPE);
        }
        left = t;
        bent = u[CURVATURE];
    }
    return b;
}

/* Return the time between a and b, where segment i is monotone, at which it has the value. */
static inline real_t reached(const struct table *drive, int64_t i, real_t a, real_t b, real_t value)
{
    const real_t *c = drive->polynomial[i];
    if (drive->first[i + 1] == drive->first[i] && c[2] == R(0.0) && c[3] == R(0.0))
        return r_min(r_max(drive->start[i] + (value - c[0]) / c[1], a), b);
    real_t low = a, high = b, t = R(0.5) * (a + b), u[DERIVATIVES];
    bool up = value_at(drive, i, b) > value_at(drive, i, a);
    for (int tries = 0; tries < 100; tries++) {
        table_at(drive, i, t, u);
        if ((u[VALUE] < value) == up)
            low = t;
        else
            high = t;
        real_t newton = u[SLOPE] != R(0.0) ? t - (u[VALUE] - value) / u[SLOPE] : R(INFINITY);
        if (u[VALUE] == value || r_abs(newton - t) <= WAYS_INSTANT * r_abs(t) || high - low <= WAYS_INSTANT * r_abs(high))
            break;
        t = low < newton && newton < high ? newton : R(0.5) * (low + high);
    }
    return t;
}

#endif
