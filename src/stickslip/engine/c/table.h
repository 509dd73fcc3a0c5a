/* Drive and load as the integrator evaluates them: tables of segments (see `stickslip/waveform/drive.py`). */
#ifndef STICKSLIP_TABLE_H
#define STICKSLIP_TABLE_H

#include <stdint.h>

#include "rodas5p.h"

/* A function of time in segments. On segment i, from start[i] on, with the local time tau, it is the sum of a cubic and
 * of the harmonics first[i] .. first[i + 1] - 1, each amplitude * sin(phase + omega * tau + chirp * tau^2). The last
 * segment has no end. */
struct table {
    int64_t segments;
    const real_t *start;            /* [segments], s, ascending */
    const real_t (*polynomial)[4];  /* [segments], coefficients c_0 .. c_3 */
    const int64_t *first;           /* [segments + 1] */
    const real_t (*harmonic)[4];    /* amplitude, omega [rad/s], phase [rad], chirp [rad/s^2] */
};

/* Values of a table at a time: the function and its first three derivatives by time. */
enum { VALUE, SLOPE, CURVATURE, THIRD, DERIVATIVES };

/* Times in a step at which tables are evaluated: the six distinct nodes of Rodas5P, and the middle of the step. */
enum { AT_START = 0, AT_END = 5, AT_MIDDLE = 6, INSTANTS = 7 };

/* Return a cubic, and its derivative, at tau. */
static inline real_t cubic_at(const real_t *c, real_t tau)
{
    return c[0] + tau * (c[1] + tau * (c[2] + tau * c[3]));
}

static inline real_t cubic_slope(const real_t *c, real_t tau)
{
    return c[1] + tau * (R(2.0) * c[2] + tau * R(3.0) * c[3]);
}

static inline void table_polynomial(const struct table *table, int64_t i, real_t tau, real_t *u)
{
    const real_t *c = table->polynomial[i];
    u[VALUE] = cubic_at(c, tau);
    u[SLOPE] = cubic_slope(c, tau);
    u[CURVATURE] = R(2.0) * c[2] + R(6.0) * c[3] * tau;
    u[THIRD] = R(6.0) * c[3];
}

/* Compute u and its derivatives at the time t, by the formula of segment i. */
static inline void table_at(const struct table *table, int64_t i, real_t t, real_t *u)
{
    real_t tau = t - table->start[i];
    table_polynomial(table, i, tau, u);
    for (int64_t row = table->first[i]; row < table->first[i + 1]; row++) {
        const real_t *wave = table->harmonic[row];
        real_t chirp = wave[3], rate = wave[1] + R(2.0) * chirp * tau;
        real_t angle = wave[2] + tau * (wave[1] + chirp * tau);
        real_t sine = wave[0] * r_sin(angle), cosine = wave[0] * r_cos(angle);
        u[VALUE] += sine;
        u[SLOPE] += rate * cosine;
        u[CURVATURE] += R(2.0) * chirp * cosine - rate * rate * sine;
        u[THIRD] -= rate * (R(6.0) * chirp * sine + rate * rate * cosine);
    }
}

/* Compute u and its derivatives at all nodes of a step of length h that starts at t. */
static inline void table_at_nodes(const struct table *table, int64_t i, real_t t, real_t h, real_t u[INSTANTS][DERIVATIVES])
{
    real_t tau = t - table->start[i];
    if (table->first[i] == table->first[i + 1]) {
        for (int node = 0; node < INSTANTS; node++)
            table_polynomial(table, i, tau + RODAS_NODES[node] * h, u[node]);
    } else {
        for (int node = 0; node < INSTANTS; node++)
            table_at(table, i, t + RODAS_NODES[node] * h, u[node]);
    }
}

/* As `table_at_nodes`, but compute only the values, and the slope at the start of the step. */
static inline void table_values_at_nodes(const struct table *table, int64_t i, real_t t, real_t h,
                                         real_t u[INSTANTS][DERIVATIVES])
{
    if (table->first[i] != table->first[i + 1]) {
        table_at_nodes(table, i, t, h, u);
        return;
    }
    real_t tau = t - table->start[i];
    const real_t *c = table->polynomial[i];
    for (int node = 0; node < INSTANTS; node++)
        u[node][VALUE] = cubic_at(c, tau + RODAS_NODES[node] * h);
    u[AT_START][SLOPE] = cubic_slope(c, tau);
}

/* Return the segment that contains the time t; at a break, the later one. */
static inline int64_t table_segment_of(const struct table *table, real_t t)
{
    int64_t low = 0, high = table->segments;
    while (high - low > 1) {
        int64_t middle = (low + high) / 2;
        if (table->start[middle] <= t)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Return true if there is a segment after i, and it has started at the time t. */
static inline bool table_next_has_begun(const struct table *table, int64_t i, real_t t)
{
    return i + 1 < table->segments && table->start[i + 1] <= t;
}

/* Return the end of segment i, at most t_end. */
static inline real_t table_next_break(const struct table *table, int64_t i, real_t t_end)
{
    return i + 1 < table->segments ? r_min(t_end, table->start[i + 1]) : t_end;
}

#endif
