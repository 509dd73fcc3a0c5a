/* Play operators on samples, and on the segments of a drive, without approximation: H is linear in u between its
 * corners. Each segment of the drive becomes pieces of the same formula, times H's slope, plus a level. */
#include "plays.h"

#include "ways.h"

STICKSLIP_API real_t stickslip_plays_skewed(const struct plays *of, real_t u)
{
    return plays_skewed(of, u);
}

STICKSLIP_API real_t stickslip_plays_unskewed(const struct plays *of, real_t v)
{
    return plays_unskewed(of, v);
}

STICKSLIP_API void stickslip_plays_response(const struct plays *of, int64_t count, const real_t *drive, real_t *z,
                                            real_t *out)
{
    for (int64_t k = 0; k < count; k++) {
        plays_taken_along(of, drive[k], z);
        out[k] = plays_output(of, drive[k], z);
    }
}

STICKSLIP_API void stickslip_plays_states(const struct plays *of, int64_t count, const real_t *drive, real_t *z,
                                          real_t *out)
{
    for (int64_t k = 0; k < count; k++) {
        plays_taken_along(of, drive[k], z);
        for (int64_t i = 0; i < of->plays; i++)
            out[k * of->plays + i] = z[i];
    }
}

STICKSLIP_API void stickslip_plays_inverse(const struct plays *of, int64_t count, const real_t *wanted, real_t u, real_t *z,
                                           real_t *out)
{
    for (int64_t k = 0; k < count; k++)
        out[k] = u = plays_solved(of, u, z, wanted[k]);
}

/* Present point on a segment of the drive: the time [s], the drive value there, and the number of pieces so far. */
struct way {
    real_t at, u;
    int64_t count;
};

/* Fill the pieces of one monotone way of segment i, up to the time `to`, cut at the corners of H. Return false if there
 * is no room. */
static bool split_way(const struct plays *of, const struct table *drive, int64_t i, real_t to, real_t *z, struct way *way,
                      const struct pieces *pieces)
{
    real_t goal = value_at(drive, i, to), up = goal > way->u ? R(1.0) : R(-1.0);
    for (;;) {
        if (way->count == pieces->room)
            return false;
        pieces->start[way->count] = way->at;
        pieces->source[way->count] = i;
        pieces->slope[way->count] = goal != way->u ? plays_steepness(of, way->u, z, up) : R(0.0);
        pieces->level[way->count] = plays_output(of, way->u, z);
        way->count++;
        real_t corner = plays_next_corner(of, way->u, z, up);
        if (goal == way->u || up * corner >= up * goal)
            break;
        way->at = reached(drive, i, way->at, to, corner);
        way->u = corner;
        plays_taken_along(of, corner, z);
    }
    way->at = to;
    way->u = goal;
    plays_taken_along(of, goal, z);
    return true;
}

STICKSLIP_API int64_t stickslip_plays_split(const struct plays *of, const struct table *drive, real_t end, real_t *z,
                                            const struct pieces *pieces)
{
    struct way way = {R(0.0), R(0.0), 0};
    for (int64_t i = 0; i < drive->segments && (i == 0 || drive->start[i] < end); i++) {
        real_t last = way_end(drive, i, end);
        way.at = drive->start[i];
        way.u = value_at(drive, i, way.at);
        plays_taken_along(of, way.u, z);
        do {
            if (!split_way(of, drive, i, turning(drive, i, way.at, last), z, &way, pieces))
                return -1;
        } while (way.at < last);
    }
    return way.count;
}
