/* Values of a plant that follow from its modes and elements. */
#ifndef STICKSLIP_COMPOSE_H
#define STICKSLIP_COMPOSE_H

#include "engine.h"

/* Return the last mode whose bit is set in both masks; -1 if there is none. */
static inline int32_t last_mode(int32_t modes, uint32_t felt, uint32_t pushed)
{
    for (int32_t m = modes - 1; m >= 0; m--)
        if ((felt & pushed) >> m & 1u)
            return m;
    return -1;
}

/* Set the places of an element in the plant, and update the plant's sums and flags. */
static inline void compose_element(struct plant *P, struct element *E)
{
    bool rare = E->law->smooth || E->law->choose != NULL || E->law->tick != NULL;
    bool shares = E->positioned || E->fed || E->follows || E->drive != R(0.0) || E->drive_rate != R(0.0);
    E->first = P->states;
    E->place = last_mode(P->modes, ~(uint32_t)0, E->pushed);
    E->pinned = last_mode(P->modes, E->felt, E->pushed);
    P->states += E->states;
    P->statics += E->law->breakaway != NULL;
    P->loaded |= E->loaded != 0;
    P->branched |= E->law->choose != NULL;
    P->sampled |= E->law->tick != NULL;
    P->follows |= E->follows && !E->law->smooth;
    P->plain &= !rare && !shares && !E->loaded && E->along == NULL && E->states == (E->law->breakaway == NULL);
}

/* Complete a plant whose modes and elements are filled in; see stickslip_compose. */
static inline int compose(struct plant *P)
{
    if (P->modes > LARGEST_MODES || P->elements > LARGEST_ELEMENTS)
        return DOES_NOT_FIT;
    P->states = 2 * P->modes;
    P->statics = P->loaded = P->branched = P->sampled = P->follows = 0;
    P->plain = 1;
    for (int e = 0; e < P->elements; e++) {
        if (P->element[e].states > LARGEST_STATES - P->states)
            return DOES_NOT_FIT;
        compose_element(P, &P->element[e]);
    }
    return DONE;
}

#endif
