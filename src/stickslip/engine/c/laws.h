/* The friction laws of the package in C.
 * Generated from the Python functions that are named below by `make laws`; do not edit. */
#ifndef STICKSLIP_LAWS_H
#define STICKSLIP_LAWS_H

#include <stddef.h>

#include "law.h"

typedef struct {
    real_t coulomb_force;
} ss_Coulomb;

typedef struct {
    real_t coulomb_force;
    real_t sigma_2;
} ss_CoulombViscous;

typedef struct {
    real_t coulomb_force;
    real_t stiction_force;
    real_t sigma_2;
} ss_StictionCoulombViscous;

typedef struct {
    real_t coulomb_force;
    real_t stiction_force;
    real_t stribeck_velocity;
    real_t sigma_2;
    real_t exponent;
} ss_Stribeck;

typedef struct {
    real_t sigma_0;
    real_t coulomb_force;
    real_t exponent;
} ss_Dahl;

typedef struct {
    real_t sigma_0;
    real_t breakaway_deflection;
    real_t stiction_excess;
    real_t sigma_2;
} ss_ResetIntegrator;

typedef struct {
    real_t sigma_0;
    real_t sigma_1;
    real_t sigma_2;
    real_t coulomb_force;
    real_t stiction_force;
    real_t stribeck_velocity;
    real_t damping_velocity;
} ss_LuGre;

typedef struct {
    real_t sigma_0;
    real_t sigma_1;
    real_t sigma_2;
    real_t coulomb_force;
    real_t stiction_force;
    real_t breakaway_deflection;
    real_t stribeck_velocity;
} ss_Elastoplastic;

typedef struct {
    real_t stiffness;
    real_t strength;
    real_t stiction;
    real_t stribeck_velocity;
    real_t attraction_rate;
    real_t sigma_2;
} ss_MaxwellElement;

typedef struct {
    real_t force;
    real_t dz;
} ss_coulomb_result;

typedef struct {
    real_t force;
    real_t dz;
} ss_coulomb_viscous_result;

typedef struct {
    real_t force;
    real_t dz;
} ss_stiction_coulomb_viscous_result;

typedef struct {
    real_t force;
    real_t dz;
} ss_stribeck_result;

typedef struct {
    real_t force;
    real_t dz;
} ss_dahl_result;

typedef struct {
    real_t force;
    real_t dz;
} ss_reset_integrator_result;

typedef struct {
    real_t force;
    real_t dz;
} ss_rate_of_result;

typedef struct {
    real_t force;
    real_t dz;
} ss_lugre_result;

typedef struct {
    real_t force;
    real_t dz;
} ss_elastoplastic_result;

typedef struct {
    real_t force;
    real_t dz;
} ss_element_rate_result;

typedef struct {
    real_t part_0;
    real_t part_1;
} ss_over_limit_result;

typedef struct {
    real_t force;
    real_t dz;
} ss_element_branch_rate_result;

/* stickslip.friction.coulomb.coulomb */
static inline ss_coulomb_result ss_coulomb(const ss_Coulomb *law, real_t v, real_t z)
{
    (void)v;
    return (ss_coulomb_result){law->coulomb_force * z, R(0.0)};
}

/* stickslip.friction.coulomb.coulomb_breakaway */
static inline real_t ss_coulomb_breakaway(const ss_Coulomb *law)
{
    return law->coulomb_force;
}

/* stickslip.friction.coulomb.coulomb_viscous */
static inline ss_coulomb_viscous_result ss_coulomb_viscous(const ss_CoulombViscous *law, real_t v, real_t z)
{
    return (ss_coulomb_viscous_result){law->coulomb_force * z + law->sigma_2 * v, R(0.0)};
}

/* stickslip.friction.coulomb.coulomb_breakaway */
static inline real_t ss_coulomb_breakaway_(const ss_CoulombViscous *law)
{
    return law->coulomb_force;
}

/* stickslip.friction.stribeck.stiction_coulomb_viscous */
static inline ss_stiction_coulomb_viscous_result ss_stiction_coulomb_viscous(const ss_StictionCoulombViscous *law, real_t v, real_t z)
{
    return (ss_stiction_coulomb_viscous_result){law->coulomb_force * z + law->sigma_2 * v, R(0.0)};
}

/* stickslip.friction.stribeck.stiction */
static inline real_t ss_stiction(const ss_StictionCoulombViscous *law)
{
    return law->stiction_force;
}

/* stickslip.friction.stribeck.stribeck_curve: Return g(v) [N], the magnitude of the steady sliding friction without its viscous part; at least F_C. */
static inline real_t ss_stribeck_curve(real_t v, real_t coulomb_force, real_t stiction_force, real_t stribeck_velocity, real_t exponent)
{
    if (stiction_force <= coulomb_force) {
        return coulomb_force;
    }
    if (v == R(0.0)) {
        return stiction_force;
    }
    real_t ratio = r_abs(v) * (R(1.0) / stribeck_velocity);
    real_t power = exponent == R(2.0) ? ratio * ratio : r_pow(ratio, exponent);
    return coulomb_force + (stiction_force - coulomb_force) * r_exp(-power);
}

/* stickslip.friction.stribeck.stribeck */
static inline ss_stribeck_result ss_stribeck(const ss_Stribeck *law, real_t v, real_t z)
{
    real_t g = ss_stribeck_curve(v, law->coulomb_force, law->stiction_force, law->stribeck_velocity, law->exponent);
    return (ss_stribeck_result){g * z + law->sigma_2 * v, R(0.0)};
}

/* stickslip.friction.stribeck.stiction */
static inline real_t ss_stiction_(const ss_Stribeck *law)
{
    return law->stiction_force;
}

/* stickslip.friction.dahl.dahl */
static inline ss_dahl_result ss_dahl(const ss_Dahl *law, real_t v, real_t z)
{
    real_t force = law->sigma_0 * z;
    if (law->exponent == R(1.0)) {
        return (ss_dahl_result){force, v - r_abs(v) * force / law->coulomb_force};
    }
    real_t left = v > R(0.0) ? R(1.0) - force / law->coulomb_force : R(1.0) + force / law->coulomb_force;
    if (left < R(0.0)) {
        return (ss_dahl_result){force, -v * r_pow(-left, law->exponent)};
    }
    return (ss_dahl_result){force, v * r_pow(left, law->exponent)};
}

/* stickslip.friction.dahl.dahl_bound: Return z within the bound that an exponent below 1 reaches, so that steps on it need not become small. */
static inline real_t ss_dahl_bound(const ss_Dahl *law, real_t z)
{
    if (law->exponent >= R(1.0)) {
        return z;
    }
    real_t bound = law->coulomb_force / law->sigma_0;
    return r_min(r_max(z, -bound), bound);
}

/* stickslip.friction.reset_integrator.reset_integrator */
static inline ss_reset_integrator_result ss_reset_integrator(const ss_ResetIntegrator *law, real_t v, real_t z)
{
    real_t z_0 = law->breakaway_deflection * R(0.999999999999);
    real_t dz = ((v > R(0.0) && z >= z_0) || (v < R(0.0) && z <= -z_0)) ? R(0.0) : v;
    real_t a = r_abs(z) < z_0 ? law->stiction_excess : R(0.0);
    return (ss_reset_integrator_result){(R(1.0) + a) * law->sigma_0 * z + law->sigma_2 * dz, dz};
}

/* stickslip.friction.reset_integrator.reset */
static inline real_t ss_reset(const ss_ResetIntegrator *law, real_t z)
{
    return r_min(r_max(z, -law->breakaway_deflection), law->breakaway_deflection);
}

/* stickslip.friction.reset_integrator.choose */
static inline int64_t ss_choose(const ss_ResetIntegrator *law, real_t speed, real_t growth, real_t z)
{
    (void)speed;
    (void)growth;
    return z >= law->breakaway_deflection * (R(1.0) - R(10.0) * R(1e-08)) ? 1 : 0;
}

/* stickslip.friction.reset_integrator.rate_of */
static inline ss_rate_of_result ss_rate_of(const ss_ResetIntegrator *law, real_t speed, real_t z, int64_t branch)
{
    if (branch == 1) {
        return (ss_rate_of_result){law->sigma_0 * z, speed / R(1e-08) * (R(1.0) - z / law->breakaway_deflection)};
    }
    return (ss_rate_of_result){(R(1.0) + law->stiction_excess) * law->sigma_0 * z + law->sigma_2 * speed, speed};
}

/* stickslip.friction.reset_integrator.left */
static inline real_t ss_left(const ss_ResetIntegrator *law, real_t speed, real_t growth, real_t z, int64_t branch)
{
    (void)speed;
    (void)growth;
    return branch == 0 ? law->breakaway_deflection - z : R(1.0);
}

/* stickslip.friction.lugre.lugre */
static inline ss_lugre_result ss_lugre(const ss_LuGre *law, real_t v, real_t z)
{
    real_t g = ss_stribeck_curve(v, law->coulomb_force, law->stiction_force, law->stribeck_velocity, R(2.0));
    real_t sigma_1 = law->sigma_1;
    if (law->damping_velocity < R(INFINITY)) {
        sigma_1 = sigma_1 * r_exp(-r_square(v * (R(1.0) / law->damping_velocity)));
    }
    real_t dz = v - r_abs(v) * z * (law->sigma_0 / g);
    return (ss_lugre_result){law->sigma_0 * z + sigma_1 * dz + law->sigma_2 * v, dz};
}

/* stickslip.friction.elastoplastic.plastic_share: Return alpha(z, v), from 0 (all motion deflects the bristle) to 1 (as in LuGre) [kang2007, fig. 2.4]. */
static inline real_t ss_plastic_share(real_t v, real_t z, real_t z_ba, real_t z_ss)
{
    real_t deflection = r_abs(z);
    if (deflection <= z_ba || (z > R(0.0) && v <= R(0.0)) || (z < R(0.0) && v >= R(0.0))) {
        return R(0.0);
    }
    if (deflection >= z_ss) {
        return R(1.0);
    }
    return R(0.5) + R(0.5) * r_sin(R(3.141592653589793) * (deflection - R(0.5) * (z_ss + z_ba)) / (z_ss - z_ba));
}

/* stickslip.friction.elastoplastic.elastoplastic */
static inline ss_elastoplastic_result ss_elastoplastic(const ss_Elastoplastic *law, real_t v, real_t z)
{
    real_t g = ss_stribeck_curve(v, law->coulomb_force, law->stiction_force, law->stribeck_velocity, R(2.0));
    real_t z_ss = g / law->sigma_0;
    real_t dz = v - ss_plastic_share(v, z, law->breakaway_deflection, z_ss) * r_abs(v) / z_ss * z;
    return (ss_elastoplastic_result){law->sigma_0 * z + law->sigma_1 * dz + law->sigma_2 * v, dz};
}

/* stickslip.friction.maxwell_slip.element_rate */
static inline ss_element_rate_result ss_element_rate(const ss_MaxwellElement *law, real_t v, real_t z)
{
    real_t strength = ss_stribeck_curve(v, law->strength, law->stiction, law->stribeck_velocity, R(2.0));
    real_t limit = strength / law->stiffness;
    real_t dz = v;
    if (v > R(0.0) && z >= limit * R(0.999999999999)) {
        dz = law->attraction_rate * law->strength / law->stiffness * (R(1.0) - z / limit);
    } else if (v < R(0.0) && z <= -limit * R(0.999999999999)) {
        dz = law->attraction_rate * law->strength / law->stiffness * (R(-1.0) - z / limit);
    }
    return (ss_element_rate_result){law->stiffness * z + law->sigma_2 * v, dz};
}

/* stickslip.friction.maxwell_slip.element_bound */
static inline real_t ss_element_bound(const ss_MaxwellElement *law, real_t z)
{
    real_t limit = law->stiction / law->stiffness;
    return r_min(r_max(z, -limit), limit);
}

/* stickslip.friction.maxwell_slip.over_limit: Return the relative excess of the deflection over the slip deflection, and its growth relative to the speed. Above a growth of 1 the spring cannot follow. */
static inline ss_over_limit_result ss_over_limit(const ss_MaxwellElement *law, real_t speed, real_t growth, real_t z)
{
    real_t fall = R(0.0);
    if (law->stiction != law->strength) {
        fall = (law->stiction - law->strength) * r_exp(-r_square(speed / law->stribeck_velocity));
    }
    real_t slope = R(2.0) * fall / (law->stiffness * r_square(law->stribeck_velocity));
    return (ss_over_limit_result){z * law->stiffness / (law->strength + fall) - R(1.0), -slope * growth};
}

/* stickslip.friction.maxwell_slip.element_choose */
static inline int64_t ss_element_choose(const ss_MaxwellElement *law, real_t speed, real_t growth, real_t z)
{
    real_t over = R(NAN);
    real_t rises = R(NAN);
    bool falls = false;
    int64_t branch = 0;
    if (law->stiction > law->strength) {
        ss_over_limit_result made_1 = ss_over_limit(law, speed, growth, z);
        over = made_1.part_0;
        rises = made_1.part_1;
        falls = growth > R(1e-08) * law->attraction_rate * law->stribeck_velocity;
        if (over > R(1e-08) || (over > R(-0.001) * R(1e-08) && falls)) {
            branch = 2;
        } else if (over >= R(-80.0) * R(1e-08) && rises <= R(1.0)) {
            branch = 1;
        }
    }
    return branch;
}

/* stickslip.friction.maxwell_slip.element_branch_rate */
static inline ss_element_branch_rate_result ss_element_branch_rate(const ss_MaxwellElement *law, real_t speed, real_t z, int64_t branch)
{
    real_t dz = speed;
    if (law->stiction <= law->strength) {
        ss_over_limit_result made_1 = ss_over_limit(law, speed, R(0.0), z);
        if (made_1.part_0 >= R(0.999999999999) - R(1.0)) {
            dz = R(0.0);
        }
    } else if (branch == 1) {
        ss_over_limit_result made_2 = ss_over_limit(law, speed, R(0.0), z);
        dz = -speed * made_2.part_0 / R(1e-08);
    } else if (branch == 2) {
        ss_over_limit_result made_3 = ss_over_limit(law, speed, R(0.0), z);
        dz = -law->attraction_rate * law->strength / law->stiffness * made_3.part_0;
    }
    return (ss_element_branch_rate_result){law->stiffness * z + law->sigma_2 * speed, dz};
}

/* stickslip.friction.maxwell_slip.element_left */
static inline real_t ss_element_left(const ss_MaxwellElement *law, real_t speed, real_t growth, real_t z, int64_t branch)
{
    if (law->stiction <= law->strength) {
        return R(1.0);
    }
    ss_over_limit_result made_1 = ss_over_limit(law, speed, growth, z);
    real_t over = made_1.part_0;
    real_t rises = made_1.part_1;
    if (branch == 0) {
        return R(3.0) * R(1e-08) - over;
    }
    if (branch == 2) {
        return over + R(0.1) * R(1e-08);
    }
    bool falls = growth > R(2.0) * R(1e-08) * law->attraction_rate * law->stribeck_velocity && over > R(0.0);
    return (falls || rises > R(1.001)) ? R(-1.0) : over + R(0.001);
}

static void law_rate_Coulomb(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz)
{
    const ss_Coulomb of = {p[0]};
    const ss_coulomb_result found = ss_coulomb(&of, v, z);
    *force = found.force;
    *dz = found.dz;
}

static real_t law_breakaway_Coulomb(const real_t *p)
{
    const ss_Coulomb of = {p[0]};
    return ss_coulomb_breakaway(&of);
}

static const struct law law_Coulomb = {
    .name = "Coulomb",
    .parameters = 1,
    .smooth = 0,
    .period = -1,
    .rate = law_rate_Coulomb,
    .breakaway = law_breakaway_Coulomb,
    .project = NULL,
    .tick = NULL,
    .choose = NULL,
    .branch_rate = NULL,
    .left = NULL,
};

static void law_rate_CoulombViscous(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz)
{
    const ss_CoulombViscous of = {p[0], p[1]};
    const ss_coulomb_viscous_result found = ss_coulomb_viscous(&of, v, z);
    *force = found.force;
    *dz = found.dz;
}

static real_t law_breakaway_CoulombViscous(const real_t *p)
{
    const ss_CoulombViscous of = {p[0], p[1]};
    return ss_coulomb_breakaway_(&of);
}

static const struct law law_CoulombViscous = {
    .name = "CoulombViscous",
    .parameters = 2,
    .smooth = 0,
    .period = -1,
    .rate = law_rate_CoulombViscous,
    .breakaway = law_breakaway_CoulombViscous,
    .project = NULL,
    .tick = NULL,
    .choose = NULL,
    .branch_rate = NULL,
    .left = NULL,
};

static void law_rate_StictionCoulombViscous(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz)
{
    const ss_StictionCoulombViscous of = {p[0], p[1], p[2]};
    const ss_stiction_coulomb_viscous_result found = ss_stiction_coulomb_viscous(&of, v, z);
    *force = found.force;
    *dz = found.dz;
}

static real_t law_breakaway_StictionCoulombViscous(const real_t *p)
{
    const ss_StictionCoulombViscous of = {p[0], p[1], p[2]};
    return ss_stiction(&of);
}

static const struct law law_StictionCoulombViscous = {
    .name = "StictionCoulombViscous",
    .parameters = 3,
    .smooth = 0,
    .period = -1,
    .rate = law_rate_StictionCoulombViscous,
    .breakaway = law_breakaway_StictionCoulombViscous,
    .project = NULL,
    .tick = NULL,
    .choose = NULL,
    .branch_rate = NULL,
    .left = NULL,
};

static void law_rate_Stribeck(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz)
{
    const ss_Stribeck of = {p[0], p[1], p[2], p[3], p[4]};
    const ss_stribeck_result found = ss_stribeck(&of, v, z);
    *force = found.force;
    *dz = found.dz;
}

static real_t law_breakaway_Stribeck(const real_t *p)
{
    const ss_Stribeck of = {p[0], p[1], p[2], p[3], p[4]};
    return ss_stiction_(&of);
}

static const struct law law_Stribeck = {
    .name = "Stribeck",
    .parameters = 5,
    .smooth = 0,
    .period = -1,
    .rate = law_rate_Stribeck,
    .breakaway = law_breakaway_Stribeck,
    .project = NULL,
    .tick = NULL,
    .choose = NULL,
    .branch_rate = NULL,
    .left = NULL,
};

static void law_rate_Dahl(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz)
{
    const ss_Dahl of = {p[0], p[1], p[2]};
    const ss_dahl_result found = ss_dahl(&of, v, z);
    *force = found.force;
    *dz = found.dz;
}

static real_t law_project_Dahl(const real_t *p, real_t z)
{
    const ss_Dahl of = {p[0], p[1], p[2]};
    return ss_dahl_bound(&of, z);
}

static const struct law law_Dahl = {
    .name = "Dahl",
    .parameters = 3,
    .smooth = 0,
    .period = -1,
    .rate = law_rate_Dahl,
    .breakaway = NULL,
    .project = law_project_Dahl,
    .tick = NULL,
    .choose = NULL,
    .branch_rate = NULL,
    .left = NULL,
};

static void law_rate_ResetIntegrator(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz)
{
    const ss_ResetIntegrator of = {p[0], p[1], p[2], p[3]};
    const ss_reset_integrator_result found = ss_reset_integrator(&of, v, z);
    *force = found.force;
    *dz = found.dz;
}

static real_t law_project_ResetIntegrator(const real_t *p, real_t z)
{
    const ss_ResetIntegrator of = {p[0], p[1], p[2], p[3]};
    return ss_reset(&of, z);
}

static int law_choose_ResetIntegrator(const real_t *p, real_t speed, real_t growth, real_t z)
{
    const ss_ResetIntegrator of = {p[0], p[1], p[2], p[3]};
    return (int)ss_choose(&of, speed, growth, z);
}

static void law_branch_rate_ResetIntegrator(const real_t *p, real_t speed, real_t z, int branch, real_t *force, real_t *dz)
{
    const ss_ResetIntegrator of = {p[0], p[1], p[2], p[3]};
    const ss_rate_of_result found = ss_rate_of(&of, speed, z, branch);
    *force = found.force;
    *dz = found.dz;
}

static real_t law_left_ResetIntegrator(const real_t *p, real_t speed, real_t growth, real_t z, int branch)
{
    const ss_ResetIntegrator of = {p[0], p[1], p[2], p[3]};
    return ss_left(&of, speed, growth, z, branch);
}

static const struct law law_ResetIntegrator = {
    .name = "ResetIntegrator",
    .parameters = 4,
    .smooth = 0,
    .period = -1,
    .rate = law_rate_ResetIntegrator,
    .breakaway = NULL,
    .project = law_project_ResetIntegrator,
    .tick = NULL,
    .choose = law_choose_ResetIntegrator,
    .branch_rate = law_branch_rate_ResetIntegrator,
    .left = law_left_ResetIntegrator,
};

static void law_rate_LuGre(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz)
{
    const ss_LuGre of = {p[0], p[1], p[2], p[3], p[4], p[5], p[6]};
    const ss_lugre_result found = ss_lugre(&of, v, z);
    *force = found.force;
    *dz = found.dz;
}

static const struct law law_LuGre = {
    .name = "LuGre",
    .parameters = 7,
    .smooth = 0,
    .period = -1,
    .rate = law_rate_LuGre,
    .breakaway = NULL,
    .project = NULL,
    .tick = NULL,
    .choose = NULL,
    .branch_rate = NULL,
    .left = NULL,
};

static void law_rate_Elastoplastic(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz)
{
    const ss_Elastoplastic of = {p[0], p[1], p[2], p[3], p[4], p[5], p[6]};
    const ss_elastoplastic_result found = ss_elastoplastic(&of, v, z);
    *force = found.force;
    *dz = found.dz;
}

static const struct law law_Elastoplastic = {
    .name = "Elastoplastic",
    .parameters = 7,
    .smooth = 0,
    .period = -1,
    .rate = law_rate_Elastoplastic,
    .breakaway = NULL,
    .project = NULL,
    .tick = NULL,
    .choose = NULL,
    .branch_rate = NULL,
    .left = NULL,
};

static void law_rate_MaxwellElement(const real_t *p, real_t v, real_t z, real_t *force, real_t *dz)
{
    const ss_MaxwellElement of = {p[0], p[1], p[2], p[3], p[4], p[5]};
    const ss_element_rate_result found = ss_element_rate(&of, v, z);
    *force = found.force;
    *dz = found.dz;
}

static real_t law_project_MaxwellElement(const real_t *p, real_t z)
{
    const ss_MaxwellElement of = {p[0], p[1], p[2], p[3], p[4], p[5]};
    return ss_element_bound(&of, z);
}

static int law_choose_MaxwellElement(const real_t *p, real_t speed, real_t growth, real_t z)
{
    const ss_MaxwellElement of = {p[0], p[1], p[2], p[3], p[4], p[5]};
    return (int)ss_element_choose(&of, speed, growth, z);
}

static void law_branch_rate_MaxwellElement(const real_t *p, real_t speed, real_t z, int branch, real_t *force, real_t *dz)
{
    const ss_MaxwellElement of = {p[0], p[1], p[2], p[3], p[4], p[5]};
    const ss_element_branch_rate_result found = ss_element_branch_rate(&of, speed, z, branch);
    *force = found.force;
    *dz = found.dz;
}

static real_t law_left_MaxwellElement(const real_t *p, real_t speed, real_t growth, real_t z, int branch)
{
    const ss_MaxwellElement of = {p[0], p[1], p[2], p[3], p[4], p[5]};
    return ss_element_left(&of, speed, growth, z, branch);
}

static const struct law law_MaxwellElement = {
    .name = "MaxwellElement",
    .parameters = 6,
    .smooth = 0,
    .period = -1,
    .rate = law_rate_MaxwellElement,
    .breakaway = NULL,
    .project = law_project_MaxwellElement,
    .tick = NULL,
    .choose = law_choose_MaxwellElement,
    .branch_rate = law_branch_rate_MaxwellElement,
    .left = law_left_MaxwellElement,
};

static const struct law *const packaged_law[] = {
    &law_Coulomb,
    &law_CoulombViscous,
    &law_StictionCoulombViscous,
    &law_Stribeck,
    &law_Dahl,
    &law_ResetIntegrator,
    &law_LuGre,
    &law_Elastoplastic,
    &law_MaxwellElement,
};

#endif
