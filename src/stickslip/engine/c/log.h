/* Log of the steps, and the row of numbers from which a later run continues with the same result to the last bit. */
#ifndef STICKSLIP_LOG_H
#define STICKSLIP_LOG_H

#include "table.h"

/* Number of rows of a log: more steps than a period needs at usual tolerances. A period that does not fit into the log
 * is never copied. */
#define LOG_ROWS 1024

/* Columns of the log: a step's start, its length, its end, the used fraction of the step; then the sides of the
 * contacts, the branches of the internal states (if a law has branches), the states at both ends, and the continuous
 * extension. If the fraction is LAUNCHED, the row is no step but the first moment of a slip. */
enum { LOG_START, LOG_LENGTH, LOG_END, LOG_FRACTION, LOG_SIDES };
#define LAUNCHED R(2.0)

struct log {
    int rows, columns, filled;
    real_t *values; /* [rows, columns] */
};

/* Entries of a row of continuation: whether the row is valid, the end of the run that had an influence, time, next
 * step, whether the sides must be determined, whether there is a previous period to compare with; then sides, branches,
 * state, state a period ago. */
enum { VALID, INFLUENCED, RESUME_TIME, RESUME_STEP, RESUME_FRESH, COMPARED, RESUME_SIDES };

/* Number of integrals of the account of work, see `reading.inl`. */
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

/* Return the normal force before its jump at the start of segment j, over the force after the jump; 0 if the force
 * after the jump is not positive. */
static inline real_t load_ratio(const struct table *load, int64_t j, real_t t)
{
    real_t before[DERIVATIVES], after[DERIVATIVES];
    table_at(load, j - 1, t, before);
    table_at(load, j, t, after);
    return after[VALUE] <= R(0.0) ? R(0.0) : before[VALUE] / after[VALUE];
}

#endif
