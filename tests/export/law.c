/* Reads v and z, prints force, rate and bound of the last element of the law; first, the static law's breakaway. */
#include <stdio.h>

#include "stickslip.h"

int main(void)
{
    const stickslip_parameters parameters = stickslip_default_parameters();
    const struct law *law = &STICKSLIP_LAW;
    real_t p[STICKSLIP_NUMBERS], force, dz;
    double v, z;
    stickslip_law_row(&parameters.model.friction, STICKSLIP_STATES - 1, p);
    printf("%.17g\n", (law->breakaway != NULL) ? (double)law->breakaway(p) : 0.0);
    while (scanf("%lf %lf", &v, &z) == 2) {
        law->rate(p, (real_t)v, (real_t)z, &force, &dz);
        printf("%.17g %.17g %.17g\n", (double)force, (double)dz,
               (double)((law->project != NULL) ? law->project(p, (real_t)z) : (real_t)z));
    }
    return 0;
}
