/* Laws and normal forces as a step sees them; see `stickslip/friction/law.py` and `normal_force.py`. */
#ifndef STICKSLIP_CONTACT_H
#define STICKSLIP_CONTACT_H

#include "plant.h"

/* Below this speed [m/s] sliding is not resolved: a thousand roundings of a few cm/s. */
#define RESOLVED R(1e-14)

/* One internal state of an element: its law, its row of parameters, the side of v = 0 on which the contact slides (-1 or
 * 1; of a smooth element 0), and the branch of the law on which the state is. */
struct bristle {
    const struct law *law;
    const real_t *p;
    real_t side;
    int branch;
};

/* Output and rate at an input v and a state z, and their slopes. */
struct law_slopes {
    real_t force, force_v, force_z, rate_v, rate_z;
};

static inline const real_t *parameters_of(const struct element *element, int state)
{
    return element->parameters + state * element->law->parameters;
}

/* Force of a static law that slides to a side. */
static inline real_t static_force(const struct law *law, const real_t *p, real_t v, real_t side)
{
    real_t force, none;
    law->rate(p, v, side, &force, &none);
    return force;
}

/* F and dF/dv of a static law that slides to a side, by a difference outwards in v. The difference is small where v is,
 * for the force may fall ever more steeply towards rest (a Stribeck curve with an exponent below 1). */
static inline void static_slope(const struct element *E, real_t v, real_t side, real_t *force, real_t *slope)
{
    real_t speed = r_abs(v), least = R(1e-11);
    real_t dv = R(1e-5) * speed + (speed > RESOLVED ? r_min(least, R(1e-2) * speed) : least);
    *force = static_force(E->law, E->parameters, side * speed, side);
    *slope = side * (static_force(E->law, E->parameters, side * (speed + dv), side) - *force) / dv;
}

/* By how much dz/dt jumps at v = 0, times the speed `beyond` [m/s]. */
static inline real_t reversal_kink(const struct law *law, const real_t *p, real_t z, real_t beyond)
{
    real_t none, forward, backward;
    law->rate(p, beyond, z, &none, &forward);
    law->rate(p, -beyond, z, &none, &backward);
    return r_abs(forward + backward);
}

/* z, put on a bound of the law that it moves towards and is within an error of. Otherwise the steps would shrink before
 * the bound for ever, for the rate jumps there. */
static inline real_t bounded(const struct law *law, const real_t *p, real_t z, real_t towards)
{
    if (law->project == NULL)
        return z;
    real_t ahead = z + towards, bound = law->project(p, ahead);
    return bound != ahead ? bound : law->project(p, z);
}

/* p(x), p'/p [1/m] and the slope of that [1/m^2]; NaN where the contact has lifted off. */
struct share_along {
    real_t share, steep, curved;
};

static inline struct share_along normal_force_at(const struct normal_force *force, real_t x)
{
    const struct share_along nothing = {R(NAN), R(NAN), R(NAN)};
    real_t at = force->origin + x, base = R(1.0) + force->slope * at;
    if (!(base > R(0.0)))
        return nothing;
    real_t share = r_pow(base, force->power), k = force->power * force->slope / base;
    real_t wave = R(2.0 * 3.141592653589793) / force->wavelength, angle = wave * at + force->phase;
    real_t ripple = force->ripple * r_sin(angle), whole = share + ripple;
    if (!(whole > R(0.0)))
        return nothing;
    real_t steep = (share * k + force->ripple * wave * r_cos(angle)) / whole;
    real_t second = share * k * (force->power - R(1.0)) * force->slope / base - wave * wave * ripple;
    return (struct share_along){whole, steep, second / whole - steep * steep};
}

/* n^(q - 1), the factor on the rates of bristles whose stiffness goes with n^q. */
static inline real_t softening(const struct normal_force *force, real_t n)
{
    real_t q = force->stiffness_exponent;
    return q != R(1.0) && n > R(0.0) ? r_pow(n, q - R(1.0)) : R(1.0);
}

/* The factor on a bristle at a jump of the load, which was `ratio` times the new one. */
static inline real_t kept_along(const struct normal_force *force, real_t ratio)
{
    return ratio < R(1.0) ? ratio : r_pow(ratio, R(1.0) - force->stiffness_exponent);
}

/* The factor on a force by its direction. */
static inline real_t leaning(const struct normal_force *force, real_t f)
{
    return f > R(0.0) ? R(1.0) + force->asymmetry : R(1.0) - force->asymmetry;
}

/* Whether the normal force is the same everywhere. */
static inline bool uniform(const struct normal_force *force)
{
    return force->slope * force->power == R(0.0) && force->ripple == R(0.0);
}

#endif
