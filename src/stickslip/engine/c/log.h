/* The log of steps, and the row of numbers from which a run continues to the last bit. */
#ifndef STICKSLIP_LOG_H
#define STICKSLIP_LOG_H

#include "table.h"

/* Rows of a log: more than a period needs at any tolerance in use. A period that does not fit is never copied. */
#define LOG_ROWS 1024

/* Columns of the log: a step's start, its length, where it ends, the fraction of it that counts; then the sides of the
 * contacts, the branches of the internal states (if there are any), the states at both ends, and the continuous
 * extension. LAUNCHED instead of the fraction: no step but the first moment of a slip. */
enum { LOG_START, LOG_LENGTH, LOG_END, LOG_FRACTION, LOG_SIDES };
#define LAUNCHED R(2.0)

struct log {
    int rows, columns, filled;
    real_t *values; /* [rows, columns] */
};

/* Entries of a row of continuation: whether it holds anything, the end that has had an influence, time, next step,
 * whether the sides are still to be found, whether there is a period to compare with; then sides, branches, state, state
 * a period ago. */
enum { VALID, INFLUENCED, RESUME_TIME, RESUME_STEP, RESUME_FRESH, COMPARED, RESUME_SIDES };

/* Running integrals of the account. */
enum { TERMS = 4 };

/* Nodes and weights of Gauss-Legendre quadrature over a unit interval. */
enum { GAUSS = 5 };
static const real_t GAUSS_NODES[GAUSS] = {
    R(0.04691007703066802), R(0.23076534494715845), R(0.5), R(0.7692346550528415), R(0.9530899229693319)};
static const real_t GAUSS_WEIGHTS[GAUSS] = {
    R(0.11846344252809454), R(0.23931433524968324), R(0.28444444444444444), R(0.23931433524968324),
    R(0.11846344252809454)};

static inline const real_t *log_row(const struct log *log, int row)
{
    return log->values + (int64_t)row * log->columns;
}

/* The normal force before over that after it jumps to segment j; 0 if there is none any more. */
static inline real_t load_ratio(const struct table *load, int64_t j, real_t t)
{
    real_t before[DERIVATIVES], after[DERIVATIVES];
    table_at(load, j - 1, t, before);
    table_at(load, j, t, after);
    return after[VALUE] <= R(0.0) ? R(0.0) : before[VALUE] / after[VALUE];
}

#endif
