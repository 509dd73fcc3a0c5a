/* Linear map of a small disturbance over one period: the periodic orbit that it leads to, and its growth. Matrices are
 * [n, n], by rows. */
#ifndef STICKSLIP_LINEAR_H
#define STICKSLIP_LINEAR_H

#include "law.h"

static inline void swap(real_t *a, real_t *b)
{
    real_t kept = *a;
    *a = *b;
    *b = kept;
}

/* Exchange rows and columns so that a[k, k] is the entry of largest modulus in the rows from k on and the columns from
 * k to `end`. */
static void pivot(int n, int k, int end, real_t *a, real_t *x, int *order)
{
    int row = k, column = k;
    for (int i = k; i < n; i++)
        for (int j = k; j < end; j++)
            if (r_abs(a[i * n + j]) > r_abs(a[row * n + column])) {
                row = i;
                column = j;
            }
    for (int j = 0; j < n; j++)
        swap(&a[k * n + j], &a[row * n + j]);
    for (int i = 0; i < n; i++)
        swap(&a[i * n + k], &a[i * n + column]);
    swap(&x[k], &x[row]);
    int kept = order[k];
    order[k] = order[column];
    order[column] = kept;
}

/* Return in x the step from a state to the periodic orbit, to first order: x = (I - J)^-1 defect. `defect` is the
 * change of the state in a period, J the derivative of the map over a period.
 *
 * Gaussian elimination in `a`, with complete pivoting: first of the `bodies` first entries, then of the others. `scale`
 * converts all entries to metres. Directions of the others that change by at most the fraction `least` in a period stay
 * as they are. x is infinite if there is no orbit. */
static void to_orbit(int n, const real_t *J, const real_t *defect, const real_t *scale, int bodies, real_t least, real_t *a,
                     int *order, real_t *x)
{
    int rank = n;
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++)
            a[i * n + j] = ((i == j ? R(1.0) : R(0.0)) - J[i * n + j]) * scale[i] / scale[j];
        x[i] = defect[i] * scale[i];
        order[i] = i;
    }
    for (int k = 0; k < n; k++) {
        pivot(n, k, k < bodies ? bodies : n, a, x, order);
        if (!(r_abs(a[k * n + k]) > (k < bodies ? R(0.0) : least))) {
            rank = k;
            break;
        }
        for (int i = k + 1; i < n; i++) {
            real_t share = a[i * n + k] / a[k * n + k];
            for (int j = k; j < n; j++)
                a[i * n + j] -= share * a[k * n + j];
            x[i] -= share * x[k];
        }
    }
    for (int i = rank; i < n; i++)
        x[i] = least > R(0.0) && rank >= bodies ? R(0.0) : R(INFINITY);
    for (int i = rank - 1; i >= 0; i--) {
        for (int j = i + 1; j < n; j++)
            x[i] -= a[i * n + j] * x[j];
        x[i] /= a[i * n + i];
    }
    for (int k = 0; k < n; k++)
        a[order[k]] = x[k] / scale[order[k]];
    for (int k = 0; k < n; k++)
        x[k] = a[k];
}

/* Return the largest modulus of the eigenvalues, from the norm of the matrix after repeated squaring; `a` and `b` are
 * workspace. */
static real_t spectral_radius(int n, const real_t *J, const real_t *scale, int squarings, real_t *a, real_t *b)
{
    real_t logarithm = R(0.0), weight = R(1.0);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++)
            a[i * n + j] = J[i * n + j] * scale[i] / scale[j];
    for (int s = 0; s < squarings; s++) {
        real_t norm = R(0.0);
        for (int i = 0; i < n * n; i++)
            norm = r_max(norm, r_abs(a[i]));
        if (!(norm > R(0.0)))
            return norm;
        logarithm += weight * r_log(norm);
        weight *= R(0.5);
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) {
                real_t total = R(0.0);
                for (int k = 0; k < n; k++)
                    total += (a[i * n + k] / norm) * (a[k * n + j] / norm);
                b[i * n + j] = total;
            }
        real_t *kept = a;
        a = b;
        b = kept;
    }
    return r_exp(logarithm);
}

#endif
