/* Friction laws as the integrator evaluates them; see `stickslip/friction/law.py`. */
#ifndef STICKSLIP_CONTACT_H
#define STICKSLIP_CONTACT_H

#include "plant.h"

/* Sliding speed [m/s] below which rounding errors dominate: a thousand roundings of some cm/s. */
#define RESOLVED RESOLVES(1e-14, 2e-6)

/* One internal state of an element: its law, its row of parameters, the side of v = 0 on which the contact slides (-1
 * or 1; 0 for a smooth element), and the branch of the law for this state. */
struct bristle {
    const struct law *law;
    const real_t *p;
    real_t side;
    int branch;
};

/* Output and rate of an element's state, and their partial derivatives by the input v and the state z. */
struct law_slopes {
    real_t force, force_v, force_z, rate_v, rate_z;
};

static inline const real_t *parameters_of(const struct element *element, int state)
{
    return element->parameters + state * element->law->parameters;
}

/* Return the force of a static law that slides at v to a side (-1 or 1). */
static inline real_t static_force(const struct law *law, const real_t *p, real_t v, real_t side)
{
    real_t force, none;
    law->rate(p, v, side, &force, &none);
    return force;
}

/* Compute F and dF/dv of a static law that slides to a side, by a difference towards larger speeds. The difference is
 * small for a small v, because the force may fall ever more steeply towards rest (a Stribeck curve with an exponent
 * below 1). */
static inline void static_slope(const struct element *E, real_t v, real_t side, real_t *force, real_t *slope)
{
    real_t speed = r_abs(v), least = RESOLVES(1e-11, 1e-5);
    real_t dv = RESOLVES(1e-5, 1e-3) * speed + (speed > RESOLVED ? r_min(least, R(1e-2) * speed) : least);
    *force = static_force(E->law, E->parameters, side * speed, side);
    *slope = side * (static_force(E->law, E->parameters, side * (speed + dv), side) - *force) / dv;
}

/* Return the jump of the slope of dz/dt at v = 0, times the speed `beyond` [m/s]. */
static inline real_t reversal_kink(const struct law *law, const real_t *p, real_t z, real_t beyond)
{
    real_t none, forward, backward;
    law->rate(p, beyond, z, &none, &forward);
    law->rate(p, -beyond, z, &none, &backward);
    return r_abs(forward + backward);
}

/* Return z, or the law's bound if z moves towards it and is within `towards` of it. Without this, steps before the
 * bound would become shorter and shorter, because the rate jumps at the bound. */
static inline real_t bounded(const struct law *law, const real_t *p, real_t z, real_t towards)
{
    if (law->project == NULL)
        return z;
    real_t ahead = z + towards, bound = law->project(p, ahead);
    return bound != ahead ? bound : law->project(p, z);
}

#endif
