/* Creep: first-order lags, for samples and for the segments of a drive.
 *
 * Each lag of each segment's polynomial is computed in closed form, x += z sum_j c_j L^j I_j(z) - ..., and approximated
 * by cubics (see `stickslip/simulation/plant/creeping.py`). The equations are in `piezo_laws.h`. */
#include "cubics.h"
#include "piezo_laws.h"
#include "ways.h"

/* Error bound of a cubic through values and slopes at both ends, per fourth derivative and fourth power of the length
 * (Hermite interpolation). */
#define CREEP_HERMITE (R(1.0) / R(384.0))

STICKSLIP_API void stickslip_lags_relaxed(const struct lags *of, int64_t count, const real_t *times, const real_t *values,
                                          real_t *x, real_t *out)
{
    for (int64_t k = 0; k < count; k++) {
        for (int64_t i = 0; i < of->count; i++) {
            if (k > 0)
                x[i] += ss_lag_change(of->tau[i], times[k] - times[k - 1], x[i], values[k - 1], values[k]);
            out[k * of->count + i] = x[i];
        }
    }
}

STICKSLIP_API void stickslip_lags_undone(const struct lags *of, int64_t count, const real_t *times, const real_t *values,
                                         real_t *x, real_t *out)
{
    for (int64_t k = 0; k < count; k++) {
        real_t known = R(0.0), slope = R(1.0);
        for (int64_t i = 0; i < of->count; i++) {
            if (k > 0) { /* lags without the effect of the unknown h at this sample, and the effect per unit of h */
                real_t step = times[k] - times[k - 1];
                x[i] += ss_lag_change(of->tau[i], step, x[i], out[k - 1], R(0.0));
                slope += of->share[i] * ss_lag_change(of->tau[i], step, R(0.0), R(0.0), R(1.0));
            }
            known += of->share[i] * x[i];
        }
        out[k] = (values[k] - known) / slope;
        for (int64_t i = 0; k > 0 && i < of->count; i++)
            x[i] += ss_lag_change(of->tau[i], times[k] - times[k - 1], R(0.0), R(0.0), R(1.0)) * out[k];
    }
}

/* Return the steady-state response of a lag with the time constant `tau` to the harmonics of segment i, `at` [s] after
 * the segment's start. */
static real_t of_harmonics(const struct table *drive, int64_t i, real_t at, real_t tau)
{
    real_t found = R(0.0);
    for (int64_t row = drive->first[i]; row < drive->first[i + 1]; row++) {
        const real_t *wave = drive->harmonic[row];
        real_t turn = wave[1] * tau, late = wave[2] - r_atan(turn) + wave[1] * at;
        found += wave[0] / r_sqrt(R(1.0) + turn * turn) * r_sin(late);
    }
    return found;
}

/* Compute the coefficients of segment i's polynomial for an origin `tau` [s] after the segment's start. */
static void polynomial_from(const struct table *drive, int64_t i, real_t tau, real_t moved[4])
{
    const real_t *c = drive->polynomial[i];
    moved[0] = cubic_at(c, tau);
    moved[1] = cubic_slope(c, tau);
    moved[2] = c[2] + R(3.0) * tau * c[3];
    moved[3] = c[3];
}

/* Return the number of equal parts (1, 2, 4, ...) of the time `left` [s] for which a cubic over the first part is
 * within the error `most` [V]. `c` is the polynomial of the drive, `x` the states of the lags. */
static real_t parts_of(const struct lags *of, const real_t c[4], const real_t *x, real_t left, real_t most)
{
    real_t fourth = R(0.0), parts = R(1.0);
    for (int64_t k = 0; k < of->count; k++) {
        real_t tau = of->tau[k], slope = (c[0] - x[k]) / tau, curvature = (c[1] - slope) / tau;
        real_t third = (R(2.0) * c[2] - curvature) / tau;
        fourth += r_abs(of->share[k] * (R(6.0) * c[3] - third) / tau);
    }
    for (;; parts *= R(2.0)) {
        real_t square = (left / parts) * (left / parts);
        if (!(CREEP_HERMITE * fourth * square * square > most))
            return parts;
    }
}

/* Fill a piece with the sum of all lags, times their shares, for the drive's polynomial c; move the states x to its
 * end. */
static void creep_piece(const struct lags *of, const real_t c[4], real_t *x, struct cubic_piece *piece)
{
    real_t length = piece->length, value = cubic_at(c, length);
    piece->value = piece->rise = piece->change = piece->fall = R(0.0);
    for (int64_t k = 0; k < of->count; k++) {
        real_t tau = of->tau[k], share = of->share[k], z = length / tau;
        const ss_weights_result w = ss_weights(z);
        real_t by = z * (w.i0 * (c[0] - x[k]) + length * (w.i1 * c[1] + length * (w.i2 * c[2] + length * w.i3 * c[3])));
        piece->value += share * x[k];
        piece->rise += share * (c[0] - x[k]) / tau;
        x[k] += by;
        piece->change += share * by;
        piece->fall += share * (value - x[k]) / tau;
    }
}

/* Fill the pieces of segment i from row `count` on, up to the time `stop` [s]. Return the number of rows then, or -1 if
 * there is no room. */
static int64_t creep_segment(const struct lags *of, const struct table *drive, int64_t i, real_t stop, real_t *x,
                             real_t most, const struct cubics *cubics, int64_t count)
{
    real_t begin = drive->start[i], a = begin, c[4];
    do {
        if (count == cubics->room)
            return -1;
        polynomial_from(drive, i, a - begin, c);
        real_t left = stop - a, parts = parts_of(of, c, x, left, most);
        real_t b = parts == R(1.0) || !(a < a + left / parts) ? stop : a + left / parts;
        struct cubic_piece piece = {.at = a, .source = i, .length = b - a};
        creep_piece(of, c, x, &piece);
        put_cubic(cubics, count++, &piece);
        a = b;
    } while (a < stop);
    return count;
}

STICKSLIP_API int64_t stickslip_lags_cubics(const struct lags *of, const struct table *drive, real_t end, real_t *x,
                                            real_t most, const struct cubics *cubics)
{
    int64_t count = 0;
    for (int64_t i = 0; i < drive->segments && (i == 0 || drive->start[i] < end) && count >= 0; i++) {
        real_t last = way_end(drive, i, end);
        for (int64_t k = 0; k < of->count; k++)
            x[k] -= of_harmonics(drive, i, R(0.0), of->tau[k]);
        count = creep_segment(of, drive, i, last, x, most, cubics, count);
        for (int64_t k = 0; k < of->count; k++)
            x[k] += of_harmonics(drive, i, last - drive->start[i], of->tau[k]);
    }
    return count;
}
