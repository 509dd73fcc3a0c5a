/* What a piezo makes of a drive: play operators with dead zones, creep, hysteresis of Duhem's form. What Python calls.
 *
 * On samples, and on the segment tables of drives (see `table.h`), of which these make the segments of the free stroke.
 * Functions that fill rows give how many there are, or -1 if there is no room for them. */
#ifndef STICKSLIP_PIEZO_H
#define STICKSLIP_PIEZO_H

#include "engine.h"

/* H[u] of `stickslip/piezo/operators.py`: plays of half-width `threshold` [V] and share `weight`, and dead zones that end
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

#endif
