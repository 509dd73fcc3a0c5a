/* The engine, which integrates trajectories of plants: functions for Python and for exported C. */
#ifndef STICKSLIP_ENGINE_H
#define STICKSLIP_ENGINE_H

#include "plant.h"
#include "table.h"

#if defined STICKSLIP_GPU /* compiled into the kernel of a GPU */
#define STICKSLIP_API
#elif defined _WIN32
#define STICKSLIP_API __declspec(dllexport)
#else
#define STICKSLIP_API __attribute__((visibility("default")))
#endif

/* Outcomes of a run. LOG_FULL is internal: the log must be read and emptied before the run continues. With NO_NUMBER
 * the run reached its end, but a sample is infinite or NaN. The others are explained at the functions. */
enum { DONE, STEP_TOO_SMALL, TOO_MANY_STEPS, LOG_FULL, STOPPED, NO_MEMORY, DOES_NOT_FIT, NOT_FOUND, NO_NUMBER };

/* One trajectory. Arrays belong to the caller. For a rotary plant m is rad, and N is N m. */
struct stickslip_task {
    const struct plant *plant;      /* completed by stickslip_compose */
    const struct table *drive, *load; /* `load`: normal force relative to its reference, over time */
    real_t *state;                  /* [plant->states], state at `begin`; replaced by the state at the time reached */
    real_t begin, end;              /* start and end of the run, s */
    real_t tolerance;               /* allowed error of positions, m */
    int64_t max_steps;              /* largest number of accepted and rejected steps together */
    int64_t count;                  /* number of samples */
    const real_t *times;            /* [count], times of the samples, s, ascending, between begin and end */
    real_t *samples;                /* [count, states + elements (at least 1)]: state, and outputs of the elements, at
                                     * each sample; filled up to the time reached */
    real_t *account;                /* [count, 4], integrals of the work of the drive (see `reading.inl`), or NULL; it
                                     * affects no step */
    real_t *resume;                 /* [stickslip_resume_size], point from which a later call continues: zeros to start
                                     * from `state`; or NULL */
    const volatile int32_t *stop;   /* the run is stopped as soon as this is not 0; or NULL */
    int32_t careful;                /* 1: tolerance that resolves small vibrations of sticking contacts */
};

struct stickslip_result {
    real_t reached;                 /* time reached, s */
    int64_t accepted, rejected;     /* numbers of steps */
};

/* Members of an ensemble: trajectories of plants with the same layout. Arrays belong to the caller. */
struct stickslip_members {
    int64_t count;
    const struct plant *plants;     /* [count], completed by stickslip_compose */
    const struct table *drives;     /* [count], drive of each member */
    const struct table *load;       /* normal force relative to its reference, the same for all members */
    real_t *states;                 /* [count, states], initial states; replaced by the states at the times reached */
    const real_t (*spans)[2];       /* [count], start and end of each trajectory, s */
    real_t tolerance;               /* allowed error of positions, m */
    int64_t max_steps;              /* largest number of steps of each member */
    int64_t samples;                /* number of samples of each member */
    const real_t *times;            /* [samples], s, ascending, within each span */
    int64_t column;                 /* index of the state that is sampled */
    real_t *positions;              /* [count, samples], this state; NaN after the time reached */
    int64_t *outcomes;              /* [count], outcome of each member; members whose outcome is not DONE at the start
                                     * are left out */
    real_t *reached;                /* [count], time reached, s */
    int64_t *steps;                 /* [count], number of accepted and rejected steps */
    const volatile int32_t *stop;   /* the run is stopped as soon as this is not 0; or NULL */
    int32_t careful;                /* as in `stickslip_task` */
};

/* A friction law under a given motion. Arrays belong to the caller. */
struct stickslip_motion {
    const struct law *law;
    const real_t *parameters;       /* [elements or 1][law->parameters] */
    int64_t elements;               /* number of internal states; 0 for a static law */
    int64_t count;                  /* number of samples, at least 2 */
    const real_t *time, *position;  /* [count], s and m; the position is linear in between */
    const real_t *load;             /* [count], normal force relative to its reference, at least 0; linear in between */
    real_t *state;                  /* [elements or 1], state at the first sample; replaced by the state at the last
                                     * one. For a static law: the force at rest over the breakaway force */
    real_t *samples;                /* [count, 1 + (elements or 1)]: force in the interval before the sample [N], then
                                     * the state */
    real_t tolerance;               /* allowed error of each deflection in each step, m */
    const volatile int32_t *stop;   /* the run is stopped as soon as this is not 0; or NULL */
    int32_t proportional;           /* 1: deflections stay as they are when the normal force changes; 0: newly loaded
                                     * contact starts without deflection */
};

/* Forces of a friction law at given velocities and states. Arrays belong to the caller. */
struct stickslip_forces {
    const struct law *law;
    const real_t *parameters;       /* [elements or 1][law->parameters] */
    int64_t elements;               /* number of internal states; 0 for a static law */
    int64_t count;
    const real_t *velocity;         /* [count], sliding velocity, m/s */
    const real_t *states;           /* [count, elements or 1]; for a static law the direction of sliding, -1 or 1 */
    real_t *force;                  /* [count], result, N */
    const volatile int32_t *stop;   /* the run is stopped as soon as this is not 0; or NULL */
};

/* Neighbours of a trajectory: slightly different plants or states of the same layout, integrated with the trajectory's
 * own steps. Their differences give derivatives (see `near.inl`). Arrays belong to the caller. */
struct stickslip_near {
    int64_t count;
    const struct plant *plants;     /* [count], completed by stickslip_compose */
    const struct table *drives;     /* [count], drive of each neighbour, or NULL if all have the trajectory's drive;
                                     * their segments may start a little earlier or later than the trajectory's, and so
                                     * do their steps then */
    real_t *states;                 /* [count, states], as `state` of the task */
    int64_t column;                 /* index of the state that is sampled */
    real_t *positions;              /* [count, samples of the task], this state; filled up to the time reached */
    real_t end;                     /* end of the trajectory, s */
    const real_t *ends;             /* [count], end of each neighbour, s; NULL if `drives` is NULL */
};

/* Periodic orbits of members: plants with the same layout under periodic drives. Arrays belong to the caller. */
struct stickslip_orbits {
    int64_t count;
    const struct plant *plants;     /* [count], completed by stickslip_compose */
    const struct table *drives;     /* [count], drive of each member */
    const struct table *load;       /* normal force relative to its reference, the same for all members */
    real_t *states;                 /* [count, states], initial states; replaced by states on the orbits */
    const real_t *periods;          /* [count], periods of the drives, s */
    real_t tolerance;               /* allowed error of the net step and of the state, m */
    int64_t max_periods;            /* largest number of periods that are integrated for one orbit */
    int64_t column;                 /* index of the state whose change in a period is the net step: the position that
                                     * moves on */
    int64_t *outcomes;              /* [count], outcome of each member; members whose outcome is not DONE at the start
                                     * are left out */
    real_t *steps, *errors, *residuals; /* [count], m: net step, its error, and the size of the last correction */
    real_t *radius;                 /* [count], largest modulus of the multipliers (eigenvalues of the map over a
                                     * period) */
    int64_t *tried;                 /* [count], number of integrated periods */
    real_t *jacobians;              /* [count, states, states], derivatives of the map over a period; zeros at the
                                     * start */
    const volatile int32_t *stop;   /* the run is stopped as soon as this is not 0; or NULL */
    int32_t smooth;                 /* 1: derivatives are computed from neighbours that take the trajectory's steps; 0:
                                     * from separate trajectories */
};

/* Return true if an outcome ends a call for all members, and not for one of them alone. */
static inline bool ends_all(int outcome)
{
    return outcome == STOPPED || outcome == NO_MEMORY;
}

/* Complete a plant whose modes and elements are filled in. Return DONE, or DOES_NOT_FIT if the plant has more modes,
 * elements or states than LARGEST_MODES, LARGEST_ELEMENTS or LARGEST_STATES. */
STICKSLIP_API int stickslip_compose(struct plant *plant);

/* Return the length of `resume` in `stickslip_task`. */
STICKSLIP_API int64_t stickslip_resume_size(const struct plant *plant);

/* Integrate one trajectory. Return DONE, STEP_TOO_SMALL, TOO_MANY_STEPS, STOPPED, NO_MEMORY or NO_NUMBER. */
STICKSLIP_API int stickslip_integrate(const struct stickslip_task *task, struct stickslip_result *result);

/* Integrate one trajectory, which must have at least one sample, together with its neighbours. Return as
 * stickslip_integrate. */
STICKSLIP_API int stickslip_integrate_near(const struct stickslip_task *task, const struct stickslip_near *near,
                                           struct stickslip_result *result);

/* Integrate the members. Return DONE, or STOPPED or NO_MEMORY if the remaining members were not integrated. */
STICKSLIP_API int stickslip_integrate_members(const struct stickslip_members *of);

/* Find the orbits. Return DONE, or STOPPED or NO_MEMORY if the remaining orbits were not computed. */
STICKSLIP_API int stickslip_find_orbits(const struct stickslip_orbits *of);

/* Compute the forces of a law under a motion; `reached` is the number of filled samples. Return DONE, STEP_TOO_SMALL if
 * the law could not be integrated to the next sample, or STOPPED. */
STICKSLIP_API int stickslip_follow_motion(const struct stickslip_motion *of, int64_t *reached);

/* Compute forces. Return DONE or STOPPED. */
STICKSLIP_API int stickslip_compute_forces(const struct stickslip_forces *of);

#endif
