/* Members of an ensemble: trajectories of plants with different numbers, one after the other. */
#include <stdlib.h>

#include "engine.h"

/* Integrate member m; `samples` has room for its samples, `columns` numbers each. */
static void follow_member(const struct stickslip_members *of, int64_t m, int64_t columns, real_t *samples)
{
    struct stickslip_result result = {of->spans[m][0], 0, 0};
    struct stickslip_task task = {
        .plant = &of->plants[m],
        .drive = &of->drives[m],
        .load = of->load,
        .state = of->states + m * of->plants[m].states,
        .begin = of->spans[m][0],
        .end = of->spans[m][1],
        .tolerance = of->tolerance,
        .max_steps = of->max_steps,
        .count = of->samples,
        .times = of->times,
        .samples = samples,
        .stop = of->stop,
        .careful = of->careful,
    };
    for (int64_t k = 0; k < of->samples; k++)
        samples[k * columns + of->column] = (real_t)NAN;
    of->outcomes[m] = stickslip_integrate(&task, &result);
    of->reached[m] = result.reached;
    of->steps[m] = result.accepted + result.rejected;
    for (int64_t k = 0; k < of->samples; k++)
        of->positions[m * of->samples + k] = samples[k * columns + of->column];
}

STICKSLIP_API int stickslip_integrate_members(const struct stickslip_members *of)
{
    if (of->count == 0)
        return DONE;
    const struct plant *P = of->plants;
    int64_t columns = P->states + (P->elements > 0 ? P->elements : 1);
    real_t *samples = malloc((size_t)(of->samples * columns + 1) * sizeof *samples);
    int outcome = samples == NULL ? NO_MEMORY : DONE;
    for (int64_t m = 0; m < of->count && outcome == DONE; m++) {
        if (of->outcomes[m] != DONE)
            continue;
        follow_member(of, m, columns, samples);
        if (ends_all((int)of->outcomes[m]))
            outcome = (int)of->outcomes[m];
    }
    free(samples);
    return outcome;
}
