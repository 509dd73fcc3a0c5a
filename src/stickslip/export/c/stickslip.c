/* The step method; see stickslip.h. The equations are those of stickslip_equations.h.
 *
 * Stage and end-effector are linear between two steps: their motion under a ramp of the input and a constant
 * friction force is known exactly, and computed once (matrix exponential). What is left is one equation for the
 * sliding velocity of the step,
 *
 *     V + mobility * F(V) = V_free,
 *
 * where F is the friction law at V with the bristle in the middle of the step, which moves by the exponential of its
 * own equation (linear in z for LuGre). It is solved with a fixed number of bracketed secant steps. A static law is
 * decided exactly: rest, if the force that rest needs is below breakaway.
 *
 * The order is 2. Where the contact is stiff against the step, law and bristle are evaluated towards the end of the
 * step (`implicit`), which damps what the step cannot resolve; the method stays stable for any stiffness.
 */
#include <stddef.h>

#include "stickslip.h"

/* Of the vector that the exponential is taken for; from MORE on, position and velocity of each further mode. */
enum { Y, W, X, S, MORE, INPUT = STICKSLIP_MOVING, CHANGE, ONE, FORCE, SIZE };
enum { EVALUATIONS = 6, HALVINGS = 10, SUBSTEPS_AT_REST = 60 };

static const double LIMIT = 1e6; /* of an input without limits of its own */
/* Of the deflection at which the contact breaks away: by less no input jumps. The ends of lines that join are apart by
 * their rounding, some 1e-6 of it; and a static stage that jumps by less is off by less than a nanometre for a step. */
static const double LEAST_JUMP = 1e-4;

/* ---- The stage: the sum of its modes ---------------------------------------------------------------------- */

/* What the further modes add to the stage's position (row Y) or velocity (row W). */
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

/* The same of the stage, from a change of all that moves. */
static real_t of_stage(const real_t change[STICKSLIP_MOVING], int row)
{
    real_t sum = change[row];
    for (int i = MORE; i < STICKSLIP_MOVING; i += 2) {
        sum += change[i + row];
    }
    return sum;
}

/* ---- Preparation ------------------------------------------------------------------------------------------ */

/* m becomes exp(m) - 1, by scaling and squaring of its Taylor series. */
static void exponential(double m[SIZE][SIZE])
{
    double norm = 0.0, sum[SIZE][SIZE], product[SIZE][SIZE];
    int squarings = 0;
    for (int i = 0; i < SIZE; ++i) {
        double row = 0.0;
        for (int j = 0; j < SIZE; ++j) {
            row += fabs(m[i][j]);
        }
        norm = fmax(norm, row);
    }
    for (; norm > 0.5 && squarings < 200; ++squarings) {
        norm *= 0.5;
    }
    const double scale = ldexp(1.0, -squarings);
    for (int i = 0; i < SIZE; ++i) {
        for (int j = 0; j < SIZE; ++j) {
            m[i][j] *= scale;
            sum[i][j] = m[i][j];
        }
    }
    for (int term = 16; term > 1; --term) { /* Horner: sum = m (1 + sum / term) */
        for (int i = 0; i < SIZE; ++i) {
            for (int j = 0; j < SIZE; ++j) {
                product[i][j] = m[i][j];
                for (int k = 0; k < SIZE; ++k) {
                    product[i][j] += m[i][k] * ((term == 16) ? 0.0 : sum[k][j]) / (double)term;
                }
            }
        }
        for (int i = 0; i < SIZE; ++i) {
            for (int j = 0; j < SIZE; ++j) {
                sum[i][j] = product[i][j];
            }
        }
    }
    for (; squarings > 0; --squarings) { /* exp(2m) - 1 = 2 (exp(m) - 1) + (exp(m) - 1)^2 */
        for (int i = 0; i < SIZE; ++i) {
            for (int j = 0; j < SIZE; ++j) {
                product[i][j] = 2.0 * sum[i][j];
                for (int k = 0; k < SIZE; ++k) {
                    product[i][j] += sum[i][k] * sum[k][j];
                }
            }
        }
        for (int i = 0; i < SIZE; ++i) {
            for (int j = 0; j < SIZE; ++j) {
                sum[i][j] = product[i][j];
            }
        }
    }
    for (int i = 0; i < SIZE; ++i) {
        for (int j = 0; j < SIZE; ++j) {
            m[i][j] = sum[i][j];
        }
    }
}

/* The linear motion over a step, from the equations of motion alone. */
static void linear_step(stickslip_plant *plant, double h)
{
    const ss_Mechanism *mech = &plant->mechanism;
    const real_t one = R(1.0), zero = R(0.0);
    const double stage = (double)ss_stage_acceleration(mech, zero, zero, zero, zero);
    const double slider = (double)ss_slider_acceleration(mech, zero, zero, zero, zero);
    double m[SIZE][SIZE] = {{0.0}};
    m[Y][W] = h;
    m[W][INPUT] = h * ((double)ss_stage_acceleration(mech, one, zero, zero, zero) - stage);
    m[W][Y] = h * ((double)ss_stage_acceleration(mech, zero, one, zero, zero) - stage);
    m[W][W] = h * ((double)ss_stage_acceleration(mech, zero, zero, one, zero) - stage);
    m[W][FORCE] = h * ((double)ss_stage_acceleration(mech, zero, zero, zero, one) - stage);
    m[W][ONE] = h * stage;
    m[X][S] = h;
    m[S][INPUT] = h * ((double)ss_slider_acceleration(mech, one, zero, zero, zero) - slider);
    m[S][X] = h * ((double)ss_slider_acceleration(mech, zero, one, zero, zero) - slider);
    m[S][S] = h * ((double)ss_slider_acceleration(mech, zero, zero, one, zero) - slider);
    m[S][FORCE] = h * ((double)ss_slider_acceleration(mech, zero, zero, zero, one) - slider);
    m[S][ONE] = h * slider;
#if STICKSLIP_FURTHER
    for (int k = 0; k < STICKSLIP_FURTHER; ++k) {
        const stickslip_model *of = &plant->model;
        const int q = MORE + 2 * k, w = q + 1;
        m[q][w] = h;
        m[w][INPUT] = h * (double)stickslip_further_acceleration(of, k, one, zero, zero, zero);
        m[w][q] = h * (double)stickslip_further_acceleration(of, k, zero, one, zero, zero);
        m[w][w] = h * (double)stickslip_further_acceleration(of, k, zero, zero, one, zero);
        m[w][FORCE] = h * (double)stickslip_further_acceleration(of, k, zero, zero, zero, one);
    }
#endif
    m[INPUT][CHANGE] = 1.0; /* the input rises by its change within the step */
    exponential(m);
    if (mech->kinematic) { /* the stage follows the input: y = C u at the end, at constant speed until then */
        const double gain = (double)mech->gain;
        double last[SIZE] = {-1.0};
        last[INPUT] = gain;
        last[CHANGE] = gain;
        for (int j = 0; j < SIZE; ++j) {
            m[Y][j] = last[j];
            m[W][j] = last[j] / h - ((j == W) ? 1.0 : 0.0);
        }
    }
    for (int i = 0; i < STICKSLIP_MOVING; ++i) {
        for (int j = 0; j < FORCE; ++j) {
            plant->free[i][j] = (real_t)m[i][j];
        }
        plant->push[i] = (real_t)m[i][FORCE];
    }
    for (int i = MORE; i < STICKSLIP_MOVING; i += 2) { /* from here on the stage */
        m[Y][FORCE] += m[i][FORCE];
        m[W][FORCE] += m[i + 1][FORCE];
    }
    plant->h = (real_t)h;
    plant->per_h = (real_t)(1.0 / h);
    plant->mean_mobility = (real_t)((m[X][FORCE] - m[Y][FORCE]) / h);
    plant->end_mobility = (real_t)(m[S][FORCE] - m[W][FORCE]);
}

/* ---- The contact over a step ------------------------------------------------------------------------------ */

#if !STICKSLIP_STATIC_LAW
/* How far the bristle of an element goes within a step at the sliding velocity v, and the mean of that over the step.
 * dz/dt is taken as linear in z, along the secant from here to where the bristle would go by v alone. */
static real_t bristle(const stickslip_plant *plant, const stickslip_element *element, real_t v, real_t z, real_t *mean)
{
    const real_t start = stickslip_law_rate(element, v, z).dz;
    real_t span = plant->h * v; /* of the secant */
    real_t there = stickslip_law_rate(element, v, z + span).dz;
    if ((span == R(0.0)) || (start == R(0.0))) { /* also where a speed is too small for its numbers */
        *mean = R(0.0);
        return R(0.0);
    }
#if !STICKSLIP_LINEAR_LAW
    bool ends = false; /* whether the motion ends within the span: at an equilibrium, or where dz/dt jumps to it */
    if (there * start <= R(0.0)) {
        real_t low = R(0.0), high = R(1.0);
        ends = true;
        for (int k = 0; k < HALVINGS; ++k) {
            const real_t middle = R(0.5) * (low + high);
            const real_t at = stickslip_law_rate(element, v, z + middle * span).dz;
            if (at * start > R(0.0)) {
                low = middle;
                there = at;
            } else {
                high = middle;
            }
        }
        there = (low > R(0.0)) ? there : start;
        span *= (low > R(0.0)) ? low : high;
    }
#endif
    real_t x = plant->h * ((there - start) / span); /* step times the slope */
    x = r_min(r_max(x, R(-1e9)), R(1.0));
    /* (e^x - 1)/x and (e^x - 1 - x)/x^2 with e^x = 1/(1 - x + x^2/2): second order, positive for every x < 1 */
    const real_t scale = plant->h * start / (R(1.0) - x + R(0.5) * x * x);
    const real_t whole = (R(1.0) - R(0.5) * x) * scale;
    *mean = (R(0.5) - R(0.5) * x) * scale;
#if !STICKSLIP_LINEAR_LAW
    if (ends && (whole * whole > span * span) && (whole * span > R(0.0))) { /* there before the step ends, then at rest */
        *mean = span * (R(1.0) - R(0.5) * span / whole);
        return span;
    }
#endif
    return whole;
}
#endif

/* Mean friction force of a step at the sliding velocity v; the internal states at its end. */
static real_t contact_force(
    const stickslip_plant *plant, const stickslip_state *state, real_t v, real_t end[STICKSLIP_STATES])
{
    real_t force = R(0.0);
    for (int i = 0; i < STICKSLIP_STATES; ++i) {
        const stickslip_element *element = &plant->element[i];
        const real_t z = state->internal[i];
#if STICKSLIP_STATIC_LAW
        end[i] = z;
        force += stickslip_law_rate(element, v, z).force;
#else
        real_t mean;
        const real_t whole = bristle(plant, element, v, z, &mean);
        const real_t at = stickslip_law_project(element, z + mean + plant->implicit * (whole - mean));
        end[i] = stickslip_law_project(element, z + whole);
        force += stickslip_law_rate(element, v, at).force;
#endif
    }
    return force;
}

/* The sliding velocity v with v + mobility * force(v) = v_free; the force there, and the states at the end. */
static real_t solve(
    const stickslip_plant *plant, const stickslip_state *state, real_t mobility, real_t v_free, real_t *velocity,
    real_t end[STICKSLIP_STATES])
{
    real_t a = *velocity;
    real_t force = contact_force(plant, state, a, end);
    real_t error_a = a + mobility * force - v_free;
    /* The left side rises at least as v does, so the root is not farther than the error. */
    real_t low = a - r_max(error_a, R(0.0)), high = a - r_min(error_a, R(0.0));
    real_t b = a - error_a * plant->newton;
    for (int k = 1; k < EVALUATIONS; ++k) {
        force = contact_force(plant, state, b, end);
        const real_t error_b = b + mobility * force - v_free;
        if (k == EVALUATIONS - 1) {
            break;
        }
        if (error_b > R(0.0)) {
            high = b;
        } else {
            low = b;
        }
        real_t next = b;
        if (error_b != error_a) {
            next = b - error_b * (b - a) / (error_b - error_a);
        }
        if (!((next >= low) && (next <= high))) {
            next = R(0.5) * (low + high);
        }
        a = b;
        error_a = error_b;
        b = next;
    }
    *velocity = b;
    return force;
}

#if STICKSLIP_STATIC_LAW
/* Rest or sliding over this step; sets the direction of sliding (0: rest). Returns the mean force, and the mean
 * sliding velocity of a step that ends at rest. Where sliding ends within the step, the force is that of sliding until
 * then and that of rest, or of sliding back, for the rest of the step. */
static real_t static_contact(
    const stickslip_plant *plant, stickslip_state *state, real_t mean_free, real_t end_free, real_t *until_rest)
{
    const real_t before = state->stage_velocity + of_further(state, W) - state->end_effector_velocity;
    real_t end[STICKSLIP_STATES], part = R(0.0), force = R(0.0), after = end_free;
    *until_rest = R(0.0);
    if (state->internal[0] != R(0.0)) { /* it slides: does it go on? */
        force = solve(plant, state, plant->mean_mobility, mean_free, &state->sliding_velocity, end);
        after = end_free - plant->end_mobility * force;
        if (after * state->internal[0] > R(0.0)) {
            return force;
        }
        if (before * state->internal[0] > R(0.0)) {
            part = before / (before - after);
            *until_rest = R(0.5) * part * before;
        }
    }
    const real_t needed = force + (after - ((part > R(0.0)) ? before : R(0.0))) / plant->end_mobility;
    state->sliding_velocity = R(0.0);
    if (r_abs(needed) <= plant->breakaway) {
        state->internal[0] = R(0.0);
        return needed + part * (force - needed);
    }
    state->internal[0] = r_copysign(R(1.0), needed);
    const real_t back = solve(plant, state, plant->mean_mobility, mean_free, &state->sliding_velocity, end);
    return back + part * (force - back);
}
#endif

/* Add to a position, or a term of creep, and remember what rounding took away. */
static void add(real_t *position, real_t *lost, real_t change)
{
    const real_t wanted = change - *lost;
    const real_t sum = *position + wanted;
    *lost = (sum - *position) - wanted;
    *position = sum;
}

#if STICKSLIP_PIEZO
#if STICKSLIP_TWO_PORT
/* What the stops take from an input with the stage at a place, V; moves them from where they were. */
static real_t after_stops(
    const stickslip_plant *plant, const stickslip_state *state, stickslip_state *moved, real_t input, real_t stage)
{
    const real_t strained = input + plant->felt * stage, way = strained - state->strained;
    real_t sum = R(0.0);
    if (plant->piezo.hysteresis.charge_drive) {
        return sum;
    }
    for (int i = 0; i < STICKSLIP_TWO_PORT; ++i) {
        const real_t wide = plant->stop_width[i];
        moved->stops[i] = r_min(r_max(state->stops[i] + way, -wide), wide);
        sum += plant->stop_share[i] * moved->stops[i];
    }
    moved->strained = strained;
    return sum;
}

/* Put them and the stage where they are at rest under an input that came from 0 V, by bisection: each stop follows
 * until its width. The stage is where it would be without them. */
static void settle_stops(const stickslip_plant *plant, stickslip_state *state, real_t input)
{
    const real_t given = plant->mechanism.stage_drive / plant->mechanism.stage_stiffness;
    const real_t wanted = input + plant->felt * state->stage_position;
    const stickslip_state from = *state;
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

/* What the piezo's hysteresis gives at an input, V; moves its states. */
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

/* What has crept, V. */
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

#if !STICKSLIP_TWO_PORT /* whose stops move with the stage */
/* The ends of a step behind hysteresis and creep; moves their states. */
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
    stickslip_stops(&made.piezo.hysteresis, made.stop_width, made.stop_share);
    made.felt = stickslip_felt(&parameters->model);
    if (made.piezo.hysteresis.charge_drive) { /* at constant charge the piezo is stiffer */
        const real_t stiffer = R(1.0) + parameters->model.gain * made.felt;
        made.mechanism.stage_stiffness *= stiffer;
        made.mechanism.stage_drive *= stiffer;
    }
#endif
#if STICKSLIP_FURTHER
    made.model = parameters->model;
#endif
    for (int i = 0; i < STICKSLIP_GAINS; ++i) {
        made.observer_gain[i] = parameters->observer_gain[i];
    }
    made.low = r_max(stickslip_input_low(&parameters->model), R(-LIMIT));
    made.high = r_min(stickslip_input_high(&parameters->model), R(LIMIT));
#if STICKSLIP_HAS_AMPLIFIER
    made.low = r_max(made.low, made.chain.amplifier.low);
    made.high = r_min(made.high, made.chain.amplifier.high);
#endif
    made.breakaway = stickslip_law_breakaway(&parameters->model.friction);
    made.stiffness = R(0.0);
    real_t damping = R(0.0);
    for (int i = 0; i < STICKSLIP_STATES; ++i) {
        made.element[i] = stickslip_law_element(&parameters->model.friction, i);
        const stickslip_element *element = &made.element[i];
        const real_t rest = stickslip_law_rate(element, R(0.0), R(0.0)).force;
#if !STICKSLIP_STATIC_LAW
        made.stiffness += (stickslip_law_rate(element, R(0.0), R(1e-9)).force - rest) / R(1e-9);
#endif
        damping += (stickslip_law_rate(element, R(1e-6), R(0.0)).force - rest) / R(1e-6);
    }
    linear_step(&made, h);
    real_t mobility = made.mechanism.reaction + made.mechanism.mobility;
#if STICKSLIP_FURTHER
    for (int m = 0; m < STICKSLIP_FURTHER; ++m) {
        mobility -= stickslip_further_acceleration(&made.model, m, R(0.0), R(0.0), R(0.0), R(1.0));
    }
#endif
    const real_t ratio = mobility * made.stiffness * made.h * made.h;
    made.implicit = ratio / (R(12.0) + ratio); /* of second order in h, and 1 where the contact is stiff */
    made.newton = R(1.0)
        / (R(1.0)
           + (made.mean_mobility + made.implicit * (made.end_mobility - made.mean_mobility))
               * (R(0.5) * made.stiffness * made.h * (R(1.0) + made.implicit) + r_max(damping, R(0.0))));
    made.holding = made.breakaway;
#if !STICKSLIP_STATIC_LAW
    stickslip_state slow = {0}; /* drawn slowly and for long, it carries what it can */
    real_t end[STICKSLIP_STATES];
    stickslip_plant creep = made;
    creep.h = R(10.0);
    for (int k = 0; k < SUBSTEPS_AT_REST; ++k) {
        made.holding = contact_force(&creep, &slow, R(1e-7), end);
        for (int i = 0; i < STICKSLIP_STATES; ++i) {
            slow.internal[i] = end[i];
        }
    }
#endif
    if (!(r_isfinite(made.newton) && r_isfinite(made.free[0][0]) && r_isfinite(made.free[1][0])
          && r_isfinite(made.free[1][INPUT]) && r_isfinite(made.free[STICKSLIP_MOVING - 1][INPUT])
          && r_isfinite(made.push[3]))) {
        return "the step is too long, or the parameters are too extreme, for the numbers of this machine";
    }
    *plant = made;
    return NULL;
}

#if !STICKSLIP_STATIC_LAW
/* The deflection, towards one side, at which sliding slowly ends it. */
static real_t farthest(const stickslip_element *element, real_t side)
{
    real_t low = R(0.0), high = R(1.0);
    for (int k = 0; k < SUBSTEPS_AT_REST; ++k) {
        const real_t middle = R(0.5) * (low + high);
        if (side * stickslip_law_rate(element, side * R(1e-9), side * middle).dz > R(0.0)) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}
#endif

/* What the contact holds of a constant force at rest, N, with its deflections in the state: equal ones, each at
 * most where sliding ends it. */
static real_t held_at_rest(const stickslip_plant *plant, stickslip_state *state)
{
    const real_t wanted = -plant->mechanism.slider_acceleration / plant->mechanism.mobility;
    if (plant->mechanism.clamped || (wanted == R(0.0))) {
        return R(0.0);
    }
#if STICKSLIP_STATIC_LAW
    (void)state;
    return r_copysign(r_min(r_abs(wanted), plant->breakaway), wanted);
#else
    const real_t side = r_copysign(R(1.0), wanted);
    real_t held = R(0.0), low = R(0.0), high = R(1.0), end[STICKSLIP_STATES];
    for (int i = 0; i < STICKSLIP_STATES; ++i) {
        end[i] = farthest(&plant->element[i], side);
    }
    for (int k = 0; k < SUBSTEPS_AT_REST; ++k) {
        const real_t middle = R(0.5) * (low + high);
        held = R(0.0);
        for (int i = 0; i < STICKSLIP_STATES; ++i) {
            state->internal[i] = side * r_min(middle, end[i]);
            held += stickslip_law_rate(&plant->element[i], R(0.0), state->internal[i]).force;
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

/* Cut an input to its limits, or keep the last one. */
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

/* The input at which the actuator comes to have a voltage; kept, where that is not finite. */
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
#if STICKSLIP_PIEZO /* reached from 0 V, long ago */
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
    state->friction_force = held;
    if (mech->kinematic) {
        state->stage_position = mech->gain * input;
    } else {
        state->stage_position =
            (mech->stage_drive * input + mech->stage_acceleration - mech->reaction * held) / mech->stage_stiffness;
    }
#if STICKSLIP_FURTHER
    for (int m = 0; m < STICKSLIP_FURTHER; ++m) {
        const stickslip_model *of = &plant->model;
        state->further[2 * m] =
            stickslip_further_acceleration(of, m, input, R(0.0), R(0.0), held)
            / -stickslip_further_acceleration(of, m, R(0.0), R(1.0), R(0.0), R(0.0));
    }
#endif
#if STICKSLIP_TWO_PORT
    settle_stops(plant, state, input);
#endif
    state->end_effector_position = (mech->slider_stiffness > R(0.0))
        ? mech->slider_drive * input / mech->slider_stiffness
        : state->stage_position + of_further(state, Y);
    state->sensor = state->end_effector_position;
#if STICKSLIP_LATE
    state->newest = 0;
    for (int i = 0; i < STICKSLIP_LATE; ++i) {
        state->late[i] = state->end_effector_position;
    }
#endif
}

#if STICKSLIP_LATE
/* The end-effector as a channel sees it that is late, after a step over which it went by `change`. Its positions are
 * kept at even times, whatever the steps are; it goes in lines between them, and from the newest of them to now. */
static real_t seen_late(const stickslip_plant *plant, stickslip_state *state, real_t change)
{
    const real_t spacing = (real_t)STICKSLIP_LATE_SPACING, delay = plant->chain.sensor.delay;
    const real_t now = state->end_effector_position;
    real_t age = r_min(state->age + plant->h, spacing * R(STICKSLIP_LATE)); /* a longer step fills them all */
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

/* Whether an input that jumps by this takes a static stage, and the bristles of its contact, along. */
static bool jumps(const stickslip_plant *plant, real_t change)
{
    const real_t force = plant->stiffness * plant->mechanism.gain * change;
    return plant->mechanism.kinematic && !plant->mechanism.clamped && (r_abs(force) > R(LEAST_JUMP) * plant->holding);
}

int stickslip_step_ramp(const stickslip_plant *plant, stickslip_state *state, real_t begin, real_t end)
{
    int bits = STICKSLIP_OK;
#if STICKSLIP_HAS_AMPLIFIER
    /* The amplifier follows the middle of its own input, which it has until the end of the step. */
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
    real_t now[FORCE] = {
        state->stage_position, state->stage_velocity, state->end_effector_position, state->end_effector_velocity};
    real_t change[STICKSLIP_MOVING];
#if STICKSLIP_FURTHER
    for (int i = 0; i < 2 * STICKSLIP_FURTHER; ++i) {
        now[MORE + i] = state->further[i];
    }
#endif
    now[ONE] = R(1.0);
#if STICKSLIP_TWO_PORT /* the stops at the end of the step: the stage as it goes if they stay as they are */
    const real_t taken = after_stops(plant, state, state, begin, now[Y]);
    real_t place = now[Y];
    begin -= taken;
    now[INPUT] = begin;
    now[CHANGE] = end - taken - begin;
    for (int j = 0; j < FORCE; ++j) {
        place += plant->free[Y][j] * now[j];
    }
    end -= after_stops(plant, state, state, end, place);
#endif
    now[INPUT] = begin;
    now[CHANGE] = end - begin;
    for (int i = 0; i < STICKSLIP_MOVING; ++i) { /* without friction */
        change[i] = R(0.0);
        for (int j = 0; j < FORCE; ++j) {
            change[i] += plant->free[i][j] * now[j];
        }
    }
    const real_t stage_velocity = now[W] + of_further(state, W);
    if (plant->mechanism.clamped) { /* the end-effector is part of the stage */
        change[X] = of_stage(change, Y);
        change[S] = stage_velocity + of_stage(change, W) - now[S];
        for (int i = 0; i < STICKSLIP_MOVING; ++i) { /* the force that holds it at the end of the step */
            now[i] += change[i];
        }
        state->friction_force = ss_holding_force(&plant->mechanism, end, R(0.0), now);
#if STICKSLIP_FURTHER
        for (int m = 0; m < STICKSLIP_FURTHER; ++m) {
            const real_t *q = &now[MORE + 2 * m];
            state->friction_force +=
                stickslip_further_acceleration(&plant->model, m, end, q[0], q[1], R(0.0)) / plant->mechanism.mobility;
        }
#endif
    } else {
        const real_t mean_free = (of_stage(change, Y) - change[X]) * plant->per_h;
        const real_t end_free = (stage_velocity + of_stage(change, W)) - (now[S] + change[S]);
#if STICKSLIP_STATIC_LAW
        real_t until_rest;
        const real_t force = static_contact(plant, state, mean_free, end_free, &until_rest);
#else
        const real_t mobility =
            plant->mean_mobility + plant->implicit * (plant->end_mobility - plant->mean_mobility);
        const real_t v_free = mean_free + plant->implicit * (end_free - mean_free);
        real_t internal[STICKSLIP_STATES];
        const real_t force = solve(plant, state, mobility, v_free, &state->sliding_velocity, internal);
        for (int i = 0; i < STICKSLIP_STATES; ++i) {
            state->internal[i] = internal[i];
        }
#endif
        for (int i = 0; i < STICKSLIP_MOVING; ++i) {
            change[i] += plant->push[i] * force;
        }
        state->friction_force = force;
#if STICKSLIP_STATIC_LAW
        if (state->internal[0] == R(0.0)) { /* at rest, exactly */
            change[X] = of_stage(change, Y) - plant->h * until_rest;
            change[S] = (stage_velocity + of_stage(change, W)) - now[S];
        }
#endif
    }
    add(&state->stage_position, &state->lost[0], change[Y]);
    add(&state->end_effector_position, &state->lost[1], change[X]);
    state->stage_velocity += change[W];
    state->end_effector_velocity += change[S];
#if STICKSLIP_FURTHER
    for (int m = 0; m < STICKSLIP_FURTHER; ++m) {
        add(&state->further[2 * m], &state->further_lost[m], change[MORE + 2 * m]);
        state->further[2 * m + 1] += change[MORE + 2 * m + 1];
    }
#endif
    state->input = last;
#if STICKSLIP_LATE
    state->sensor = seen_late(plant, state, change[X]);
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
    out.stage_position = state->stage_position + of_further(state, Y);
    out.sliding_displacement = out.stage_position - state->end_effector_position;
    out.friction_force = state->friction_force;
    out.drive_voltage = state->input;
    out.stage_velocity = state->stage_velocity + of_further(state, W);
    out.end_effector_velocity = state->end_effector_velocity;
#if STICKSLIP_HAS_SENSOR
    out.sensor_output = stickslip_sensor_output(&plant->chain, state->sensor);
#else
    (void)plant;
    out.sensor_output = state->sensor;
#endif
    return out;
}

/* Begin the estimate again: at rest under the last input, where the end-effector was measured. */
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
    const real_t reach = plant->mechanism.gain * (plant->high - plant->low); /* of the stage */
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
            stickslip_law_project(&plant->element[i], state->internal[i] + plant->observer_gain[4] * error);
    }
#endif
    return STICKSLIP_OK;
}

#if STICKSLIP_FURTHER
/* The input for a motion of a stage of several modes that carries a force, to the second derivative of the motion:
 * 1/G(s) = c0 + c1 s + c2 s^2 of G(s), the sum of g / (1 + a s + b s^2) over the modes. */
static real_t through_modes(
    const stickslip_plant *plant, real_t position, real_t velocity, real_t acceleration, real_t force)
{
    const ss_Mechanism *mech = &plant->mechanism;
    const real_t zero = R(0.0), one = R(1.0);
    real_t g = mech->stage_drive / mech->stage_stiffness, b = R(1.0) / mech->stage_stiffness;
    real_t a = mech->stage_damping * b, yields = mech->reaction * b, whole = g, first = g * a, second = g * (a * a - b);
    for (int m = 0; m < STICKSLIP_FURTHER; ++m) {
        b = R(-1.0) / stickslip_further_acceleration(&plant->model, m, zero, one, zero, zero);
        g = b * stickslip_further_acceleration(&plant->model, m, one, zero, zero, zero);
        a = -b * stickslip_further_acceleration(&plant->model, m, zero, zero, one, zero);
        yields -= b * stickslip_further_acceleration(&plant->model, m, zero, zero, zero, one);
        whole += g;
        first += g * a;
        second += g * (a * a - b);
    }
    return (position + yields * force + first / whole * velocity
            + (first * first / whole - second) / whole * acceleration) / whole;
}
#endif

int stickslip_feedforward(
    const stickslip_plant *plant, real_t position, real_t velocity, real_t acceleration, real_t *input)
{
    const ss_Mechanism *mech = &plant->mechanism;
    /* The contact carries the end-effector and yields by its deflection. */
    const real_t force =
        (acceleration - ss_slider_acceleration(mech, R(0.0), position, velocity, R(0.0))) / mech->mobility;
    const real_t deflection = (plant->stiffness > R(0.0)) ? force / plant->stiffness : R(0.0);
    const real_t stage = position + deflection;
    real_t made = stage / mech->gain;
    int bits = (r_abs(force) > plant->holding) ? STICKSLIP_WOULD_SLIDE : STICKSLIP_OK;
#if STICKSLIP_FURTHER
    made = through_modes(plant, stage, velocity, acceleration, mech->clamped ? R(0.0) : force);
#else
    if (!mech->kinematic) { /* stage and end-effector move as one body */
        const ss_Mechanism one = ss_joined(mech, R(0.0));
        made = (acceleration - ss_stage_acceleration(&one, R(0.0), stage, velocity, R(0.0))) / one.stage_drive;
    }
#endif
#if STICKSLIP_PIEZO /* of its own limits: stickslip_piezo_inverse */
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

/* What hysteresis and creep give at rest, V, where the actuator has a voltage; sets the state and the input. */
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
