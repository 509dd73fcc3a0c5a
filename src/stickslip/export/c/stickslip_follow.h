/* The model as a plant of the engine, and one time step of it with the engine's integrator. Only stickslip.c includes
 * this file. */
#ifndef STICKSLIP_FOLLOW_H
#define STICKSLIP_FOLLOW_H

#include <float.h>
#include <stddef.h>

#include "stickslip.h"
#include "stickslip_layout.h"

#define HOT static inline
#define UNROLL
#include "engine/engine.h"

#include "engine/compose.h"
#include "engine/contact.h"
#include "engine/log.h"
#include "engine/reversal.h"

#include "engine/elements.inl"
#include "engine/equations.inl"
#include "engine/system.inl"
#include "engine/kinematics.inl"
#include "engine/step.inl"
#include "engine/starting.inl"
#include "engine/walk.inl"
#include "engine/log.inl"
#include "engine/run.inl"

#ifdef STICKSLIP_FLOAT
#define EPSILON FLT_EPSILON
#else
#define EPSILON DBL_EPSILON
#endif
/* Largest difference of two joined ends of lines, as a multiple of the rounding error. */
#define JOINED R(8.0)

/* Return the number of the stage's modes; a stage that follows the input has none. */
static int stage_modes(const stickslip_plant *plant)
{
    return plant->engine.modes - (plant->mechanism.clamped ? 0 : 1);
}

static bool follows_input(const stickslip_plant *plant)
{
    return plant->mechanism.kinematic;
}

/* ---- The plant -------------------------------------------------------------------------------------------- */

static void fill_stage(const stickslip_model *model, const ss_Mechanism *mech, struct plant *P)
{
    P->mode[P->modes++] =
        (struct mode){mech->stage_stiffness, mech->stage_damping, mech->stage_drive, mech->stage_acceleration};
    (void)model;
#if STICKSLIP_FURTHER
    for (int m = 0; m < STICKSLIP_FURTHER; ++m) {
        const ss_Mode mode = stickslip_further_mode(model, m);
        P->mode[P->modes++] = (struct mode){mode.stiffness, mode.damping, mode.drive, mode.acceleration};
    }
#endif
}

/* Add the contact to a plant. It acts between the stage's modes and the end-effector, which is the last mode. */
static void fill_contact(const stickslip_model *model, const ss_Mechanism *mech, struct plant *P)
{
    struct element *E = &P->element[P->elements++];
    const int last = P->modes - 1;
    (void)model;
    for (int m = 0; m < LARGEST_MODES; ++m) {
        E->velocity[m] = (m < last) ? R(1.0) : (m == last) ? R(-1.0) : R(0.0);
    }
    if (last > 0) {
        E->push[0] = -mech->reaction;
    }
#if STICKSLIP_FURTHER
    for (int m = 1; m < last; ++m) {
        E->push[m] = stickslip_further_push(model, m - 1);
    }
#endif
    E->push[last] = mech->mobility;
    E->felt = E->pushed = ((uint32_t)1 << P->modes) - 1u;
    E->normal = R(1.0);
    E->states = STICKSLIP_STATIC_LAW ? 0 : STICKSLIP_STATES;
    if (mech->kinematic) {
        E->drive_rate = mech->gain;
        E->follows = 1;
    }
}

#if STICKSLIP_TWO_PORT
/* Add the stops of a piezo to a plant, which depend on its input and the stage's first mode
 * (stickslip.simulation.two_port). */
static void fill_stops(const stickslip_model *model, real_t felt, struct plant *P)
{
    struct element *E = &P->element[P->elements++];
    E->velocity[0] = R(STICKSLIP_PER_VOLT) * felt;
    E->push[0] = -model->gain / R(STICKSLIP_PER_VOLT) * model->natural_frequency * model->natural_frequency;
    E->felt = E->pushed = 1u;
    E->normal = R(1.0);
    E->states = STICKSLIP_TWO_PORT;
    E->drive_rate = R(STICKSLIP_PER_VOLT);
    E->follows = 1;
}
#endif

/* Set a plant's pointers to its laws and their numbers, which are not copied with it. */
static void point(const stickslip_plant *from, struct plant *P)
{
    int e = 0;
    if (!from->mechanism.clamped) {
        P->element[e].law = &STICKSLIP_LAW;
        P->element[e++].parameters = &from->contact[0][0];
    }
#if STICKSLIP_TWO_PORT
    if (e < P->elements) {
        P->element[e].law = &STICKSLIP_STOP_LAW;
        P->element[e].parameters = &from->stop[0][0];
    }
#endif
    (void)e;
}

/* Fill the engine's plant from the mechanism and the rows of numbers. Returns false if this code was compiled for
 * another layout. */
static bool fill(const stickslip_model *model, stickslip_plant *made)
{
    const ss_Mechanism *mech = &made->mechanism;
    const struct plant empty = {0};
    struct plant *P = &made->engine;
    *P = empty;
    P->rate = mech->rate;
    if (mech->clamped || !mech->kinematic) {
        fill_stage(model, mech, P);
    }
    if (!mech->clamped) {
        P->mode[P->modes++] = (struct mode){
            mech->slider_stiffness, mech->slider_damping, mech->slider_drive, mech->slider_acceleration};
        fill_contact(model, mech, P);
    }
#if STICKSLIP_TWO_PORT
    if (!made->piezo.hysteresis.charge_drive) {
        fill_stops(model, made->felt, P);
    }
#endif
    if (P->modes != MODES(P) || P->elements != ELEMENTS(P)) {
        return false;
    }
    point(made, P);
    (void)compose(P);
    for (int e = 0; e < P->elements; ++e) {
        P->element[e].law = NULL;
        P->element[e].parameters = NULL;
    }
    return true;
}

/* ---- The state -------------------------------------------------------------------------------------------- */

/* Return the sum of the further modes of the stage: of their positions (row 0) or velocities (row 1). */
static real_t of_further(const stickslip_state *state, int row)
{
    real_t sum = R(0.0);
    (void)state;
    (void)row;
#if STICKSLIP_FURTHER
    for (int m = 0; m < STICKSLIP_FURTHER; ++m) {
        sum += state->further[2 * m + row];
    }
#endif
    return sum;
}

static void pack(const stickslip_plant *plant, const stickslip_state *state, real_t q[ROOM_STATES], struct OF(regime) *on)
{
    const struct plant *P = &plant->engine;
    const int count = stage_modes(plant);
    int c = 0;
    for (int i = 0; i < ROOM_STATES; ++i) {
        q[i] = R(0.0);
        on->branch[i] = 0;
    }
    for (int e = 0; e < ROOM_ELEMENTS; ++e) {
        on->side[e] = state->side[e];
    }
    if (count > 0 && !follows_input(plant)) {
        q[0] = state->stage_position;
        q[1] = state->stage_velocity;
#if STICKSLIP_FURTHER
        for (int i = 0; i < 2 * STICKSLIP_FURTHER; ++i) {
            q[2 + i] = state->further[i];
        }
#endif
    }
    c = 2 * P->modes;
    if (!plant->mechanism.clamped) {
        q[c - 2] = state->end_effector_position;
        q[c - 1] = state->end_effector_velocity;
        for (int i = 0; i < P->element[0].states; ++i) {
            q[c++] = state->internal[i];
        }
    }
#if STICKSLIP_TWO_PORT
    for (int i = 0; i < STICKSLIP_TWO_PORT && c < P->states; ++i) {
        q[c++] = state->stops[i];
    }
#endif
}

/* Add a change to a position or a term of creep, and keep the rounding error in `lost` for the next call (Kahan's
 * compensated sum). */
static void add(real_t *position, real_t *lost, real_t change)
{
    const real_t wanted = change - *lost;
    const real_t sum = *position + wanted;
    *lost = (sum - *position) - wanted;
    *position = sum;
}

/* Update the state from the integrator's result q, whose positions are relative to those of the state. */
static void unpack(const stickslip_plant *plant, const real_t q[ROOM_STATES], const struct OF(regime) *on,
                   stickslip_state *state)
{
    const struct plant *P = &plant->engine;
    int c = 2 * P->modes;
    for (int e = 0; e < ROOM_ELEMENTS; ++e) {
        state->side[e] = on->side[e];
    }
    if (follows_input(plant)) {
        state->stage_position = plant->mechanism.gain * state->drive;
        state->stage_velocity = plant->mechanism.gain * state->slope;
    } else {
        add(&state->stage_position, &state->lost[0], q[0]);
        state->stage_velocity = q[1];
#if STICKSLIP_FURTHER
        for (int m = 0; m < STICKSLIP_FURTHER; ++m) {
            add(&state->further[2 * m], &state->lost[1 + m], q[2 + 2 * m]);
            state->further[2 * m + 1] = q[3 + 2 * m];
        }
#endif
    }
    if (plant->mechanism.clamped) {
        state->end_effector_position = state->stage_position + of_further(state, 0);
        state->end_effector_velocity = state->stage_velocity + of_further(state, 1);
    } else {
        add(&state->end_effector_position, &state->lost[P->modes - 1], q[c - 2]);
        state->end_effector_velocity = q[c - 1];
        for (int i = 0; i < P->element[0].states; ++i) {
            state->internal[i] = q[c++];
        }
    }
#if STICKSLIP_TWO_PORT
    for (int i = 0; i < STICKSLIP_TWO_PORT && c < P->states; ++i) {
        state->stops[i] = q[c++];
    }
#endif
}

/* ---- The step --------------------------------------------------------------------------------------------- */

/* Integrate the motion over one time step in which the drive, after hysteresis and creep of the piezo, changes linearly
 * from `begin` to `end`. Returns bits. */
static int follow(const stickslip_plant *plant, stickslip_state *state, real_t begin, real_t end)
{
    static const int64_t none[3] = {0, 0, 0};
    static const real_t at_once[1] = {R(0.0)}, constant[1][4] = {{R(1.0)}};
    const struct table load = {1, at_once, constant, none, NULL};
    const real_t slope = (end - begin) * plant->per_h;
    const real_t joined = JOINED * (real_t)EPSILON * (r_abs(begin) + r_abs(end));
    const real_t starts[2] = {-plant->h, R(0.0)};
    const real_t lines[2][4] = {{state->drive - state->slope * plant->h, state->slope}, {begin, slope}};
    const struct table drive = {2, starts, lines, none, NULL};
    const bool turns = r_abs(begin - state->drive) > joined || r_abs(slope - state->slope) * plant->h > joined;
    struct plant P = plant->engine;
    struct log unused = {0};
    point(plant, &P);
    struct OF(walk) walk = {.P = &P, .drive = &drive, .load = &load, .h = state->next, .fresh = state->fresh || turns,
                            .local = LOCAL * R(STICKSLIP_TOLERANCE), .max_steps = STICKSLIP_MOST_TRIES, .log = &unused};
    pack(plant, state, walk.q, &walk.on);
    for (int m = 0; m < MODES(&P); ++m) { /* relative positions: otherwise the rounding of small changes would add up */
        P.mode[m].acceleration -= P.mode[m].stiffness * walk.q[2 * m];
        walk.q[2 * m] = R(0.0);
    }
    (void)OF(run)(&walk, plant->h);
    const bool whole = walk.t >= plant->h;
    state->drive = end;
    state->slope = slope;
    state->next = walk.h;
    state->tries = (int)(walk.accepted + walk.rejected);
    state->fresh = walk.fresh || !whole;
    unpack(plant, walk.q, &walk.on, state);
    return whole ? STICKSLIP_OK : STICKSLIP_NOT_FOLLOWED;
}

/* Return the friction force of the stage on the end-effector, N. */
static real_t force_now(const stickslip_plant *plant, const stickslip_state *state)
{
    const ss_Mechanism *mech = &plant->mechanism;
    const real_t u[DERIVATIVES] = {state->drive, state->slope}, normal[DERIVATIVES] = {R(1.0)};
    real_t q[ROOM_STATES], dq[ROOM_STATES] = {R(0.0)}, force[ROOM_ELEMENTS] = {R(0.0)}, acceleration = R(0.0);
    struct OF(regime) on;
    struct plant P = plant->engine;
    point(plant, &P);
    pack(plant, state, q, &on);
    OF(slope)(&P, &on, q, u, normal, dq, force);
    if (!mech->clamped) {
        return force[0];
    }
    for (int m = 0; m < P.modes; ++m) {
        acceleration += dq[2 * m + 1];
    }
    return (acceleration - mech->slider_acceleration) / mech->mobility;
}

#endif
