/* The engine for plants of PLAIN_MODES modes and PLAIN_ELEMENTS bristle contacts with one state each, whose normal force
 * does not vary. */
#define PLAIN_NAME_(name, modes, elements) name##_##modes##_##elements
#define PLAIN_NAME(name, modes, elements) PLAIN_NAME_(name, modes, elements)
#define OF(name) PLAIN_NAME(name, PLAIN_MODES, PLAIN_ELEMENTS)
#define HOT PLAIN_HOT
#define UNROLL PLAIN_UNROLL
#define ROOM_MODES PLAIN_MODES
#define ROOM_ELEMENTS PLAIN_ELEMENTS
#define ROOM_STATES (2 * PLAIN_MODES + PLAIN_ELEMENTS)
#define MODES(P) ((void)(P), PLAIN_MODES)
#define ELEMENTS(P) ((void)(P), PLAIN_ELEMENTS)
#define STATES(P) ((void)(P), ROOM_STATES)
#define STATES_OF(P, e) ((void)(P), (void)(e), 1)
#define FIRST(P, e) (2 * PLAIN_MODES + (e))
#define RARE(test) (0 && (test))
#include "size.inl"
#undef PLAIN_NAME_
#undef PLAIN_NAME
#undef PLAIN_MODES
#undef PLAIN_ELEMENTS
