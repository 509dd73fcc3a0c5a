/* Rest at the first number of the standard input, then a step at each of the others: the voltage at the actuator, the
 * position and the bits after it. */
#include <stdio.h>
#include <stdlib.h>

#include "stickslip.h"

int main(void)
{
    const stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant plant;
    stickslip_state state;
    char word[40];
    int bits = STICKSLIP_OK;
    if (stickslip_init(&plant, &parameters, 20e-6) != NULL) {
        return 1;
    }
    for (long tick = 0; scanf("%39s", word) == 1; ++tick) {
        const real_t input = (real_t)strtod(word, NULL);
        if (tick == 0) {
            stickslip_rest(&plant, &state, input);
        } else {
            bits = stickslip_step(&plant, &state, input);
        }
        const stickslip_outputs out = stickslip_read(&plant, &state);
        printf("%.17g %.17g %d\n", (double)out.drive_voltage, (double)out.end_effector_position, bits);
    }
    return 0;
}
