/* One step of Rodas5P [steinebach2023]. Included once per size, after `kinematics.inl`.
 *
 * With W = I/(h gamma) - J the stages are
 *     W U_i = f(t + c_i h, q + sum_{j<i} a_ij U_j) + 1/h sum_{j<i} C_ij U_j + h d_i f_t,
 * the new state is q + sum a_8j U_j + U_8, and U_8 is the error estimate.
 *
 * Each contact slides on one side of v = 0 in a step, and its law is continued smoothly beyond a reversal. So the kink
 * of |v| never enters a step; the step is cut at the reversal afterwards, on its continuous extension. */

/* Step over relaxation time above which a bristle is stiff; below it, the embedded error estimate is reliable. */
#ifndef STEP_STIFF
#define STEP_STIFF R(1.0)
#endif

/* A step: drive and normal force at its nodes; the new state and the continuous extension; the error [m]; for each
 * element the step's length over the relaxation time of its fastest state. */
struct OF(step) {
    real_t u[INSTANTS][DERIVATIVES], normal[INSTANTS][DERIVATIVES];
    real_t next[ROOM_STATES], rows[3][ROOM_STATES];
    real_t error, fast[ROOM_ELEMENTS];
};

/* Return an entry of the state at the fraction theta of a step, by the continuous extension. */
HOT real_t OF(extended)(real_t theta, real_t old, real_t next, real_t row_0, real_t row_1, real_t row_2)
{
    real_t rest = R(1.0) - theta;
    return rest * old + theta * next + theta * rest * (row_0 + theta * row_1 + theta * theta * row_2);
}

/* Compute the state at the fraction theta of a step. */
HOT void OF(at)(const struct plant *P, real_t theta, const real_t *q, const struct OF(step) *S, real_t *out)
{
    for (int c = 0; c < STATES(P); c++)
        out[c] = OF(extended)(theta, q[c], S->next[c], S->rows[0][c], S->rows[1][c], S->rows[2][c]);
}

/* Add a weighted sum of the first `count` stages to `sum`. */
HOT void OF(add_stages)(const struct plant *P, int count, const real_t *weights, real_t k[RODAS_STAGES][ROOM_STATES],
                        real_t *sum)
{
    UNROLL
    for (int j = 0; j < count; j++)
        for (int c = 0; c < STATES(P); c++)
            sum[c] += weights[j] * k[j][c];
}

/* Compute stage s at the state p; t is the partial derivative of dq/dt by time. */
HOT void OF(stage)(const struct plant *P, const struct OF(regime) *on, const struct OF(system) *w, real_t h,
                             const real_t *p, const real_t *t, const struct OF(step) *S, int s,
                             real_t k[RODAS_STAGES][ROOM_STATES])
{
    real_t r[ROOM_STATES], past[ROOM_STATES], force[ROOM_ELEMENTS], per_h = R(1.0) / h;
    int node = s < RODAS_INNER ? s : AT_END;
    OF(clear)(P, past);
    OF(add_stages)(P, s, RODAS_C[s], k, past);
    OF(slope)(P, on, p, S->u[node], S->normal[node], r, force);
    for (int c = 0; c < STATES(P); c++)
        r[c] += s < RODAS_INNER ? per_h * past[c] + RODAS_D[s] * (h * t[c]) : per_h * past[c];
    OF(solve)(P, on, w, r, k[s]);
}

/* Return the error of the continuous extension in the middle of the step [m]: its residual in the equations of motion,
 * converted to a state by W. */
static inline real_t OF(defect)(const struct plant *P, const struct OF(regime) *on, const struct OF(system) *w,
                                real_t per_h, const real_t *q, const real_t *weights, const struct OF(step) *S)
{
    real_t middle[ROOM_STATES], r[ROOM_STATES], defect[ROOM_STATES], force[ROOM_ELEMENTS];
    OF(at)(P, R(0.5), q, S, middle);
    OF(slope)(P, on, middle, S->u[AT_MIDDLE], S->normal[AT_MIDDLE], r, force);
    for (int c = 0; c < STATES(P); c++)
        r[c] -= per_h * (S->next[c] - q[c] + R(0.25) * S->rows[1][c] + R(0.25) * S->rows[2][c]);
    OF(solve)(P, on, w, r, defect);
    return OF(size)(P, defect, weights);
}

static inline bool OF(is_stiff)(const struct plant *P, const real_t *fast)
{
    for (int e = 0; e < ELEMENTS(P); e++)
        if (fast[e] >= STEP_STIFF)
            return true;
    return false;
}

/* Advance the state q by h. `S` has the drive and the normal force at the nodes; the rest of it is set here.
 *
 * There are two error estimates: the embedded one, and for stiff bristles the residual of the continuous extension in
 * the middle of the step. The first alone does not see a stiff bristle that softens within one step (sliding that slows
 * down through the Stribeck range). */
static inline void OF(take)(const struct plant *P, const struct OF(regime) *on, real_t h, const real_t *q,
                            struct OF(step) *S)
{
    struct OF(system) w;
    real_t k[RODAS_STAGES][ROOM_STATES], p[ROOM_STATES], t[ROOM_STATES], weights[ROOM_STATES];
    OF(factor)(P, on, q, S->u[AT_START], S->normal[AT_START], h * RODAS_GAMMA, &w, t, weights, S->fast);
    UNROLL
    for (int s = 0; s <= RODAS_INNER; s++) {
        OF(copy)(P, q, p);
        OF(add_stages)(P, s, RODAS_A[s], k, p);
        OF(stage)(P, on, &w, h, p, t, S, s, k);
    }
    UNROLL
    for (int s = RODAS_INNER + 1; s < RODAS_STAGES; s++) {
        for (int c = 0; c < STATES(P); c++)
            p[c] += k[s - 1][c];
        OF(stage)(P, on, &w, h, p, t, S, s, k);
    }
    for (int c = 0; c < STATES(P); c++)
        S->next[c] = p[c] + k[RODAS_STAGES - 1][c];
    for (int row = 0; row < 3; row++) {
        OF(clear)(P, p);
        OF(add_stages)(P, RODAS_STAGES, RODAS_H[row], k, p);
        OF(copy)(P, p, S->rows[row]);
    }
    S->error = OF(size)(P, k[RODAS_STAGES - 1], weights);
    for (int e = 0; e < ELEMENTS(P); e++)
        S->fast[e] *= h;
    if (OF(is_stiff)(P, S->fast))
        S->error = r_max(S->error, OF(defect)(P, on, &w, R(1.0) / h, q, weights, S));
}
