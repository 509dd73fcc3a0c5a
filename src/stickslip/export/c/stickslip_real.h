/* Numbers of the model: double, or float with -DSTICKSLIP_FLOAT. */
#ifndef STICKSLIP_REAL_H
#define STICKSLIP_REAL_H

#include <math.h>
#include <stdbool.h>

#ifdef STICKSLIP_FLOAT
typedef float real_t;
#define STICKSLIP_MATH(name) name##f
#else
typedef double real_t;
#define STICKSLIP_MATH(name) name
#endif

/* A constant of that type. */
#define R(number) ((real_t)(number))

static inline real_t r_exp(real_t x) { return STICKSLIP_MATH(exp)(x); }
static inline real_t r_sin(real_t x) { return STICKSLIP_MATH(sin)(x); }
static inline real_t r_cos(real_t x) { return STICKSLIP_MATH(cos)(x); }
static inline real_t r_tan(real_t x) { return STICKSLIP_MATH(tan)(x); }
static inline real_t r_tanh(real_t x) { return STICKSLIP_MATH(tanh)(x); }
static inline real_t r_atan(real_t x) { return STICKSLIP_MATH(atan)(x); }
static inline real_t r_sqrt(real_t x) { return STICKSLIP_MATH(sqrt)(x); }
static inline real_t r_log(real_t x) { return STICKSLIP_MATH(log)(x); }
static inline real_t r_abs(real_t x) { return STICKSLIP_MATH(fabs)(x); }
static inline real_t r_pow(real_t x, real_t y) { return STICKSLIP_MATH(pow)(x, y); }
static inline real_t r_copysign(real_t x, real_t y) { return STICKSLIP_MATH(copysign)(x, y); }
static inline real_t r_square(real_t x) { return x * x; }
static inline real_t r_min(real_t x, real_t y) { return (y < x) ? y : x; }
static inline real_t r_max(real_t x, real_t y) { return (y > x) ? y : x; }
static inline bool r_isinf(real_t x) { return (x - x != R(0.0)) && (x == x); }
static inline bool r_isfinite(real_t x) { return x - x == R(0.0); }

#endif
