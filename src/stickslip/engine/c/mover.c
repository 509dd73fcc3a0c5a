/* The state machine of moves, for Python. Exported C contains the same headers, with its functions static. */
#include "engine.h"

#define MOVER_API STICKSLIP_API
#include "arrival.h"
#include "mover.h"
