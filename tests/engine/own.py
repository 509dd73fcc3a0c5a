"""Small laws as a user writes them: each is one function, or calls others."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stickslip.friction import register

TABLE_V = (0.0, 1e-4, 1e-3, 1e-2, 0.1, 1.0)
TABLE_F = np.array([0.7, 0.68, 0.6, 0.55, 0.54, 0.6])
WEIGHTS = (0.5, 0.3, 0.2)
LIMIT = 4e-7


class Own(NamedTuple):
    """A bristle without a curve."""

    stiffness: float
    force: float


def own_rate(law, v, z):
    return law.stiffness * z, v - abs(v) * law.stiffness * z / law.force


register(Own, own_rate, named=False)


class Numbers(NamedTuple):
    stiffness: float
    force: float
    speed: float


class Shapes(NamedTuple):
    """Fields of several kinds."""

    stiffness: float
    shares: tuple[float, ...]
    order: int
    soft: bool
    inner: Numbers
    name: str = "mine"

    @property
    def half(self) -> float:
        return 0.5 * self.stiffness

    def bent(self, x: float, by: float = 2.0) -> float:
        return x / (1.0 + by * abs(x))


NUMBERS = Numbers(1.4e6, 0.54, 1e-3)
SHAPES = Shapes(1.4e6, (0.5, 0.3, 0.2), 3, True, Numbers(1e5, 0.3, 1e-2))


def curve(v, low, high, speed):
    return low + (high - low) * math.exp(-((v / speed) ** 2))


def saturated(x, limit):
    if x > limit:
        return limit
    if x < -limit:
        return -limit
    return x


def plain(law, v, z):
    return law.stiffness * z, v * (1.0 - abs(z) / LIMIT)


def with_helper(law, v, z):
    g = curve(v, law.force, 1.3 * law.force, law.speed)
    return law.stiffness * z, v - law.stiffness * abs(v) / g * z


def with_undecorated_helper(law, v, z):
    return law.force * saturated(law.stiffness * z / law.force, 1.0), v


def with_while(law, v, z):
    x, n = abs(v) + 1e-9, 0
    while x < law.speed:
        x *= 2.0
        n += 1
    return law.force * n, v / x * 1e-3


def with_break(law, v, z):
    total = 0.0
    for i in range(50):
        term = (abs(z) / LIMIT) ** i / math.factorial(3) / (i + 1)
        if term < 1e-6:
            break
        total += term
    return total, v


def with_break_and_table(law, v, z):
    found = 0.0
    for i in range(len(TABLE_V)):
        if TABLE_V[i] > abs(v):
            break
        found = TABLE_F[i]
    return found, v


def with_continue(law, v, z):
    total = 0.0
    for i in range(6):
        if i % 2 == 0:
            continue
        total += i * z
    return law.stiffness * total, v


def over_a_tuple(law, v, z):
    total = 0.0
    for share in (0.5, 0.3, 0.2):
        total += share * math.tanh(z * share / LIMIT)
    return law.force * total, v


def over_tuples(law, v, z):
    total = 0.0
    for share, speed in ((0.5, 1e-3), (0.3, 1e-2), (0.2, 1e-1)):
        total += share * math.atan(v / speed)
    return law.force * total, v


def over_a_zip(law, v, z):
    total = 0.0
    for i, (weight, limit) in enumerate(zip(WEIGHTS, (1.0, 2.0, 4.0), strict=True)):
        total += weight * max(-limit, min(limit, v / law.speed)) * (i + 1)
    return law.force * total, v


def backwards(law, v, z):
    x = 0.0
    for i in range(5, 0, -2):
        x = (x + 1.0 / i) * z / LIMIT
    return law.force * x, v


def with_extremes(law, v, z):
    return max(0.1, min(law.force, 0.5, abs(v)), z) * min(1, 2), v


def with_floor(law, v, z):
    n = math.floor(v / law.speed)
    return n // 3 + math.ceil(z / LIMIT), v - n * law.speed


def with_remainder(law, v, z):
    return law.force * ((z % LIMIT) / LIMIT - 0.5), v // law.speed


def with_whole_numbers(law, v, z):
    n = 7
    n = n // 2 + 5 % 3 - (-7) // 2
    return n * law.force, n % -4 * v


def with_other_functions(law, v, z):
    x = z / LIMIT
    return law.force * math.erf(x) + math.hypot(x, 0.1) + math.log10(1.0 + x * x), math.asinh(v)


def with_numpy(law, v, z):
    sign = np.sign(v)
    return law.force * sign * np.exp(-np.abs(v) / law.speed) + np.sqrt(z * z) * sign, np.tanh(v)


def with_table(law, v, z):
    return np.interp(abs(v), TABLE_V, TABLE_F) * (1.0 if v > 0.0 else -1.0), v


def with_truths(law, v, z):
    slides = abs(z) >= LIMIT and v * z > 0.0
    stuck = not slides or v == 0.0
    return law.force * ((v > 0.0) - (v < 0.0)), 0.0 if slides and not stuck else v


def chained(law, v, z):
    inside = -LIMIT < z < LIMIT <= 1.0
    return law.force if inside else -law.force, v if 0.0 <= v <= 1e-3 != 2.0 else 0.5 * v


def with_local_function(law, v, z):
    def g(speed, more=1.0):
        return law.force * more + 0.1 * math.exp(-abs(speed) / law.speed)

    return g(v) + g(v, 2.0) + g(0.5 * v, more=3.0), v - z * abs(v) * law.stiffness / g(v)


def with_lambda(law, v, z):
    square = lambda x: x * x  # noqa: E731
    return law.force * square(v / law.speed), square(z) * v


def with_tuple_variable(law, v, z):
    pair = (v, z)
    if v > 0.0:
        pair = (2.0 * v, -z)
    a, b = pair
    return law.stiffness * b, a + pair[0]


def with_swap(law, v, z):
    low, high = z, v
    if low > high:
        low, high = high, low
    return high - low, low + high


def newton(law, v, z):
    x = 1.0
    for _ in range(20):
        step = (x**3 - abs(v) - 1.0) / (3.0 * x**2)
        x -= step
        if abs(step) < 1e-13:
            break
    return law.force * x, v


def with_widened(law, v, z):
    total = 0
    flag = False
    if v > 0:
        total = z * 2
        flag = 1
    return law.stiffness * total + flag, v


def with_number_as_truth(law, v, z):
    return (law.force if v else 0.0) + (v or 1.0) * (z and 2.0), v


def with_early_return(law, v, z):
    while True:
        z = 0.5 * z
        if abs(z) < 1e-9:
            return z, v


def with_walrus(law, v, z):
    return (law.force if (x := abs(v) / law.speed) > 1.0 else x * law.force), x


def with_membership(law, v, z):
    n = int(abs(v) / law.speed)
    return law.force if n in (0, 2, 5) else 0.0, v


def with_constants(law, v, z):
    return law.force * math.sin(2 * math.pi * z / LIMIT), v if v < math.inf else math.nan


def with_choice(law, v, z):
    return np.where(v > 0.0, law.force, -law.force) * 1.0, np.clip(z, -LIMIT, LIMIT) * 1.0


def of_shapes(law, v, z):
    total = 0.0
    for i in range(law.order):
        total += law.shares[i] * law.bent(z / LIMIT, by=i) + law.shares[-1]
    return total * law.half if law.soft else law.inner.force, v * sum(law.shares) * max(law.shares)


def of_text(law, v, z):
    return law.stiffness * z if law.name == "mine" else 0.0, v


def with_comprehension(law, v, z):
    return sum([share * z for share in law.shares]) * law.stiffness, v


def with_match(law, v, z):
    match int(v > 0.0):
        case 1:
            return law.force, v
        case _:
            return -law.force, v


def that_fails(law, v, z):
    if v > 0.5:
        raise RuntimeError("too fast for this contact")
    return law.stiffness * z, v


# By what runs them where a C compiler is there.
TRANSLATED = {
    NUMBERS: (plain, with_helper, with_undecorated_helper, with_while, with_break_and_table, with_continue,
              over_a_tuple, over_tuples, over_a_zip, backwards, with_extremes, with_floor, with_remainder,
              with_whole_numbers, with_other_functions, with_numpy, with_table, with_truths, chained,
              with_local_function, with_lambda, with_tuple_variable, with_swap, newton, with_widened,
              with_number_as_truth, with_early_return, with_walrus, with_membership, with_constants,
              with_choice),
    SHAPES: (of_shapes,),
}  # fmt: skip
NOT_TRANSLATED = {NUMBERS: (with_break, with_match, that_fails), SHAPES: (of_text, with_comprehension)}
