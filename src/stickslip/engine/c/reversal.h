/* Reversals of a contact within a step: where its sliding speed passes through a value or has an extremum. The speed is
 * a polynomial of degree 4 of the fraction of the step. */
#ifndef STICKSLIP_REVERSAL_H
#define STICKSLIP_REVERSAL_H

#include "plant.h"

/* A root is exact to rounding if its last correction was smaller than this fraction of the step. */
#define ROOT_EXACT RESOLVES(1e-8, 1e-4)
#define ROOT_ITERATIONS 30
/* Number of bisections of half a step in the search for an extremum of the sliding speed. */
#define EXTREMUM_HALVINGS 12

enum { COEFFICIENTS = 5 };

/* Return the sliding speed at the fraction theta of the step; `a` are the coefficients of the polynomial. */
static inline real_t speed_at(real_t theta, const real_t *a)
{
    return a[0] + theta * (a[1] + theta * (a[2] + theta * (a[3] + theta * a[4])));
}

/* Return the derivative of the sliding speed by the fraction of the step. */
static inline real_t rise_at(real_t theta, const real_t *a)
{
    return a[1] + theta * (R(2.0) * a[2] + theta * (R(3.0) * a[3] + theta * R(4.0) * a[4]));
}

/* Return the fraction of the step between `low` and `high` at which the speed in the direction `side` (1 or -1) has
 * fallen to `speed`, by Newton's method within these bounds. */
static inline real_t speed_reached(real_t speed, real_t low, real_t high, real_t side, const real_t *of)
{
    real_t a[COEFFICIENTS], theta = R(0.5) * (low + high);
    for (int k = 0; k < COEFFICIENTS; k++)
        a[k] = of[k] * side;
    a[0] -= speed;
    for (int iteration = 0; iteration < ROOT_ITERATIONS; iteration++) {
        real_t f = speed_at(theta, a), slope = rise_at(theta, a);
        if (f > R(0.0))
            low = theta;
        else
            high = theta;
        real_t correction = slope != R(0.0) ? f / slope : R(2.0);
        theta -= correction;
        if (!(low <= theta && theta <= high))
            theta = R(0.5) * (low + high);
        else if (r_abs(correction) < ROOT_EXACT)
            break;
    }
    return theta;
}

/* Return the fraction of the step at which the derivative of the speed is zero, between fractions at which it has
 * opposite signs. */
static inline real_t extremum(real_t low, real_t high, const real_t *a)
{
    real_t begun = rise_at(low, a);
    for (int k = 0; k < EXTREMUM_HALVINGS; k++) {
        real_t theta = R(0.5) * (low + high);
        if (rise_at(theta, a) * begun > R(0.0))
            low = theta;
        else
            high = theta;
    }
    return R(0.5) * (low + high);
}

/* Return the fraction of the step at which the speed in the direction `side` has a minimum; 1 if there is none. */
static inline real_t least_speed(real_t side, const real_t *a)
{
    bool early = rise_at(R(0.5), a) * side > R(0.0);
    real_t low = early ? R(0.0) : R(0.5), high = early ? R(0.5) : R(1.0);
    if (rise_at(low, a) * side < R(0.0) && rise_at(high, a) * side > R(0.0))
        return extremum(low, high, a);
    return R(1.0);
}

/* Return the fraction of the step at which the speed in the direction `side` has a maximum in the first half of the
 * step; 0 if there is none. */
static inline real_t most_speed(real_t side, const real_t *a)
{
    if (rise_at(R(0.0), a) * side > R(0.0) && rise_at(R(0.5), a) * side < R(0.0))
        return extremum(R(0.0), R(0.5), a);
    return R(0.0);
}

#endif
