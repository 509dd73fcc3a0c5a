/* Effects of a piezo on a drive: play operators with dead zones, creep, hysteresis of Duhem's form. Functions for
 * Python.
 *
 * They work on samples, or on the segment tables of drives (see `table.h`), from which they compute the segments of the
 * free stroke. Functions that fill rows return the number of rows, or -1 if there is no room. */
#ifndef STICKSLIP_PIEZO_H
#define STICKSLIP_PIEZO_H

#include "engine.h"

/* Operator H[u] of `stickslip/physics/piezo/operators.py`: plays with the half-width `threshold` [V] and the weight
 * `weight`; dead zones that end at `zone` [V], ascending, beyond which H has the additional slope `slope`, and the
 * input of the plays the additional slope `skew`. */
struct plays {
    int64_t plays, zones;
    const real_t *threshold, *weight;   /* [plays] */
    const real_t *zone, *slope, *skew;  /* [zones] */
};

/* First-order lags of creep: time constant `tau` and share of each. */
struct lags {
    int64_t count;
    const real_t *tau;              /* [count], s */
    const real_t *share;            /* [count] */
};

/* Hysteresis of the kind dh/du = slope(p, u, h, up), H = u - h [V], of `stickslip/physics/piezo/duhem.py`. `p` points
 * to the numbers of the model's record in Python; `up` is 1 for a rising and -1 for a falling drive. */
typedef real_t duhem_slope_fn(const real_t *p, real_t u, real_t h, real_t up);

/* h after a monotone way of the drive from u to the goal, in closed form. */
typedef real_t duhem_way_fn(const real_t *p, real_t h, real_t u, real_t goal);

/* Drive value on this way at which h is 0 and the slope jumps; the goal if there is none. */
typedef real_t duhem_corner_fn(const real_t *p, real_t h, real_t u, real_t goal);

struct duhem {
    const char *name;               /* name of the record in Python */
    int parameters;                 /* length of p */
    duhem_slope_fn *slope;
    duhem_way_fn *way;              /* NULL: the slope is integrated numerically */
    duhem_corner_fn *corner;        /* NULL: the slope has no jump */
};

struct duhem_model {
    const struct duhem *of;
    const real_t *parameters;
    real_t exact;                   /* allowed error of h in one step of the integration, V */
    const volatile int32_t *stop;   /* the computation is stopped as soon as this is not 0; or NULL */
};

/* Pieces of the output for a drive: from `start` [s] on, level + slope (u(t) - u(start)), where u is segment `source`
 * of the drive. */
struct pieces {
    int64_t room;
    real_t *start;
    int64_t *source;
    real_t *slope, *level;
};

/* Cubics that are added to segments: from `start` [s] on, to the segment `source`. */
struct cubics {
    int64_t room;
    real_t *start;
    int64_t *source;
    real_t (*cubic)[4];
};

/* Return the plays' input for a drive value u; and the drive value for which the plays' input is v. */
STICKSLIP_API real_t stickslip_plays_skewed(const struct plays *of, real_t u);
STICKSLIP_API real_t stickslip_plays_unskewed(const struct plays *of, real_t v);

/* Compute H at each sample of a drive. `z` [plays] are the initial states, and are replaced by those at the end. */
STICKSLIP_API void stickslip_plays_response(const struct plays *of, int64_t count, const real_t *drive, real_t *z,
                                            real_t *out);

/* Compute the state of each play at each sample, out[sample][play]; z as for the response. */
STICKSLIP_API void stickslip_plays_states(const struct plays *of, int64_t count, const real_t *drive, real_t *z,
                                          real_t *out);

/* Compute the drive for which H has the wanted value at each sample, starting from the drive u and the states z, which
 * are updated; NaN if there is none. */
STICKSLIP_API void stickslip_plays_inverse(const struct plays *of, int64_t count, const real_t *wanted, real_t u, real_t *z,
                                           real_t *out);

/* Fill the pieces for a drive up to `end` [s]; z are the initial states, and are replaced by those at the end. */
STICKSLIP_API int64_t stickslip_plays_split(const struct plays *of, const struct table *drive, real_t end, real_t *z,
                                            const struct pieces *pieces);

/* Compute the lags of a signal that is linear between samples, exactly: out[sample][lag]. x [lags] are the initial
 * states, and are replaced by those at the end. */
STICKSLIP_API void stickslip_lags_relaxed(const struct lags *of, int64_t count, const real_t *times, const real_t *values,
                                          real_t *x, real_t *out);

/* Remove creep from `values`: compute h, linear between the times, for which h plus the sum of shares times lags of h
 * has these values. x are the initial states, and are updated. */
STICKSLIP_API void stickslip_lags_undone(const struct lags *of, int64_t count, const real_t *times, const real_t *values,
                                         real_t *x, real_t *out);

/* Fill the cubics of the creep of a drive's polynomials up to `end` [s], with an error of at most `most` [V]. x are the
 * initial states, and are replaced by those at the end. The creep of the drive's harmonics is left to the caller. */
STICKSLIP_API int64_t stickslip_lags_cubics(const struct lags *of, const struct table *drive, real_t end, real_t *x,
                                            real_t most, const struct cubics *cubics);

/* Compute H at each sample of a drive, starting from the drive u and the state h. */
STICKSLIP_API void stickslip_duhem_response(const struct duhem_model *of, int64_t count, const real_t *drive, real_t u,
                                            real_t h, real_t *out);

/* Compute the drive for which H has the wanted value at each sample, starting from the drive u and the state h. The
 * slope of H by u must be at least `least` > 0. */
STICKSLIP_API void stickslip_duhem_inverse(const struct duhem_model *of, int64_t count, const real_t *wanted, real_t u,
                                           real_t h, real_t least, real_t *out);

/* Fill the cubics of -h for a drive up to `end` [s], with an error of at most `most` [V]. `state` is (u, h) at the
 * start, and is replaced by the values at the end. */
STICKSLIP_API int64_t stickslip_duhem_cubics(const struct duhem_model *of, const struct table *drive, real_t end,
                                             real_t *state, real_t most, const struct cubics *cubics);

/* Return the i-th kind of hysteresis of the package; NULL after the last one. */
STICKSLIP_API const struct duhem *stickslip_packaged_duhem(int32_t i);

#endif
