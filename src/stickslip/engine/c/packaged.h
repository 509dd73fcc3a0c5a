/* The laws of the package, for who knows only their names. */
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

/* STICKSLIP_ABI of the headers that the library was built from. */
STICKSLIP_API int32_t stickslip_abi(void);

/* The i-th law; NULL after the last one. */
STICKSLIP_API const struct law *stickslip_packaged_law(int32_t i);

#endif
