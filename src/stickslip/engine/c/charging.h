/* The voltage at a capacitance behind a lag with a limited current (see `stickslip/physics/electronics/charging.py`). */
#ifndef STICKSLIP_CHARGING_H
#define STICKSLIP_CHARGING_H

#include "engine.h"

/* Fills times and voltages, to be joined by lines, for targets values[k] + slopes[k] (t - bounds[k]) from bounds[k] to
 * bounds[k + 1], k < pieces. `limits` are the fields of ChargingLimits in Python, one after the other. `state` [3] is the
 * output [V], the mean square of the current [A^2], and 1 while the steady one limits; it becomes that at the end. Returns
 * the number of points, or -1 if there is no room for them. */
STICKSLIP_API int64_t stickslip_charge(const real_t *limits, int64_t pieces, const real_t *bounds, const real_t *values,
                                       const real_t *slopes, real_t *state, real_t tolerance, int64_t room, real_t *times,
                                       real_t *volts);

#endif
