/* Periodic orbits by Newton's method on difference quotients of the map over one period, which is integrated more and
 * more accurately. The method is explained in `stickslip/simulation/periodic.py`. */
#include <stdlib.h>

#include "engine.h"
#include "linear.h"

/* Tolerances of the integrations, over the required one: of the first integration (for bristles, and for static laws),
 * of the second, the ratio from one to the next, and the least. */
#define COARSEST R(1000.0)
#define COARSEST_STATIC R(0.4)
#define COARSE R(8.0)
#define FINER R(0.25)
#define FINEST R(1e-5)
/* If the defect does not fall to this fraction of its previous value, derivatives of a coarser integration are computed
 * again. */
#define SLOWLY R(0.1)
/* Estimated error of the orbit, over the distance by which the last, finer integration has moved it. */
#define PER_MOVE R(6.0)
/* Largest step of Newton's method, over the largest state of the motion so far. */
#define FARTHEST R(4.0)
/* Difference of neighbours from the trajectory for derivatives: in m for bristles; over the tolerance for static laws,
 * whose neighbours take steps of their own. */
#define NUDGE R(1e-12)
#define NUDGE_STATIC R(1e3)
/* Fraction of a coarser integration's tolerance below which the defect need not fall further. */
#define NOISE R(0.1)
/* For static laws: relative change of a disturbance in a period below which the disturbance counts as constant, because
 * its element does not slip. */
#define KEPT R(1e-5)
/* Number of squarings of the map's derivative for the largest multiplier: for a rough and for an accurate value. */
#define ROUGHLY 12
#define CLOSELY 40
/* Largest modulus of a multiplier up to which derivatives of the coarsest integration, or of an earlier one, can be
 * used. */
#define SHORT R(0.5)
#define LONG R(0.95)
/* PATIENCE: number of periods of plain motion between the first two attempts; it is doubled after each attempt. SOUGHT:
 * largest number of further periods after the first orbit is found, if the motion has not been seen to settle into it.
 * ANCHORED: if an attempt's waiting exceeds PATIENCE times this, attempts continue from the result of the last one. */
#define PATIENCE 20
#define SOUGHT 500
#define ANCHORED 16
/* Largest multiplier of a stable orbit; the multiplier is known up to rounding errors. */
#define STABLE R(1.00001)
/* The motion from rest leads to an orbit if it comes within NEAR times the size of the state, or if a period moves the
 * state as the multipliers predict, up to the fraction REMAINDER. */
#define NEAR R(1e-3)
#define REMAINDER R(0.25)
#define MOST_STEPS 10000000

/* Result of an attempt, or of the search: net step, its error, last correction [m], and largest multiplier. */
struct best {
    real_t step, error, residual, radius;
};

/* Search for the orbit of member m: its data and workspace. Vectors are [n], matrices [n, n]. */
struct orbit {
    const struct stickslip_orbits *of;
    const struct plant *plant;
    int64_t m;
    int n;
    struct plant *beside;           /* [n], copies of the plant for the neighbours */
    real_t *states;                 /* [n, n], states of the neighbours */
    real_t *scale, *of_step;
    real_t *r, *q, *aim, *after, *change, *kept, *rest, *defect, *begun;
    real_t *J, *derivatives, *a, *b; /* J is the caller's array */
    int *order;
    real_t *memory;
};

/* Outcome of one attempt of Newton's method. */
struct attempt {
    struct best found;
    int outcome;
    int64_t periods;
    real_t moved, level;            /* size of the first step, and the last tolerance, m */
    bool far;                       /* true if the first step was longer than FARTHEST allows */
};

static void put(const struct orbit *O, const real_t *from, real_t *to)
{
    for (int c = 0; c < O->n; c++)
        to[c] = from[c];
}

static void move(const struct orbit *O, real_t *r)
{
    for (int c = 0; c < O->n; c++)
        r[c] += O->change[c];
}

/* Return the largest entry of a vector, converted to metres; infinite if an entry is NaN. */
static real_t size_in(const struct orbit *O, const real_t *r)
{
    real_t most = R(0.0);
    for (int c = 0; c < O->n; c++) {
        real_t value = r_abs(r[c]) * O->scale[c];
        most = value <= R(INFINITY) ? r_max(most, value) : R(INFINITY);
    }
    return most;
}

static real_t apart(const struct orbit *O, const real_t *a, const real_t *b)
{
    real_t most = R(0.0);
    for (int c = 0; c < O->n; c++) {
        real_t value = r_abs(a[c] - b[c]) * O->scale[c];
        most = value <= R(INFINITY) ? r_max(most, value) : R(INFINITY);
    }
    return most;
}

/* Integrate one period from r to `after` at the tolerance `level`, with the first `beside` neighbours; `step` is the
 * net step. Return an outcome. */
static int advance(struct orbit *O, const real_t *r, real_t level, int beside, real_t *after, real_t *step)
{
    const struct stickslip_orbits *of = O->of;
    struct stickslip_result result;
    struct stickslip_near near = {.count = beside, .plants = O->beside, .states = O->states, .column = of->column};
    put(O, r, after);
    struct stickslip_task task = {.plant = O->plant, .drive = &of->drives[O->m], .load = of->load, .state = after,
                                  .end = of->periods[O->m], .tolerance = level, .max_steps = MOST_STEPS,
                                  .stop = of->stop};
    int outcome = stickslip_integrate_near(&task, &near, &result);
    *step = after[of->column];
    after[of->column] = R(0.0);
    return outcome;
}

/* Integrate one period as `advance` does, and compute the derivatives of the map (J) and of the net step (of_step). */
static int slopes(struct orbit *O, const real_t *r, real_t level, real_t *step)
{
    int n = O->n, column = (int)O->of->column;
    for (int p = 0; p < n - 1; p++) {
        int c = p < column ? p : p + 1;
        put(O, r, O->states + p * n);
        O->states[p * n + c] += NUDGE / O->scale[c];
    }
    int outcome = advance(O, r, level, O->of->smooth ? n - 1 : 0, O->after, step);
    for (int p = 0; p < n - 1; p++) {
        int c = p < column ? p : p + 1;
        real_t nudge = NUDGE / O->scale[c], *moved = O->states + p * n, moved_step = moved[column];
        if (!O->of->smooth) {
            nudge = NUDGE_STATIC * level / O->scale[c];
            put(O, r, moved);
            moved[c] += nudge;
            int own = advance(O, moved, level, 0, moved, &moved_step);
            outcome = own > outcome ? own : outcome;
        }
        for (int i = 0; i < n; i++)
            O->J[i * n + c] = i != column ? (moved[i] - O->after[i]) / nudge : R(0.0);
        O->of_step[c] = (moved_step - *step) / nudge;
    }
    return outcome;
}

/* Results of the previous integration: its tolerance (infinite: there is no integration to compare with), its defect,
 * the net step of the orbit by it, and its residual. */
struct before {
    real_t level, gap, step, residual;
};

/* Return the error of a net step by an integration at the tolerance `level` that moves the orbit by `moves`. `least`
 * and `older` are the last known error and its tolerance; the error cannot fall faster than the root of the
 * tolerance. */
static real_t error_of(real_t moves, real_t level, const struct before *before, real_t *least, real_t *older)
{
    real_t moved_by = PER_MOVE * moves, error = moved_by;
    if (level < before->level) {
        error = r_max(moved_by, *least * r_sqrt(level / *older));
        /* otherwise the move may come from Newton's method, which had not converged */
        bool known = before->residual <= moved_by;
        *least = known ? moved_by : R(0.0);
        *older = before->level;
    }
    return error;
}

/* Apply Newton's method from the state r on, and replace r by the state on the orbit. `aim` becomes the result of the
 * first step; if the method fails later, the result of a period of motion before the last step. */
static struct attempt newton(struct orbit *O, real_t level, int64_t max_periods)
{
    const struct stickslip_orbits *of = O->of;
    const real_t tolerance = of->tolerance, first = level, none = R(INFINITY);
    struct attempt A = {.moved = none, .level = level, .found = {.error = R(NAN)}};
    struct before before = {none, none, none, none};
    real_t derived = level, radius = R(NAN), largest = size_in(O, O->r), least = R(0.0), older = none, step;
    bool fresh = true;
    put(O, O->r, O->begun);
    for (;;) {
        if (fresh) {
            A.outcome = slopes(O, O->r, A.level, &step);
            A.periods += of->smooth ? 2 : O->n;
            radius = spectral_radius(O->n, O->J, O->scale, ROUGHLY, O->a, O->b);
            derived = A.level;
        } else {
            A.outcome = advance(O, O->r, A.level, 0, O->after, &step);
            A.periods++;
        }
        for (int c = 0; c < O->n; c++)
            O->defect[c] = O->after[c] - O->r[c];
        to_orbit(O->n, O->J, O->defect, O->scale, 2 * O->plant->modes, of->smooth ? R(0.0) : KEPT, O->a, O->order,
                 O->change);
        real_t gap = size_in(O, O->defect), size = size_in(O, O->change), further = R(0.0);
        for (int c = 0; c < O->n; c++)
            further += c != of->column ? O->of_step[c] * O->change[c] : R(0.0);
        /* If a multiplier is near 1, the orbit is much further away than the change in one period. */
        real_t residual = r_max(r_max(gap, size), r_abs(further));
        /* r is the orbit by a coarser integration, with which this one is compared */
        bool compared = before.level < none;
        if (compared)
            A.found.error =
                error_of(r_max(size, r_abs(step + further - before.step)), A.level, &before, &least, &older);
        A.found.residual = residual;
        A.found.step = step;
        /* The agreement with an orbit to which Newton's method had not converged proves nothing. */
        bool enough = compared && A.found.error <= tolerance && A.level <= FINER * before.level &&
                      before.residual <= tolerance;
        if (A.outcome == DONE && residual <= tolerance && (enough || A.level < FINEST * tolerance)) {
            move(O, O->r);
            A.found.step = step + further;
            return A;
        }
        bool falls = A.outcome == DONE && (gap < R(0.5) * before.gap || gap <= NOISE * before.level);
        if (compared && !falls && derived > A.level && A.outcome == DONE) {
            before.level = none;
            least = R(0.0);
            fresh = true;
            continue;
        }
        largest = r_max(largest, size_in(O, O->after));
        A.far = !(size <= FARTHEST * largest);
        if (A.outcome != DONE || (compared && !falls) || A.far || A.periods >= max_periods) {
            if (compared) /* continue from the start of the last step */
                put(O, O->begun, O->aim);
            A.far = A.far && A.moved == none;
            A.outcome = ends_all(A.outcome) ? A.outcome : NOT_FOUND;
            return A;
        }
        bool slowly = gap > SLOWLY * before.gap && gap > NOISE * before.level;
        put(O, O->after, O->begun);
        before = (struct before){A.level, gap, step + further, residual};
        move(O, O->r);
        if (A.moved == none) {
            put(O, O->r, O->aim);
            A.moved = size;
        }
        if (size <= r_max(A.level, tolerance)) /* further steps would only show rounding errors */
            A.level = r_max(r_min(FINER * A.level, COARSE * tolerance), FINER * FINEST * tolerance);
        fresh = radius > LONG || (derived == first && radius > SHORT) || (slowly && derived > A.level);
    }
}

/* Return true if a period of the motion from `before` to `after` leads to the orbit: it is within `near` of the orbit,
 * or moves as the derivatives on the orbit predict. */
static bool leads(const struct orbit *O, const real_t *before, const real_t *after, real_t near)
{
    real_t largest = R(0.0), off = R(0.0);
    for (int i = 0; i < O->n; i++) {
        real_t expected = O->kept[i] - before[i];
        for (int j = 0; j < O->n; j++)
            expected -= O->derivatives[i * O->n + j] * (O->kept[j] - before[j]);
        largest = r_max(largest, r_abs(expected) * O->scale[i]);
        off = r_max(off, r_abs(after[i] - before[i] - expected) * O->scale[i]);
    }
    return apart(O, after, O->kept) <= near || off <= REMAINDER * largest;
}

/* State of the search. */
struct search {
    struct best best;
    int outcome;
    bool found, sure;               /* an orbit is found; the motion from the start leads to it */
    real_t near, walked, level;
    int64_t count, most;
};

/* Store an orbit that an attempt has found, and judge whether the motion leads to it. */
static void judge_orbit(struct orbit *O, struct search *S, const struct attempt *A)
{
    real_t radius = spectral_radius(O->n, O->J, O->scale, CLOSELY, O->a, O->b);
    S->near = NEAR * size_in(O, O->q);
    bool again = S->found && apart(O, O->r, O->kept) <= S->near;
    S->sure = !(radius > STABLE) &&
              (again || apart(O, O->r, O->aim) <= r_max(S->near, REMAINDER * A->moved));
    if (!S->found)
        S->most = S->count + SOUGHT < O->of->max_periods ? S->count + SOUGHT : O->of->max_periods;
    S->best = A->found;
    S->best.radius = radius;
    S->found = true;
    put(O, O->r, O->kept);
    for (int i = 0; i < O->n * O->n; i++)
        O->derivatives[i] = O->J[i];
}

/* Follow the motion itself for `wait` periods, which cannot lead to a wrong orbit. */
static void wait_for(struct orbit *O, struct search *S, int64_t wait)
{
    for (; wait > 0 && S->outcome == DONE && !S->sure; wait--) {
        if (S->count >= S->most) {
            S->outcome = NOT_FOUND;
            return;
        }
        S->outcome = advance(O, O->q, S->level, 0, O->after, &S->walked);
        S->count++;
        if (S->found && !(S->best.radius > STABLE) && S->outcome == DONE)
            S->sure = leads(O, O->q, O->after, S->near);
        put(O, O->after, O->q);
    }
}

/* Find the orbit into which the motion from the state q settles; replace q by the state on the orbit. */
static struct search search(struct orbit *O)
{
    const struct stickslip_orbits *of = O->of;
    struct search S = {.best = {R(NAN), R(NAN), R(INFINITY), R(NAN)}, .count = 1, .most = of->max_periods};
    real_t finer = COARSE * of->tolerance;
    int64_t patience = PATIENCE, hesitation = 1;
    S.level = of->tolerance * (of->smooth ? COARSEST : COARSEST_STATIC);
    finer = r_min(S.level, finer);
    O->q[of->column] = R(0.0);
    put(O, O->q, O->rest);
    S.outcome = advance(O, O->q, S.level, 0, O->after, &S.walked);
    put(O, O->after, O->q);
    while (S.outcome == DONE && !S.sure) {
        put(O, O->q, O->r);
        struct attempt A = newton(O, S.level, of->max_periods - S.count);
        S.count += A.periods;
        if (ends_all(A.outcome)) {
            S.outcome = A.outcome;
            return S;
        }
        if (A.outcome == DONE) {
            judge_orbit(O, &S, &A);
            if (S.sure)
                break;
        } else if (!S.found) {
            S.best = A.found;
            S.best.radius = spectral_radius(O->n, O->J, O->scale, CLOSELY, O->a, O->b);
        }
        int64_t wait = A.far ? hesitation : patience;
        hesitation *= A.far ? 2 : 1;
        patience *= A.far ? 1 : 2;
        if (S.level > finer) { /* a coarse first period may lead to another orbit than the motion itself */
            S.outcome = advance(O, O->rest, finer, 0, O->after, &S.walked);
            put(O, O->after, O->q);
            S.count++;
            S.level = finer;
        }
        if (!S.found && !A.far && patience > ANCHORED * PATIENCE && A.moved < R(INFINITY)) {
            put(O, O->aim, O->q);
            wait = PATIENCE;
            S.level = A.level;
        }
        wait_for(O, &S, wait);
    }
    if (!S.found || ends_all(S.outcome))
        return S;
    if (!S.sure) /* the error includes the difference from the net step of the motion */
        S.best.error = r_max(S.best.error, r_abs(S.walked - S.best.step));
    S.outcome = DONE;
    put(O, O->kept, O->q);
    for (int i = 0; i < O->n * O->n; i++)
        O->J[i] = O->derivatives[i];
    return S;
}

/* Allocate workspace for orbits of n states. Return false if there is no memory. */
static bool make_room(struct orbit *O)
{
    size_t n = (size_t)O->n;
    real_t **vectors[] = {&O->scale, &O->of_step, &O->r, &O->aim, &O->after, &O->change, &O->kept,
                          &O->rest, &O->defect, &O->begun};
    real_t **matrices[] = {&O->states, &O->derivatives, &O->a, &O->b};
    const size_t count = sizeof vectors / sizeof *vectors, squares = sizeof matrices / sizeof *matrices;
    O->memory = calloc(n * (count + squares * n), sizeof *O->memory);
    O->order = calloc(n, sizeof *O->order);
    O->beside = malloc(n * sizeof *O->beside);
    if (O->memory == NULL || O->order == NULL || O->beside == NULL)
        return false;
    for (size_t k = 0; k < count; k++)
        *vectors[k] = O->memory + k * n;
    for (size_t k = 0; k < squares; k++)
        *matrices[k] = O->memory + n * (count + k * n);
    return true;
}

/* Find the orbit of member m, and store the results in the caller's arrays. */
static void find_member(struct orbit *O, int64_t m)
{
    const struct stickslip_orbits *of = O->of;
    O->m = m;
    O->plant = &of->plants[m];
    O->q = of->states + m * O->n;
    O->J = of->jacobians + m * O->n * O->n;
    for (int c = 0; c < O->n; c++) {
        O->scale[c] = c < 2 * O->plant->modes && c % 2 == 1 ? R(1.0) / O->plant->rate : R(1.0);
        O->of_step[c] = R(0.0);
        O->beside[c] = *O->plant;
    }
    for (int i = 0; i < O->n * O->n; i++)
        O->derivatives[i] = R(0.0);
    struct search S = search(O);
    of->outcomes[m] = S.outcome;
    of->steps[m] = S.best.step;
    of->errors[m] = S.best.error;
    of->residuals[m] = S.best.residual;
    of->radius[m] = S.best.radius;
    of->tried[m] = S.count;
}

STICKSLIP_API int stickslip_find_orbits(const struct stickslip_orbits *of)
{
    if (of->count == 0)
        return DONE;
    struct orbit O = {.of = of, .n = of->plants->states};
    int outcome = make_room(&O) ? DONE : NO_MEMORY;
    for (int64_t m = 0; m < of->count && outcome == DONE; m++) {
        if (of->outcomes[m] != DONE)
            continue;
        find_member(&O, m);
        if (ends_all((int)of->outcomes[m]))
            outcome = (int)of->outcomes[m];
    }
    free(O.memory);
    free(O.order);
    free(O.beside);
    return outcome;
}
