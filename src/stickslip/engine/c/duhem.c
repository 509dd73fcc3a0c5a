/* Hysteresis dh/du = slope(u, h, up), see `stickslip/physics/piezo/duhem.py`. On each monotone section ("way") of a
 * drive it is computed in closed form or integrated. For the segments of a drive, -h is approximated by cubics. */
#include "cubics.h"
#include "duhem_laws.h"
#include "ways.h"

/* Shortest step of the integration, as a fraction of a way: 2^-40. */
#define DUHEM_LEAST_SHARE R(9.094947017729282e-13)
/* Largest number of steps on a way; if it is not enough, the result is NAN. */
#define DUHEM_MOST_STEPS 100000
/* Largest number of bisections, enough for the resolution of a double. */
#define DUHEM_BISECTIONS 100

static bool stopped(const struct duhem_model *of)
{
    return of->stop != NULL && *of->stop != 0;
}

static real_t slope_of(const struct duhem_model *of, real_t u, real_t h, real_t up)
{
    return of->of->slope(of->parameters, u, h, up);
}

/* Return h after one step du of the classical Runge-Kutta method of order 4. */
static real_t stepped(const struct duhem_model *of, real_t h, real_t u, real_t du)
{
    real_t up = du > R(0.0) ? R(1.0) : R(-1.0);
    real_t first = slope_of(of, u, h, up);
    real_t second = slope_of(of, u + R(0.5) * du, h + R(0.5) * du * first, up);
    real_t third = slope_of(of, u + R(0.5) * du, h + R(0.5) * du * second, up);
    real_t fourth = slope_of(of, u + du, h + du * third, up);
    return h + du / R(6.0) * (first + R(2.0) * second + R(2.0) * third + fourth);
}

/* Return h after a way from u to the goal, by integration with steps that are halved where the slope changes quickly;
 * NAN if this fails. */
static real_t integrated(const struct duhem_model *of, real_t h, real_t u, real_t goal)
{
    real_t whole = goal - u, share = R(1.0), done = R(0.0); /* fractions of the way: next step, and finished part */
    for (int steps = 0; steps < DUHEM_MOST_STEPS && done < R(1.0); steps++) {
        share = r_min(share, R(1.0) - done);
        real_t at = u + done * whole, du = share * whole;
        real_t coarse = stepped(of, h, at, du), half = stepped(of, h, at, R(0.5) * du);
        real_t fine = stepped(of, half, at + R(0.5) * du, R(0.5) * du);
        if (!r_isfinite(fine))
            break;
        if (r_abs(fine - coarse) <= of->exact || share <= DUHEM_LEAST_SHARE) {
            h = fine;
            done += share;
            share *= R(2.0);
        } else {
            share *= R(0.5);
        }
    }
    return done >= R(1.0) ? h : R(NAN);
}

/* Return h after a way of the drive from u to the goal. */
static real_t way_of(const struct duhem_model *of, real_t h, real_t u, real_t goal)
{
    return of->of->way != NULL ? of->of->way(of->parameters, h, u, goal) : integrated(of, h, u, goal);
}

STICKSLIP_API void stickslip_duhem_response(const struct duhem_model *of, int64_t count, const real_t *drive, real_t u,
                                            real_t h, real_t *out)
{
    for (int64_t k = 0; k < count && !stopped(of); k++) {
        h = way_of(of, h, u, drive[k]);
        u = drive[k];
        out[k] = u - h;
    }
}

STICKSLIP_API void stickslip_duhem_inverse(const struct duhem_model *of, int64_t count, const real_t *wanted, real_t u,
                                           real_t h, real_t least, real_t *out)
{
    for (int64_t k = 0; k < count && !stopped(of); k++) {
        real_t missing = wanted[k] - (u - h), low = u, high = u + missing / least;
        for (int halved = 0; halved < DUHEM_BISECTIONS; halved++) {
            real_t middle = R(0.5) * (low + high);
            if (middle == low || middle == high)
                break;
            if ((wanted[k] - (middle - way_of(of, h, u, middle))) * missing > R(0.0))
                low = middle;
            else
                high = middle;
        }
        h = way_of(of, h, u, low);
        out[k] = u = low;
    }
}

/* A way of segment i of a drive, in the direction `up` (1 or -1). */
struct course {
    const struct duhem_model *of;
    const struct table *drive;
    int64_t i;
    real_t up;
};

/* Return dh/dt at the time t. */
static real_t rate_of(const struct course *way, real_t t, real_t h)
{
    real_t u[DERIVATIVES];
    table_at(way->drive, way->i, t, u);
    return slope_of(way->of, u[VALUE], h, way->up) * u[SLOPE];
}

/* Return the end of a cubic piece from the time a, at most b, and replace h (its value at a) by its value there. The
 * cubic's error at a quarter, at the middle and at three quarters is at most `most`; the middle alone would not show
 * errors of odd symmetry. */
static real_t fitting(const struct course *way, real_t a, real_t b, real_t *h, real_t most)
{
    real_t u = value_at(way->drive, way->i, a), rise = rate_of(way, a, *h);
    for (;;) {
        real_t length = b - a, off = R(0.0), from = u, exact[4];
        for (int k = 0; k < 4; k++) {
            real_t to = value_at(way->drive, way->i, k == 3 ? b : a + R(0.25) * (real_t)(k + 1) * length);
            exact[k] = way_of(way->of, k == 0 ? *h : exact[k - 1], from, to);
            from = to;
        }
        real_t change = exact[3] - *h, begins = length * rise, ends = length * rate_of(way, b, exact[3]);
        real_t square = R(3.0) * change - R(2.0) * begins - ends, cube = begins + ends - R(2.0) * change;
        bool finite = true;
        for (int k = 0; k < 3; k++) {
            real_t s = R(0.25) * (real_t)(k + 1);
            real_t error = r_abs(*h + s * (begins + s * (square + s * cube)) - exact[k]);
            off = r_max(off, error);
            finite = finite && r_isfinite(error);
        }
        real_t middle = a + R(0.5) * length;
        if (!finite || off <= most || !(a < middle && middle < b)) {
            *h = exact[3];
            return b;
        }
        b = middle;
    }
}

/* Fill the pieces of a way from the time `a` to `to`, from row `count` on, and replace h at `a` by h at `to`. Return
 * the number of rows then, or -1 if there is no room. */
static int64_t way_pieces(const struct course *way, real_t a, real_t to, real_t *h, real_t most, const struct cubics *cubics,
                          int64_t count)
{
    const struct duhem *of = way->of->of;
    real_t u = value_at(way->drive, way->i, a), goal = value_at(way->drive, way->i, to), via = to;
    real_t bend = of->corner != NULL ? of->corner(way->of->parameters, *h, u, goal) : goal;
    if (bend != goal)
        via = reached(way->drive, way->i, a, to, bend);
    do {
        if (count == cubics->room)
            return -1;
        real_t after = *h, b = fitting(way, a, via, &after, most);
        if (b == via && via != to)
            after = R(0.0);
        struct cubic_piece piece = {
            a, way->i, b - a, -*h, -rate_of(way, a, *h), *h - after, -rate_of(way, b, after)};
        put_cubic(cubics, count++, &piece);
        a = b;
        *h = after;
        if (a >= via)
            via = to;
    } while (a < to && !stopped(way->of));
    return count;
}

STICKSLIP_API int64_t stickslip_duhem_cubics(const struct duhem_model *of, const struct table *drive, real_t end,
                                             real_t *state, real_t most, const struct cubics *cubics)
{
    int64_t count = 0;
    real_t u = state[0], h = state[1];
    for (int64_t i = 0; i < drive->segments && (i == 0 || drive->start[i] < end) && !stopped(of); i++) {
        real_t a = drive->start[i], last = way_end(drive, i, end), begins = value_at(drive, i, a);
        h = way_of(of, h, u, begins);
        u = begins;
        do {
            real_t to = turning(drive, i, a, last), goal = value_at(drive, i, to);
            struct course way = {of, drive, i, goal > u ? R(1.0) : R(-1.0)};
            count = way_pieces(&way, a, to, &h, most, cubics, count);
            if (count < 0)
                return -1;
            a = to;
            u = goal;
        } while (a < last && !stopped(of));
    }
    state[0] = u;
    state[1] = h;
    return count;
}

STICKSLIP_API const struct duhem *stickslip_packaged_duhem(int32_t i)
{
    const int32_t count = (int32_t)(sizeof packaged_duhem / sizeof *packaged_duhem);
    return (0 <= i && i < count) ? packaged_duhem[i] : NULL;
}
