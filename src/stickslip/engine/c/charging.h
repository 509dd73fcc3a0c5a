/* Voltage at a capacitance behind a first-order lag with a limited current. Equations:
 * `stickslip/physics/electronics/charging.py`. */
#ifndef STICKSLIP_CHARGING_H
#define STICKSLIP_CHARGING_H

#include "engine.h"

/* Compute the output voltage as points (time, voltage), which lines join. The target is values[k] + slopes[k] (t -
 * bounds[k]) from bounds[k] to bounds[k + 1], k < pieces. `limits` has the fields of ChargingLimits in Python, in their
 * order. `state` [3] has the output [V], the mean square of the current [A^2], and 1 while the limit of the steady
 * current applies; it is updated to the end. `tolerance` [V] is the largest interpolation error. Return the number of
 * points, or -1 if more than `room` are needed. */
STICKSLIP_API int64_t stickslip_charge(const real_t *limits, int64_t pieces, const real_t *bounds, const real_t *values,
                                       const real_t *slopes, real_t *state, real_t tolerance, int64_t room, real_t *times,
                                       real_t *volts);

#endif
