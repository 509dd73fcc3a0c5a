/* The package's friction laws, translated from Python. */
#include "packaged.h"

#include "laws.h"

STICKSLIP_API int32_t stickslip_abi(void)
{
    return STICKSLIP_ABI;
}

STICKSLIP_API const struct law *stickslip_packaged_law(int32_t i)
{
    const int32_t count = (int32_t)(sizeof packaged_law / sizeof *packaged_law);
    return (0 <= i && i < count) ? packaged_law[i] : NULL;
}
