"""A small boundary-element solution of two elastic half-spaces in contact, the oracle of the closed forms.

Tractions are constant on each square of a grid; their displacements are summed by FFT, without (padded) or
with periodic images. Pressed by conjugate gradients [polonsky1999], pushed by the same on what sticks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.fft import irfft2, rfft2


class Kernel(NamedTuple):
    """Displacement by a traction on one square, in the space of the FFT."""

    transform: np.ndarray
    size: int
    padded: bool

    def __call__(self, traction: np.ndarray) -> np.ndarray:
        n = self.transform.shape[0]
        return irfft2(self.transform * rfft2(traction, s=(n, n)), s=(n, n))[: self.size, : self.size]


def free(size: int, spacing: float, nu: float | None = None, modulus: float = 1.0) -> Kernel:
    """On an infinite half-space: u_z by a pressure, with E* = `modulus` (Love), or u_x by a traction along x
    on one body of the shear modulus `modulus` and Poisson's ratio `nu` (Cerruti)."""
    n = 2 * size
    at = spacing * np.where(np.arange(n) < size, np.arange(n), np.arange(n) - n)
    x, y = np.meshgrid(at, at, indexing="ij")

    def corner(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        r = np.hypot(x, y)
        along, across = y * np.log(x + r), x * np.log(y + r)  # of x²/r³ and y²/r³
        if nu is None:
            return (along + across) / (np.pi * modulus)
        return (along + (1.0 - nu) * across) / (2.0 * np.pi * modulus)

    h = 0.5 * spacing
    total = corner(x + h, y + h) - corner(x + h, y - h) - corner(x - h, y + h) + corner(x - h, y - h)
    return Kernel(rfft2(total), size, True)


def periodic(size: int, spacing: float, nu: float | None = None, modulus: float = 1.0) -> Kernel:
    """With images in both directions; mean displacement 0."""
    k, l = np.fft.fftfreq(size, spacing / (2 * np.pi)), np.fft.rfftfreq(size, spacing / (2 * np.pi))
    qx, qy = np.meshgrid(k, l, indexing="ij")
    q = np.hypot(qx, qy)
    q[0, 0] = 1.0
    found = 2.0 / (modulus * q) if nu is None else (1.0 - nu * (qx / q) ** 2) / (modulus * q)
    found[0, 0] = 0.0
    return Kernel(found, size, False)


def pressed(kernel: Kernel, gap: np.ndarray, mean_pressure: float, tolerance: float = 1e-6) -> np.ndarray:
    """Pressure on each square [n, n], of a given mean, over an undeformed gap."""
    p = np.full(gap.shape, mean_pressure)
    direction, old, restart = np.zeros(gap.shape), 1.0, 0.0
    for _ in range(2000):
        distance = kernel(p) + gap
        touch = p > 0.0
        distance -= distance[touch].mean()
        now = float(np.sum(distance[touch] ** 2))
        direction = np.where(touch, distance + restart * now / old * direction, 0.0)
        old = now
        moved = kernel(direction)
        moved -= moved[touch].mean()
        step = float(np.sum(distance[touch] * direction[touch]) / np.sum(moved[touch] * direction[touch]))
        before = p
        p = np.maximum(np.where(touch, p - step * direction, p), 0.0)
        inside = (p == 0.0) & (distance < 0.0)
        restart = 0.0 if np.any(inside) else 1.0
        p = np.where(inside, p - step * distance, p)
        p *= mean_pressure / p.mean()
        if np.abs(p - before).sum() < tolerance * before.sum():
            return p
    raise RuntimeError("the pressed contact was not found")


def held(kernel: Kernel, stuck: np.ndarray, wanted: np.ndarray, tolerance: float = 1e-8) -> np.ndarray:
    """Tractions on the squares that are stuck, so that these move as wanted: conjugate gradients."""
    t = np.zeros(stuck.shape)
    rest = np.where(stuck, wanted, 0.0)
    direction, now = rest, float(np.sum(rest**2))
    first = now
    for _ in range(2000):
        moved = np.where(stuck, kernel(direction), 0.0)
        step = now / float(np.sum(direction * moved))
        t, rest = t + step * direction, rest - step * moved
        now, old = float(np.sum(rest**2)), now
        if now < tolerance**2 * first:
            return t
        direction = rest + now / old * direction
    raise RuntimeError("the tractions were not found")


def pushed(kernel: Kernel, strength: np.ndarray, displacement: float) -> np.ndarray:
    """Tractions of a first push: those that stick move by `displacement`, others carry their strength."""
    stuck = strength > 0.0
    while True:
        slipping = np.where(stuck, 0.0, strength)
        t = slipping + held(kernel, stuck, displacement - kernel(slipping))
        over = stuck & (t > strength)
        if not np.any(over):
            return t
        stuck = stuck & ~over


def rough(size: int, spacing: float, hurst: float, longest: float, shortest: float, seed: int) -> np.ndarray:
    """Heights of a periodic random surface, self-affine between two wavelengths; rms 1."""
    random = np.random.default_rng(seed)
    k, l = np.fft.fftfreq(size, spacing), np.fft.rfftfreq(size, spacing)
    q = np.hypot(*np.meshgrid(k, l, indexing="ij"))
    inside = (q >= 1.0 / longest * (1 - 1e-9)) & (q <= 1.0 / shortest)
    size_of = np.where(inside, np.where(inside, q, 1.0) ** (-1.0 - hurst), 0.0)
    z = irfft2(size_of * rfft2(random.standard_normal((size, size))), s=(size, size))
    return z / z.std()
