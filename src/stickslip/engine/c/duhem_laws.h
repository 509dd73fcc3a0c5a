/* Hysteresis of Duhem's form in C.
 * Generated from the Python functions that are named below by `make laws`; do not edit. */
#ifndef STICKSLIP_DUHEM_LAWS_H
#define STICKSLIP_DUHEM_LAWS_H

#include <stddef.h>

#include "piezo.h"

typedef struct {
    real_t alpha;
    real_t beta;
    real_t gamma;
} ss_BoucWen;

/* stickslip.physics.piezo.bouc_wen.decay_of: Return r of dh/du = ? - r h for motion in the direction `up`, on the side of h (at 0, of the motion). */
static inline real_t ss_decay_of(const ss_BoucWen *of, real_t h, real_t up)
{
    real_t side = h == R(0.0) ? up : r_copysign(R(1.0), h);
    return of->beta * up + of->gamma * side;
}

/* stickslip.physics.piezo.bouc_wen.bouc_wen_slope: Return dh/du. */
static inline real_t ss_bouc_wen_slope(const ss_BoucWen *model, real_t u, real_t h, real_t up)
{
    (void)u;
    return model->alpha - ss_decay_of(model, h, up) * h;
}

/* stickslip.physics.piezo.bouc_wen.crossing: Return the drive value between u and the goal at which h becomes 0; the goal if it does not. */
static inline real_t ss_crossing(const ss_BoucWen *model, real_t h, real_t u, real_t goal)
{
    real_t up = goal > u ? R(1.0) : R(-1.0);
    if (h * up >= R(0.0) || model->alpha == R(0.0)) {
        return goal;
    }
    real_t r = ss_decay_of(model, h, up);
    real_t du = r_log1p(-r * h / model->alpha) / r;
    return r_abs(du) < r_abs(goal - u) ? u + du : goal;
}

/* stickslip.physics.piezo.bouc_wen.along_way: Return h after the drive has changed by du, if h does not change its sign. */
static inline real_t ss_along_way(real_t alpha, real_t r, real_t h, real_t du)
{
    real_t x = r * du;
    return h * r_exp(-x) - (x != R(0.0) ? alpha * du * (r_expm1(-x) / x) : R(0.0));
}

/* stickslip.physics.piezo.bouc_wen.bent: Return h after the drive has moved from u to the goal. */
static inline real_t ss_bent(const ss_BoucWen *model, real_t h, real_t u, real_t goal)
{
    if (goal == u) {
        return h;
    }
    real_t up = goal > u ? R(1.0) : R(-1.0);
    real_t at = ss_crossing(model, h, u, goal);
    h = at == goal ? ss_along_way(model->alpha, ss_decay_of(model, h, up), h, at - u) : R(0.0);
    return at == goal ? h : ss_along_way(model->alpha, ss_decay_of(model, R(0.0), up), R(0.0), goal - at);
}

static real_t duhem_slope_BoucWen(const real_t *p, real_t u, real_t h, real_t up)
{
    const ss_BoucWen of = {p[0], p[1], p[2]};
    return ss_bouc_wen_slope(&of, u, h, up);
}

static real_t duhem_way_BoucWen(const real_t *p, real_t h, real_t u, real_t goal)
{
    const ss_BoucWen of = {p[0], p[1], p[2]};
    return ss_bent(&of, h, u, goal);
}

static real_t duhem_corner_BoucWen(const real_t *p, real_t h, real_t u, real_t goal)
{
    const ss_BoucWen of = {p[0], p[1], p[2]};
    return ss_crossing(&of, h, u, goal);
}

static const struct duhem duhem_BoucWen = {
    .name = "BoucWen",
    .parameters = 3,
    .slope = duhem_slope_BoucWen,
    .way = duhem_way_BoucWen,
    .corner = duhem_corner_BoucWen,
};

static const struct duhem *const packaged_duhem[] = {
    &duhem_BoucWen,
};

#endif
