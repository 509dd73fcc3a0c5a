/* Macros for sizes that are known at run time: for any plant within the room of the arrays. See `elements.inl`. */
#define ROOM_MODES LARGEST_MODES
#define ROOM_ELEMENTS LARGEST_ELEMENTS
#define ROOM_STATES LARGEST_STATES
#define MODES(P) ((P)->modes)
#define ELEMENTS(P) ((P)->elements)
#define STATES(P) ((P)->states)
#define STATES_OF(P, e) ((P)->element[e].states)
#define FIRST(P, e) ((P)->element[e].first)
#define STATIC(test) (test)
#define RARE(test) (test)
