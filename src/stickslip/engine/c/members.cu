/* Members of an ensemble on a GPU: each thread integrates one member, with the same steps as on a processor.
 *
 * NVRTC compiles this file for one layout of plants. `stickslip/engine/cuda.py` writes the layout's `layout.h`: the
 * sizes, the macros of `elements.inl`, the laws, and `fill_plant`. */
#define STICKSLIP_GPU
#ifdef __CUDACC__
#define UNROLL _Pragma("unroll 1")
#else
#define UNROLL
#endif
#include "layout.h"

#include "engine.h"

#include "contact.h"
#include "gpu.h"
#include "log.h"
#include "repeats.h"
#include "reversal.h"
#include "size.inl"

static struct table table_of(const struct gpu_table *of, int64_t which)
{
    struct table made = {of->segments, of->start + which * of->segments, NULL, of->first + which * (of->segments + 1), NULL};
    made.polynomial = (const real_t (*)[4])of->polynomial + which * of->segments;
    made.harmonic = (const real_t (*)[4])of->harmonic + which * of->harmonics;
    return made;
}

extern "C" __global__ void __launch_bounds__(THREADS, BLOCKS) stickslip_gpu_members(const struct gpu_members of)
{
    int64_t m = (int64_t)blockIdx.x * blockDim.x + threadIdx.x;
    if (m >= of.count || of.outcomes[m] != DONE)
        return;
    real_t numbers[NUMBERS];
    for (int k = 0; k < NUMBERS; k++)
        numbers[k] = of.numbers[k * of.count + m];
    struct plant P = {};
    fill_plant(&P, numbers);
    struct table drive = table_of(&of.drives, of.which[m]), load = table_of(&of.load, 0);
    struct stickslip_task task = {.plant = &P, .drive = &drive, .load = &load, .state = of.states + m * P.states,
                                  .begin = of.spans[2 * m], .end = of.spans[2 * m + 1], .tolerance = of.tolerance,
                                  .max_steps = of.max_steps, .careful = (int32_t)of.careful};
    struct stickslip_result result = {of.spans[2 * m], 0, 0};
    struct log none = {}; /* no log, and so no samples: they would need room for the steps of a period in each thread */
    struct journey_gpu J = {};
    of.outcomes[m] = travel_gpu(&J, &none, &task, &result);
    of.reached[m] = result.reached;
    of.steps[m] = result.accepted + result.rejected;
}
