/* Implementation of stickslip.h: the model in fixed time steps. stickslip_follow.h has its equations of motion and calls
 * the engine's integrator. */
#include "stickslip_follow.h"

enum { SUBSTEPS_AT_REST = 60 };

static const double LIMIT = 1e6; /* largest absolute value of an input without limits of its own */
/* Smallest change of the input between two steps that counts as a jump, as a fraction of the contact's breakaway
 * deflection. Joined lines differ by rounding, about 1e-6 of this deflection; a static stage that jumps by less than the
 * limit has an error below a nanometre for one step. */
static const double LEAST_JUMP = 1e-4;

/* ---- The law ---------------------------------------------------------------------------------------------- */

#if !STICKSLIP_STATIC_LAW
typedef struct {
    real_t force, dz;
} contact_rate;

/* Return the friction force (N) of element i of the contact, and the rate of its deflection (m/s), at the sliding
 * velocity v and the deflection z. */
static contact_rate rate_of(const stickslip_plant *plant, int i, real_t v, real_t z)
{
    contact_rate made;
    STICKSLIP_LAW.rate(plant->contact[i], v, z, &made.force, &made.dz);
    return made;
}

/* Return the deflection z of element i, limited to the bounds of the law if it has any. */
static real_t projected(const stickslip_plant *plant, int i, real_t z)
{
    return (STICKSLIP_LAW.project != NULL) ? STICKSLIP_LAW.project(plant->contact[i], z) : z;
}

/* Return the absolute deflection of element i in slow steady sliding towards one side (1 or -1), m. */
static real_t farthest(const stickslip_plant *plant, int i, real_t side)
{
    real_t low = R(0.0), high = R(1.0);
    for (int k = 0; k < SUBSTEPS_AT_REST; ++k) {
        const real_t middle = R(0.5) * (low + high);
        if (side * rate_of(plant, i, side * R(1e-9), side * middle).dz > R(0.0)) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}
#endif

/* Compute the largest friction force of the contact at rest, N, and its stiffness, N/m. */
static void measure_contact(stickslip_plant *made)
{
    made->stiffness = made->holding = R(0.0);
#if STICKSLIP_STATIC_LAW
    made->holding = STICKSLIP_LAW.breakaway(made->contact[0]);
#else
    for (int i = 0; i < STICKSLIP_STATES; ++i) {
        const real_t rest = rate_of(made, i, R(0.0), R(0.0)).force;
        made->stiffness += (rate_of(made, i, R(0.0), R(1e-9)).force - rest) / R(1e-9);
        made->holding += rate_of(made, i, R(1e-9), farthest(made, i, R(1.0))).force;
    }
#endif
}

/* Return the part of the constant external force that the contact carries at rest, N, and store the deflections in the
 * state. All elements have the same deflection, but none more than in slow sliding. */
static real_t held_at_rest(const stickslip_plant *plant, stickslip_state *state)
{
    const real_t wanted = -plant->mechanism.slider_acceleration / plant->mechanism.mobility;
    if (plant->mechanism.clamped || (wanted == R(0.0))) {
        return R(0.0);
    }
#if STICKSLIP_STATIC_LAW
    (void)state;
    return r_copysign(r_min(r_abs(wanted), plant->holding), wanted);
#else
    const real_t side = r_copysign(R(1.0), wanted);
    real_t held = R(0.0), low = R(0.0), high = R(1.0), end[STICKSLIP_STATES];
    for (int i = 0; i < STICKSLIP_STATES; ++i) {
        end[i] = farthest(plant, i, side);
    }
    for (int k = 0; k < SUBSTEPS_AT_REST; ++k) {
        const real_t middle = R(0.5) * (low + high);
        held = R(0.0);
        for (int i = 0; i < STICKSLIP_STATES; ++i) {
            state->internal[i] = side * r_min(middle, end[i]);
            held += rate_of(plant, i, R(0.0), state->internal[i]).force;
        }
        if (side * held < side * wanted) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return held;
#endif
}

/* ---- Hysteresis and creep of the piezo ---------------------------------------------------------------------- */

#if STICKSLIP_PIEZO
#if STICKSLIP_TWO_PORT
/* Return the voltage that the stops of the piezo take from an input, V, with the stage at a position; store their new
 * states in `moved`. */
static real_t after_stops(
    const stickslip_plant *plant, const stickslip_state *state, stickslip_state *moved, real_t input, real_t stage)
{
    const real_t way = R(STICKSLIP_PER_VOLT)
        * ((input - state->input) + plant->felt * (stage - state->stage_position));
    real_t sum = R(0.0);
    if (plant->piezo.hysteresis.charge_drive) {
        return sum;
    }
    for (int i = 0; i < STICKSLIP_TWO_PORT; ++i) {
        real_t force, none;
        moved->stops[i] = STICKSLIP_STOP_LAW.project(plant->stop[i], state->stops[i] + way);
        STICKSLIP_STOP_LAW.rate(plant->stop[i], R(0.0), moved->stops[i], &force, &none);
        sum += force / R(STICKSLIP_PER_VOLT);
    }
    return sum;
}

/* Set the stops and the stage to rest at an input that was reached from 0 V, by bisection: each stop follows up to its
 * width. At the call the stage must be at the position that it has without the stops. */
static void settle_stops(const stickslip_plant *plant, stickslip_state *state, real_t input)
{
    const real_t given = plant->mechanism.stage_drive / plant->mechanism.stage_stiffness;
    const real_t wanted = input + plant->felt * state->stage_position;
    const stickslip_state from = {0};
    real_t low = R(0.0), high = wanted, taken = R(0.0);
    for (int k = 0; k < SUBSTEPS_AT_REST; ++k) {
        const real_t middle = R(0.5) * (low + high);
        taken = after_stops(plant, &from, state, middle, R(0.0));
        if (r_abs(middle + plant->felt * given * taken) < r_abs(wanted)) {
            low = middle;
        } else {
            high = middle;
        }
    }
    state->stage_position -= given * taken;
}
#endif

/* Return the output of the piezo's hysteresis at an input, V; store its new states in `moved`. */
static real_t after_hysteresis(
    const stickslip_plant *plant, const stickslip_state *state, stickslip_state *moved, real_t before, real_t input)
{
    (void)plant;
    (void)state;
    (void)moved;
    (void)before;
#if STICKSLIP_HYSTERESIS
    for (int i = 0; i < STICKSLIP_HYSTERESIS; ++i) {
        moved->hysteresis[i] = state->hysteresis[i];
    }
    return stickslip_hysteresis(&plant->piezo, before, input, moved->hysteresis);
#elif STICKSLIP_TWO_PORT
    return input - after_stops(plant, state, moved, input, state->stage_position);
#else
    return input;
#endif
}

/* Return the output of creep in a state, V. */
static real_t crept(const stickslip_plant *plant, const stickslip_state *state)
{
    real_t sum = R(0.0);
    (void)plant;
    (void)state;
#if STICKSLIP_CREEP
    for (int k = 0; k < STICKSLIP_CREEP; ++k) {
        sum += plant->piezo.creep.shares[k] * state->creep[k];
    }
#endif
    return sum;
}

#if !STICKSLIP_TWO_PORT /* the stops of a two-port depend on the stage, so the integrator moves them */
/* Replace the input at both ends of a step by the outputs of hysteresis and creep, V, and update their states. */
static void through_piezo(const stickslip_plant *plant, stickslip_state *state, real_t *begin, real_t *end)
{
    const real_t from = after_hysteresis(plant, state, state, state->input, *begin);
    const real_t to = after_hysteresis(plant, state, state, *begin, *end);
    *begin = from + crept(plant, state);
#if STICKSLIP_CREEP
    for (int k = 0; k < STICKSLIP_CREEP; ++k) {
        add(&state->creep[k], &state->creep_lost[k],
            stickslip_creep(&plant->piezo, k, plant->h, state->creep[k], from, to));
    }
#endif
    *end = to + crept(plant, state);
}
#endif
#endif

/* ---- Public ----------------------------------------------------------------------------------------------- */

/* Return true if all numbers of the plant are finite. */
static bool is_finite(const stickslip_plant *plant)
{
    const struct plant *P = &plant->engine;
    real_t sum = P->rate + plant->per_h + plant->holding;
    for (int m = 0; m < P->modes; ++m) {
        sum += r_abs(P->mode[m].stiffness) + r_abs(P->mode[m].damping) + r_abs(P->mode[m].drive)
            + r_abs(P->mode[m].acceleration);
        for (int e = 0; e < P->elements; ++e) {
            sum += r_abs(P->element[e].push[m]) + r_abs(P->element[e].velocity[m]);
        }
    }
    return r_isfinite(sum);
}

const char *stickslip_init(stickslip_plant *plant, const stickslip_parameters *parameters, double h)
{
    const char *wrong = stickslip_check(&parameters->model, &parameters->chain);
    stickslip_plant made;
    if (wrong != NULL) {
        return wrong;
    }
    if (!((h >= 1e-9) && (h <= 1.0))) {
        return "the step h [s] is out of range: it must be >= 1e-9 and <= 1";
    }
#if STICKSLIP_LATE
    if (!((parameters->chain.sensor.delay >= R(0.0)) &&
          ((double)parameters->chain.sensor.delay <= STICKSLIP_LATE_SPACING * (STICKSLIP_LATE - 2) * (1.0 + 1e-6)))) {
        return "the channel's delay is longer than what is kept of the past: export with this delay";
    }
#endif
    made.mechanism = ss_mechanism(&parameters->model);
    made.chain = parameters->chain;
#if STICKSLIP_PIEZO
    made.piezo = parameters->model.piezo;
#endif
#if STICKSLIP_TWO_PORT
    stickslip_stops(&made.piezo.hysteresis, made.stop);
    made.felt = stickslip_felt(&parameters->model);
    if (made.piezo.hysteresis.charge_drive) { /* at constant charge the piezo is stiffer */
        const real_t stiffer = R(1.0) + parameters->model.gain * made.felt;
        made.mechanism.stage_stiffness *= stiffer;
        made.mechanism.stage_drive *= stiffer;
    }
#endif
    for (int i = 0; i < STICKSLIP_STATES; ++i) {
        stickslip_law_row(&parameters->model.friction, i, made.contact[i]);
    }
    for (int i = 0; i < STICKSLIP_GAINS; ++i) {
        made.observer_gain[i] = parameters->observer_gain[i];
    }
    made.low = r_max(stickslip_input_low(&parameters->model), R(-LIMIT));
    made.high = r_min(stickslip_input_high(&parameters->model), R(LIMIT));
#if STICKSLIP_HAS_AMPLIFIER
    made.low = r_max(made.low, made.chain.amplifier.low);
    made.high = r_min(made.high, made.chain.amplifier.high);
#endif
    made.h = (real_t)h;
    made.per_h = (real_t)(1.0 / h);
    measure_contact(&made);
    if (!fill(&parameters->model, &made)) {
        return "these parameters change what moves (a stage with or without dynamics, a clamped end-effector, a drive by "
               "charge), and the code is for what was exported: compile it with -DSTICKSLIP_ANY_LAYOUT=1";
    }
    if (!is_finite(&made)) {
        return "the step is too short, or the parameters are too extreme, for the numbers of this machine";
    }
    *plant = made;
    return NULL;
}

/* Limit an input to its limits, or replace it by the previous one if it is not finite. Returns bits. */
static int admitted(const stickslip_plant *plant, real_t last, real_t low, real_t high, real_t *input)
{
    (void)plant;
    if (!r_isfinite(*input)) {
        *input = last;
        return STICKSLIP_INPUT_NOT_FINITE;
    }
    if ((*input < low) || (*input > high)) {
        *input = r_min(r_max(*input, low), high);
        return STICKSLIP_INPUT_CLIPPED;
    }
    return STICKSLIP_OK;
}

/* Compute the input at which the actuator settles to a voltage; it is unchanged if the voltage is not finite. Returns
 * bits. */
static int input_for(const stickslip_plant *plant, real_t volts, real_t *input)
{
    const int bits = admitted(plant, R(0.0), plant->low, plant->high, &volts);
    if ((bits & STICKSLIP_INPUT_NOT_FINITE) == 0) {
#if STICKSLIP_HAS_AMPLIFIER
        volts = stickslip_amplifier_input(&plant->chain, volts);
#endif
        *input = volts;
    }
    return bits;
}

void stickslip_rest(const stickslip_plant *plant, stickslip_state *state, real_t input)
{
    const ss_Mechanism *mech = &plant->mechanism;
    const struct plant *P = &plant->engine;
    const stickslip_state empty = {0};
    *state = empty;
    const real_t held = held_at_rest(plant, state);
#if STICKSLIP_HAS_AMPLIFIER
    (void)admitted(plant, R(0.0), R(-LIMIT), R(LIMIT), &input);
    state->asked = input;
    input = stickslip_amplifier_settled(&plant->chain, input);
#endif
    (void)admitted(plant, r_min(r_max(R(0.0), plant->low), plant->high), plant->low, plant->high, &input);
    state->input = input;
#if STICKSLIP_PIEZO /* the input was reached from 0 V, so long ago that creep has ended */
#if !STICKSLIP_TWO_PORT
    input = after_hysteresis(plant, state, state, R(0.0), input);
#endif
#if STICKSLIP_CREEP
    for (int k = 0; k < STICKSLIP_CREEP; ++k) {
        state->creep[k] = input;
    }
#endif
    input += crept(plant, state);
#endif
    state->drive = input;
    state->next = R(INFINITY);
    state->fresh = true;
    if (follows_input(plant)) {
        state->stage_position = mech->gain * input;
    }
    for (int m = 0; m < stage_modes(plant) && !follows_input(plant); ++m) {
        const real_t push = mech->clamped ? R(0.0) : P->element[0].push[m] * held;
        const real_t there = (P->mode[m].drive * input + P->mode[m].acceleration + push) / P->mode[m].stiffness;
        if (m == 0) {
            state->stage_position = there;
        }
#if STICKSLIP_FURTHER
        else {
            state->further[2 * m - 2] = there;
        }
#endif
    }
#if STICKSLIP_TWO_PORT
    settle_stops(plant, state, input);
#endif
    state->end_effector_position = (mech->slider_stiffness > R(0.0))
        ? mech->slider_drive * input / mech->slider_stiffness
        : state->stage_position + of_further(state, 0);
    state->sensor = state->end_effector_position;
#if STICKSLIP_LATE
    state->newest = 0;
    for (int i = 0; i < STICKSLIP_LATE; ++i) {
        state->late[i] = state->end_effector_position;
    }
#endif
}

#if STICKSLIP_LATE
/* Return the end-effector position of a delayed channel after a step in which the position changed by `change`, m. Past
 * positions are stored at equal intervals, whatever the time steps are, and interpolated linearly, also from the newest
 * of them to the present one. */
static real_t seen_late(const stickslip_plant *plant, stickslip_state *state, real_t change)
{
    const real_t spacing = (real_t)STICKSLIP_LATE_SPACING, delay = plant->chain.sensor.delay;
    const real_t now = state->end_effector_position;
    real_t age = r_min(state->age + plant->h, spacing * R(STICKSLIP_LATE)); /* a longer step replaces all of them */
    while (age >= spacing * R(0.999999)) {
        age = r_max(age - spacing, R(0.0));
        state->newest = (state->newest + 1) % STICKSLIP_LATE;
        state->late[state->newest] = now - change * (age * plant->per_h);
    }
    state->age = age;
    if (delay < age) {
        return now + (state->late[state->newest] - now) * (delay / age);
    }
    const real_t steps = (delay - age) / spacing;
    const int whole = (int)steps;
    const real_t part = steps - (real_t)whole;
    const int later = (state->newest - whole + STICKSLIP_LATE) % STICKSLIP_LATE;
    const int earlier = (later - 1 + STICKSLIP_LATE) % STICKSLIP_LATE;
    return state->late[later] + part * (state->late[earlier] - state->late[later]);
}
#endif

int stickslip_step(const stickslip_plant *plant, stickslip_state *state, real_t input)
{
    return stickslip_step_ramp(plant, state, input, input);
}

/* Return true if a jump of the input by `change` makes a static stage, and the bristles of its contact, jump. */
static bool jumps(const stickslip_plant *plant, real_t change)
{
    const real_t force = plant->stiffness * plant->mechanism.gain * change;
    return follows_input(plant) && !plant->mechanism.clamped && (r_abs(force) > R(LEAST_JUMP) * plant->holding);
}

int stickslip_step_ramp(const stickslip_plant *plant, stickslip_state *state, real_t begin, real_t end)
{
    int bits = STICKSLIP_OK;
#if STICKSLIP_LATE
    const real_t before = state->end_effector_position;
#endif
#if STICKSLIP_HAS_AMPLIFIER
    /* The amplifier's input is taken as constant during the step, at the mean of its ends. */
    real_t wanted = R(0.5) * (begin + end);
    bits |= admitted(plant, state->asked, R(-LIMIT), R(LIMIT), &wanted);
    state->asked = wanted;
    begin = state->input;
    end = stickslip_amplifier_after(&plant->chain, wanted, begin, plant->h);
#endif
    bits |= admitted(plant, state->input, plant->low, plant->high, &begin);
    bits |= admitted(plant, begin, plant->low, plant->high, &end);
    bits |= jumps(plant, begin - state->input) ? STICKSLIP_JUMPED : STICKSLIP_OK;

    const real_t last = end;
#if STICKSLIP_PIEZO && !STICKSLIP_TWO_PORT
    through_piezo(plant, state, &begin, &end);
#endif
#if STICKSLIP_TWO_PORT /* the stops of a piezo jump with its voltage */
    (void)after_stops(plant, state, state, begin, state->stage_position);
#endif
    bits |= follow(plant, state, begin, end);
    state->input = last;
#if STICKSLIP_LATE
    state->sensor = seen_late(plant, state, state->end_effector_position - before);
#elif STICKSLIP_HAS_SENSOR
    state->sensor = stickslip_sensor_after(&plant->chain, state->end_effector_position, state->sensor, plant->h);
#else
    state->sensor = state->end_effector_position;
#endif
    return bits;
}

stickslip_outputs stickslip_read(const stickslip_plant *plant, const stickslip_state *state)
{
    stickslip_outputs out;
    out.end_effector_position = state->end_effector_position;
    out.stage_position = state->stage_position + of_further(state, 0);
    out.sliding_displacement = out.stage_position - state->end_effector_position;
    out.friction_force = force_now(plant, state);
    out.drive_voltage = state->input;
    out.stage_velocity = state->stage_velocity + of_further(state, 1);
    out.end_effector_velocity = state->end_effector_velocity;
#if STICKSLIP_HAS_SENSOR
    out.sensor_output = stickslip_sensor_output(&plant->chain, state->sensor);
#else
    out.sensor_output = state->sensor;
#endif
    return out;
}

/* Restart the estimate: at rest at the last input, with the end-effector at the measured position. */
static void begin_again(const stickslip_plant *plant, stickslip_state *state, real_t measured)
{
#if STICKSLIP_HAS_AMPLIFIER
    const real_t last = state->asked;
#else
    const real_t last = state->input;
#endif
    stickslip_rest(plant, state, r_isfinite(last) ? last : R(0.0));
    state->end_effector_position = measured;
    state->sensor = measured;
#if STICKSLIP_LATE
    for (int i = 0; i < STICKSLIP_LATE; ++i) {
        state->late[i] = measured;
    }
#endif
}

int stickslip_correct(const stickslip_plant *plant, stickslip_state *state, real_t measured)
{
    const real_t error = measured - state->end_effector_position;
    const real_t reach = plant->mechanism.gain * (plant->high - plant->low); /* range of the stage's motion */
    if (!r_isfinite(measured)) {
        return STICKSLIP_INPUT_NOT_FINITE;
    }
    if (!r_isfinite(error) || ((reach != R(0.0)) && !(r_abs(error) <= r_abs(reach)))) {
        begin_again(plant, state, measured);
        return STICKSLIP_ESTIMATE_LOST;
    }
    state->stage_position += plant->observer_gain[0] * error;
    state->stage_velocity += plant->observer_gain[1] * error;
    state->end_effector_position += plant->observer_gain[2] * error;
    state->end_effector_velocity += plant->observer_gain[3] * error;
#if STICKSLIP_FURTHER
    for (int i = 0; i < 2 * STICKSLIP_FURTHER; ++i) {
        state->further[i] += plant->observer_gain[5 + i] * error;
    }
#endif
#if !STICKSLIP_STATIC_LAW
    for (int i = 0; i < STICKSLIP_STATES; ++i) {
        state->internal[i] =
            projected(plant, i, state->internal[i] + plant->observer_gain[4] * error);
    }
#endif
    state->fresh = true;
    return STICKSLIP_OK;
}

/* Return the input for a motion of the stage under a force, to the second derivative of the motion. With the stage's
 * transfer function G(s), the sum of g / (1 + a s + b s^2) over the modes, 1/G(s) = c0 + c1 s + c2 s^2 is exact for one
 * mode and the start of the series for several. */
static real_t through_modes(
    const stickslip_plant *plant, real_t position, real_t velocity, real_t acceleration, real_t force)
{
    real_t whole = R(0.0), first = R(0.0), second = R(0.0), yields = R(0.0);
    for (int m = 0; m < stage_modes(plant); ++m) {
        const struct mode *mode = &plant->engine.mode[m];
        const real_t b = R(1.0) / mode->stiffness, g = mode->drive * b, a = mode->damping * b;
        if (!plant->mechanism.clamped) {
            yields -= plant->engine.element[0].push[m] * b;
        }
        whole += g;
        first += g * a;
        second += g * (a * a - b);
    }
    return (position + yields * force + first / whole * velocity
            + (first * first / whole - second) / whole * acceleration) / whole;
}

int stickslip_feedforward(
    const stickslip_plant *plant, real_t position, real_t velocity, real_t acceleration, real_t *input)
{
    const ss_Mechanism *mech = &plant->mechanism;
    /* The sticking contact accelerates the end-effector, and its bristles deflect under this force. */
    const real_t free =
        mech->slider_acceleration - mech->slider_damping * velocity - mech->slider_stiffness * position;
    const real_t force = (acceleration - free) / mech->mobility;
    const real_t deflection = (plant->stiffness > R(0.0)) ? force / plant->stiffness : R(0.0);
    const real_t stage = position + deflection;
    const real_t made = follows_input(plant) ? stage / mech->gain
                                             : through_modes(plant, stage, velocity, acceleration, force);
    const int bits = (r_abs(force) > plant->holding) ? STICKSLIP_WOULD_SLIDE : STICKSLIP_OK;
#if STICKSLIP_PIEZO /* this output of the piezo is not limited; stickslip_piezo_inverse limits its input */
    if (!r_isfinite(made)) {
        return bits | STICKSLIP_INPUT_NOT_FINITE;
    }
    *input = made;
    return bits;
#else
    return bits | input_for(plant, made, input);
#endif
}

#if STICKSLIP_PIEZO
int stickslip_piezo_inverse(
    const stickslip_plant *plant, const stickslip_state *state, real_t wanted, real_t *input)
{
    const real_t missing = wanted - crept(plant, state);
    real_t low = plant->low, high = plant->high;
    stickslip_state tried = *state;
    if (!r_isfinite(missing)) {
        return STICKSLIP_INPUT_NOT_FINITE;
    }
    const bool beyond = (after_hysteresis(plant, state, &tried, state->input, low) > missing)
        || (after_hysteresis(plant, state, &tried, state->input, high) < missing);
    for (int k = 0; k < SUBSTEPS_AT_REST; ++k) {
        const real_t middle = R(0.5) * (low + high);
        if (after_hysteresis(plant, state, &tried, state->input, middle) < missing) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return (beyond ? STICKSLIP_INPUT_CLIPPED : STICKSLIP_OK) | input_for(plant, R(0.5) * (low + high), input);
}

/* Return the output of hysteresis and creep at rest at a voltage of the actuator, V; set the state and the input. */
static real_t given_at_rest(const stickslip_plant *plant, stickslip_state *state, real_t volts, real_t *input)
{
    (void)input_for(plant, volts, input);
    stickslip_rest(plant, state, *input);
    stickslip_state tried = *state;
    return after_hysteresis(plant, state, &tried, state->input, state->input) + crept(plant, state);
}

int stickslip_piezo_rest(const stickslip_plant *plant, stickslip_state *state, real_t wanted, real_t *input)
{
    real_t low = plant->low, high = plant->high;
    int bits = admitted(plant, R(0.0), R(-LIMIT), R(LIMIT), &wanted);
    if ((given_at_rest(plant, state, low, input) > wanted) || (given_at_rest(plant, state, high, input) < wanted)) {
        bits |= STICKSLIP_INPUT_CLIPPED;
    }
    for (int k = 0; k < SUBSTEPS_AT_REST; ++k) {
        const real_t middle = R(0.5) * (low + high);
        if (given_at_rest(plant, state, middle, input) < wanted) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return bits;
}
#endif
