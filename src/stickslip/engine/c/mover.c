/* State machine of moves, exported to Python. Exported C contains the same headers, with static functions. */
#include "engine.h"

#define MOVER_API STICKSLIP_API
#include "arrival.h"
#include "mover.h"
