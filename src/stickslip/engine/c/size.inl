/* The engine for one size. The including file defines the macros that `elements.inl` lists; they are undefined at the
 * end. */
#include "elements.inl"
#include "equations.inl"
#include "system.inl"
#include "kinematics.inl"
#include "step.inl"
#include "starting.inl"
#include "walk.inl"
#include "log.inl"
#include "run.inl"
#include "reading.inl"
#include "near.inl"
#include "periods.inl"

#undef OF
#undef HOT
#undef UNROLL
#undef ROOM_MODES
#undef ROOM_ELEMENTS
#undef ROOM_STATES
#undef MODES
#undef ELEMENTS
#undef STATES
#undef STATES_OF
#undef FIRST
#undef STATIC
#undef RARE
#undef WATCHED
