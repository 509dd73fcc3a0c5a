import numpy as np

from stickslip.recording import make_recording
from stickslip.report.figures.recordings import recording_detail, recordings_together

TIME = np.arange(400) * 1e-3


def recording(volts: float, **more):
    variables = {"drive_voltage": volts * (TIME > 0.2), "end_effector_position": 1e-7 * volts * TIME}
    return make_recording(TIME, {**variables, **more})


def test_together_shows_what_all_have() -> None:
    both = {"low": recording(35.0), "high": recording(65.0, force=TIME)}
    drive, position = recordings_together(both).axes
    assert drive.get_ylabel() == "drive voltage (V)"
    assert position.get_ylabel() == "end-effector position (µm)"
    assert position.get_xlabel() == "time (ms)"
    assert [line.get_label() for line in drive.lines] == ["low", "high"]
    np.testing.assert_allclose(np.asarray(position.lines[1].get_ydata())[-1], 65.0 * 0.1 * 0.399)


def test_detail_shows_every_sample_of_the_part() -> None:
    drive, position = recording_detail(recording(65.0), 0.19, 0.21, 0.2).axes
    samples, mark = drive.lines
    np.testing.assert_allclose(samples.get_xdata(), np.arange(190, 211))
    assert samples.get_marker() == "."
    np.testing.assert_allclose(mark.get_xdata(), 200.0)
    assert position.get_xlabel() == "time (ms)"
