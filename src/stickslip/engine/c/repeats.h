/* Periods of drive and load: the number of segments in a period, and the number of repetitions. */
#ifndef STICKSLIP_REPEATS_H
#define STICKSLIP_REPEATS_H

#include "table.h"

/* Fraction of a period by which two equal times may differ because of rounding. */
#define SAME_TIME R(1e-9)
/* Largest number of segments in a period. */
#define LONGEST_CYCLE 64

/* A period: its number of segments of the drive, the segment with which the first period starts, and its number of
 * segments of the load (0: the load is constant). All are 0 if drive and load do not repeat together. */
struct cycle {
    int64_t segments, first, of_load;
};

/* Return true if two segments have the same formula. */
static inline bool segments_alike(const struct table *table, int64_t i, int64_t j)
{
    int64_t count = table->first[i + 1] - table->first[i];
    for (int c = 0; c < 4; c++)
        if (table->polynomial[i][c] != table->polynomial[j][c])
            return false;
    if (count != table->first[j + 1] - table->first[j])
        return false;
    for (int64_t row = 0; row < count; row++)
        for (int c = 0; c < 4; c++)
            if (table->harmonic[table->first[i] + row][c] != table->harmonic[table->first[j] + row][c])
                return false;
    return true;
}

/* Return true if `count` segments from i on have the formulas of those `cycle` segments before, and start a period
 * later. The times must be compared, too: pulses of different width have the same formulas. */
static inline bool table_repeats(const struct table *table, int64_t i, int64_t count, int64_t cycle)
{
    const real_t *start = table->start;
    real_t period = start[i] - start[i - cycle];
    for (int64_t k = i; k < i + count; k++)
        if (!segments_alike(table, k, k - cycle) || r_abs(start[k] - start[k - cycle] - period) > SAME_TIME * period)
            return false;
    return true;
}

/* Return true if the segments after the first `cycle` ones from `begin` on repeat these. */
static inline bool table_is_periodic(const struct table *table, int64_t begin, int64_t cycle)
{
    int64_t i = begin + cycle, left = table->segments - i;
    return left > 0 && table_repeats(table, i, left < cycle ? left : cycle, cycle);
}

static inline bool table_is_constant(const struct table *table)
{
    const real_t *c = table->polynomial[0];
    bool flat = c[1] == R(0.0) && c[2] == R(0.0) && c[3] == R(0.0);
    return table->segments == 1 && table->first[1] == 0 && flat;
}

/* Compare the start of segment i of the drive with the load, up to rounding. Return 1 if segment j of the load starts
 * there, -1 if the next one does (a moment later), 0 if none does. */
static inline int table_meets(const struct table *drive, const struct table *load, int64_t i, int64_t j, real_t period)
{
    real_t t = drive->start[i];
    if (j >= load->segments || load->start[j] > t || table_next_has_begun(load, j, t))
        return 0;
    if (t - load->start[j] <= SAME_TIME * period)
        return 1;
    return j + 1 < load->segments && load->start[j + 1] - t <= SAME_TIME * period ? -1 : 0;
}

/* Return the number of segments of the load in a period of the drive; 0 if the load does not repeat with it. */
static inline int64_t cycle_of_load(const struct table *drive, const struct table *load, int64_t begin, int64_t cycle)
{
    real_t period = drive->start[begin + cycle] - drive->start[begin];
    int64_t j = table_segment_of(load, drive->start[begin]);
    int64_t after = table_segment_of(load, drive->start[begin + cycle]), count = after - j;
    int met = table_meets(drive, load, begin, j, period);
    if (met == 0 || count < 1 || count > LONGEST_CYCLE || !table_is_periodic(load, j, count))
        return 0;
    return table_meets(drive, load, begin + cycle, after, period) == met ? count : 0;
}

/* Return the period of drive and load. It may start later than the drive: behind a piezo with hysteresis, the first
 * period differs from the others, and the second starts with a jump or within the segments of a period. */
static inline struct cycle cycle_of(const struct table *drive, const struct table *load)
{
    bool constant = table_is_constant(load);
    for (int64_t begin = 0; begin <= LONGEST_CYCLE; begin++) {
        for (int64_t k = begin > 1 ? begin : 1; k <= LONGEST_CYCLE; k++) {
            if (!table_is_periodic(drive, begin, k))
                continue;
            int64_t of_load = constant ? 0 : cycle_of_load(drive, load, begin, k);
            if (constant || of_load > 0)
                return (struct cycle){k, begin, of_load};
        }
    }
    return (struct cycle){0, 0, 0};
}

/* Return the number of whole periods from segment i of the drive on, within t_end, that repeat the period before i,
 * whose duration is `period` [s]. */
static inline int64_t count_repeats(const struct table *drive, const struct table *load, int64_t i, struct cycle cycle,
                                    real_t period, real_t t_end)
{
    int64_t count = 0, n = cycle.segments, j = 0;
    int met = 0;
    if (cycle.of_load > 0) {
        j = table_segment_of(load, drive->start[i - n]);
        met = table_meets(drive, load, i - n, j, period);
        if (met == 0)
            return 0;
        j += cycle.of_load;
    }
    for (; i + n <= drive->segments; i += n, count++) {
        if (!table_repeats(drive, i, n, n))
            return count;
        if (cycle.of_load > 0) {
            if (j + cycle.of_load > load->segments || table_meets(drive, load, i, j, period) != met ||
                !table_repeats(load, j, cycle.of_load, cycle.of_load))
                return count;
            j += cycle.of_load;
        }
        if (r_abs(table_next_break(drive, i + n - 1, t_end) - drive->start[i] - period) > SAME_TIME * period)
            return count;
    }
    return count;
}

#endif
