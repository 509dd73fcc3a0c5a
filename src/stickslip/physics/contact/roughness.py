r"""Roughness with its lateral scale: from a spectrum, or from a measured topography.

.. math:: h_{rms}^2 = 2\pi \int q\, C(q)\, dq, \qquad h'^2_{rms} = 2\pi \int q^3 C(q)\, dq, \qquad
          h''^2_{rms} = 2\pi \int q^5 C(q)\, dq

with the isotropic spectrum C(q) [m⁴] over the wavevector q [rad/m], whose integral over the plane is the
variance of the heights [jacobs2017]. A self-affine spectrum is constant from q_l to q_r (the plateau) and
falls as q^(-2-2H) to q_s, with the Hurst exponent H and the wavevectors of the longest, roll-off and shortest
wavelength.

A single number such as Ra is not sufficient: 2,088 measurements in a challenge showed that it is useless
without a lateral scale [pradhan2025]; neither slope nor the longest wavelength follow from it.
"""

from __future__ import annotations

import math
import os
import warnings
from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, array_si, optional_si, to_si

Array = NDArray[np.float64]

# Degree of the polynomial (tilt and bow) that is subtracted from a line scan, or from a map as a whole.
FLATTENED = 2
# Smallest number of heights in each direction of a measured topography.
FEWEST = 8
# Largest rms height after the subtraction of tilt and bow, relative to the largest height before, that counts
# as rounding errors: such a surface is flat.
ROUNDING = 1e-12


@record
class Roughness(NamedTuple):
    """Root mean squares of height [m], slope and curvature [1/m] of a rough surface, between two wavelengths
    [m].

    For a contact they are those of both surfaces together (`with_other`). Slope and curvature are those of
    the surface in all directions; both, and so the real area, depend on the shortest wavelength.
    """

    height: Annotated[float, Quantity("m", "h_rms", "root mean square of the heights", above=0)]
    slope: Annotated[float, Quantity("", "h'_rms", "root mean square of the slopes", above=0)]
    curvature: Annotated[float, Quantity("1/m", "h''_rms", "root mean square of the Laplacian", above=0)]
    longest: Annotated[float, Quantity("m", "λ_l", "longest wavelength", above=0)]
    shortest: Annotated[float, Quantity("m", "λ_s", "shortest wavelength", above=0)]

    def _check(self) -> None:
        if not self.shortest < self.longest:
            raise QuantityError(
                f"Roughness.shortest = {self.shortest:g} m must be below longest = {self.longest:g} m"
            )

    def with_other(self, other: Roughness) -> Roughness:
        """Return the combined roughness of two independent rough surfaces in contact: height, slope and
        curvature add in quadrature, and the wavelengths cover both ranges."""
        return Roughness(
            math.hypot(self.height, other.height),
            math.hypot(self.slope, other.slope),
            math.hypot(self.curvature, other.curvature),
            max(self.longest, other.longest),
            min(self.shortest, other.shortest),
        )


def self_affine(
    height: float | str,
    hurst: float | str,
    *,
    longest: float | str,
    shortest: float | str,
    roll_off: float | str | None = None,
) -> Roughness:
    """Return the roughness of a self-affine surface from its spectrum.

    Args:
        height: root mean square height, m.
        hurst: Hurst exponent H, above 0 and at most 1.
        longest, shortest: wavelengths at which the spectrum ends, m.
        roll_off: wavelength above which the spectrum is constant, m; by default there is no plateau.

    Raises:
        QuantityError: a value is out of range.
    """
    height, hurst = to_si(height, "m", "height"), to_si(hurst, "", "hurst")
    longest, shortest = to_si(longest, "m", "longest"), to_si(shortest, "m", "shortest")
    bend = optional_si(roll_off, "m", "roll_off") or longest
    if not 0.0 < hurst <= 1.0:
        raise QuantityError(f"hurst = {hurst:g} is out of range: it must be > 0 and <= 1")
    if not 0.0 < shortest < bend <= longest < math.inf:
        raise QuantityError(
            f"shortest = {shortest:g} m, roll_off = {bend:g} m and longest = {longest:g} m are out of range: "
            "they must be positive, and grow in this order"
        )
    q_l, q_r, q_s = (2.0 * math.pi / wavelength for wavelength in (longest, bend, shortest))

    roots = []
    # The integrals of q, q^3 and q^5 (q: wavevector) times a spectrum that is 1 on its plateau give height,
    # slope and curvature, except for a common factor.
    for power in (1, 3, 5):
        flat = (q_r ** (power + 1) - q_l ** (power + 1)) / (power + 1)
        left, ends = power - 1.0 - 2.0 * hurst, math.log(q_s / q_r)
        # The expression equals (q_s^left - q_r^left)/left, but is also finite for left = 0.
        fall = q_r**left * ends * float(scipy.special.exprel(left * ends))
        roots.append(math.sqrt(flat + q_r ** (2.0 + 2.0 * hurst) * fall))
    slope, curvature = (height * root / roots[0] for root in roots[1:])
    return Roughness(height, slope, curvature, longest, shortest)


def measured(heights: ArrayLike, spacing: float | str | tuple[float | str, ...]) -> Roughness:
    """Return the roughness of a measured topography.

    Tilt and bow are subtracted (a plane and parabola by least squares). Slopes and curvatures are
    differences between neighbours: they belong to the finest measured scale, of the surface or the
    instrument. A line scan is taken for one of an isotropic surface. The longest wavelength is the length of
    the line or of the map's shorter side, the shortest is twice the (larger) spacing.

    Args:
        heights: heights in m, [n] for a line scan, or [n, m] for a map.
        spacing: distance between neighbouring points, m; for a map one for both directions, or a tuple of
            two.

    Raises:
        QuantityError: heights are one number, missing, too few, or without roughness (all equal, a plane); or
            a spacing is missing or not above 0.
    """
    steps = _spacing(spacing)
    if np.ndim(heights) == 0:
        raise QuantityError(
            f"heights = {heights!r} is one number, such as Ra, which has no lateral scale: neither slope nor "
            "wavelength follow from it, so no contact does; give a topography with its spacing, or a "
            "spectrum (self_affine)"
        )
    z = array_si(heights, "m", "heights")
    if z.ndim > 2 or min(z.shape) < FEWEST or not np.all(np.isfinite(z)):
        raise QuantityError(
            f"heights of the shape {z.shape} are not the line or map of finite values [m] that is needed, "
            f"of at least {FEWEST} each way"
        )
    steps = steps * z.ndim if len(steps) == 1 else steps
    if len(steps) != z.ndim:
        raise QuantityError(f"spacing has {len(steps)} values for heights of {z.ndim} dimensions")
    most = float(np.abs(z).max())
    z = z - _bowed(z)
    height = float(np.sqrt(np.mean(z**2)))
    if not height > ROUNDING * most:
        raise QuantityError("heights are all alike, or a plane: there is no roughness in them")
    slopes = [np.mean((np.diff(z, axis=i) / steps[i]) ** 2) for i in range(z.ndim)]
    bends = [np.diff(z, 2, axis=i) / steps[i] ** 2 for i in range(z.ndim)]
    # For an isotropic surface, the mean squares of slope and curvature are 2 and 8/3 times those along a
    # line.
    if z.ndim == 1:
        slope, curvature = 2.0 * slopes[0], 8.0 / 3.0 * np.mean(bends[0] ** 2)
    else:
        slope, curvature = sum(slopes), np.mean((bends[0][:, 1:-1] + bends[1][1:-1, :]) ** 2)
    size = min((n - 1) * step for n, step in zip(z.shape, steps, strict=True))
    return Roughness(height, math.sqrt(slope), math.sqrt(curvature), size, 2.0 * max(steps))


def read_topography(path: str | os.PathLike[str], channel: int = 0) -> Roughness:
    """Return the roughness from an instrument's file, in any format that SurfaceTopography reads.

    Args:
        path: the file.
        channel: index of the height channel in the file, from 0.

    Raises:
        QuantityError: the file cannot be read or has no such channel, or an error of `of_topography`.
        ModuleNotFoundError: SurfaceTopography is missing (extra ``stickslip[topography]``).
    """
    try:
        # The package SurfaceTopography warns at its import if MPI is missing, which is not needed here.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ImportWarning)
            from SurfaceTopography.IO import open_topography
    except ModuleNotFoundError as missing:
        raise ModuleNotFoundError(
            f'topographies need {missing.name}, which is not installed: pip install "stickslip[topography]"',
            name=missing.name,
        ) from None
    try:
        with open_topography(os.fspath(path)) as reader:
            scan = reader.topography(channel_index=channel)
    # The readers of three dozen file formats may raise any exception.
    except Exception as error:
        said = str(error).strip().split("\n")[0]
        raise QuantityError(
            f"{path} cannot be read as a topography: {said or type(error).__name__}"
        ) from None
    return of_topography(scan, str(path))


def of_topography(scan: Any, name: str = "topography") -> Roughness:
    """Return the roughness of a line scan or map of the package SurfaceTopography; `name` is for messages.

    Raises:
        QuantityError: the scan has no unit, points that were not measured, or uneven steps; or an error of
            `measured`.
    """
    if not scan.unit:
        raise QuantityError(f"{name} has no unit of length, so no lateral scale")
    if scan.has_undefined_data:
        raise QuantityError(f"{name} has points that were not measured: fill them, or cut them off")
    if not scan.is_uniform:
        raise QuantityError(f"{name} is a line of uneven steps: interpolate it first")
    unit = to_si(f"1 {scan.unit}", "m", f"unit of {name}")
    steps = np.atleast_1d(scan.pixel_size)
    return measured(np.asarray(scan.heights()) * unit, tuple(float(step) * unit for step in steps))


def _spacing(given: float | str | tuple[float | str, ...]) -> tuple[float, ...]:
    several = given if isinstance(given, tuple) else (given,)
    steps = tuple(to_si(step, "m", "spacing") for step in several)
    if not steps or not all(0.0 < step < math.inf for step in steps):
        raise QuantityError(f"spacing = {given!r} is out of range: it must be > 0 m")
    return steps


def _bowed(z: Array) -> Array:
    """Return the polynomial of degree `FLATTENED` (tilt and bow) that fits heights z [n] or [n, m] best, by
    least squares: its values in the shape of z."""
    axes = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in z.shape), indexing="ij")
    columns = [np.ones(z.size)]
    for i, one in enumerate(axes):
        columns += [one.ravel() ** power for power in range(1, FLATTENED + 1)]
        columns += [one.ravel() * other.ravel() for other in axes[:i]]
    basis = np.column_stack(columns)
    return (basis @ np.linalg.lstsq(basis, z.ravel(), rcond=None)[0]).reshape(z.shape)
