/* The voltage at a capacitance behind a lag with a limited, and for a time only larger, current.
 *
 * Between two breaks the target is a line, and the output is a line (at the limit) or a line and an exponential, both in
 * closed form, as are the times at which one becomes the other: no time step, no error that builds up. */
#include "charging.h"

#define CHARGING_BELOW R(1e-9)      /* share of the limit of the mean square, by which it must fall until the peak is back */
#define CHARGING_SAME R(1e-12)      /* share of that limit which is rounding */
#define CHARGING_OFTEN R(0.03125)   /* of the memory, after which it is looked whether the limit was reached in between */
#define CHARGING_ROUNDING R(1e-15)  /* share of a time or a voltage which is rounding */
#define CHARGING_BISECTIONS 60      /* of a time, to rounding */

/* What is known at an instant, and what is known of the piece that starts there. */
struct charging_piece {
    real_t square;                  /* A^2, mean square of the current */
    bool folded;                    /* whether the steady current limits */
    real_t duration;                /* s */
    bool to_end;                    /* whether the piece lasts as long as its line */
};

/* The points so far; `last` [s] is the instant of the last one, which has room or not. */
struct charging_points {
    const struct stickslip_charging *of;
    int64_t count;
    real_t last;
};

static void put_point(struct charging_points *points, int64_t k, real_t volts)
{
    if (k < points->of->room) {
        points->of->times[k] = points->last;
        points->of->volts[k] = volts;
    }
}

/* Adds a point, unless time has not moved on since the last one: the `final` point of a piece then replaces that. */
static void add_point(struct charging_points *points, real_t t, real_t volts, bool final)
{
    if (t > points->last) {
        points->last = t;
        put_point(points, points->count++, volts);
    } else if (final) {
        put_point(points, points->count - 1, volts);
    }
}

/* The mean of exp(-rate t'), by now. */
static real_t remembered(real_t t, real_t memory, real_t rate)
{
    real_t z = t / memory - rate * t, left = r_exp(-t / memory);
    if (r_abs(z) < R(1e-3))
        return left * t / memory * (R(1.0) + z * (R(0.5) + z / R(6.0)));
    return (r_exp(-rate * t) - left) / (R(1.0) - rate * memory);
}

/* The mean square of the current t later, of an output with this slope [V/s] and, with a lag, an exponential of height
 * `bend` [V] that falls to 0. */
static real_t mean_square(const struct charging_limits *of, real_t t, real_t before, real_t slope, real_t bend)
{
    real_t steady = of->farad * slope, left = r_exp(-t / of->memory);
    real_t found = before * left + steady * steady * (R(1.0) - left);
    if (of->tau > R(0.0)) {
        real_t falling = of->farad * bend / of->tau;
        found += R(2.0) * steady * falling * remembered(t, of->memory, R(1.0) / of->tau);
        found += falling * falling * remembered(t, of->memory, R(2.0) / of->tau);
    }
    return found;
}

/* How long [s] until an output that starts `bend` [V] from following a slope s [V/s] is as fast as `rate`, below |s|. */
static real_t until_as_fast(real_t tau, real_t rate, real_t s, real_t bend)
{
    return -tau * r_log(tau * (rate - r_abs(s)) / (s > R(0.0) ? bend : -bend));
}

/* Cuts a piece at the limit, whose gap closes by `closing` [V/s] and is `over` [V] until it is not limited any more, and
 * moves its mean square to its end. */
static void ramped(const struct charging_limits *of, real_t over, real_t closing, real_t rate, real_t least,
                   struct charging_piece *piece)
{
    if (closing > R(0.0) && over < closing * piece->duration) {
        piece->duration = r_max(over / closing, least);
        piece->to_end = false;
    }
    if (r_isinf(of->memory))
        return;
    real_t now = r_square(of->farad * rate);
    bool folds = false;
    if (!piece->folded && now > of->steady_square * (R(1.0) + CHARGING_SAME)) {
        real_t ratio = r_max((now - piece->square) / (now - of->steady_square), R(1.0));
        real_t until = of->memory * r_log(ratio);
        if (until < piece->duration) {
            piece->duration = r_max(until, least);
            piece->to_end = false;
            folds = true;
        }
    }
    piece->square = now + (piece->square - now) * r_exp(-piece->duration / of->memory);
    piece->folded = piece->folded || folds;
    if (piece->folded)
        piece->square = r_min(piece->square, of->steady_square);
}

static void cut(struct charging_piece *piece, real_t duration)
{
    if (duration < piece->duration) {
        piece->duration = duration;
        piece->to_end = false;
    }
}

/* Cuts a piece below the limit while the peak current is there, so that no excess of the steady current is passed over:
 * the mean square of a line goes one way, that of an exponential may not. */
static void cut_to_look(const struct charging_limits *of, real_t gap, real_t s, real_t bend, real_t least,
                        struct charging_piece *piece)
{
    real_t calm = r_sqrt(of->steady_square) / of->farad; /* V/s, of the steady current */
    if (!(of->tau > R(0.0)))
        return;
    if (r_abs(gap) >= calm * of->tau * (R(1.0) - CHARGING_BELOW))
        cut(piece, CHARGING_OFTEN * of->memory);
    else if (r_abs(s) > calm)
        cut(piece, r_max(until_as_fast(of->tau, calm, s, bend), least));
}

/* Cuts a piece below the limit, `gap` [V] from its target, where the limit is reached or the current folds back, and moves
 * its mean square to its end. */
static void lagged(const struct charging_limits *of, real_t gap, real_t s, real_t rate, real_t least,
                   struct charging_piece *piece)
{
    real_t bend = gap - s * of->tau;
    if (r_abs(s) > rate && of->tau > R(0.0)) /* it falls behind until the limit is reached */
        cut(piece, r_max(until_as_fast(of->tau, rate, s, bend), least));
    if (r_isinf(of->memory))
        return;
    if (!piece->folded)
        cut_to_look(of, gap, s, bend, least, piece);
    real_t after = mean_square(of, piece->duration, piece->square, s, bend);
    if (!piece->folded && after > of->steady_square * (R(1.0) + CHARGING_SAME)) {
        real_t low = R(0.0), high = piece->duration, middle = high;
        for (int halved = 0; halved < CHARGING_BISECTIONS; halved++) {
            middle = R(0.5) * (low + high);
            if (mean_square(of, middle, piece->square, s, bend) > of->steady_square)
                high = middle;
            else
                low = middle;
        }
        piece->duration = r_max(middle, least);
        piece->folded = true;
        piece->to_end = false;
        after = of->steady_square;
    }
    piece->square = after;
    piece->folded = piece->folded && after >= of->steady_square * (R(1.0) - CHARGING_BELOW);
}

/* Adds the points inside a piece below the limit, from the instant t and its target then, and returns the output at its
 * end. With w = exp(-t / 2 tau) steps dw leave the error bend dw^2 / 2, and bend dw^2 at the end of the exponential. */
static real_t settled(struct charging_points *points, real_t t, real_t target, real_t s, real_t bend, real_t duration)
{
    real_t tau = points->of->limits.tau, w = tau > R(0.0) ? r_exp(R(-0.5) * duration / tau) : R(0.0);
    int64_t parts = r_whole(r_ceil((R(1.0) - w) * r_sqrt(r_abs(bend) / points->of->tolerance)));
    for (int64_t j = 1; j < parts; j++) {
        real_t root = R(1.0) - (real_t)j * (R(1.0) - w) / (real_t)parts, later = R(-2.0) * tau * r_log(root);
        if (later < duration)
            add_point(points, t + later, target + s * (later - tau) - bend * root * root, false);
    }
    return target + s * (duration - tau) - bend * w * w;
}

STICKSLIP_API int64_t stickslip_charge(const struct stickslip_charging *of)
{
    const struct charging_limits *limits = &of->limits;
    real_t u = of->state[0], least = CHARGING_ROUNDING * of->bounds[of->count]; /* s: time goes on */
    struct charging_piece piece = {.square = of->state[1], .folded = of->state[2] > R(0.0)};
    struct charging_points points = {of, 1, of->bounds[0]};
    put_point(&points, 0, u);
    for (int64_t k = 0; k < of->count; k++) {
        real_t s = of->slopes[k], t = of->bounds[k], end = of->bounds[k + 1];
        while (t < end) {
            real_t rate = piece.folded ? limits->steady_rate : limits->rate;
            real_t target = of->values[k] + s * (t - of->bounds[k]), gap = target - u;
            real_t side = gap > R(0.0) || (gap == R(0.0) && s > R(0.0)) ? R(1.0) : R(-1.0);
            real_t over = r_abs(gap) - (limits->tau > R(0.0) ? rate * limits->tau : R(0.0));
            real_t slack = R(1e-9) * of->tolerance + R(1e3) * CHARGING_ROUNDING * (r_abs(target) + r_abs(u));
            piece.duration = end - t;
            piece.to_end = true;
            if (over > slack || (over > -slack && side * s > rate)) {
                ramped(limits, over, rate - side * s, rate, least, &piece);
                u += side * rate * piece.duration;
            } else {
                lagged(limits, gap, s, rate, least, &piece);
                u = settled(&points, t, target, s, gap - s * limits->tau, piece.duration);
            }
            t = piece.to_end ? end : r_min(t + piece.duration, end);
            add_point(&points, t, u, true);
        }
    }
    of->state[0] = u;
    of->state[1] = piece.square;
    of->state[2] = piece.folded ? R(1.0) : R(0.0);
    return points.count;
}
