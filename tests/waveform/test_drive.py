"""The segment table itself, with every coefficient in use."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial

from stickslip.waveform.drive import constant, evaluate, segment_at, value_slope_curvature
from stickslip.waveform.pieces import Piece, assemble, with_breaks

CUBIC = Polynomial([1.5, -2.0, 3.0, 4.0])


def test_cubic_and_two_chirps_in_one_segment() -> None:
    waves = ((2.0, 3.0, 0.4, 5.0), (-1.0, 7.0, -2.0, -6.0))
    drive = assemble(9.0, [Piece(0.0, (9.0,)), Piece(0.5, tuple(CUBIC.coef), waves)], 2.0)
    t = np.linspace(0.5, 2, 13)
    tau = t - 0.5
    u, du, ddu = CUBIC(tau), CUBIC.deriv()(tau), CUBIC.deriv(2)(tau)
    for amplitude, omega, phase, kappa in waves:
        wave = amplitude * np.exp(1j * (phase + omega * tau + kappa * tau**2))  # imaginary part: the sine
        rate = 1j * (omega + 2 * kappa * tau)
        u, du, ddu = u + wave.imag, du + (rate * wave).imag, ddu + ((rate**2 + 2j * kappa) * wave).imag
    np.testing.assert_allclose(evaluate(drive, t), [u, du], rtol=0, atol=1e-12)
    seen = [value_slope_curvature(drive, 1, s) for s in t]
    np.testing.assert_allclose(np.transpose(seen), [u, du, ddu], rtol=1e-12, atol=1e-11)


def test_segments_own_their_begin() -> None:
    drive = assemble(
        0.0, [Piece(0.0, (1.0,)), Piece(0.5, (2.0,)), Piece(0.5, (3.0,)), Piece(1.0, (4.0,))], 5.0
    )
    assert np.array_equal(drive.start, [0, 0.5, 1])  # of two pieces at one time the last counts
    assert np.array_equal(segment_at(drive, np.array([-1, 0, 0.4, 0.5, 1, 99])), [0, 0, 0, 1, 2, 2])
    assert np.array_equal(evaluate(drive, np.array([-1, 0, 0.4, 0.5, 1, 99]))[0], [0, 1, 1, 3, 4, 4])


def test_more_breaks_change_no_value() -> None:
    waves = ((2.0, 3.0, 0.4, 5.0), (-1.0, 7.0, -2.0, -6.0))
    pieces = [Piece(0.0, (9.0,), waves[:1]), Piece(0.5, tuple(CUBIC.coef), waves), Piece(1.2, (1.0, -3.0))]
    drive = assemble(8.0, pieces, 2.0)
    finer = with_breaks(drive, np.array([0.1, 0.5, 0.7, 0.9, 1.9]))
    assert np.array_equal(finer.start, [0, 0.1, 0.5, 0.7, 0.9, 1.2, 1.9])
    assert np.array_equal(finer.first, [0, 1, 2, 4, 6, 8, 8, 8])
    t = np.linspace(-0.1, 2.3, 49)
    np.testing.assert_allclose(evaluate(finer, t), evaluate(drive, t), rtol=1e-12, atol=1e-12)


def test_constant() -> None:
    assert value_slope_curvature(constant(7), 0, 3.0) == (7, 0, 0)
    assert constant(7).before == 7
