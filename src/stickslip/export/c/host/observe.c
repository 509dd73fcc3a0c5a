/* Observer against open loop: the model follows a plant that has less friction than it thinks, from noisy samples of
 * the end-effector. Writes CSV: the plant, the model alone, the model corrected by what is measured. */
#include <stdio.h>

#include "stickslip.h"
#include "stickslip_waveform.h"

int main(void)
{
    stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant plant, model;
    stickslip_state truth, alone, observed;
    stickslip_player player = STICKSLIP_WAVEFORM_START;
    real_t begin = R(0.0), end = R(0.0);
    unsigned long random = 1UL;
    const char *wrong = stickslip_init(&model, &parameters, STICKSLIP_WAVEFORM_STEP);
    parameters.model.external_force += R(0.1) * model.holding; /* what the model does not know */
    if (wrong == NULL) {
        wrong = stickslip_init(&plant, &parameters, STICKSLIP_WAVEFORM_STEP);
    }
    if (wrong != NULL) {
        fprintf(stderr, "%s\n", wrong);
        return 1;
    }
    stickslip_rest(&plant, &truth, STICKSLIP_REST_INPUT);
    stickslip_rest(&model, &alone, STICKSLIP_REST_INPUT);
    observed = alone;
    puts("time,end_effector_position,model_alone,observer,stage_velocity,observer_stage_velocity");
    for (long step = 0; stickslip_play(&player, &begin, &end); ++step) {
        real_t noise = R(0.0);
        (void)stickslip_step_ramp(&plant, &truth, begin, end);
        (void)stickslip_step_ramp(&model, &alone, begin, end);
        (void)stickslip_step_ramp(&model, &observed, begin, end);
        for (int k = 0; k < 12; ++k) { /* about normal, standard deviation 1 */
            random = (1103515245UL * random + 12345UL) % 2147483648UL;
            noise += (real_t)random / R(2147483648.0) - R(0.5);
        }
        if (stickslip_correct(
                &model, &observed, truth.end_effector_position + STICKSLIP_MEASUREMENT_NOISE * noise) != STICKSLIP_OK) {
            fprintf(stderr, "%g s: the estimate was lost and begun again\n", (double)(step + 1) * STICKSLIP_WAVEFORM_STEP);
        }
        if (step % 50 == 0) {
            printf("%.9g,%.12g,%.12g,%.12g,%.9g,%.9g\n", (double)(step + 1) * STICKSLIP_WAVEFORM_STEP,
                   (double)truth.end_effector_position, (double)alone.end_effector_position,
                   (double)observed.end_effector_position,
                   (double)stickslip_read(&plant, &truth).stage_velocity,
                   (double)stickslip_read(&model, &observed).stage_velocity);
        }
    }
    return 0;
}
