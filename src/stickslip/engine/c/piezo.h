/* What a piezo makes of a drive: play operators with dead zones, creep, hysteresis of Duhem's form. What Python calls.
 *
 * On samples, and on the segment tables of drives (see `table.h`), of which these make the segments of the free stroke.
 * Functions that fill rows give how many there are, or -1 if there is no room for them. */
#ifndef STICKSLIP_PIEZO_H
#define STICKSLIP_PIEZO_H

#include "engine.h"

/* H[u] of `stickslip/physics/piezo/operators.py`: plays of half-width `threshold` [V] and share `weight`, and dead zones that end
 * at `zone` [V], ascending, with the share `slope` beyond, and what plays see more there, `skew`. */
struct plays {
    int64_t plays, zones;
    const real_t *threshold, *weight;   /* [plays] */
    const real_t *zone, *slope, *skew;  /* [zones] */
};

/* First-order lags: creep. */
struct lags {
    int64_t count;
    const real_t *tau;              /* [count], s */
    const real_t *share;            /* [count] */
};

/* A kind of hysteresis dh/du = slope(p, u, h, up), H = u - h [V], of `stickslip/physics/piezo/duhem.py`. `p` points to the
 * numbers of its record in Python. */
typedef real_t duhem_slope_fn(const real_t *p, real_t u, real_t h, real_t up);

/* h after a way from u to the goal, in closed form. */
typedef real_t duhem_way_fn(const real_t *p, real_t h, real_t u, real_t goal);

/* Where h comes to 0 on that way, and the slope jumps; the goal if nowhere. */
typedef real_t duhem_corner_fn(const real_t *p, real_t h, real_t u, real_t goal);

struct duhem {
    const char *name;               /* of its record in Python */
    int parameters;                 /* length of p */
    duhem_slope_fn *slope;
    duhem_way_fn *way;              /* NULL: the slope is integrated */
    duhem_corner_fn *corner;        /* NULL: it jumps nowhere */
};

struct duhem_model {
    const struct duhem *of;
    const real_t *parameters;
    real_t exact;                   /* V, of h over one step of integration */
    const volatile int32_t *stop;   /* given up once this is not 0; or NULL */
};

/* What segments become: from `start` [s] on, level + slope (u(t) - u(start)) of the segment `source`. */
struct pieces {
    int64_t room;
    real_t *start;
    int64_t *source;
    real_t *slope, *level;
};

/* What is added to segments: cubics, from `start` [s] on, to the segment `source`. */
struct cubics {
    int64_t room;
    real_t *start;
    int64_t *source;
    real_t (*cubic)[4];
};

/* What plays see of the drive value u, and the drive value of which they see v. */
STICKSLIP_API real_t stickslip_plays_skewed(const struct plays *of, real_t u);
STICKSLIP_API real_t stickslip_plays_unskewed(const struct plays *of, real_t v);

/* H at each sample of a drive, from the states z [plays], which are left as they are at the end. */
STICKSLIP_API void stickslip_plays_response(const struct plays *of, int64_t count, const real_t *drive, real_t *z,
                                            real_t *out);

/* The state of each play at each sample, out[sample][play]. */
STICKSLIP_API void stickslip_plays_states(const struct plays *of, int64_t count, const real_t *drive, real_t *z,
                                          real_t *out);

/* The drive at which H is as wanted at each sample, from the drive u and the states z on; NaN where none gives it. */
STICKSLIP_API void stickslip_plays_inverse(const struct plays *of, int64_t count, const real_t *wanted, real_t u, real_t *z,
                                           real_t *out);

/* Fills the pieces of a drive up to `end` [s]; z are the states before, and at the end those then. */
STICKSLIP_API int64_t stickslip_plays_split(const struct plays *of, const struct table *drive, real_t end, real_t *z,
                                            const struct pieces *pieces);

/* The lags of what is joined by lines, exactly: out[sample][lag], from the states x [lags] on, which are left as they are
 * at the end. */
STICKSLIP_API void stickslip_lags_relaxed(const struct lags *of, int64_t count, const real_t *times, const real_t *values,
                                          real_t *x, real_t *out);

/* What creeps into `values` at the times: h of h + sum of shares x lags of h, joined by lines, from the states x on. */
STICKSLIP_API void stickslip_lags_undone(const struct lags *of, int64_t count, const real_t *times, const real_t *values,
                                         real_t *x, real_t *out);

/* Fills the cubics of what creep adds to the polynomials of a drive up to `end` [s], off by at most `most` [V]; x are the
 * states at the start, and at the end those then. The creep of harmonics is left to the caller. */
STICKSLIP_API int64_t stickslip_lags_cubics(const struct lags *of, const struct table *drive, real_t end, real_t *x,
                                            real_t most, const struct cubics *cubics);

/* H at each sample of a drive, from the drive u and the state h on. */
STICKSLIP_API void stickslip_duhem_response(const struct duhem_model *of, int64_t count, const real_t *drive, real_t u,
                                            real_t h, real_t *out);

/* The drive at which H is as wanted at each sample, from the drive u and the state h on; H must grow with u by the slope
 * `least` at least. */
STICKSLIP_API void stickslip_duhem_inverse(const struct duhem_model *of, int64_t count, const real_t *wanted, real_t u,
                                           real_t h, real_t least, real_t *out);

/* Fills the cubics of -h of a drive up to `end` [s], off by at most `most` [V]; state: (u, h) before, and those at the end
 * then. */
STICKSLIP_API int64_t stickslip_duhem_cubics(const struct duhem_model *of, const struct table *drive, real_t end,
                                             real_t *state, real_t most, const struct cubics *cubics);

/* The i-th kind of the package; NULL after the last one. */
STICKSLIP_API const struct duhem *stickslip_packaged_duhem(int32_t i);

#endif
