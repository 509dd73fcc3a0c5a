/* Every function of every law of the package on many inputs, for Python to compare with its own. */
#include "engine.c"
#include "laws.h"
#include "normal_force.h"

#define MANY for (long k = 0; k < n; ++k)

const char *name_of(int i) { return i < (int)(sizeof packaged_law / sizeof *packaged_law) ? packaged_law[i]->name : NULL; }
int length_of(int i) { return packaged_law[i]->parameters; }

/* Returns 0 where the law has no such function. */
int evaluate(int i, int role, long n, const double *p, const double *a, const double *b, const double *c,
             const int *branch, double *first, double *second);
int evaluate(int i, int role, long n, const double *p, const double *a, const double *b, const double *c,
             const int *branch, double *first, double *second)
{
    const struct law *law = packaged_law[i];
    const int m = law->parameters;
    switch (role) {
    case 0: MANY law->rate(p + k * m, a[k], c[k], first + k, second + k); return 1;
    case 1: if (!law->breakaway) { return 0; } MANY first[k] = law->breakaway(p + k * m); return 1;
    case 2: if (!law->project) { return 0; } MANY first[k] = law->project(p + k * m, c[k]); return 1;
    case 3: if (!law->tick) { return 0; } MANY first[k] = law->tick(p + k * m, a[k], c[k]); return 1;
    case 4: if (!law->choose) { return 0; } MANY first[k] = law->choose(p + k * m, a[k], b[k], c[k]); return 1;
    case 5: if (!law->branch_rate) { return 0; }
        MANY law->branch_rate(p + k * m, a[k], c[k], branch[k], first + k, second + k);
        return 1;
    case 6: if (!law->left) { return 0; } MANY first[k] = law->left(p + k * m, a[k], b[k], c[k], branch[k]); return 1;
    default: return 0;
    }
}

void press(long n, const ss_NormalForce *p, const double *x, double *out)
{
    MANY {
        const ss_along_result found = ss_along(p + k, x[k]);
        const double all[] = {found.share, found.steep, found.curved, ss_softening(p + k, x[k]), ss_kept(p + k, x[k]),
                              ss_leaning(p + k, x[k]), ss_uniform(p + k)};
        for (int j = 0; j < 7; ++j) { out[7 * k + j] = all[j]; }
    }
}

/* What a step sees of a contact: five slopes, force and rate beyond the reversal, the kink, the state on its bound. */
void see(int i, long n, const double *p, const double *v, const double *z, const double *side, const int *branch, double *out)
{
    const struct law *law = packaged_law[i];
    MANY {
        const real_t *own = p + k * law->parameters;
        const struct bristle of = {.law = law, .p = own, .side = side[k], .branch = branch[k]};
        const struct law_slopes slopes = slopes_of_any(&of, v[k], z[k]);
        double *row = out + 10 * k;
        row[0] = slopes.force;
        row[1] = slopes.force_v;
        row[2] = slopes.force_z;
        row[3] = slopes.rate_v;
        row[4] = slopes.rate_z;
        smooth_rate_any(&of, v[k], z[k], row + 5, row + 6);
        row[7] = reversal_kink(law, own, z[k], v[k]);
        row[8] = bounded(law, own, z[k], 1e-3 * z[k]);
        row[9] = 0.0;
        if (law->breakaway) {
            const struct element E = {.law = law, .parameters = own};
            static_slope(&E, v[k], side[k], row + 8, row + 9);
        }
    }
}
