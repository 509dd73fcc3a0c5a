/* Plays the waveform table on the plant and writes what happens as CSV: ./walk > walk.csv */
#include <math.h>
#include <stdio.h>

#include "stickslip.h"
#include "stickslip_waveform.h"

#ifndef ROWS_PER_SECOND
#define ROWS_PER_SECOND 1000.0
#endif

int main(void)
{
    const stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant plant;
    stickslip_state state;
    stickslip_player player = STICKSLIP_WAVEFORM_START;
    real_t begin = R(0.0), end = R(0.0);
    const double h = STICKSLIP_WAVEFORM_STEP;
    const long every = (1.0 / (ROWS_PER_SECOND * h) > 1.0) ? lround(1.0 / (ROWS_PER_SECOND * h)) : 1L;
    const char *wrong = stickslip_init(&plant, &parameters, h);
    int bits = STICKSLIP_OK;
    if (wrong != NULL) {
        fprintf(stderr, "%s\n", wrong);
        return 1;
    }
    stickslip_rest(&plant, &state, STICKSLIP_REST_INPUT);
    puts("time,drive_voltage,stage_position,end_effector_position,friction_force");
    for (long step = 0;; ++step) {
        if (step % every == 0) {
            const stickslip_outputs out = stickslip_read(&plant, &state);
            printf("%.9g,%.9g,%.12g,%.12g,%.9g\n", (double)step * h, (double)out.drive_voltage,
                   (double)out.stage_position, (double)out.end_effector_position, (double)out.friction_force);
        }
        if (!stickslip_play(&player, &begin, &end)) {
            break;
        }
        bits |= stickslip_step_ramp(&plant, &state, begin, end);
    }
    if ((bits & STICKSLIP_JUMPED) != 0) {
        fputs("walk: the waveform jumps, which a static stage with a presliding law cannot follow: the motion is wrong\n",
              stderr);
    }
    if (STICKSLIP_WAVEFORM_JUMPS_BETWEEN) {
        fprintf(stderr, "walk: the waveform jumps between two steps of %.3g s, and is played over one: export with a shorter "
                "step, or with one of which its period is a multiple\n", h);
    }
    if (STICKSLIP_WAVEFORM_MISSED > 0.0) {
        fprintf(stderr, "walk: within a step of %.3g s the waveform differs by up to %.3g %s from the straight line that is "
                "played: export with a shorter step, or with one that ends at each corner of the waveform\n",
                h, STICKSLIP_WAVEFORM_MISSED, STICKSLIP_WAVEFORM_UNIT);
    }
    if ((bits & STICKSLIP_NOT_FOLLOWED) != 0) {
        fputs("walk: the integrator gave a step up: STICKSLIP_MOST_TRIES are too few, or the numbers too extreme; the motion "
              "is wrong\n", stderr);
    }
    return 0;
}
