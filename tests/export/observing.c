/* An exact model observes the example's plant from samples with noise. Prints the rms error of the end-effector's
 * position (m), that of the samples, how often the estimate was lost, and the error at the end. */
#include <stdio.h>
#include <stdlib.h>

#include "stickslip.h"
#include "stickslip_waveform.h"

int main(int count, char **arguments)
{
    stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant model;
    stickslip_state truth, observed;
    stickslip_player player = STICKSLIP_WAVEFORM_START;
    real_t begin = R(0.0), end = R(0.0);
    unsigned long random = 1UL;
    const double jump = (count > 1) ? atof(arguments[1]) : 0.0; /* m, of the estimate, NaN too, at its 100th step */
    double sum = 0.0, raw = 0.0, last = 0.0;
    long steps = 0, lost = 0;
    if (stickslip_init(&model, &parameters, STICKSLIP_WAVEFORM_STEP) != NULL) {
        return 1;
    }
    stickslip_rest(&model, &truth, STICKSLIP_REST_INPUT);
    observed = truth;
    for (; stickslip_play(&player, &begin, &end); ++steps) {
        real_t noise = R(0.0);
        (void)stickslip_step_ramp(&model, &truth, begin, end);
        (void)stickslip_step_ramp(&model, &observed, begin, end);
        if (steps == 100) {
            observed.end_effector_position += (real_t)jump;
        }
        for (int k = 0; k < 12; ++k) {
            random = (1103515245UL * random + 12345UL) % 2147483648UL;
            noise += (real_t)random / R(2147483648.0) - R(0.5);
        }
        noise *= STICKSLIP_MEASUREMENT_NOISE;
        const int bits = stickslip_correct(&model, &observed, truth.end_effector_position + noise);
        lost += (bits & STICKSLIP_ESTIMATE_LOST) != 0;
        last = (double)(observed.end_effector_position - truth.end_effector_position);
        sum += last * last;
        raw += (double)(noise * noise);
    }
    printf("%.9g %.9g %ld %.9g\n", sqrt(sum / (double)steps), sqrt(raw / (double)steps), lost, last);
    return 0;
}
