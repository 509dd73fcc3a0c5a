/* Voltage at a capacitance behind a first-order lag with a limited current. Between two breaks the target is a line.
 * The output is then a line (at the current limit), or a line plus an exponential. The equations of both are in
 * `charging_laws.h`. */
#include "charging.h"

#include "charging_laws.h"

#define CHARGE_ROUNDING R(1e-15)

/* Points of the output voltage: `n` points are set in arrays of `room` entries. */
struct points {
    int64_t n, room;
    real_t *times, *volts;
};

/* State of the output: voltage u [V], mean square of the current [A^2], true while the limit of the steady current
 * applies. */
struct charge {
    real_t u, square;
    bool folded;
};

/* Set the point at t, or replace the last point if its time is not earlier. Return false if there is no room. */
static bool put_point(struct points *points, real_t t, real_t volts)
{
    if (t > points->times[points->n - 1]) {
        if (points->n == points->room)
            return false;
        points->times[points->n++] = t;
    }
    points->volts[points->n - 1] = volts;
    return true;
}

/* Set points within a lagged piece of d seconds from t on, without its end. With w = exp(-t/2 tau), steps of dw leave
 * an interpolation error of bend dw^2 / 2, and of bend dw^2 at the end. Return false if there is no room. */
static bool put_curve(const ss_ChargingLimits *of, real_t t, real_t d, real_t target, real_t s, real_t bend, real_t w,
                      real_t tolerance, struct points *points)
{
    int64_t count = r_whole(r_ceil((R(1.0) - w) * r_sqrt(r_abs(bend) / tolerance)));
    for (int64_t j = 1; j < count; j++) {
        real_t root = R(1.0) - (real_t)j * (R(1.0) - w) / (real_t)count, later = R(-2.0) * of->tau * r_log(root);
        if (later < d && t + later > points->times[points->n - 1]
            && !put_point(points, t + later, target + s * (later - of->tau) - bend * root * root))
            return false;
    }
    return true;
}

/* Follow a target that starts at `value` with the slope s, from t to `end`. Return false if there is no room. */
static bool follow_line(const ss_ChargingLimits *of, real_t t, real_t end, real_t value, real_t s, real_t least,
                        real_t tolerance, struct charge *now, struct points *points)
{
    real_t begin = t;
    while (t < end) {
        real_t rate = now->folded ? of->steady_rate : of->rate;
        real_t target = value + s * (t - begin), gap = target - now->u;
        real_t side = gap > R(0.0) || (gap == R(0.0) && s > R(0.0)) ? R(1.0) : R(-1.0);
        real_t over = r_abs(gap) - (of->tau > R(0.0) ? rate * of->tau : R(0.0));
        real_t slack = R(1e-9) * tolerance + R(1e3) * CHARGE_ROUNDING * (r_abs(target) + r_abs(now->u));
        real_t lasts;
        bool to_end;
        if (over > slack || (over > -slack && side * s > rate)) {
            const ss_ramped_result made = ss_ramped(of, end - t, over, side, s, rate, now->square, now->folded, least);
            lasts = made.lasts;
            to_end = made.to_end > R(0.0);
            *now = (struct charge){now->u + side * rate * lasts, made.square, made.folded > R(0.0)};
        } else {
            const ss_lagged_result made = ss_lagged(of, end - t, gap, s, rate, now->square, now->folded, least);
            lasts = made.lasts;
            to_end = made.to_end > R(0.0);
            real_t bend = gap - s * of->tau, w = of->tau > R(0.0) ? r_exp(R(-0.5) * lasts / of->tau) : R(0.0);
            if (!put_curve(of, t, lasts, target, s, bend, w, tolerance, points))
                return false;
            *now = (struct charge){target + s * (lasts - of->tau) - bend * w * w, made.square, made.folded > R(0.0)};
        }
        t = to_end ? end : r_min(t + lasts, end);
        if (!put_point(points, t, now->u))
            return false;
    }
    return true;
}

STICKSLIP_API int64_t stickslip_charge(const real_t *limits, int64_t pieces, const real_t *bounds, const real_t *values,
                                       const real_t *slopes, real_t *state, real_t tolerance, int64_t room, real_t *times,
                                       real_t *volts)
{
    const ss_ChargingLimits of = {limits[0], limits[1], limits[2], limits[3], limits[4], limits[5]};
    struct points points = {1, room, times, volts};
    struct charge now = {state[0], state[1], state[2] > R(0.0)};
    real_t least = CHARGE_ROUNDING * bounds[pieces]; /* shortest piece, s, so that time always advances */
    times[0] = bounds[0];
    volts[0] = now.u;
    for (int64_t k = 0; k < pieces; k++)
        if (!follow_line(&of, bounds[k], bounds[k + 1], values[k], slopes[k], least, tolerance, &now, &points))
            return -1;
    state[0] = now.u;
    state[1] = now.square;
    state[2] = now.folded ? R(1.0) : R(0.0);
    return points.n;
}
