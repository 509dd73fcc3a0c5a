/* A stick-slip actuator in fixed time steps: no heap, no globals, no library except math.h. Within each time step the
 * simulator's integrator (engine/) takes as many integration steps as STICKSLIP_TOLERANCE needs.
 *
 *     stickslip_parameters parameters = stickslip_default_parameters();
 *     stickslip_plant plant;
 *     stickslip_state state;
 *     if (stickslip_init(&plant, &parameters, 20e-6) != NULL) { ...the text says what is wrong... }
 *     stickslip_rest(&plant, &state, 0.0);
 *     for (;;) { stickslip_step(&plant, &state, u); ... stickslip_read(&plant, &state).end_effector_position; }
 *
 * All quantities are in SI units. A plant is constant after stickslip_init and can serve many states. A state is plain
 * data: copy it to save it.
 */
#ifndef STICKSLIP_H
#define STICKSLIP_H

#include "stickslip_equations.h"

#include "engine/plant.h"

/* Error tolerance of the positions in the integration, m (rad). */
#ifndef STICKSLIP_TOLERANCE
#ifdef STICKSLIP_FLOAT
#define STICKSLIP_TOLERANCE 1e-8
#else
#define STICKSLIP_TOLERANCE 1e-10
#endif
#endif

/* Largest number of integration steps, accepted or rejected, for one time step. */
#ifndef STICKSLIP_MOST_TRIES
#define STICKSLIP_MOST_TRIES 10000
#endif

/* Bits of the result of a step, a correction or a feedforward; several may be set. */
enum {
    STICKSLIP_OK = 0,
    STICKSLIP_INPUT_CLIPPED = 1,   /* the input was outside its limits and was limited to them */
    STICKSLIP_INPUT_NOT_FINITE = 2, /* the input was NaN or infinite: the previous input was used; such a measured
                                    * position corrects nothing */
    STICKSLIP_WOULD_SLIDE = 4,     /* feedforward: the wanted motion needs more force than friction holds */
    STICKSLIP_ESTIMATE_LOST = 8,   /* observer: the estimate was not finite, or farther from the measured position than
                                    * the stage can move; it was set to rest at the measured position */
    STICKSLIP_JUMPED = 16,         /* the input at the start of the step differs from that at the end of the previous one.
                                    * A static stage would jump with it at infinite speed, for which a presliding law is
                                    * not valid: the motion is wrong. Use an input without jumps, or give
                                    * natural_frequency a finite value */
    STICKSLIP_NOT_FOLLOWED = 32    /* the integrator did not finish the step, because STICKSLIP_MOST_TRIES steps were too
                                    * few or the numbers too extreme. The state is that of an earlier time: the motion is
                                    * wrong */
};

#define STICKSLIP_GAINS (5 + 2 * STICKSLIP_FURTHER)

typedef struct {
    stickslip_model model;           /* the actuator, with its friction law */
    stickslip_signal_chain chain;    /* amplifier and sensor; STICKSLIP_HAS_AMPLIFIER and STICKSLIP_HAS_SENSOR in
                                      * stickslip_equations.h say whether there are any */
    real_t observer_gain[STICKSLIP_GAINS]; /* correction per position error of stage position (1) and velocity (1/s),
                                      * end-effector position and velocity, bristle deflection (1), and position and
                                      * velocity of each further mode of the stage */
} stickslip_parameters;

typedef struct {
    struct plant engine;   /* the equations of motion; its pointers are set within a step */
    real_t contact[STICKSLIP_STATES][STICKSLIP_NUMBERS]; /* the friction law's numbers, one row for each element */
    ss_Mechanism mechanism;
    stickslip_signal_chain chain;
#if STICKSLIP_PIEZO
    stickslip_piezo piezo;
#endif
#if STICKSLIP_TWO_PORT
    real_t stop[STICKSLIP_TWO_PORT][STICKSLIP_STOP_NUMBERS]; /* the hysteresis elements (stops) of the piezo, as a law */
    real_t felt;           /* V/m, voltage at the stops per displacement of the stage */
#endif
    real_t observer_gain[STICKSLIP_GAINS];
    real_t low, high;      /* V, limits of the voltage at the actuator, from the actuator and the amplifier */
    real_t h;              /* s, the time step */
    real_t per_h;          /* 1/s, the inverse of the time step */
    real_t stiffness;      /* N/m, stiffness of the sticking contact; 0 for a law without presliding */
    real_t holding;        /* N, approximate largest friction force at rest */
} stickslip_plant;

typedef struct {
    real_t stage_position;         /* m, of the stage's first mode; stickslip_read gives the sum of all modes */
    real_t stage_velocity;         /* m/s */
    real_t end_effector_position;  /* m */
    real_t end_effector_velocity;  /* m/s */
#if STICKSLIP_FURTHER
    real_t further[2 * STICKSLIP_FURTHER]; /* m and m/s, position and velocity of each further mode of the stage */
#endif
    real_t internal[STICKSLIP_STATES]; /* m, deflections of the bristles; not used by a law without presliding */
    real_t input;                  /* V, voltage at the actuator at the end of the last step */
#if STICKSLIP_HAS_AMPLIFIER
    real_t asked;                  /* V, the last input of the amplifier */
#endif
    real_t lost[LARGEST_MODES];    /* m, rounding errors of the positions, which later steps compensate */
#if STICKSLIP_HYSTERESIS
    real_t hysteresis[STICKSLIP_HYSTERESIS]; /* V, outputs of the play operators, or the state h of Bouc-Wen */
#endif
#if STICKSLIP_TWO_PORT
    real_t stops[STICKSLIP_TWO_PORT]; /* states of the piezo's stops, V times STICKSLIP_PER_VOLT */
#endif
#if STICKSLIP_CREEP
    real_t creep[STICKSLIP_CREEP]; /* V, states of the terms of creep */
    real_t creep_lost[STICKSLIP_CREEP]; /* V, rounding errors of these states */
#endif
    real_t sensor;                 /* m, end-effector position as the sensor measures it */
#if STICKSLIP_LATE
    real_t late[STICKSLIP_LATE];   /* m, past end-effector positions at equal intervals, for a delayed channel */
    real_t age;                    /* s, time since the newest of these positions */
    int newest;                    /* index of the newest position */
#endif
    /* State of the integrator: the drive after hysteresis and creep of the piezo at the end of the last step, and its
     * slope; for each contact the direction of sliding, 0 if it sticks; the next integration step, s; and whether the
     * integrator must evaluate everything again. */
    real_t drive, slope;
    real_t side[LARGEST_ELEMENTS];
    real_t next;
    bool fresh;
    int tries;                     /* number of integration steps, accepted or rejected, in the last time step */
} stickslip_state;

typedef struct {
    real_t end_effector_position;  /* m */
    real_t stage_position;         /* m */
    real_t sliding_displacement;   /* m */
    real_t friction_force;         /* N, of the stage on the end-effector */
    real_t drive_voltage;          /* V, at the actuator (behind the amplifier, if there is one) */
    real_t stage_velocity;         /* m/s */
    real_t end_effector_velocity;  /* m/s */
    real_t sensor_output;          /* output in the unit of the sensor; the position in m without a sensor */
} stickslip_outputs;

/* Return the exported values; stickslip_parameters.c has their units and sources. */
stickslip_parameters stickslip_default_parameters(void);

/* Prepare a plant for time steps of h seconds. Returns NULL, or an error message about the parameters; the plant is
 * then unchanged. */
const char *stickslip_init(stickslip_plant *plant, const stickslip_parameters *parameters, double h);

/* Set a state to rest at a constant input (V at the amplifier if there is one, which has settled, else at the
 * actuator). The contact carries the external force as far as friction can. */
void stickslip_rest(const stickslip_plant *plant, stickslip_state *state, real_t input);

/* Compute one time step with a constant input, as a converter holds it; a static stage jumps with a changed input.
 * Returns bits. */
int stickslip_step(const stickslip_plant *plant, stickslip_state *state, real_t input);

/* Compute one time step with an input that changes linearly from `begin` to `end`. Returns bits. */
int stickslip_step_ramp(const stickslip_plant *plant, stickslip_state *state, real_t begin, real_t end);

/* Return the outputs of the model in a state. */
stickslip_outputs stickslip_read(const stickslip_plant *plant, const stickslip_state *state);

/* Observer: correct the state by a measured end-effector position (m), after the step to the time of measurement. The
 * gain is valid for one correction in each time step of the export. Returns bits. */
int stickslip_correct(const stickslip_plant *plant, stickslip_state *state, real_t measured);

/* Feedforward: compute the input (V) for a wanted position (m), velocity and acceleration of a sticking end-effector.
 * Returns bits.
 * With an amplifier it is the amplifier's input; the amplifier's lag is not compensated. It is limited to the limits of
 * amplifier and actuator, and unchanged if a number is not finite. With hysteresis or creep it is the wanted output of
 * these, not limited; stickslip_piezo_inverse converts it to an input. For a stage of several modes it is exact to the
 * second derivative, that is, for motions that are slow compared with the lowest mode. */
int stickslip_feedforward(
    const stickslip_plant *plant, real_t position, real_t velocity, real_t acceleration, real_t *input);

#if STICKSLIP_PIEZO
/* Compute by bisection the input (V) at which the output of hysteresis and creep, from this state on, is `wanted` (V).
 * With an amplifier it is the amplifier's input. It is limited to the limits of both, and unchanged if a number is not
 * finite. Returns bits. */
int stickslip_piezo_inverse(
    const stickslip_plant *plant, const stickslip_state *state, real_t wanted, real_t *input);

/* Set a state to rest, reached from 0 V long ago, in which the output of hysteresis and creep is `wanted` (V), and return
 * its input. A sequence of calls of stickslip_piezo_inverse starts from this state. Returns bits. */
int stickslip_piezo_rest(const stickslip_plant *plant, stickslip_state *state, real_t wanted, real_t *input);
#endif

#endif
