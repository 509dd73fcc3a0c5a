/* Pieces of the voltage at a capacitance in C.
 * Generated from the Python functions that are named below by `make laws`; do not edit. */
#ifndef STICKSLIP_CHARGING_LAWS_H
#define STICKSLIP_CHARGING_LAWS_H

#include <stddef.h>

#include "law.h"

typedef struct {
    real_t tau;
    real_t rate;
    real_t steady_rate;
    real_t steady_square;
    real_t memory;
    real_t farad;
} ss_ChargingLimits;

typedef struct {
    real_t lasts;
    real_t square;
    real_t folded;
    real_t to_end;
} ss_ramped_result;

typedef struct {
    real_t lasts;
    real_t square;
    real_t folded;
    real_t to_end;
} ss_lagged_result;

/* stickslip.physics.electronics.charging._ramped: Return a part of d seconds in which the output is at its slope limit. */
static inline ss_ramped_result ss_ramped(const ss_ChargingLimits *of, real_t d, real_t over, real_t side, real_t s, real_t rate, real_t square, bool folded, real_t least)
{
    real_t now = R(NAN);
    bool folds = false;
    real_t until = R(NAN);
    bool to_end = true;
    real_t closing = rate - side * s;
    if (closing > R(0.0) && over < closing * d) {
        d = r_max(over / closing, least);
        to_end = false;
    }
    if (!r_isinf(of->memory)) {
        now = r_square(of->farad * rate);
        folds = false;
        if (!folded && now > of->steady_square * (R(1.0) + R(1e-12))) {
            until = of->memory * r_log(r_max((now - square) / (now - of->steady_square), R(1.0)));
            if (until < d) {
                d = r_max(until, least);
                folds = true;
                to_end = false;
            }
        }
        square = now + (square - now) * r_exp(-d / of->memory);
        folded = folded || folds;
        if (folded) {
            square = r_min(square, of->steady_square);
        }
    }
    return (ss_ramped_result){d, square, (real_t)folded, (real_t)to_end};
}

/* stickslip.physics.electronics.charging._until_as_fast: Return the time [s] at which the slope of the output reaches `rate` [V/s], below abs(s). */
static inline real_t ss_until_as_fast(real_t tau, real_t rate, real_t s, real_t bend)
{
    return -tau * r_log(tau * (rate - r_abs(s)) / (s > R(0.0) ? bend : -bend));
}

/* stickslip.physics.electronics.charging._remembered: Return the weighted mean of exp(-rate t') over the last t seconds, with exponential weights of this memory time. */
static inline real_t ss_remembered(real_t t, real_t memory, real_t rate)
{
    real_t z = t / memory - rate * t;
    real_t left = r_exp(-t / memory);
    if (r_abs(z) < R(0.001)) {
        return left * t / memory * (R(1.0) + z * (R(0.5) + z / R(6.0)));
    }
    return (r_exp(-rate * t) - left) / (R(1.0) - rate * memory);
}

/* stickslip.physics.electronics.charging._mean_square: Return the mean square of the current t seconds later, for an output with this slope [V/s] and, with tau > 0, an exponential of height `bend` [V] that decays to 0. */
static inline real_t ss_mean_square(const ss_ChargingLimits *of, real_t t, real_t before, real_t slope, real_t bend)
{
    real_t falling = R(NAN);
    real_t steady = of->farad * slope;
    real_t left = r_exp(-t / of->memory);
    real_t found = before * left + steady * steady * (R(1.0) - left);
    if (of->tau > R(0.0)) {
        falling = of->farad * bend / of->tau;
        found = found + R(2.0) * steady * falling * ss_remembered(t, of->memory, R(1.0) / of->tau);
        found = found + falling * falling * ss_remembered(t, of->memory, R(2.0) / of->tau);
    }
    return found;
}

/* stickslip.physics.electronics.charging._lagged: Return a part of d seconds in which the output is below its slope limit; results as `_ramped`. */
static inline ss_lagged_result ss_lagged(const ss_ChargingLimits *of, real_t d, real_t gap, real_t s, real_t rate, real_t square, bool folded, real_t least)
{
    real_t until = R(NAN);
    real_t calm = R(NAN);
    bool above = false;
    real_t after = R(NAN);
    real_t low = R(NAN);
    real_t high = R(NAN);
    bool to_end = true;
    real_t bend = gap - s * of->tau;
    if (r_abs(s) > rate && of->tau > R(0.0)) {
        until = r_max(ss_until_as_fast(of->tau, rate, s, bend), least);
        if (until < d) {
            d = until;
            to_end = false;
        }
    }
    if (!r_isinf(of->memory)) {
        if (!folded) {
            calm = r_sqrt(of->steady_square) / of->farad;
            above = false;
            if (of->tau > R(0.0)) {
                above = r_abs(gap) >= calm * of->tau * (R(1.0) - R(1e-09));
                if (!above && r_abs(s) > calm) {
                    until = r_max(ss_until_as_fast(of->tau, calm, s, bend), least);
                    if (until < d) {
                        d = until;
                        to_end = false;
                    }
                }
            }
            if (above && d > R(0.03125) * of->memory) {
                d = R(0.03125) * of->memory;
                to_end = false;
            }
        }
        after = ss_mean_square(of, d, square, s, bend);
        if (!folded && after > of->steady_square * (R(1.0) + R(1e-12))) {
            low = R(0.0);
            high = d;
            for (int64_t _ = 0; _ < 60; ++_) {
                d = R(0.5) * (low + high);
                if (ss_mean_square(of, d, square, s, bend) > of->steady_square) {
                    high = d;
                } else {
                    low = d;
                }
            }
            real_t made_1 = r_max(d, least);
            real_t made_2 = of->steady_square;
            d = made_1;
            after = made_2;
            folded = true;
            to_end = false;
        }
        square = after;
        folded = folded && square >= of->steady_square * (R(1.0) - R(1e-09));
    }
    return (ss_lagged_result){d, square, (real_t)folded, (real_t)to_end};
}

#endif
