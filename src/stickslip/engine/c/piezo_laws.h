/* The equations of the piezo's models in C.
 * Generated from the Python functions that are named below by `make laws`; do not edit. */
#ifndef STICKSLIP_PIEZO_LAWS_H
#define STICKSLIP_PIEZO_LAWS_H

#include <stddef.h>

#include "law.h"

typedef struct {
    real_t i0;
    real_t i1;
    real_t i2;
    real_t i3;
} ss_weights_result;

/* stickslip.physics.piezo.operators.play: Return the new state of a play of half-width r for the input v, from its state z. */
static inline real_t ss_play(real_t v, real_t r, real_t z)
{
    return r_max(v - r, r_min(v + r, z));
}

/* stickslip.physics.piezo.operators.beyond: Return the excess of the drive value u over the end s of a dead zone. */
static inline real_t ss_beyond(real_t u, real_t s)
{
    return r_max(u - s, R(0.0));
}

/* stickslip.physics.piezo.creep.lag_change: Return the exact change of the state x of a first-order lag over a step in which its input changes linearly. */
static inline real_t ss_lag_change(real_t tau, real_t step, real_t x, real_t before, real_t after)
{
    real_t part = -r_expm1(-step / tau);
    return part * (before - x) + (after - before) * (R(1.0) - part * (tau / step));
}

/* stickslip.simulation.plant.creeping.weights: Return I_0, I_1, I_2 and I_3 for a step of z time constants. */
static inline ss_weights_result ss_weights(real_t z)
{
    real_t first = R(NAN);
    real_t second = R(NAN);
    real_t third = R(NAN);
    if (r_abs(z) > R(1.0)) {
        first = -r_expm1(-z) / z;
        second = (R(1.0) - first) / z;
        third = (R(1.0) - R(2.0) * second) / z;
        return (ss_weights_result){first, second, third, (R(1.0) - R(3.0) * third) / z};
    }
    real_t last = R(0.0);
    real_t term = R(0.25);
    for (int64_t k = 0; k < 18; ++k) {
        last = last + term;
        term = term * (-z / ((real_t)k + R(5.0)));
    }
    third = (R(1.0) - z * last) / R(3.0);
    second = (R(1.0) - z * third) / R(2.0);
    return (ss_weights_result){R(1.0) - z * second, second, third, last};
}

#endif
