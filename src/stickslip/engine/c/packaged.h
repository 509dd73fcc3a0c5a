/* Access to the package's friction laws by number, for callers that know their names. */
#ifndef STICKSLIP_PACKAGED_H
#define STICKSLIP_PACKAGED_H

#include <stdint.h>

#include "abi.h"
#include "law.h"

#ifndef STICKSLIP_API
#if defined _WIN32
#define STICKSLIP_API __declspec(dllexport)
#else
#define STICKSLIP_API __attribute__((visibility("default")))
#endif
#endif

/* Return STICKSLIP_ABI, the number of the headers from which the library was built. */
STICKSLIP_API int32_t stickslip_abi(void);

/* Return the i-th law; NULL after the last one. */
STICKSLIP_API const struct law *stickslip_packaged_law(int32_t i);

#endif
