/* The elements of a friction law under a prescribed motion: scalar equations, one element at a time.
 *
 * Between two samples the velocity is constant, so nothing couples the elements, and neither inertia nor a spring makes
 * them stiff: an explicit pair of order 3(2) with error control [bogacki1989] does. */
#include "engine.h"

/* Steps within one interval between samples, after which the law counts as one that cannot be followed. */
#define MOST_STEPS 100000
/* Part of an interval that is rounding. */
#define REST R(1e-12)

/* An interval: constant velocity [m/s], duration [s], normal force over its reference at both ends. */
struct interval {
    real_t v, duration, before, after;
};

/* Rate of the deflection where the normal force n grows by `growth` [1/s]: what is newly loaded carries no tangential
 * force (see `stickslip/plant/system.py`). */
static real_t renewed(const struct law *law, const real_t *p, real_t v, real_t z, real_t n, real_t growth)
{
    real_t force, dz;
    law->rate(p, v, z, &force, &dz);
    if (growth > R(0.0) && n > R(0.0))
        return dz - growth / n * z;
    return growth > R(0.0) ? R(0.5) * dz : dz; /* the limit at contact that begins: z = t dz/2 */
}

/* Moves the deflection to the end of the interval. Returns whether the law could be followed to there. */
static bool advance(const struct law *law, const real_t *p, const struct interval *over, real_t tolerance,
                    const volatile int32_t *stop, real_t *deflection)
{
    real_t v = over->v, left = over->duration, h = left, growth = (over->after - over->before) / left;
    real_t z = *deflection, n = over->before, k_1 = renewed(law, p, v, z, n, growth);
    for (int step = 0; step < MOST_STEPS && (stop == NULL || *stop == 0); step++) {
        h = r_min(h, left);
        real_t k_2 = renewed(law, p, v, z + R(0.5) * h * k_1, n + R(0.5) * h * growth, growth);
        real_t k_3 = renewed(law, p, v, z + R(0.75) * h * k_2, n + R(0.75) * h * growth, growth);
        real_t new_z = z + h * (R(2.0) * k_1 + R(3.0) * k_2 + R(4.0) * k_3) / R(9.0);
        real_t k_4 = renewed(law, p, v, new_z, n + h * growth, growth);
        /* Of a bristle that relaxes x times within the step the estimate of the pair is x^2 (x - 1)/48, which is blind
         * at 1; the distance from the midpoint rule, x^2/6, is not. */
        real_t error = r_abs(h * (R(-5.0) * k_1 + R(6.0) * k_2 + R(8.0) * k_3 - R(9.0) * k_4) / R(72.0));
        error = r_max(error, r_abs(new_z - z - h * k_2) / R(8.0));
        if (error <= tolerance) {
            z = law->project != NULL ? law->project(p, new_z) : new_z;
            left -= h;
            n += h * growth;
            if (left <= REST * over->duration) {
                *deflection = over->after > R(0.0) ? z : R(0.0);
                return true;
            }
            k_1 = renewed(law, p, v, z, n, growth);
        }
        real_t factor = R(0.9) * r_pow(tolerance / r_max(error, R(1e-300)), R(1.0) / R(3.0));
        h *= r_min(R(5.0), r_max(R(0.2), factor));
    }
    *deflection = z;
    return false;
}

/* Force of a static law over an interval; in `carried`, what it carries at its end, over its breakaway; both forces over
 * the normal force. At rest the force stays what it was when the motion stopped, as far as rest can hold it, and follows
 * the normal force as that of a bristle does. */
static real_t static_force(const struct law *law, const real_t *p, const struct interval *over, real_t *carried)
{
    real_t limit = law->breakaway(p), force, dz;
    if (over->v != R(0.0)) {
        law->rate(p, over->v, r_copysign(R(1.0), over->v), &force, &dz);
        *carried = limit > R(0.0) ? r_min(r_max(force / limit, R(-1.0)), R(1.0)) : R(0.0);
    } else {
        if (over->after > over->before)
            *carried *= over->before / over->after;
        force = limit * *carried;
    }
    if (!(over->after > R(0.0)))
        *carried = R(0.0); /* contact that is lost is made anew with nothing */
    return force;
}

/* Fills sample k. Returns whether the law could be followed to there. */
static bool follow_to(const struct stickslip_motion *of, int64_t k)
{
    int64_t ahead = k > 0 ? k : 1; /* the first sample shows the force with which the first interval begins */
    struct interval over = {R(0.0), of->time[ahead] - of->time[ahead - 1], R(1.0), R(1.0)};
    over.v = (of->position[ahead] - of->position[ahead - 1]) / over.duration;
    if (!of->proportional) {
        over.before = of->load[ahead - 1];
        over.after = of->load[ahead];
    }
    real_t total = R(0.0), *row = of->samples + k * (1 + (of->elements > 0 ? of->elements : 1));
    if (of->elements == 0) {
        if (k == 0)
            over.after = over.before; /* the first sample is before the interval */
        total = static_force(of->law, of->parameters, &over, of->state);
        row[1] = of->state[0];
    }
    for (int64_t e = 0; e < of->elements; e++) {
        const real_t *p = of->parameters + e * of->law->parameters;
        real_t force, dz;
        if (k > 0 && !advance(of->law, p, &over, of->tolerance, of->stop, &of->state[e]))
            return false;
        of->law->rate(p, over.v, of->state[e], &force, &dz);
        total += force;
        row[1 + e] = of->state[e];
    }
    row[0] = of->load[k] * total;
    return true;
}

STICKSLIP_API int stickslip_follow_motion(const struct stickslip_motion *of, int64_t *reached)
{
    for (*reached = 0; *reached < of->count; ++*reached) {
        if (!follow_to(of, *reached))
            return of->stop != NULL && *of->stop != 0 ? STOPPED : STEP_TOO_SMALL;
    }
    return DONE;
}

STICKSLIP_API int stickslip_compute_forces(const struct stickslip_forces *of)
{
    int64_t width = of->elements > 0 ? of->elements : 1;
    for (int64_t k = 0; k < of->count; k++) {
        if (of->stop != NULL && *of->stop != 0)
            return STOPPED;
        of->force[k] = R(0.0);
        for (int64_t e = 0; e < width; e++) {
            real_t force, dz;
            of->law->rate(of->parameters + e * of->law->parameters, of->velocity[k], of->states[k * width + e], &force, &dz);
            of->force[k] += force;
        }
    }
    return DONE;
}
