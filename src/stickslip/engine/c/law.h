/* Interface of a law to the engine: a friction contact, or any other element with scalar states.
 *
 * A law's equation, in the symbols of its paper, is F, dz/dt = rate(p, v, z): sliding velocity v [m/s] of the driving
 * body relative to the driven one, internal state z, force F [N] on the driven body. `p` points to the law's parameters,
 * in the order of the fields of its record in Python.
 *
 * There is one struct law per kind of record, shared by all plants. Python divides a composed law (Maxwell slip) into
 * its elements; each of these is a law with one state and its own row of parameters.
 *
 * All functions are pure: they have no side effects. Functions that a law does not have are NULL. */
#ifndef STICKSLIP_LAW_H
#define STICKSLIP_LAW_H

#include "stickslip_real.h"

/* The law's equation. A static law is given its direction of sliding, -1 or 1, as z, and leaves *dz at 0. */
typedef void law_rate_fn(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz);

/* Largest force [N] at rest. Only static laws have this function: their contacts come to true rest. */
typedef real_t law_breakaway_fn(const real_t *p);

/* The state, put back within the bounds that the law sets. */
typedef real_t law_project_fn(const real_t *p, real_t z);

/* The state of a sampled element after a tick, given its input v at that time. */
typedef real_t law_tick_fn(const real_t *p, real_t v, real_t z);

/* Branches are for a law whose rate jumps or has a kink where its state meets a curve. A step stays on one branch,
 * which is continued smoothly, and is cut where the state leaves the branch. The functions are given the speed |v|, the
 * state z in the direction of sliding, and (choose and left alone) the growth d|v|/dt. */

/* The branch of a state, from 0 to 3. */
typedef int law_choose_fn(const real_t *p, real_t speed, real_t growth, real_t z);

/* The law's equation on a branch. */
typedef void law_branch_rate_fn(const real_t *p, real_t speed, real_t z, int branch, real_t *force, real_t *dz);

/* A negative number if the state has left the branch. */
typedef real_t law_left_fn(const real_t *p, real_t speed, real_t growth, real_t z, int branch);

#ifndef STICKSLIP_ONE_LAW /* on a GPU, the kernel defines struct law with the functions of one law */
struct law {
    const char *name;          /* name of the law's record in Python */
    int parameters;            /* length of p */
    int smooth;                /* 1: no contact, and without a kink at v = 0 (a lag, an amplifier, a controller) */
    int period;                /* for a sampled element: index of the parameter that is the time between ticks [s]; else
                                * -1 */
    law_rate_fn *rate;
    law_breakaway_fn *breakaway;
    law_project_fn *project;
    law_tick_fn *tick;
    law_choose_fn *choose;     /* the last three functions: all, or all NULL */
    law_branch_rate_fn *branch_rate;
    law_left_fn *left;
};
#endif

#endif
