/* The normal force along the stroke in C.
 * Generated from the Python functions that are named below by `make laws`; do not edit. */
#ifndef STICKSLIP_NORMAL_FORCE_H
#define STICKSLIP_NORMAL_FORCE_H

#include <stddef.h>

#include "law.h"

typedef struct {
    real_t slope;
    real_t power;
    real_t ripple;
    real_t wavelength;
    real_t phase;
    real_t origin;
    real_t stiffness_exponent;
    real_t asymmetry;
} ss_NormalForce;

typedef struct {
    real_t share;
    real_t steep;
    real_t curved;
} ss_along_result;

/* stickslip.friction.normal_force.along: Return p(x), the ratio p'/p [1/m] and its derivative [1/m^2] at the position x [m]; NaN where the contact has lifted off. */
static inline ss_along_result ss_along(const ss_NormalForce *force, real_t x)
{
    real_t at = force->origin + x;
    real_t base = R(1.0) + force->slope * at;
    if (!(base > R(0.0))) {
        return (ss_along_result){R(NAN), R(NAN), R(NAN)};
    }
    real_t share = r_pow(base, force->power);
    real_t k = force->power * force->slope / base;
    real_t wave = R(2.0) * R(3.141592653589793) / force->wavelength;
    real_t angle = wave * at + force->phase;
    real_t ripple = force->ripple * r_sin(angle);
    real_t whole = share + ripple;
    if (!(whole > R(0.0))) {
        return (ss_along_result){R(NAN), R(NAN), R(NAN)};
    }
    real_t steepness = (share * k + force->ripple * wave * r_cos(angle)) / whole;
    real_t second = share * k * (force->power - R(1.0)) * force->slope / base - wave * wave * ripple;
    return (ss_along_result){whole, steepness, second / whole - steepness * steepness};
}

/* stickslip.friction.normal_force.softening: Return the factor n^(q-1) on the rate of the deflection, for a relative normal force n and the stiffness exponent q. */
static inline real_t ss_softening(const ss_NormalForce *force, real_t n)
{
    real_t q = force->stiffness_exponent;
    return (q != R(1.0) && n > R(0.0)) ? r_pow(n, q - R(1.0)) : R(1.0);
}

/* stickslip.friction.normal_force.kept: Return the factor on the deflection at a jump of the load; `ratio` is the old load divided by the new one. */
static inline real_t ss_kept(const ss_NormalForce *force, real_t ratio)
{
    return ratio < R(1.0) ? ratio : r_pow(ratio, R(1.0) - force->stiffness_exponent);
}

/* stickslip.friction.normal_force.leaning: Return the factor on a friction force f [N] by its direction (asymmetry). */
static inline real_t ss_leaning(const ss_NormalForce *force, real_t f)
{
    return f > R(0.0) ? R(1.0) + force->asymmetry : R(1.0) - force->asymmetry;
}

/* stickslip.friction.normal_force.uniform: Return True if the normal force is the same along the stroke. */
static inline bool ss_uniform(const ss_NormalForce *force)
{
    return force->slope * force->power == R(0.0) && force->ripple == R(0.0);
}

#endif
