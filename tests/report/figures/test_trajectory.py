import numpy as np
import pytest

from stickslip.recording import make_recording
from stickslip.report.figures.trajectory import trajectory

TIME = np.linspace(0.0, 0.4, 41)
STAGE = 6.87e-6 * (TIME % 0.2) / 0.2
WALKER = STAGE + 3e-6 * (TIME // 0.2)


def test_panels_of_an_actuator() -> None:
    recording = make_recording(
        TIME,
        {
            "end_effector_position": WALKER,
            "stage_position": STAGE,
            "friction_force": 0.54 * np.sin(TIME),
            "drive_voltage": 65.0 * (TIME % 0.2) / 0.2,
        },
    )
    drive, position, force = trajectory(recording).axes
    assert drive.get_ylabel() == "drive voltage (V)"
    assert position.get_ylabel() == "position (µm)"
    assert force.get_ylabel() == "friction force (mN)"
    assert force.get_xlabel() == "time (ms)"
    lines = {line.get_label(): line for line in position.lines}
    assert set(lines) == {"stage position", "end-effector position"}
    np.testing.assert_allclose(lines["end-effector position"].get_ydata(), WALKER * 1e6)
    np.testing.assert_allclose(lines["stage position"].get_xdata(), TIME * 1e3)
    legend = position.get_legend()
    assert legend is not None
    assert {text.get_text() for text in legend.get_texts()} == set(lines)
    assert drive.get_legend() is None  # one line, named by its axis
    assert force.get_xlim() == (0.0, 400.0)


def test_panels_of_a_pulled_slider() -> None:
    recording = make_recording(
        TIME,
        {
            "end_effector_position": (1e-3 * TIME, "m"),
            "spring_position": (2e-3 * TIME, "m"),
            "friction_force": 3.0 * np.ones_like(TIME),
            "spring_force": (4.0 * np.ones_like(TIME), "N"),
        },
    )
    position, force = trajectory(recording).axes
    assert [line.get_label() for line in position.lines] == ["spring position", "end-effector position"]
    assert force.get_ylabel() == "force (N)"
    np.testing.assert_array_equal(force.lines[1].get_ydata(), 4.0)


def test_a_recording_without_any_of_it() -> None:
    with pytest.raises(ValueError, match=r"temperature.*drive_voltage.*friction_force"):
        trajectory(make_recording(TIME, {"temperature": (TIME, "K")}))
