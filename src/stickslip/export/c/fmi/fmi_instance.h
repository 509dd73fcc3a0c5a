/* What the FMI 2.0 and 3.0 shells share: an instance, its phases, its steps. No pointer is inside fmi_data, so that a
 * copy of it is the state of the FMU, and its bytes are the serialised state.
 */
#ifndef FMI_INSTANCE_H
#define FMI_INSTANCE_H

#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stickslip.h"

enum { PLANT, OBSERVER, FEEDFORWARD };                 /* modes */
enum { INSTANTIATED, INITIALIZING, STEPPING, STOPPED }; /* phases */

typedef struct {
    stickslip_parameters parameters;
    stickslip_plant plant;
    stickslip_state state;
    stickslip_outputs outputs;
    real_t input[3]; /* voltage and measured position, or wanted position, velocity, acceleration */
    real_t slope;    /* time derivative of the first input, V/s */
    real_t voltage;  /* output of the feedforward, V */
    bool would_slide;
    real_t step; /* s, longest internal step */
    double time;
    double uncorrected; /* s, time since the last correction of the observer */
    int phase;
} fmi_data;

#include "fmi_variables.h" /* MODE, TOKEN, fmi_real, fmi_boolean, is_parameter: generated */

static const double MOST_STEPS = 1e7; /* largest number of internal steps in one communication step */

static void fmi_start(fmi_data *data)
{
    memset(data, 0, sizeof *data);
    data->parameters = stickslip_default_parameters();
    data->step = R(DEFAULT_STEP);
    data->phase = INSTANTIATED;
    data->input[0] = R(REST_INPUT);
}

static void fmi_refresh(fmi_data *data)
{
    data->outputs = stickslip_read(&data->plant, &data->state);
    if (MODE == FEEDFORWARD) {
        const int bits =
            stickslip_feedforward(&data->plant, data->input[0], data->input[1], data->input[2], &data->voltage);
        data->would_slide = (bits & STICKSLIP_WOULD_SLIDE) != 0;
    }
}

/* Compute the state and the outputs at the start. Returns NULL, or an error message about the parameters. */
static const char *fmi_initial(fmi_data *data)
{
    const char *wrong = stickslip_init(&data->plant, &data->parameters, (double)data->step);
    if (wrong != NULL) {
        return wrong;
    }
    stickslip_rest(&data->plant, &data->state, (MODE == FEEDFORWARD) ? R(REST_INPUT) : data->input[0]);
    if (MODE == OBSERVER) { /* the end-effector starts at the measured position, if that is finite */
        const real_t there = data->input[1] - data->state.end_effector_position;
        data->state.end_effector_position += (data->input[1] - data->input[1] == R(0.0)) ? there : R(0.0);
    }
    data->uncorrected = (double)data->step;
    fmi_refresh(data);
    return NULL;
}

/* End the initialisation. Returns NULL, or an error message about the parameters. */
static const char *fmi_begin(fmi_data *data)
{
    const char *wrong = fmi_initial(data);
    if (wrong == NULL) {
        data->phase = STEPPING;
    }
    return wrong;
}

/* Update the outputs before a variable is read, so that they belong to the inputs and parameters that were set. Returns
 * NULL, or an error message about the parameters. */
static const char *fmi_before_get(fmi_data *data, unsigned int reference)
{
    if (is_parameter(reference) || is_input(reference)) {
        return NULL;
    }
    if (data->phase == INITIALIZING) {
        return fmi_initial(data);
    }
    if (MODE == FEEDFORWARD && data->phase == STEPPING) {
        fmi_refresh(data);
    }
    return NULL;
}

/* Correct the observer, once in each step for which its gain is valid. Returns NULL, or a warning. */
static const char *fmi_observe(fmi_data *data)
{
    const double step = (double)data->step, since = data->uncorrected;
    if (since < step * (1.0 - 1e-6)) {
        return NULL;
    }
    data->uncorrected = 0.0;
    if ((stickslip_correct(&data->plant, &data->state, data->input[1]) & STICKSLIP_ESTIMATE_LOST) != 0) {
        return "the estimate was lost: it was not finite, or farther from the measured position than the stage can go; "
               "it begins again at rest where that is";
    }
    return (since <= step * (1.0 + 1e-6))
        ? NULL : "the time since the last correction is longer than the step that the observer's gain is for";
}

/* Compute a communication step in equal internal steps. Returns NULL, or an error message; sets `warning` if there is
 * one. */
static const char *fmi_advance(fmi_data *data, double length, const char **warning)
{
    const double count = ceil(length / (double)data->step - 1e-6);
    if (!(length > 0.0) || !(count <= MOST_STEPS)) {
        return "the communication step is out of range: it must be > 0 s and at most 1e7 internal steps";
    }
    if (MODE == OBSERVER && length > (double)data->step * (1.0 + 1e-6)) {
        return "the communication step is longer than the step that the observer's gain is for: take that of the default "
               "experiment, or export the observer with the communication step as its step";
    }
    const long steps = (count < 1.0) ? 1L : (long)count;
    const double h = length / (double)steps;
    if (fabs(h - (double)data->plant.h) > 1e-9 * h) {
        const char *wrong = stickslip_init(&data->plant, &data->parameters, h);
        if (wrong != NULL) {
            return wrong;
        }
    }
    if (MODE == OBSERVER) {
        *warning = fmi_observe(data);
        data->uncorrected += length;
    }
    if (MODE != FEEDFORWARD) {
        for (long k = 0; k < steps; ++k) {
            const real_t begin = data->input[0] + data->slope * (real_t)((double)k * h);
            const real_t end = data->input[0] + data->slope * (real_t)((double)(k + 1) * h);
            const int bits = stickslip_step_ramp(&data->plant, &data->state, begin, end);
            if ((bits & STICKSLIP_NOT_FOLLOWED) != 0) {
                return "the integrator gave an internal step up: the parameters or the input are too extreme, or 'step' is too "
                       "long";
            }
            if ((bits & STICKSLIP_JUMPED) != 0) {
                return "the voltage jumps, and a static stage would jump with it, at infinite speed, at which a presliding "
                       "law has no meaning: give 'natural_frequency' a finite value, or the voltage its derivative (FMI 2 "
                       "only), with which one line ends where the next begins, or export the model with its amplifier";
            }
        }
    }
    data->time += length;
    fmi_refresh(data);
    if (!r_isfinite(data->outputs.end_effector_position)) {
        return "the motion is not finite: the parameters or the step are too extreme";
    }
    return NULL;
}

/* Return a value that the importer set. FMI has no infinity, so the largest double stands for it. */
static real_t fmi_number(double value)
{
    return (fabs(value) >= DBL_MAX) ? (real_t)copysign(INFINITY, value) : (real_t)value;
}

/* Check that a variable may be set in the present phase. Returns NULL, or an error message. */
static const char *fmi_forbidden(const fmi_data *data, unsigned int reference)
{
    if (is_parameter(reference)) {
        return (data->phase <= INITIALIZING) ? NULL : "a parameter can be set before the end of the initialisation only";
    }
    return is_input(reference) ? NULL : "an output cannot be set";
}

#endif
