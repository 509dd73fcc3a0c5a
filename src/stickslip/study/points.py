"""Points of a study: grids, random and quasi-random designs, draws of a posterior, and products of them.

The varied values of a task are computed from the task's position in the study, with equal results on every
machine. So no array of all members of a random design or of a product is made.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ..quantities.units import QuantityError

Array = NDArray[np.float64]
# Function that is given the name and the values of a varied quantity (numbers in SI, or strings with units).
# The function returns the values in SI [n] and the attributes of the quantity, `units` and `long_name`.
Read = Callable[[str, ArrayLike], tuple[Array, dict[str, str]]]
Method = Literal["sobol", "halton", "uniform"]
Spacing = Literal["linear", "log"]

MOST_MEMBERS = 10**12  # largest number of members of a study
# Largest number of points of a Sobol sequence in SciPy, which computes it with 30 bits.
MOST_SOBOL = 2**30


@dataclass(frozen=True)
class Grid:
    """Grid: all combinations of the values of several quantities; each quantity becomes a dimension.

    Args:
        values: values of each quantity by name, in SI or with units; a quantity may not have a value twice.
    """

    values: Mapping[str, ArrayLike]


class Range(NamedTuple):
    """Range of a random quantity, from `low` to `high`, in SI or as strings with units.

    With the spacing "linear" the quantity is uniformly distributed, with "log" its logarithm; `low` must then
    be positive.
    """

    low: float | str
    high: float | str
    spacing: Spacing = "linear"


@dataclass(frozen=True)
class Random:
    """Random or quasi-random design: members spread over ranges, along the dimension "member".

    Args:
        ranges: range of each quantity by name, a `Range` or a pair (low, high).
        members: number of members.
        method: "sobol" (scrambled; best with a power of two), "halton" (scrambled) or "uniform"
            (independent random numbers). A Sobol sequence has up to 2^30 members.
        seed: seed of the scrambling or of the random numbers.
    """

    ranges: Mapping[str, Range | tuple[float | str, float | str]]
    members: int
    method: Method = "sobol"
    seed: int = 0


@dataclass(frozen=True)
class Draws:
    """Members with listed values, along one dimension, such as draws from a fit or a posterior.

    Member i has the i-th value of each quantity. `drawn_parameters` makes such draws.

    Args:
        values: values of each quantity by name, arrays of equal length, in SI or with units.
        dim: name of the dimension.
    """

    values: Mapping[str, ArrayLike]
    dim: str = "draw"


Part = Grid | Random | Draws


class StudyAxis(NamedTuple):
    """One dimension of a study with the values that vary along it.

    `names` are the quantities that vary along it, `size` is its number of points, and `about` has the
    attributes (`units`, `long_name`) of each name. `values` [names, size] is the array of values of a grid or
    of draws. For a random design it is None, and ``drawn(start, stop)`` computes the values of the points
    from `start` up to `stop`, [names, stop - start].
    """

    dim: str
    names: tuple[str, ...]
    size: int
    about: dict[str, dict[str, str]]
    values: Array | None
    drawn: Callable[[int, int], Array] | None = None

    def at(self, start: int, stop: int) -> Array:
        """Return the values of the points from `start` up to (without) `stop`, [names, points]."""
        return self.values[:, start:stop] if self.drawn is None else self.drawn(start, stop)  # type: ignore[index]


def axes_of(parts: Part | Sequence[Part], read: Read) -> list[StudyAxis]:
    """Return the dimensions of a study in order; each quantity of a grid is a dimension of its own.

    Args:
        parts: a `Grid`, a `Random` design, `Draws`, or several of them.
        read: function from a name and its values to the values in SI and the attributes of the name, see
            `Read`.

    Raises:
        QuantityError: nothing varies, a name varies twice, a dimension occurs twice (as with two random
            designs), there are more than `MOST_MEMBERS` members, or a name, a value or an option of a part is
            not allowed.
    """
    found: list[StudyAxis] = []
    for part in [parts] if isinstance(parts, Part) else parts:
        if isinstance(part, Grid):
            found += [_grid_axis(name, values, read) for name, values in part.values.items()]
        elif isinstance(part, Random):
            found.append(_random_axis(part, read))
        elif isinstance(part, Draws):
            found.append(_draws_axis(part, read))
        else:
            raise QuantityError(f"points are of a Grid, Random or Draws, not of a {type(part).__name__}")
    names = [name for axis in found for name in axis.names]
    dims = [axis.dim for axis in found]
    for name in {*names, *dims}:
        if names.count(name) > 1 or dims.count(name) > 1:
            raise QuantityError(f"points: {name!r} varies twice")
    if not found:
        raise QuantityError("points: nothing varies")
    if math.prod(axis.size for axis in found) > MOST_MEMBERS:
        raise QuantityError(f"points: more than {MOST_MEMBERS:.0e} members")
    return found


def _grid_axis(name: str, values: ArrayLike, read: Read) -> StudyAxis:
    column, about = read(name, values)
    if np.unique(column).size != column.size:
        raise QuantityError(f"grid: {name} has the same value twice")
    return StudyAxis(name, (name,), column.size, {name: about}, column[None, :])


def _draws_axis(part: Draws, read: Read) -> StudyAxis:
    columns = {name: read(name, values) for name, values in part.values.items()}
    sizes = {name: column.size for name, (column, _) in columns.items()}
    if len(set(sizes.values())) != 1:
        raise QuantityError(f"draws must be arrays of one length; there are {sizes or 'none'}")
    stacked = np.stack([column for column, _ in columns.values()])
    return StudyAxis(
        part.dim, tuple(columns), stacked.shape[1], {n: a for n, (_, a) in columns.items()}, stacked
    )


def _random_axis(part: Random, read: Read) -> StudyAxis:
    if part.method not in get_args(Method):
        raise QuantityError(f"random: there are {', '.join(get_args(Method))}, not {part.method!r}")
    if isinstance(part.members, bool) or not (isinstance(part.members, int) and part.members > 0):
        raise QuantityError(f"random: members = {part.members!r} must be a whole number > 0")
    if part.method == "sobol" and part.members > MOST_SOBOL:
        raise QuantityError(f'random: a Sobol sequence has {MOST_SOBOL:,} members at most; take "halton"')
    if isinstance(part.seed, bool) or not (isinstance(part.seed, int) and part.seed >= 0):
        raise QuantityError(f"random: seed = {part.seed!r} must be a whole number >= 0")
    if not part.ranges:
        raise QuantityError("random: there are no ranges")
    about, low, high, logs = {}, [], [], []
    for name, given in part.ranges.items():
        ends = given if isinstance(given, Range) else Range(given[0], given[1])
        (first, last), about[name] = read(name, [ends.low, ends.high])
        if not first < last:
            raise QuantityError(f"random: {name}: low = {first:g} must be below high = {last:g}")
        if ends.spacing not in get_args(Spacing):
            raise QuantityError(f"random: {name}: the spacing is 'linear' or 'log', not {ends.spacing!r}")
        log = ends.spacing == "log"
        if log and not first > 0.0:
            raise QuantityError(f"random: {name}: log needs values above 0, not {first:g}")
        low.append(math.log(first) if log else first)
        high.append(math.log(last) if log else last)
        logs.append(log)
    sequence = _Sequence(part.method, part.seed, len(low))
    begin, width = np.array(low)[:, None], (np.array(high) - np.array(low))[:, None]
    which = np.array(logs)[:, None]

    def drawn(start: int, stop: int) -> Array:
        at = begin + width * sequence.numbers(start, stop)
        return np.where(which, np.exp(np.where(which, at, 0.0)), at)

    return StudyAxis("member", tuple(about), part.members, about, None, drawn)


class _Sequence:
    """Quasi-random or random points in the unit cube; any range of the sequence can be computed alone.

    `method` and `seed` are as for `Random`; `dimensions` is the number of random quantities.
    """

    def __init__(self, method: Method, seed: int, dimensions: int) -> None:
        self._method, self._seed, self._dimensions = method, seed, dimensions
        self._sampler: Any = None

    def numbers(self, start: int, stop: int) -> Array:
        """Return the points from index `start` up to (without) `stop`, [dimensions, stop - start], from 0 to
        1.
        """
        if self._method == "uniform":
            generator = np.random.PCG64(self._seed)
            generator.advance(start * self._dimensions)
            return np.random.Generator(generator).random((stop - start, self._dimensions)).T
        if self._sampler is None or self._sampler.num_generated > start:
            self._sampler = self._new
            self._sampler.reset()
        if start > self._sampler.num_generated:
            self._sampler.fast_forward(start - self._sampler.num_generated)
        with warnings.catch_warnings():
            # SciPy warns if the number of points is no power of two, which only affects how evenly they lie.
            warnings.simplefilter("ignore", UserWarning)
            return self._sampler.random(stop - start).T

    @cached_property
    def _new(self) -> Any:
        if self._method == "halton":
            return scipy.stats.qmc.Halton(
                self._dimensions, scramble=True, rng=np.random.default_rng(self._seed)
            )
        return scipy.stats.qmc.Sobol(self._dimensions, scramble=True, rng=np.random.default_rng(self._seed))
