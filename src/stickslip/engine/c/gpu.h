/* Members of an ensemble on a GPU: plants with the same layout. Arrays are in the GPU's memory. */
#ifndef STICKSLIP_GPU_H
#define STICKSLIP_GPU_H

struct gpu_table {
    int64_t segments, harmonics;    /* numbers in each table */
    const real_t *start, *polynomial, *harmonic; /* [tables, segments], [tables, segments, 4], [tables, harmonics, 4] */
    const int64_t *first;           /* [tables, segments + 1] */
};

struct gpu_members {
    int64_t count;
    const real_t *numbers;          /* [numbers, count], numbers of the plants, in the order of `layout.h` */
    struct gpu_table drives, load;  /* `load` has one table, for all members */
    const int64_t *which;           /* [count], index of each member's table in `drives` */
    real_t *states;                 /* [count, states], initial states; replaced by the states at the times reached */
    const real_t *spans;            /* [count, 2], start and end, s */
    int64_t *outcomes;              /* [count], outcome of each member; members whose outcome is not DONE at the start
                                     * are left out */
    real_t *reached;                /* [count], time reached, s */
    int64_t *steps;                 /* [count], number of accepted and rejected steps */
    real_t tolerance;               /* allowed error of positions, m */
    int64_t max_steps;              /* largest number of steps of each member */
    int64_t careful;                /* as in `stickslip_task` */
};

#endif
