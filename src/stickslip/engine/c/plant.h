/* A plant: linear modes of bodies, and elements that act on or between them. The equations are in
 * `stickslip/simulation/plant/system.py`; the names here are those of its records.
 *
 * The state is a row of numbers: position and velocity of each mode, then the internal states of each element. */
#ifndef STICKSLIP_PLANT_H
#define STICKSLIP_PLANT_H

#include <stdint.h>

#include "law.h"
#include "normal_force.h"

/* Most modes, elements and states of a plant: the room of the instance with run-time sizes; on a GPU those of the plant. */
#ifndef LARGEST_MODES
#define LARGEST_MODES 16
#define LARGEST_ELEMENTS 16
#define LARGEST_STATES 400
#endif

/* One linear mode, per unit of modal mass: k [1/s^2], c [1/s], b [m/s^2 per unit of the drive], a [m/s^2]. */
struct mode {
    real_t stiffness, damping, drive, acceleration;
};

/* An element. A share that the element does not have is 0. */
struct element {
    const struct law *law;
    const real_t *parameters;               /* [states or 1][law->parameters], a row for each internal state */
    const ss_NormalForce *along;            /* NULL: the normal force is the same everywhere */
    real_t velocity[LARGEST_MODES];         /* h, shares of the modes' velocities in the input */
    real_t push[LARGEST_MODES];             /* p, acceleration of the modes per unit of output */
    real_t position[LARGEST_MODES];         /* g, shares of the modes' positions in the input */
    real_t feed[LARGEST_ELEMENTS];          /* l, shares of the outputs of earlier elements in the input */
    real_t normal;                          /* factor on the output */
    real_t drive, drive_rate;               /* d and d', shares of the drive and of its slope in the input */
    int32_t states;                         /* number of internal states; 0 for a static law */
    int32_t loaded;                         /* 1: the normal force varies as the load says */
    int32_t follows;                        /* 1: a body of the element follows the drive (`drive_rate`) */
    int32_t positioned, fed;                /* 1: `position`, `feed` have entries */
    uint32_t felt, pushed;                  /* bit m: the element has a share of mode m in `velocity`, in `push` */
    /* Set by stickslip_compose: where the internal states begin; the last mode that the element pushes, along which its
     * normal force changes; the last mode that it both feels and pushes, which is fixed to the others at rest; -1: none. */
    int32_t first, place, pinned;
};

struct plant {
    int32_t modes, elements;
    real_t rate;                            /* rad/s, makes a velocity comparable with a position */
    struct mode mode[LARGEST_MODES];
    struct element element[LARGEST_ELEMENTS];
    /* Set by stickslip_compose. */
    int32_t states;                         /* length of the state */
    int32_t statics;                        /* number of elements with a static law */
    int32_t loaded, branched, sampled;      /* 1: an element is */
    int32_t follows;                        /* 1: a contact has a body that follows the drive */
    int32_t plain;                          /* 1: contacts that are bristles with one state each or static, nothing rarer */
};

#endif
