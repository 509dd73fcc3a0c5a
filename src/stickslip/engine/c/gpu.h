/* Members of an ensemble on a GPU, whose plants are of one layout. Arrays lie in the GPU's memory. */
#ifndef STICKSLIP_GPU_H
#define STICKSLIP_GPU_H

struct gpu_table {
    int64_t segments, harmonics;    /* of each table */
    const real_t *start, *polynomial, *harmonic; /* [tables, segments], [tables, segments, 4], [tables, harmonics, 4] */
    const int64_t *first;           /* [tables, segments + 1] */
};

struct gpu_members {
    int64_t count;
    const real_t *numbers;          /* [numbers, count], of the plants, in the order of `layout.h` */
    struct gpu_table drives, load;  /* of the load there is one table, for all */
    const int64_t *which;           /* [count], the drive of each */
    real_t *states;                 /* [count, states], at the start; become the states at the times reached */
    const real_t *spans;            /* [count, 2], start and end, s */
    int64_t *outcomes;              /* [count]; members whose outcome is not DONE at the start are left out */
    real_t *reached;                /* [count], s */
    int64_t *steps;                 /* [count], accepted and rejected */
    real_t tolerance;               /* m, on positions */
    int64_t max_steps;              /* of each */
    int64_t careful;                /* see `stickslip_task` */
};

#endif
