/* The engine, compiled for all sizes of plants. */
#include "engine.h"

#include <stdlib.h>

#include "compose.h"
#include "contact.h"
#include "log.h"
#include "repeats.h"
#include "reversal.h"

#define HOT static inline
#define UNROLL
#define OF(name) name##_any
#include "any_size.inl"
#define WATCHED(test) (test)
#include "size.inl"

/* In instances of fixed size, functions that each stage calls are inlined and loops are unrolled, so that numbers stay
 * in registers. */
#if defined __clang__
#define PLAIN_UNROLL _Pragma("clang loop unroll(full)")
#define PLAIN_HOT static inline __attribute__((always_inline))
#elif defined __GNUC__
#define PLAIN_UNROLL _Pragma("GCC unroll 8")
#define PLAIN_HOT static inline __attribute__((always_inline))
#else
#define PLAIN_UNROLL
#define PLAIN_HOT static inline
#endif

/* Instances of fixed size, for frequent plants: contacts with one bristle each, or with static laws, and nothing
 * rarer. */
#define PLAIN_MODES 1
#define PLAIN_ELEMENTS 1
#define PLAIN_BRISTLES 1
#include "plain.inl"
#define PLAIN_MODES 2
#define PLAIN_ELEMENTS 1
#define PLAIN_BRISTLES 1
#include "plain.inl"
#define PLAIN_MODES 3
#define PLAIN_ELEMENTS 1
#define PLAIN_BRISTLES 1
#include "plain.inl"
#define PLAIN_MODES 2
#define PLAIN_ELEMENTS 2
#define PLAIN_BRISTLES 1
#include "plain.inl"
#define PLAIN_MODES 3
#define PLAIN_ELEMENTS 2
#define PLAIN_BRISTLES 1
#include "plain.inl"
#define PLAIN_MODES 2
#define PLAIN_ELEMENTS 1
#define PLAIN_BRISTLES 0
#include "plain.inl"

STICKSLIP_API int stickslip_compose(struct plant *P)
{
    return compose(P);
}

STICKSLIP_API int64_t stickslip_resume_size(const struct plant *P)
{
    return resume_columns_any(P);
}

enum { STATICS = 100 };

/* Return the code of the instance that fits a plant: ten times its modes plus its elements, plus STATICS if the laws
 * are static; 0 for the instance with run-time sizes. */
static int size_of(const struct plant *P)
{
    if (!P->plain || (P->statics > 0 && P->statics < P->elements))
        return 0;
    return 10 * P->modes + P->elements + (P->statics > 0 ? STATICS : 0);
}

static int integrate(int size, const struct stickslip_task *task, const struct stickslip_near *near,
                     struct stickslip_result *result)
{
    switch (size) {
    case STATICS + 21:
        return integrate_2_1_0(task, near, result);
    case 11:
        return integrate_1_1_1(task, near, result);
    case 21:
        return integrate_2_1_1(task, near, result);
    case 31:
        return integrate_3_1_1(task, near, result);
    case 22:
        return integrate_2_2_1(task, near, result);
    case 32:
        return integrate_3_2_1(task, near, result);
    default:
        return integrate_any(task, near, result);
    }
}

STICKSLIP_API int stickslip_integrate(const struct stickslip_task *task, struct stickslip_result *result)
{
    return integrate(size_of(task->plant), task, NULL, result);
}

STICKSLIP_API int stickslip_integrate_near(const struct stickslip_task *task, const struct stickslip_near *near,
                                           struct stickslip_result *result)
{
    int size = size_of(task->plant);
    for (int64_t p = 0; p < near->count; p++)
        size = size_of(&near->plants[p]) == size ? size : 0;
    return integrate(size, task, near, result);
}
