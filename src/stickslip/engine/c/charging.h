/* The voltage at a capacitance behind a lag with a limited current. What Python calls. */
#ifndef STICKSLIP_CHARGING_H
#define STICKSLIP_CHARGING_H

#include "engine.h"

/* What limits the output, and the memory of the limit. */
struct charging_limits {
    real_t tau;                     /* s, of the lag; 0 without one */
    real_t rate, steady_rate;       /* V/s, greatest slopes with the peak and with the steady current */
    real_t steady_square;           /* A^2, the square of the steady current */
    real_t memory;                  /* s, in which the mean square forgets; infinite: the peak lasts for ever */
    real_t farad;                   /* F */
};

/* A target in lines, and the output that follows it. Arrays belong to the caller. */
struct stickslip_charging {
    struct charging_limits limits;
    int64_t count;                  /* of lines */
    const real_t *bounds;           /* [count + 1], s, where lines start, and the end */
    const real_t *values, *slopes;  /* [count], V at the start of each line, V/s */
    real_t tolerance;               /* V, of the lines between the points */
    real_t *state;                  /* [3], V; A^2, the mean square of the current; 1 while the steady current limits.
                                     * Becomes the state at the end */
    int64_t room;
    real_t *times, *volts;          /* [room], points to be joined by lines; those without room are left out */
};

/* Charges the capacitance. Returns how many points there are. */
STICKSLIP_API int64_t stickslip_charge(const struct stickslip_charging *of);

#endif
