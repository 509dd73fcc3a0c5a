/* Every function of every law of the package on many inputs, for Python to compare with its own. */
#include "laws.h"
#include "normal_force.h"

#define MANY for (long k = 0; k < n; ++k)

const char *name_of(int i) { return i < (int)(sizeof packaged_laws / sizeof *packaged_laws) ? packaged_laws[i]->name : NULL; }
int parameters_of(int i) { return packaged_laws[i]->parameters; }

/* Returns 0 where the law has no such function. */
int evaluate(int i, int role, long n, const double *p, const double *a, const double *b, const double *c,
             const int *branch, double *first, double *second);
int evaluate(int i, int role, long n, const double *p, const double *a, const double *b, const double *c,
             const int *branch, double *first, double *second)
{
    const struct law *law = packaged_laws[i];
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
