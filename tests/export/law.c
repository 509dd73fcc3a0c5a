/* Reads v and z, prints force and rate of the first element of the law, or the static law's breakaway. */
#include <stdio.h>

#include "stickslip.h"

int main(void)
{
    const stickslip_parameters parameters = stickslip_default_parameters();
    const stickslip_element element = stickslip_law_element(&parameters.model.friction, STICKSLIP_STATES - 1);
    double v, z;
    printf("%.17g\n", (double)stickslip_law_breakaway(&parameters.model.friction));
    while (scanf("%lf %lf", &v, &z) == 2) {
        const stickslip_contact contact = stickslip_law_rate(&element, (real_t)v, (real_t)z);
        printf("%.17g %.17g %.17g\n", (double)contact.force, (double)contact.dz,
               (double)stickslip_law_project(&element, (real_t)z));
    }
    return 0;
}
