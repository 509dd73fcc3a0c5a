/* The engine: trajectories of plants. What Python, and exported C, call. */
#ifndef STICKSLIP_ENGINE_H
#define STICKSLIP_ENGINE_H

#include "plant.h"
#include "table.h"

#if defined STICKSLIP_GPU /* what is in the kernel */
#define STICKSLIP_API
#elif defined _WIN32
#define STICKSLIP_API __declspec(dllexport)
#else
#define STICKSLIP_API __attribute__((visibility("default")))
#endif

/* Outcomes of a run. LOG_FULL is no end: the log must be read and emptied before the run goes on; no caller sees it.
 * NO_NUMBER: the run came to its end, but a sample is no number. */
enum { DONE, STEP_TOO_SMALL, TOO_MANY_STEPS, LOG_FULL, STOPPED, NO_MEMORY, DOES_NOT_FIT, NOT_FOUND, NO_NUMBER };

/* One trajectory. Arrays belong to the caller. */
struct stickslip_task {
    const struct plant *plant;      /* composed, see stickslip_compose */
    const struct table *drive, *load; /* `load`: the normal force over its reference */
    real_t *state;                  /* [plant->states], at `begin`; becomes the state at the time reached */
    real_t begin, end;              /* s */
    real_t tolerance;               /* m, on positions */
    int64_t max_steps;              /* bound on accepted plus rejected steps */
    int64_t count;                  /* number of samples */
    const real_t *times;            /* [count], s, ascending, between begin and end */
    real_t *samples;                /* [count, states + elements (at least 1)], filled up to the time reached: states and
                                     * outputs of the elements */
    real_t *account;                /* [count, 4], the work of the drive (see `log.inl`), or NULL; changes no step */
    real_t *resume;                 /* [stickslip_resume_size], zeros to start from `state`; or NULL */
    const volatile int32_t *stop;   /* given up once this is not 0; or NULL */
    int32_t careful;                /* 1: small vibrations of contacts that stick are not to be lost */
};

struct stickslip_result {
    real_t reached;                 /* s */
    int64_t accepted, rejected;     /* steps */
};

/* Members of an ensemble, whose plants are of one layout. Arrays belong to the caller. */
struct stickslip_members {
    int64_t count;
    const struct plant *plants;     /* [count], composed */
    const struct table *drives;     /* [count] */
    const struct table *load;       /* the same for all */
    real_t *states;                 /* [count, states], at the start; become the states at the times reached */
    const real_t (*spans)[2];       /* [count], start and end, s */
    real_t tolerance;               /* m, on positions */
    int64_t max_steps;              /* of each */
    int64_t samples;                /* number of samples of each */
    const real_t *times;            /* [samples], s, ascending, inside each span */
    int64_t column;                 /* the state that is sampled */
    real_t *positions;              /* [count, samples], that state; NaN after the time reached */
    int64_t *outcomes;              /* [count]; members whose outcome is not DONE at the start are left out */
    real_t *reached;                /* [count], s */
    int64_t *steps;                 /* [count], accepted and rejected */
    const volatile int32_t *stop;   /* given up once this is not 0; or NULL */
    int32_t careful;                /* see `stickslip_task` */
};

/* A friction law under a prescribed motion. Arrays belong to the caller. */
struct stickslip_motion {
    const struct law *law;
    const real_t *parameters;       /* [elements or 1][law->parameters] */
    int64_t elements;               /* number of internal states; 0 for a static law */
    int64_t count;                  /* of samples, 2 at least */
    const real_t *time, *position;  /* [count], s and m; linear in between */
    const real_t *load;             /* [count], normal force over its reference, linear in between; 0 or more */
    real_t *state;                  /* [elements or 1] at the first sample; moved to the last one. Of a static law, the
                                     * force that it carries over its breakaway */
    real_t *samples;                /* [count, 1 + (elements or 1)]: force of the interval that ends there [N], state */
    real_t tolerance;               /* m, on each deflection over each step */
    const volatile int32_t *stop;   /* given up once this is not 0; or NULL */
    int32_t proportional;           /* 1: deflections stay when the normal force changes, instead of being renewed */
};

/* Forces of a law at given velocities and states. Arrays belong to the caller. */
struct stickslip_forces {
    const struct law *law;
    const real_t *parameters;       /* [elements or 1][law->parameters] */
    int64_t elements;               /* number of internal states; 0 for a static law */
    int64_t count;
    const real_t *velocity;         /* [count], m/s */
    const real_t *states;           /* [count, elements or 1]; of a static law, the direction */
    real_t *force;                  /* [count], N */
    const volatile int32_t *stop;   /* given up once this is not 0; or NULL */
};

/* Neighbours of a trajectory, of its layout: they take its steps. Arrays belong to the caller. */
struct stickslip_near {
    int64_t count;
    const struct plant *plants;     /* [count], composed */
    const struct table *drives;     /* [count], or NULL where all have the trajectory's: their segments are those of the
                                     * trajectory a little earlier or later, as their steps are then */
    real_t *states;                 /* [count, states], as that of the task */
    int64_t column;                 /* the state that is sampled */
    real_t *positions;              /* [count, samples], that state, filled up to the time reached */
    real_t end;                     /* s, when the trajectory ends */
    const real_t *ends;             /* [count], s, when they end; NULL without `drives` */
};

/* Periodic orbits of members, whose plants are of one layout. Arrays belong to the caller. */
struct stickslip_orbits {
    int64_t count;
    const struct plant *plants;     /* [count], composed */
    const struct table *drives;     /* [count] */
    const struct table *load;       /* the same for all */
    real_t *states;                 /* [count, states], from which they are looked for; become those on the orbits */
    const real_t *periods;          /* [count], s, of the drives */
    real_t tolerance;               /* m, on step and state */
    int64_t max_periods;            /* integrated for one orbit, at most */
    int64_t column;                 /* of the state, the position that moves on */
    int64_t *outcomes;              /* [count]; members whose outcome is not DONE at the start are left out */
    real_t *steps, *errors, *residuals; /* [count], m: net step, how far off it may be, the last correction */
    real_t *radius;                 /* [count], the largest multiplier in size */
    int64_t *tried;                 /* [count], periods integrated */
    real_t *jacobians;              /* [count, states, states], of the map over a period; zeros at the start */
    const volatile int32_t *stop;   /* given up once this is not 0; or NULL */
    int32_t smooth;                 /* 1: derivatives may be those of neighbours */
};

/* Whether an outcome ends a call for all members, and not for one alone. */
static inline bool ends_all(int outcome)
{
    return outcome == STOPPED || outcome == NO_MEMORY;
}

/* Completes a plant whose modes and elements are filled in. Returns DONE, or DOES_NOT_FIT if it is larger than the
 * engine's room. */
STICKSLIP_API int stickslip_compose(struct plant *plant);

/* How many numbers a row of continuation has. */
STICKSLIP_API int64_t stickslip_resume_size(const struct plant *plant);

/* Integrates one trajectory. Returns an outcome. */
STICKSLIP_API int stickslip_integrate(const struct stickslip_task *task, struct stickslip_result *result);

/* Integrates one trajectory, whose samples are at least one, with its neighbours. Returns an outcome. */
STICKSLIP_API int stickslip_integrate_near(const struct stickslip_task *task, const struct stickslip_near *near,
                                           struct stickslip_result *result);

/* Integrates the members. Returns DONE, or STOPPED or NO_MEMORY where the rest of them was not followed. */
STICKSLIP_API int stickslip_integrate_members(const struct stickslip_members *of);

/* Finds the orbits. Returns DONE, or STOPPED or NO_MEMORY where the rest of them was not looked for. */
STICKSLIP_API int stickslip_find_orbits(const struct stickslip_orbits *of);

/* Follows a motion; `reached`: the number of samples that are filled. Returns DONE, STEP_TOO_SMALL where the law could not
 * be followed to the next one, or STOPPED. */
STICKSLIP_API int stickslip_follow_motion(const struct stickslip_motion *of, int64_t *reached);

/* Computes forces. Returns DONE or STOPPED. */
STICKSLIP_API int stickslip_compute_forces(const struct stickslip_forces *of);

#endif
