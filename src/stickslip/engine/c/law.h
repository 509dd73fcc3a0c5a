/* Interface of a law to the engine: a friction contact, or any other element with scalar states.
 *
 * A law's equation, in the symbols of its paper, is F, dz/dt = rate(p, v, z): sliding velocity v [m/s] of the driving
 * body relative to the driven one, internal state z, force F [N] on the driven body. `p` points to the law's parameters,
 * in the order of the fields of its record in Python.
 *
 * There is one struct law per kind of record, shared by all plants. A composed law (Maxwell slip) is never seen here:
 * Python takes it apart, and each of its elements is a law with one state and a row of parameters of its own.
 *
 * All functions are pure. Those that a law does not have are NULL. */
#ifndef STICKSLIP_LAW_H
#define STICKSLIP_LAW_H

#include "stickslip_real.h"

/* The law's equation. A static law takes its direction of sliding, -1 or 1, as z, and leaves *dz at 0. */
typedef void law_rate_fn(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz);

/* Largest force [N] at rest. Only static laws have it: their contacts come to true rest. */
typedef real_t law_breakaway_fn(const real_t *p);

/* The state, put back inside the bounds that the law sets. */
typedef real_t law_project_fn(const real_t *p, real_t z);

/* The state after a tick of a sampled element, for its input v at that instant. */
typedef real_t law_tick_fn(const real_t *p, real_t v, real_t z);

/* Branches of a law whose rate jumps or kinks where its state meets a curve. A step stays on one branch, smoothly
 * continued, and is cut where it leaves the branch. All three take the speed |v|, its growth d|v|/dt, and z in the
 * direction of sliding. */

/* The branch of a state, 0 to 3. */
typedef int law_choose_fn(const real_t *p, real_t speed, real_t growth, real_t z);

/* The law's equation on a branch. */
typedef void law_branch_rate_fn(const real_t *p, real_t speed, real_t z, int branch, real_t *force, real_t *dz);

/* Negative where a branch has ended. */
typedef real_t law_left_fn(const real_t *p, real_t speed, real_t growth, real_t z, int branch);

#ifndef STICKSLIP_ONE_LAW /* else the kernel of a GPU has defined it, with the functions of one law */
struct law {
    const char *name;          /* of its record in Python */
    int parameters;            /* length of p */
    int smooth;                /* 1: no contact, and no kink at v = 0 (a lag, an amplifier, a controller) */
    int period;                /* of a sampled element: which parameter is the time between ticks [s]; else -1 */
    law_rate_fn *rate;
    law_breakaway_fn *breakaway;
    law_project_fn *project;
    law_tick_fn *tick;
    law_choose_fn *choose;     /* these three together, or none */
    law_branch_rate_fn *branch_rate;
    law_left_fn *left;
};
#endif

#endif
