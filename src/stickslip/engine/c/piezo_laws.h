/* The equations of the piezo's models in C.
 * Generated from the Python functions that are named below by `make laws`; do not edit. */
#ifndef STICKSLIP_PIEZO_LAWS_H
#define STICKSLIP_PIEZO_LAWS_H

#include <stddef.h>

#include "law.h"

/* stickslip.piezo.operators.play: The state of a play of half-width r for what it sees, v, from the state z. */
static inline real_t ss_play(real_t v, real_t r, real_t z)
{
    return r_max(v - r, r_min(v + r, z));
}

/* stickslip.piezo.operators.beyond: How far the drive value u is beyond the end s of a dead zone. */
static inline real_t ss_beyond(real_t u, real_t s)
{
    return r_max(u - s, R(0.0));
}

#endif
