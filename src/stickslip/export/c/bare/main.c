/* A timer interrupt plays the waveform table and steps the model: a plant for hardware in the loop, or the model
 * beside the real actuator. Put your converters where it says so.
 */
#include <stdint.h>

#include "stickslip.h"
#include "stickslip_waveform.h"

#define CLOCK 168000000.0 /* Hz, of the processor */

static volatile uint32_t *const TIMER = (volatile uint32_t *)0xE000E010u; /* SysTick: control, reload, value */

static stickslip_plant plant;
static stickslip_state state;
static const stickslip_player first = STICKSLIP_WAVEFORM_START;
static stickslip_player player = STICKSLIP_WAVEFORM_START;
static volatile real_t voltage_out, position_out; /* in place of two converters */

void timer_interrupt(void);

void timer_interrupt(void)
{
    real_t begin, end;
    if (!stickslip_play(&player, &begin, &end)) {
        player = first;
        (void)stickslip_play(&player, &begin, &end);
    }
    voltage_out = begin; /* write it to the DAC of the amplifier */
    (void)stickslip_step_ramp(&plant, &state, begin, end);
    position_out = stickslip_read(&plant, &state).end_effector_position; /* write it to the DAC of the "sensor" */
}

int main(void)
{
    const stickslip_parameters parameters = stickslip_default_parameters();
    if (stickslip_init(&plant, &parameters, STICKSLIP_WAVEFORM_STEP) != NULL) {
        return 1;
    }
    stickslip_rest(&plant, &state, STICKSLIP_REST_INPUT);
    TIMER[1] = (uint32_t)(CLOCK * STICKSLIP_WAVEFORM_STEP) - 1u;
    TIMER[2] = 0u;
    TIMER[0] = 7u; /* processor clock, interrupt, on */
    for (;;) {
        __asm volatile("wfi");
    }
}
