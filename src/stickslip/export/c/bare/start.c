/* Start of a Cortex-M4F without any vendor's library: vectors, FPU on, memory, main. */
#include <stdint.h>

extern uint32_t memory_top, data_load, data_begin, data_end, zero_begin, zero_end; /* board.ld */

int main(void);
void reset(void);
void stop(void);
void timer_interrupt(void) __attribute__((weak, alias("stop")));

void stop(void)
{
    for (;;) {
    }
}

void reset(void)
{
    volatile uint32_t *const coprocessors = (volatile uint32_t *)0xE000ED88u;
    *coprocessors |= 0xFu << 20;
    __asm volatile("dsb\n isb");
    const uint32_t *from = &data_load;
    for (uint32_t *to = &data_begin; to < &data_end; ++to) {
        *to = *from++;
    }
    for (uint32_t *to = &zero_begin; to < &zero_end; ++to) {
        *to = 0u;
    }
    (void)main();
    stop();
}

typedef void (*handler)(void);

__attribute__((section(".vectors"), used)) static const struct {
    const uint32_t *stack;
    handler handlers[15];
} vectors = {
    &memory_top,
    {reset, stop, stop, stop, stop, stop, 0, 0, 0, 0, stop, stop, 0, stop, timer_interrupt}};
