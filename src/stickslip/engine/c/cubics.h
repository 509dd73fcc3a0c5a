/* Cubics through values and slopes at both ends. */
#ifndef STICKSLIP_CUBICS_H
#define STICKSLIP_CUBICS_H

#include "piezo.h"

/* A piece of the segment `source` from the time `at` [s] on: from `value` with the slope `rise` to value + change with
 * the slope `fall`. */
struct cubic_piece {
    real_t at;
    int64_t source;
    real_t length, value, rise, change, fall;
};

/* Set row k to the cubic of a piece, or to a straight line if its length is 0. */
static inline void put_cubic(const struct cubics *cubics, int64_t k, const struct cubic_piece *of)
{
    real_t *c = cubics->cubic[k];
    cubics->start[k] = of->at;
    cubics->source[k] = of->source;
    c[0] = of->value;
    c[1] = of->rise;
    c[2] = c[3] = R(0.0);
    if (of->length > R(0.0)) {
        real_t mean = of->change / of->length;
        c[2] = (R(3.0) * mean - R(2.0) * of->rise - of->fall) / of->length;
        c[3] = (of->rise + of->fall - R(2.0) * mean) / (of->length * of->length);
    }
}

#endif
