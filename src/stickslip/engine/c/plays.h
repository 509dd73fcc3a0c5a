/* Play operators and dead zones on values of a drive. H grows with u on each monotone way. H is linear in u between its
 * corners, where a play starts to move or a dead zone ends. The equations of one play are in `piezo_laws.h`. */
#ifndef STICKSLIP_PLAYS_H
#define STICKSLIP_PLAYS_H

#include "piezo.h"
#include "piezo_laws.h"

/* Relative rounding error: a play that is nearer to its edge counts as moving. */
#define PLAYS_ROUNDING R(1e-13)
/* Largest number of corners on one way, against endless loops; each corner is passed once. */
#define PLAYS_MOST_CORNERS 2000

/* Return the plays' input for the drive value u. */
static inline real_t plays_skewed(const struct plays *of, real_t u)
{
    real_t v = u;
    for (int64_t j = 0; j < of->zones; j++)
        v += of->skew[j] * (ss_beyond(u, of->zone[j]) - ss_beyond(R(0.0), of->zone[j]));
    return v;
}

/* Return the drive value for which the plays' input is v. */
static inline real_t plays_unskewed(const struct plays *of, real_t v)
{
    if (of->zones == 0)
        return v;
    real_t corner = of->zone[0];
    real_t at = plays_skewed(of, corner), slope = R(1.0); /* input at the corner, and its slope by u below the corner */
    real_t u = corner + (v - at);
    for (int64_t j = 0; j < of->zones; j++) {
        at += slope * (of->zone[j] - corner);
        corner = of->zone[j];
        slope += of->skew[j];
        if (v > at)
            u = corner + (v - at) / slope;
    }
    return u;
}

/* Update the plays' states for the drive value u. */
static inline void plays_taken_along(const struct plays *of, real_t u, real_t *z)
{
    real_t v = plays_skewed(of, u);
    for (int64_t i = 0; i < of->plays; i++)
        z[i] = ss_play(v, of->threshold[i], z[i]);
}

/* Return H [V] for the drive value u and the states z. */
static inline real_t plays_output(const struct plays *of, real_t u, const real_t *z)
{
    real_t total = R(0.0);
    for (int64_t i = 0; i < of->plays; i++)
        total += of->weight[i] * z[i];
    for (int64_t j = 0; j < of->zones; j++)
        total += of->slope[j] * ss_beyond(u, of->zone[j]);
    return total;
}

/* Return the largest number in the sum that gives the plays' input, apart from u itself. */
static inline real_t plays_furthest(const struct plays *of)
{
    real_t furthest = R(0.0);
    for (int64_t j = 0; j < of->zones; j++)
        furthest = r_max(furthest, r_abs(of->zone[j]));
    return furthest;
}

/* Return true if play i does not move yet at the input v, in the direction `up` (1 or -1): its edge is further away
 * than the rounding of the numbers in the sum. */
static inline bool plays_lacking(const struct plays *of, real_t v, const real_t *z, int64_t i, real_t up, real_t furthest)
{
    real_t r = of->threshold[i];
    return up * (z[i] - v) + r > PLAYS_ROUNDING * (r_abs(v) + r + furthest);
}

/* Return the next corner of H beyond the drive value u, in the direction `up` (1 or -1); infinite if there is none. */
static inline real_t plays_next_corner(const struct plays *of, real_t u, const real_t *z, real_t up)
{
    real_t v = plays_skewed(of, u), furthest = plays_furthest(of), nearest = R(INFINITY);
    for (int64_t i = 0; i < of->plays; i++)
        if (plays_lacking(of, v, z, i, up, furthest))
            nearest = r_min(nearest, up * z[i] + of->threshold[i]);
    real_t corner = nearest < R(INFINITY) ? up * plays_unskewed(of, up * nearest) : nearest;
    for (int64_t j = 0; j < of->zones; j++)
        if (up * of->zone[j] > up * u)
            corner = r_min(corner, up * of->zone[j]);
    return up * corner;
}

/* Return dH/du just beyond u, in the direction `up`. */
static inline real_t plays_steepness(const struct plays *of, real_t u, const real_t *z, real_t up)
{
    real_t along = R(0.0), beside = R(0.0), share = R(1.0);
    real_t v = plays_skewed(of, u), furthest = plays_furthest(of);
    for (int64_t i = 0; i < of->plays; i++)
        if (!plays_lacking(of, v, z, i, up, furthest))
            along += of->weight[i];
    for (int64_t j = 0; j < of->zones; j++) {
        if (u > of->zone[j] || (up > R(0.0) && u == of->zone[j])) {
            share += of->skew[j];
            beside += of->slope[j];
        }
    }
    return along * share + beside;
}

/* Return the drive value for which H has the wanted value, starting from u and the states z, which are updated; NaN if
 * there is none. */
static inline real_t plays_solved(const struct plays *of, real_t u, real_t *z, real_t wanted)
{
    real_t missing = wanted - plays_output(of, u, z);
    real_t up = missing > R(0.0) ? R(1.0) : R(-1.0);
    for (int passed = 0; passed < PLAYS_MOST_CORNERS && missing != R(0.0); passed++) {
        real_t corner = plays_next_corner(of, u, z, up), slope = plays_steepness(of, u, z, up);
        if (slope > R(0.0) && r_abs(missing) <= slope * r_abs(corner - u)) {
            u += missing / slope;
            missing = R(0.0);
        } else if (r_isinf(corner) || slope < R(0.0)) {
            break;
        } else {
            missing -= slope * (corner - u);
            u = corner;
        }
        plays_taken_along(of, u, z);
    }
    return missing == R(0.0) ? u : R(NAN);
}

#endif
