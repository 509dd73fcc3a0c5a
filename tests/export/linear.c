/* What a step makes of a small change of each part of the state at rest: the matrix, a column a line. */
#include <stdio.h>
#include <stdlib.h>

#include "stickslip.h"

static void parts(const stickslip_state *state, double part[5])
{
    part[0] = (double)state->stage_position;
    part[1] = (double)state->stage_velocity;
    part[2] = (double)state->end_effector_position;
    part[3] = (double)state->end_effector_velocity;
    part[4] = (double)state->internal[0];
}

int main(int count, char **arguments)
{
    stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant plant;
    const double h = (count > 1) ? atof(arguments[1]) : 20e-6;
    const double small[5] = {1e-11, 1e-7, 1e-11, 1e-7, 1e-11};
    if (stickslip_init(&plant, &parameters, h) != NULL) {
        return 1;
    }
    for (int j = 0; j < 5; ++j) {
        double after[2][5];
        for (int side = 0; side < 2; ++side) {
            const real_t by = (real_t)((side == 0) ? -small[j] : small[j]);
            stickslip_state state;
            stickslip_rest(&plant, &state, R(0.0));
            state.stage_position += (j == 0) ? by : R(0.0);
            state.stage_velocity += (j == 1) ? by : R(0.0);
            state.end_effector_position += (j == 2) ? by : R(0.0);
            state.end_effector_velocity += (j == 3) ? by : R(0.0);
            for (int i = 0; i < STICKSLIP_STATES; ++i) {
                state.internal[i] += ((j == 4) && !STICKSLIP_STATIC_LAW) ? by : R(0.0);
            }
            (void)stickslip_step(&plant, &state, R(0.0));
            parts(&state, after[side]);
        }
        for (int i = 0; i < 5; ++i) {
            printf("%.9g ", (after[1][i] - after[0][i]) / (2.0 * small[j]));
        }
        puts("");
    }
    return 0;
}
