/* Functions inside the engine, for tests of its equations: those of the size that is known at run time. */
#include "engine.c"

static struct regime_any regime(const struct plant *P, const double *sides, const double *branches)
{
    struct regime_any on = {{0}, {0}};
    for (int e = 0; e < P->elements; e++)
        on.side[e] = sides[e];
    for (int c = 0; c < P->states; c++)
        on.branch[c] = (unsigned char)branches[c];
    return on;
}

STICKSLIP_API void inner_slope(const struct plant *P, const double *sides, const double *branches, const double *q,
                               const double *u, const double *normal, double *dq, double *force);
STICKSLIP_API void inner_solve(const struct plant *P, const double *sides, const double *branches, const double *q,
                               const double *u, const double *normal, double per_g, const double *r, double *x, double *t,
                               double *weights, double *fast);
STICKSLIP_API void inner_inputs(const struct plant *P, const double *q, const double *u, double *whole, double *relative);
STICKSLIP_API double inner_size(const struct plant *P, const double *r, const double *weights);
STICKSLIP_API void inner_settle(const struct plant *P, double *q, const double *u, double local);
STICKSLIP_API void inner_kinks(const struct plant *P, const double *q, double beyond, double *kinks);
STICKSLIP_API void inner_bring(const struct plant *P, double *q, const double *u, int64_t e, double speed);
STICKSLIP_API void inner_ride(const struct plant *P, const double *sides, double *q, const double *u, const double *begun,
                              const double *u_begun);
STICKSLIP_API double inner_apart(const struct plant *P, const double *q, const double *other, double apart, double *gone);
STICKSLIP_API void inner_unload(const struct plant *P, double *q, double ratio);
STICKSLIP_API double inner_unrest(const struct plant *P, const double *dq, const double *u);
STICKSLIP_API double inner_jolt(const struct plant *P, const double *u);
STICKSLIP_API double inner_decay(const struct plant *P, double lasts);
STICKSLIP_API double inner_take(const struct plant *P, const double *sides, const struct table *drive,
                                const struct table *load, double t, double h, const double *q, double theta, double *next,
                                double *within, double *fast);
STICKSLIP_API void inner_coefficients(double *A, double *C, double *D, double *H, double *nodes, double *gamma);
STICKSLIP_API void inner_table(const struct table *table, int64_t i, double t, double h, double *at, double *nodes);
STICKSLIP_API void inner_cycle(const struct table *drive, const struct table *load, int64_t *found);
STICKSLIP_API double inner_repeats(const struct table *drive, const struct table *load, int64_t i, const int64_t *cycle,
                                   double period, double t_end);
STICKSLIP_API void inner_polynomial(const struct plant *P, const struct table *drive, double t, double h, const double *q,
                                    const double *next, const double *rows, double *a);
STICKSLIP_API double inner_speed_at(double theta, const double *a);
STICKSLIP_API double inner_least(double side, const double *a);
STICKSLIP_API double inner_most(double side, const double *a);
STICKSLIP_API double inner_reached(double speed, double low, double high, double side, const double *a);
STICKSLIP_API void inner_breakaway(const struct plant *P, const double *q, const double *normal, double *forces);

void inner_slope(const struct plant *P, const double *sides, const double *branches, const double *q, const double *u,
                 const double *normal, double *dq, double *force)
{
    struct regime_any on = regime(P, sides, branches);
    slope_any(P, &on, q, u, normal, dq, force);
}

void inner_solve(const struct plant *P, const double *sides, const double *branches, const double *q, const double *u,
                 const double *normal, double per_g, const double *r, double *x, double *t, double *weights, double *fast)
{
    struct regime_any on = regime(P, sides, branches);
    struct system_any w;
    factor_any(P, &on, q, u, normal, per_g, &w, t, weights, fast);
    solve_any(P, &on, &w, r, x);
}

void inner_inputs(const struct plant *P, const double *q, const double *u, double *whole, double *relative)
{
    for (int e = 0; e < P->elements; e++) {
        whole[e] = speed_any(P, e, q, u);
        relative[e] = relative_speed_any(P, e, q);
    }
}

double inner_size(const struct plant *P, const double *r, const double *weights)
{
    return size_any(P, r, weights);
}

void inner_settle(const struct plant *P, double *q, const double *u, double local)
{
    settle_any(P, q, u, local);
}

void inner_kinks(const struct plant *P, const double *q, double beyond, double *kinks)
{
    for (int e = 0; e < P->elements; e++)
        kinks[e] = kink_any(P, e, q, beyond);
}

void inner_bring(const struct plant *P, double *q, const double *u, int64_t e, double speed)
{
    bring_any(P, q, u, (int)e, speed);
}

void inner_ride(const struct plant *P, const double *sides, double *q, const double *u, const double *begun,
                const double *u_begun)
{
    struct regime_any on = {{0}, {0}};
    for (int e = 0; e < P->elements; e++)
        on.side[e] = sides[e];
    ride_any(P, &on, q, u, begun, u_begun);
}

double inner_apart(const struct plant *P, const double *q, const double *other, double apart, double *gone)
{
    gone_any(P, q, other, apart, gone);
    return drift_apart_any(P, q, other);
}

void inner_unload(const struct plant *P, double *q, double ratio)
{
    unload_any(P, q, ratio);
}

double inner_unrest(const struct plant *P, const double *dq, const double *u)
{
    return unrest_any(P, dq, u);
}

double inner_jolt(const struct plant *P, const double *u)
{
    return jolt_any(P, u);
}

double inner_decay(const struct plant *P, double lasts)
{
    return decay_any(P, lasts);
}

void inner_breakaway(const struct plant *P, const double *q, const double *normal, double *forces)
{
    for (int e = 0; e < P->elements; e++)
        forces[e] = is_static_any(P, e) ? breakaway_any(P, e, q, normal) : (double)INFINITY;
}

double inner_take(const struct plant *P, const double *sides, const struct table *drive, const struct table *load, double t,
                  double h, const double *q, double theta, double *next, double *within, double *fast)
{
    struct regime_any on = {{0}, {0}};
    struct step_any S = {{{0}}, {{0}}, {0}, {{0}}, 0.0, {0}};
    for (int e = 0; e < P->elements; e++)
        on.side[e] = sides[e];
    table_at_nodes(drive, 0, t, h, S.u);
    table_at_nodes(load, 0, t, h, S.normal);
    take_any(P, &on, h, q, &S);
    at_any(P, theta, q, &S, within);
    copy_any(P, S.next, next);
    for (int e = 0; e < P->elements; e++)
        fast[e] = S.fast[e];
    return S.error;
}

static void put(double *to, const double *from, int count)
{
    for (int k = 0; k < count; k++)
        to[k] = from[k];
}

void inner_coefficients(double *A, double *C, double *D, double *H, double *nodes, double *gamma)
{
    put(A, RODAS_A[0], 6 * RODAS_STAGES);
    put(C, RODAS_C[0], RODAS_STAGES * RODAS_STAGES);
    put(D, RODAS_D, RODAS_INNER);
    put(H, RODAS_H[0], 3 * RODAS_STAGES);
    put(nodes, RODAS_NODES, INSTANTS);
    *gamma = RODAS_GAMMA;
}

void inner_table(const struct table *table, int64_t i, double t, double h, double *at, double *nodes)
{
    double u[INSTANTS][DERIVATIVES];
    table_at(table, i, t, at);
    table_at_nodes(table, i, t, h, u);
    put(nodes, u[0], INSTANTS * DERIVATIVES);
}

void inner_polynomial(const struct plant *P, const struct table *drive, double t, double h, const double *q,
                      const double *next, const double *rows, double *a)
{
    struct walk_any w = {.P = P, .tried_h = h};
    copy_any(P, q, w.q);
    copy_any(P, next, w.step.next);
    for (int row = 0; row < 3; row++)
        copy_any(P, rows + row * P->states, w.step.rows[row]);
    table_at_nodes(drive, 0, t, h, w.step.u);
    polynomial_any(&w, 0, a);
}

double inner_speed_at(double theta, const double *a)
{
    return speed_at(theta, a);
}

double inner_least(double side, const double *a)
{
    return least_speed(side, a);
}

double inner_most(double side, const double *a)
{
    return most_speed(side, a);
}

double inner_reached(double speed, double low, double high, double side, const double *a)
{
    return speed_reached(speed, low, high, side, a);
}

void inner_cycle(const struct table *drive, const struct table *load, int64_t *found)
{
    struct cycle cycle = cycle_of(drive, load);
    found[0] = cycle.segments;
    found[1] = cycle.first;
    found[2] = cycle.of_load;
}

double inner_repeats(const struct table *drive, const struct table *load, int64_t i, const int64_t *cycle, double period,
                     double t_end)
{
    return (double)count_repeats(drive, load, i, (struct cycle){cycle[0], cycle[1], cycle[2]}, period, t_end);
}
