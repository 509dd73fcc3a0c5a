/* A plant: linear modes of bodies, and elements that act on or between them. The equations are in
 * `stickslip/simulation/plant/system.py`; names are the same as in its records. For a rotary plant m is rad, and N is
 * N m.
 *
 * The state is a row of numbers: position and velocity of each mode, then the internal states of each element. */
#ifndef STICKSLIP_PLANT_H
#define STICKSLIP_PLANT_H

#include <stdint.h>

#include "law.h"
#include "normal_force.h"

/* Largest numbers of modes, elements and states of a plant, for the instance with run-time sizes; on a GPU those of the
 * plant itself. */
#ifndef LARGEST_MODES
#define LARGEST_MODES 16
#define LARGEST_ELEMENTS 16
#define LARGEST_STATES 400
#endif

/* One linear mode, per unit of modal mass: stiffness k [1/s^2], damping c [1/s], b [m/s^2 per unit of the drive],
 * constant acceleration a [m/s^2]. */
struct mode {
    real_t stiffness, damping, drive, acceleration;
};

/* An element, such as a contact: its input, an internal state and an output (a force). A coefficient of an input that
 * the element does not have is 0. */
struct element {
    const struct law *law;
    const real_t *parameters;               /* [states or 1][law->parameters], a row for each internal state */
    const ss_NormalForce *along;            /* variation of the normal force along the stroke; NULL: it is constant */
    real_t velocity[LARGEST_MODES];         /* h, coefficients of the modes' velocities in the input */
    real_t push[LARGEST_MODES];             /* p, acceleration of the modes per unit of output */
    real_t position[LARGEST_MODES];         /* g, coefficients of the modes' positions in the input */
    real_t feed[LARGEST_ELEMENTS];          /* l, coefficients of the outputs of earlier elements in the input */
    real_t normal;                          /* normal force, as a factor on the output */
    real_t drive, drive_rate;               /* d and d', coefficients of the drive and of its slope in the input */
    int32_t states;                         /* number of internal states; 0 for a static law */
    int32_t loaded;                         /* 1: the load varies the normal force over time */
    int32_t follows;                        /* 1: a body of the element follows the drive exactly (`drive_rate`) */
    int32_t positioned, fed;                /* 1: `position`, `feed` have entries other than 0 */
    uint32_t felt, pushed;                  /* bit m: the entry of mode m is not 0 in `velocity`, in `push` */
    /* Set by stickslip_compose. first: index of the first internal state. place: last mode that the element pushes,
     * along which the normal force varies. pinned: last mode that the element both feels and pushes, which is fixed to
     * the others at rest. -1: there is no such mode. */
    int32_t first, place, pinned;
};

struct plant {
    int32_t modes, elements;
    real_t rate;                            /* rad/s; a velocity over this rate is comparable with a position */
    struct mode mode[LARGEST_MODES];
    struct element element[LARGEST_ELEMENTS];
    /* Set by stickslip_compose. */
    int32_t states;                         /* length of the state */
    int32_t statics;                        /* number of elements with a static law */
    int32_t loaded, branched, sampled;      /* 1: an element is loaded, has branches, is sampled */
    int32_t follows;                        /* 1: a body of a contact follows the drive exactly */
    int32_t plain;                          /* 1: all elements are contacts with one bristle each or a static law, with
                                             * nothing rarer */
};

#endif
