/* Plays the waveform table on the plant and writes what happens as CSV: ./walk > walk.csv
 * It walks in half the step beside it, and says where that leads elsewhere. */
#include <math.h>
#include <stdio.h>

#include "stickslip.h"
#include "stickslip_halved.h"
#include "stickslip_waveform.h"

#ifndef ROWS_PER_SECOND
#define ROWS_PER_SECOND 1000.0
#endif

#ifndef MOST_OF_PATH
#define MOST_OF_PATH 0.005 /* that half the step may lead elsewhere; an error of order 1 is twice that */
#endif

static void play(const stickslip_plant *plant, stickslip_state *state, stickslip_player *player)
{
    real_t begin = R(0.0), end = R(0.0);
    if (stickslip_play(player, &begin, &end)) {
        (void)stickslip_step_ramp(plant, state, begin, end);
    }
}

int main(void)
{
    const stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant plant, halved;
    stickslip_state state, finer;
    stickslip_player player = STICKSLIP_WAVEFORM_START, halves = STICKSLIP_HALVED_START;
    real_t begin = R(0.0), end = R(0.0);
    const double h = STICKSLIP_WAVEFORM_STEP;
    const long every = (1.0 / (ROWS_PER_SECOND * h) > 1.0) ? lround(1.0 / (ROWS_PER_SECOND * h)) : 1L;
    const char *wrong = stickslip_init(&plant, &parameters, h);
    double apart = 0.0, path = 0.0, last = NAN;
    int bits = STICKSLIP_OK;
    if (wrong == NULL) {
        wrong = stickslip_init(&halved, &parameters, STICKSLIP_HALVED_STEP);
    }
    if (wrong != NULL) {
        fprintf(stderr, "%s\n", wrong);
        return 1;
    }
    stickslip_rest(&plant, &state, STICKSLIP_REST_INPUT);
    stickslip_rest(&halved, &finer, STICKSLIP_REST_INPUT);
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
        play(&halved, &finer, &halves);
        play(&halved, &finer, &halves);
        {
            const double position = (double)stickslip_read(&halved, &finer).end_effector_position;
            const double off = (double)stickslip_read(&plant, &state).end_effector_position - position;
            apart = fmax(apart, fabs(off));
            path += isnan(last) ? 0.0 : fabs(position - last);
            last = position;
        }
    }
    if ((bits & STICKSLIP_JUMPED) != 0) {
        fputs("walk: the waveform jumps, which a static stage with a presliding law cannot follow: the motion is wrong\n",
              stderr);
    } else if (!(apart <= MOST_OF_PATH * path)) {
        fprintf(stderr,
                "walk: %.3g s is too long a step for this contact and drive: in half of it the end-effector is up to "
                "%.3g elsewhere, %.2g %% of its path\n",
                h, apart, 100.0 * apart / path);
    }
    return 0;
}
