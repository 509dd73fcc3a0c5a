/* Instance of the engine for plants of PLAIN_MODES modes and PLAIN_ELEMENTS contacts with a constant normal force:
 * bristles with one state each (PLAIN_BRISTLES 1), or all with static laws (PLAIN_BRISTLES 0). */
#define PLAIN_NAME_(name, modes, elements, bristles) name##_##modes##_##elements##_##bristles
#define PLAIN_NAME(name, modes, elements, bristles) PLAIN_NAME_(name, modes, elements, bristles)
#define OF(name) PLAIN_NAME(name, PLAIN_MODES, PLAIN_ELEMENTS, PLAIN_BRISTLES)
#define HOT PLAIN_HOT
#define UNROLL PLAIN_UNROLL
#define ROOM_MODES PLAIN_MODES
#define ROOM_ELEMENTS PLAIN_ELEMENTS
#define ROOM_STATES (2 * PLAIN_MODES + PLAIN_ELEMENTS * PLAIN_BRISTLES)
#define MODES(P) ((void)(P), PLAIN_MODES)
#define ELEMENTS(P) ((void)(P), PLAIN_ELEMENTS)
#define STATES(P) ((void)(P), ROOM_STATES)
#define STATES_OF(P, e) ((void)(P), (void)(e), PLAIN_BRISTLES)
#define FIRST(P, e) (2 * PLAIN_MODES + (e) * PLAIN_BRISTLES)
#define STATIC(test) (!PLAIN_BRISTLES || (0 && (test)))
#define RARE(test) (0 && (test))
#define WATCHED(test) (test)
#include "size.inl"
#undef PLAIN_NAME_
#undef PLAIN_NAME
#undef PLAIN_MODES
#undef PLAIN_ELEMENTS
#undef PLAIN_BRISTLES
