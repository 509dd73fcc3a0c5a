/* Feedforward: the voltage for the wanted motion, played on the plant. Writes CSV with both motions. */
#include <stdio.h>

#include "stickslip.h"
#include "stickslip_motion.h"

int main(void)
{
    const stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant plant;
    stickslip_state state;
    stickslip_player player = STICKSLIP_MOTION_START;
    const real_t per_h = R(1.0 / STICKSLIP_MOTION_STEP);
    real_t now = R(0.0), next = R(0.0), last, origin, voltage = R(0.0), before;
    int bits = STICKSLIP_OK;
    const char *wrong = stickslip_init(&plant, &parameters, STICKSLIP_MOTION_STEP);
    if (wrong != NULL) {
        fprintf(stderr, "%s\n", wrong);
        return 1;
    }
    (void)stickslip_play(&player, &now, &next);
    origin = now;
    bits |= stickslip_feedforward(&plant, now, R(0.0), R(0.0), &voltage);
#if STICKSLIP_PIEZO
    bits |= stickslip_piezo_rest(&plant, &state, voltage, &voltage);
#else
    stickslip_rest(&plant, &state, voltage);
#endif
    origin -= state.end_effector_position;
    last = now;
    puts("time,wanted_position,end_effector_position,voltage,bits");
    for (long step = 0;; ++step) { /* central differences give velocity and acceleration */
        before = voltage;
        const real_t velocity = R(0.5) * (next - last) * per_h;
        const real_t acceleration = (next - R(2.0) * now + last) * per_h * per_h;
        bits |= stickslip_feedforward(&plant, now, velocity, acceleration, &voltage);
#if STICKSLIP_PIEZO
        bits |= stickslip_piezo_inverse(&plant, &state, voltage, &voltage);
#endif
        if (step > 0) {
            (void)stickslip_step_ramp(&plant, &state, before, voltage);
        }
        if (step % 50 == 0) {
            printf("%.9g,%.12g,%.12g,%.9g,%d\n", (double)step * STICKSLIP_MOTION_STEP, (double)now,
                   (double)(state.end_effector_position + origin), (double)voltage, bits);
        }
        last = now;
        now = next;
        if (!stickslip_play(&player, &before, &next)) {
            return 0;
        }
    }
}
