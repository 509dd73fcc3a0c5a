/* Counts the instructions of each step on QEMU's Cortex-M4, over the waveform and then over random input, and
 * prints the mean and the most. make count runs it: with -icount shift=6 an instruction takes 64 ns of the virtual
 * clock, and the timer runs at 25 MHz, so 1.6 ticks are one instruction.
 */
#include <stdint.h>

#include "stickslip.h"
#include "stickslip_waveform.h"

#define RANDOM_STEPS 20000L

static volatile uint32_t *const TIMER = (volatile uint32_t *)0xE000E010u;
static stickslip_plant plant;
static stickslip_state state;

static void semihost(int operation, const void *argument)
{
    register int r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void print_number(const char *label, uint32_t number)
{
    char text[12];
    int at = 11;
    text[at--] = '\0';
    text[at--] = '\n';
    do {
        text[at--] = (char)('0' + (char)(number % 10u));
        number /= 10u;
    } while (number != 0u);
    semihost(4, label);
    semihost(4, &text[at + 1]);
}

static uint32_t timed(real_t begin, real_t end)
{
    TIMER[2] = 0u;
    const uint32_t before = TIMER[2];
    (void)stickslip_step_ramp(&plant, &state, begin, end);
    const uint32_t after = TIMER[2];
    return (((before - after) & 0xFFFFFFu) * 10u) / 16u;
}

int main(void)
{
    const stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_player player = STICKSLIP_WAVEFORM_START;
    uint32_t most = 0u, steps = 0u, random = 1u;
    uint64_t sum = 0u;
    real_t begin, end, last = R(0.0);
    if (stickslip_init(&plant, &parameters, STICKSLIP_WAVEFORM_STEP) != NULL) {
        return 1;
    }
    stickslip_rest(&plant, &state, STICKSLIP_REST_INPUT);
    TIMER[1] = 0xFFFFFFu;
    TIMER[0] = 5u; /* processor clock, on */
    player.repeats = 1;
    while (stickslip_play(&player, &begin, &end)) {
        const uint32_t count = timed(begin, end);
        most = (count > most) ? count : most;
        sum += count;
        ++steps;
    }
    for (long k = 0; k < RANDOM_STEPS; ++k) {
        random = 1664525u * random + 1013904223u;
        const real_t next = (real_t)random * R(150.0 / 4294967296.0);
        const uint32_t count = timed(last, next);
        last = next;
        most = (count > most) ? count : most;
        sum += count;
        ++steps;
    }
    print_number("steps ", steps);
    print_number("instructions per step, mean ", (uint32_t)(sum / steps));
    print_number("instructions per step, most ", most);
    semihost(0x18, (const void *)0x20026); /* end */
    return 0;
}
