/* Plays a table of straight lines, one step at a time; afterwards it stays at the last value. */
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
    long repeats; /* of the whole table */
    int line;     /* where it is now */
    long step;
    long repeat;
} stickslip_player;

/* The value at both ends of the next step. Returns whether the table still goes on. */
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
