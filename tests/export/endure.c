/* Random input, held and in ramps, with jumps and wrong numbers in it; prints the largest of what must stay bounded. */
#include <stdio.h>
#include <stdlib.h>

#include "stickslip.h"

int main(int count, char **arguments)
{
    stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant plant;
    stickslip_state state;
    const long steps = (count > 1) ? atol(arguments[1]) : 1000000L;
    const double h = (count > 2) ? atof(arguments[2]) : 20e-6;
    unsigned long long random = 88172645463325252ULL;
    double force = 0.0, velocity = 0.0, stage = 0.0;
    const char *wrong = stickslip_init(&plant, &parameters, h);
    if (wrong != NULL) {
        fprintf(stderr, "%s\n", wrong);
        return 1;
    }
    stickslip_rest(&plant, &state, R(0.0));
    for (long k = 0; k < steps; ++k) {
        random ^= random << 13; /* xorshift */
        random ^= random >> 7;
        random ^= random << 17;
        const real_t volts = (real_t)(200.0 * (double)(random >> 11) / 9007199254740992.0 - 25.0);
        if (random % 1009ULL == 0ULL) {
            (void)stickslip_step(&plant, &state, (random & 4096ULL) ? R(NAN) : R(INFINITY));
        } else if (random & 8192ULL) {
            (void)stickslip_step_ramp(&plant, &state, state.input, volts);
        } else {
            (void)stickslip_step(&plant, &state, volts);
        }
        const double f = fabs((double)stickslip_read(&plant, &state).friction_force), v = fabs((double)state.end_effector_velocity);
        const double y = fabs((double)state.stage_position);
        if (!(f < 1e12) || !(v < 1e6) || !(y < 1.0) || !(fabs((double)state.end_effector_position) < 1e6)) {
            fprintf(stderr, "step %ld: force %g, velocity %g, stage %g\n", k, f, v, y);
            return 1;
        }
        force = (f > force) ? f : force;
        velocity = (v > velocity) ? v : velocity;
        stage = (y > stage) ? y : stage;
    }
    printf("%.9g %.9g %.9g\n", force, velocity, stage);
    return 0;
}
