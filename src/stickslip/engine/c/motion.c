/* Friction law under a given motion: a scalar equation for each element.
 *
 * The velocity is constant between two samples, so the elements are independent. A stiff bristle reaches equilibrium
 * within a small part of an interval. It is integrated by an exponential Rosenbrock pair of order 3(2) with error
 * control [hochbruck2010, "exprb32"]. For a law that is linear in its state at constant velocity, such as LuGre, one
 * step of any length is exact. */
#include "engine.h"
#include "piezo_laws.h"

/* Largest number of steps in one interval between samples; if it is not enough, the integration fails. */
#define MOST_STEPS 100000
/* Fraction of an interval that counts as rounding. */
#define REST R(1e-12)

/* An interval: constant velocity [m/s], duration [s], normal force relative to its reference at both ends. */
struct interval {
    real_t v, duration, before, after;
};

/* The equation of a deflection; the relative normal force grows by `growth` [1/s]. */
struct deflection {
    const struct law *law;
    const real_t *p;
    real_t v, growth;
};

/* Return the rate of the deflection at the normal force n, relative to its reference. Newly loaded contact carries no
 * tangential force, which reduces the mean deflection (see `stickslip/simulation/plant/system.py`). */
static real_t renewed(const struct deflection *of, real_t z, real_t n)
{
    real_t force, dz;
    of->law->rate(of->p, of->v, z, &force, &dz);
    if (of->growth > R(0.0) && n > R(0.0))
        return dz - of->growth / n * z;
    return of->growth > R(0.0) ? R(0.5) * dz : dz; /* limit for n = 0, where contact starts: z = t dz/2 */
}

/* Return the deflection after a step h, and an estimate of its error in `error`. The derivative by z is a difference
 * towards smaller |z|, where no bound is met. The difference is not larger than the tolerance, so that the error stays
 * within the tolerance if the rate jumps and keeps z there. */
static real_t stepped(const struct deflection *of, real_t z, real_t n, real_t h, real_t tolerance, real_t *error)
{
    real_t size = r_abs(z), off = r_min(R(1e-5) * size, r_max(tolerance, R(1e-9) * size)) + R(1e-15);
    real_t in = r_copysign(off, z), rate = renewed(of, z, n);
    real_t slope = (rate - renewed(of, z - in, n)) / in;
    bool renews = of->growth > R(0.0) && n > R(0.0);
    real_t by_time = renews ? r_square(of->growth / n) * z : R(0.0);
    /* phi_1, phi_2 and 2 phi_3 of h times the derivative of the rate by z */
    ss_weights_result phi = ss_weights(-h * slope);
    real_t second = z + h * (phi.i0 * rate + h * phi.i1 * by_time);
    real_t bends = renewed(of, second, n + h * of->growth) - rate - slope * (second - z) - h * by_time;
    real_t correction = h * phi.i2 * bends;
    *error = r_abs(correction);
    return second + correction;
}

/* Move the deflection to the end of the interval. Return false if the law could not be integrated to there. */
static bool advance(const struct law *law, const real_t *p, const struct interval *over, real_t tolerance,
                    const volatile int32_t *stop, real_t *deflection)
{
    struct deflection of = {law, p, over->v, (over->after - over->before) / over->duration};
    real_t left = over->duration, h = left, z = *deflection, n = over->before;
    for (int step = 0; step < MOST_STEPS && (stop == NULL || *stop == 0); step++) {
        real_t error;
        h = r_min(h, left);
        real_t new_z = stepped(&of, z, n, h, tolerance, &error);
        if (!r_isfinite(error)) {
            h *= R(0.2);
            continue;
        }
        if (error <= tolerance) {
            z = law->project != NULL ? law->project(p, new_z) : new_z;
            left -= h;
            n += h * of.growth;
            if (left <= REST * over->duration) {
                *deflection = over->after > R(0.0) ? z : R(0.0);
                return true;
            }
        }
        real_t factor = R(0.9) * r_pow(tolerance / r_max(error, R(1e-300)), R(1.0) / R(3.0));
        h *= r_min(R(5.0), r_max(R(0.2), factor));
    }
    *deflection = z;
    return false;
}

/* Return the force of a static law in an interval, over the normal force. `carried` is the force at rest over the
 * breakaway force, and is updated to the end. At rest, the force stays as it was when the motion stopped, up to the
 * breakaway force. A growing normal force does not change the absolute force; a falling one reduces the force in
 * proportion, like that of a bristle. */
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
        *carried = R(0.0); /* contact that is lost starts again without force */
    return force;
}

/* Fill sample k. Return false if the law could not be integrated to there. */
static bool follow_to(const struct stickslip_motion *of, int64_t k)
{
    int64_t ahead = k > 0 ? k : 1; /* the first sample has the force at the start of the first interval */
    struct interval over = {R(0.0), of->time[ahead] - of->time[ahead - 1], R(1.0), R(1.0)};
    over.v = (of->position[ahead] - of->position[ahead - 1]) / over.duration;
    if (!of->proportional) {
        over.before = of->load[ahead - 1];
        over.after = of->load[ahead];
    }
    real_t total = R(0.0), *row = of->samples + k * (1 + (of->elements > 0 ? of->elements : 1));
    if (of->elements == 0) {
        if (k == 0)
            over.after = over.before; /* the first sample is before the interval, so the load does not change */
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
