/* Player of a waveform table of straight lines, one time step at a time. After the last repeat it keeps the last
 * value. */
#ifndef STICKSLIP_PLAYER_H
#define STICKSLIP_PLAYER_H

#include "engine/stickslip_real.h"

typedef struct {
    long steps;
    real_t begin;
    real_t end;
} stickslip_line;

typedef struct {
    const stickslip_line *lines;
    int count;
    long repeats; /* number of times that the whole table is played */
    int line;     /* present position: index of the line, step in this line, repeat of the table */
    long step;
    long repeat;
} stickslip_player;

/* Give the values at the start and the end of the next time step. Returns false if the table has ended before this
 * step. */
static inline bool stickslip_play(stickslip_player *player, real_t *begin, real_t *end)
{
    const stickslip_line *line = &player->lines[player->line];
    if (player->repeat >= player->repeats) {
        *begin = player->lines[player->count - 1].end;
        *end = *begin;
        return false;
    }
    const real_t rise = line->end - line->begin, per_step = R(1.0) / (real_t)line->steps;
    *begin = line->begin + rise * ((real_t)player->step * per_step);
    ++player->step;
    *end = line->begin + rise * ((real_t)player->step * per_step);
    if (player->step == line->steps) {
        *end = line->end;
        player->step = 0;
        ++player->line;
        if (player->line == player->count) {
            player->line = 0;
            ++player->repeat;
        }
    }
    return true;
}

#endif
