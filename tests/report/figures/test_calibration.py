import numpy as np

from stickslip.recording.calibration import fit_calibration, read_table
from stickslip.report.figures.calibration import calibration_curve


def test_curve_and_errors() -> None:
    table = read_table("kang2007-inductive")
    calibration = fit_calibration(table.x, table.y, 5)
    curve, rest = calibration_curve(calibration, table.x, table.y).axes
    readings, line = curve.lines
    np.testing.assert_allclose(readings.get_xdata(), table.x.ravel())
    np.testing.assert_allclose(np.asarray(readings.get_ydata())[:4], [0.0, 0.0, 0.0, 0.1])  # mm
    np.testing.assert_allclose(np.asarray(line.get_ydata())[-1], 1e3 * calibration(10.002))
    assert curve.get_ylabel() == "true value (mm)"
    assert rest.get_ylabel() == "error (µm)"
    assert rest.get_xlabel() == "reading (V)"
    shown = np.concatenate([np.asarray(found.get_ydata(), dtype=float) for found in rest.lines[1:]])
    assert calibration.max_error is not None
    np.testing.assert_allclose(np.abs(shown).max(), 1e6 * calibration.max_error)
    assert rest.collections  # the band


def test_a_calibration_through_all_points_has_no_band() -> None:
    calibration = fit_calibration([0.0, 1.0], [0.0, 1e-3], 1)
    assert not calibration_curve(calibration, [0.0, 1.0], [0.0, 1e-3]).axes[1].collections
