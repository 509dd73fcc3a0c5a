/* A stick-slip actuator in fixed steps: no heap, no globals, nothing but math.h. A step is followed by the simulator's own
 * integrator (engine/), within STICKSLIP_TOLERANCE, in as many steps of its own as that takes.
 *
 *     stickslip_parameters parameters = stickslip_default_parameters();
 *     stickslip_plant plant;
 *     stickslip_state state;
 *     if (stickslip_init(&plant, &parameters, 20e-6) != NULL) { ...the text says what is wrong... }
 *     stickslip_rest(&plant, &state, 0.0);
 *     for (;;) { stickslip_step(&plant, &state, u); ... stickslip_read(&plant, &state).end_effector_position; }
 *
 * All quantities in SI. A plant is constant after its init and can serve many states. A state is plain data: copy
 * it to save it.
 */
#ifndef STICKSLIP_H
#define STICKSLIP_H

#include "stickslip_equations.h"

#include "engine/plant.h"

/* Of positions, m (rad). */
#ifndef STICKSLIP_TOLERANCE
#ifdef STICKSLIP_FLOAT
#define STICKSLIP_TOLERANCE 1e-8
#else
#define STICKSLIP_TOLERANCE 1e-10
#endif
#endif

/* Most steps of the integrator that one step of the model may take, accepted or not. */
#ifndef STICKSLIP_MOST_TRIES
#define STICKSLIP_MOST_TRIES 10000
#endif

/* Bits that a step, a correction or a feedforward returns. */
enum {
    STICKSLIP_OK = 0,
    STICKSLIP_INPUT_CLIPPED = 1,   /* the input was outside its limits and was cut to them */
    STICKSLIP_INPUT_NOT_FINITE = 2, /* the input was NaN or infinite: the last one was kept; no correction by it */
    STICKSLIP_WOULD_SLIDE = 4,     /* feedforward: the wanted motion needs more than friction holds */
    STICKSLIP_ESTIMATE_LOST = 8,   /* observer: not finite, or farther from the measured position than the stage can
                                    * go; begun again at rest where that is */
    STICKSLIP_JUMPED = 16,         /* the step began elsewhere than the last one ended, and a static stage would jump with
                                    * it, at infinite speed, at which a presliding law has no meaning: the motion is
                                    * wrong. Play lines that join, or give natural_frequency a finite value */
    STICKSLIP_NOT_FOLLOWED = 32    /* the integrator gave the step up: STICKSLIP_MOST_TRIES were too few, or the numbers
                                    * too extreme. The state is that of an earlier instant: the motion is wrong */
};

#define STICKSLIP_GAINS (5 + 2 * STICKSLIP_FURTHER)

typedef struct {
    stickslip_model model;           /* the actuator, with its friction law */
    stickslip_signal_chain chain;    /* amplifier and sensor; see stickslip_parameters.h whether they are used */
    real_t observer_gain[STICKSLIP_GAINS]; /* for stage position and velocity, end-effector position and velocity,
                                      * bristle, and position and velocity of each further mode of the stage */
} stickslip_parameters;

typedef struct {
    struct plant engine;   /* the equations of motion; its pointers are set within a step */
    real_t contact[STICKSLIP_STATES][STICKSLIP_NUMBERS]; /* the law's numbers, a row for each element */
    ss_Mechanism mechanism;
    stickslip_signal_chain chain;
#if STICKSLIP_PIEZO
    stickslip_piezo piezo;
#endif
#if STICKSLIP_TWO_PORT
    real_t stop[STICKSLIP_TWO_PORT][STICKSLIP_STOP_NUMBERS]; /* the stops of the piezo, as a law */
    real_t felt;           /* V/m, by how much the stops feel the stage */
#endif
    real_t observer_gain[STICKSLIP_GAINS];
    real_t low, high;      /* V, limits at the actuator: its own, and those of the amplifier */
    real_t h;              /* s, the step */
    real_t per_h;          /* 1/s */
    real_t stiffness;      /* N/m, of the sticking contact; 0 for a static law */
    real_t holding;        /* N, about the most that friction holds */
} stickslip_plant;

typedef struct {
    real_t stage_position;         /* m, of its first mode; see stickslip_read for the stage */
    real_t stage_velocity;         /* m/s */
    real_t end_effector_position;  /* m */
    real_t end_effector_velocity;  /* m/s */
#if STICKSLIP_FURTHER
    real_t further[2 * STICKSLIP_FURTHER]; /* m and m/s, position and velocity of each further mode of the stage */
#endif
    real_t internal[STICKSLIP_STATES]; /* m, bristle deflections; a static law has none */
    real_t input;                  /* the last input of the actuator, V */
#if STICKSLIP_HAS_AMPLIFIER
    real_t asked;                  /* V, the last input of the amplifier */
#endif
    real_t lost[LARGEST_MODES];    /* m, what rounding took from the positions */
#if STICKSLIP_HYSTERESIS
    real_t hysteresis[STICKSLIP_HYSTERESIS]; /* V, of its plays, or h of Bouc-Wen */
#endif
#if STICKSLIP_TWO_PORT
    real_t stops[STICKSLIP_TWO_PORT]; /* V times STICKSLIP_PER_VOLT */
#endif
#if STICKSLIP_CREEP
    real_t creep[STICKSLIP_CREEP]; /* V, of its terms */
    real_t creep_lost[STICKSLIP_CREEP];
#endif
    real_t sensor;                 /* m, the end-effector as the sensor sees it */
#if STICKSLIP_LATE
    real_t late[STICKSLIP_LATE];   /* m, the end-effector at even times, for a channel that is late */
    real_t age;                    /* s, of the newest of them */
    int newest;
#endif
    /* The integrator's: where the drive behind the piezo's hysteresis and creep ended, and its slope; the direction in which
     * each contact slides, 0: it is held; its next step, s, and whether it has to look at all anew. */
    real_t drive, slope;
    real_t side[LARGEST_ELEMENTS];
    real_t next;
    bool fresh;
    int tries;                     /* steps that it took for the last step, accepted or not */
} stickslip_state;

typedef struct {
    real_t end_effector_position;  /* m */
    real_t stage_position;         /* m */
    real_t sliding_displacement;   /* m */
    real_t friction_force;         /* N, of the stage on the end-effector */
    real_t drive_voltage;          /* V, at the actuator (behind the amplifier, if there is one) */
    real_t stage_velocity;         /* m/s */
    real_t end_effector_velocity;  /* m/s */
    real_t sensor_output;          /* in the unit of the sensor; m without one */
} stickslip_outputs;

/* The values of the export, with units and sources. */
stickslip_parameters stickslip_default_parameters(void);

/* Prepare steps of h seconds. Returns NULL, or what is wrong with the parameters; the plant is then unchanged. */
const char *stickslip_init(stickslip_plant *plant, const stickslip_parameters *parameters, double h);

/* The state at rest under a constant input, to which the amplifier, if there is one, has come; the contact carries
 * what it can of the external force. */
void stickslip_rest(const stickslip_plant *plant, stickslip_state *state, real_t input);

/* One step with the input held, as a converter holds it: a static stage jumps with it. Returns bits. */
int stickslip_step(const stickslip_plant *plant, stickslip_state *state, real_t input);

/* One step with an input that goes from one value to another in a straight line: exact for a ramp. */
int stickslip_step_ramp(const stickslip_plant *plant, stickslip_state *state, real_t begin, real_t end);

/* What can be seen of a state. */
stickslip_outputs stickslip_read(const stickslip_plant *plant, const stickslip_state *state);

/* Observer: move the state towards a measured end-effector position (m), after the step to that instant. The gain
 * is for a correction after each step of the export. Returns bits. */
int stickslip_correct(const stickslip_plant *plant, stickslip_state *state, real_t measured);

/* Feedforward: the input for a wanted position, velocity and acceleration of a sticking end-effector; that of the
 * amplifier, if there is one, whose lag is not made up for. Cut to the limits of both; left as it was where a number
 * is not finite. Returns bits. With hysteresis or creep of the piezo it is what these are to give, V, which is not
 * cut: see stickslip_piezo_inverse. For a stage of several modes it is right to the second derivative: for motions
 * that are slow against its lowest one. */
int stickslip_feedforward(
    const stickslip_plant *plant, real_t position, real_t velocity, real_t acceleration, real_t *input);

#if STICKSLIP_PIEZO
/* The input at which, from this state on, hysteresis and creep give what is wanted (V), by bisection; that of the
 * amplifier, if there is one. Cut to the limits of both, or left as it was. Returns bits. */
int stickslip_piezo_inverse(
    const stickslip_plant *plant, const stickslip_state *state, real_t wanted, real_t *input);

/* The state at rest, reached from 0 V long ago, where hysteresis and creep give what is wanted (V), and its input: where
 * stickslip_piezo_inverse goes on from. Returns bits. */
int stickslip_piezo_rest(const stickslip_plant *plant, stickslip_state *state, real_t wanted, real_t *input);
#endif

#endif
