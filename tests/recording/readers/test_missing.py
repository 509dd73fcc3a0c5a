"""What programs write where a number is missing, infinite or beyond a range."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stickslip as ss
from stickslip.recording import RecordingError

N, AT = 60, 30


def written(path: Path, token: str, delimiter: str = ",", head: str = "") -> Path:
    rows = [
        delimiter.join((f"{1e-3 * i:.4f}", token if i == AT else f"{0.5 * i:.3f}", str(i))) for i in range(N)
    ]
    names = delimiter.join(("Time (s)", "Position (um)", "Voltage (V)"))
    path.write_text("\n".join([*head.splitlines(), names, *rows]) + "\n", encoding="utf-8")
    return path


TOKENS = """1.#QNAN -1.#IND 1.#INF -1.#INF00 1.#QNAN0 nan NaN -NaN NAN(IND) inf -Inf +INF Infinity -infinity
∞ -∞ +∞ OL -OL O.L OVLD OVERFLOW overload Overrange UNDER -- --- - ***** ##### ? n/a N/A NA null NULL
None #N/A #DIV/0! #VALUE! #NUM! #NV 9.9E+37 -9.9e37 9.91E37 3.402823e38 -3.4028235E+38
1.7976931348623157e308 no_data"""


@pytest.mark.parametrize("token", [token.replace("_", " ") for token in TOKENS.split()] + [""])
def test_a_token_is_no_number_and_leaves_its_sample_out(tmp_path: Path, token: str) -> None:
    path = written(tmp_path / "a.csv", token)
    with pytest.raises(
        RecordingError, match=r"line 32: position .*is empty, NaN or infinite \(missing='drop'"
    ):
        ss.read_recording(path)
    found = ss.read_recording(path, missing="drop")
    kept = np.delete(np.arange(N), AT)
    np.testing.assert_allclose(found.time, 1e-3 * kept)
    np.testing.assert_allclose(found.position, 0.5e-6 * kept, atol=1e-15)


@pytest.mark.parametrize("token", ["#N/A", "1.#QNAN", "-1.#IND", "#DIV/0!"])
def test_the_sign_of_comments_in_a_token_begins_no_comment(tmp_path: Path, token: str) -> None:
    """Cut off at its sign, "1.#QNAN" was 1.0."""
    path = written(tmp_path / "a.csv", token, head="# a rig\n# a day\n")
    with pytest.raises(RecordingError, match="line 34: position"):
        ss.read_recording(path)
    assert ss.read_recording(path, missing="drop").sizes["time"] == N - 1
    path.write_text(path.read_text().replace("\n0.0300,", "\n" + token + ","))
    with pytest.raises(RecordingError, match=r"line 34: time \(.*, position"):
        ss.read_recording(path)


def test_numbers_of_fortran(tmp_path: Path) -> None:
    rows = [f"  {i}.0D-03 {0.5 * i:.3f}d0 -1.25D+01" for i in range(N)]
    (tmp_path / "a.dat").write_text("\n".join(["time_s position_um drive_V", *rows]) + "\n")
    found = ss.read_recording(tmp_path / "a.dat")
    np.testing.assert_allclose(found.time, 1e-3 * np.arange(N), rtol=1e-15)
    np.testing.assert_allclose(found.position, 0.5e-6 * np.arange(N), rtol=1e-15)
    np.testing.assert_array_equal(found.drive, -12.5)


@pytest.mark.parametrize("token", ["-9999", "n.v.", "err 3", "1e30"])
def test_ones_own_token(tmp_path: Path, token: str) -> None:
    path = written(tmp_path / "a.csv", token, ";")
    found = ss.read_recording(path, missing="drop", missing_values=[token])
    np.testing.assert_allclose(found.voltage, np.delete(np.arange(N), AT))
    with pytest.raises(RecordingError, match=r"line 32: position .* is empty"):
        ss.read_recording(path, missing_values=[token])


def test_dropping_is_no_advice_where_nothing_would_be_left(tmp_path: Path) -> None:
    rows = [f"{i},{i},OL" for i in range(N)]
    (tmp_path / "a.csv").write_text("\n".join(["t [s],x [um],u [V]", "0,0,1", *rows[1:]]) + "\n")
    with pytest.raises(RecordingError, match=r"u .* no two samples are complete: name columns without it"):
        ss.read_recording(tmp_path / "a.csv")
    found = ss.read_recording(tmp_path / "a.csv", {"x": "x"})
    assert found.sizes["time"] == N


LABELS = (
    ("Position (m)", 0.1, "position .*the file says m, and as m they go over 5.9 m"),
    ("stage [mm]", 100.0, "stage .*the file says mm, and as m they go over 5.9 m"),
    ("Drive [kV]", 10.0, "drive .*the file says kV, and as V they go over 5.9e[+]05 V"),
    ("Force (N)", 1e4, "force .*the file says N, and as N they go over 5.9e[+]05 N"),
    ("v_mm_s", 1e4, "v .*the file says mm/s, and as m/s they go over 590 m/s"),
)


@pytest.mark.parametrize(("label", "factor", "said"), LABELS)
def test_a_label_is_doubted_where_the_numbers_are_not_likely(
    tmp_path: Path, label: str, factor: float, said: str
) -> None:
    rows = [f"{1e-3 * i:.4f},{factor * i:.6g}" for i in range(N)]
    (tmp_path / "a.csv").write_text("\n".join([f"Time (s),{label}", *rows]) + "\n")
    with pytest.raises(RecordingError, match=said):
        ss.read_recording(tmp_path / "a.csv")
    (name,) = [said.split(" ")[0]]
    unit = {"position": "m", "stage": "mm", "drive": "kV", "force": "N", "v": "mm/s"}[name]
    ss.read_recording(tmp_path / "a.csv", {name: 1}, {name: unit})  # who says so means it


def test_a_label_of_the_time_is_doubted(tmp_path: Path) -> None:
    rows = [f"{100 * i},{i}" for i in range(N)]  # microseconds
    (tmp_path / "a.csv").write_text("\n".join(["Time (s),x (um)", *rows]) + "\n")
    with pytest.raises(RecordingError, match=r"time .*the file says s, and as seconds they are 100 s apart"):
        ss.read_recording(tmp_path / "a.csv")
    assert ss.read_recording(tmp_path / "a.csv", units={"time": "us"}).time[-1] == pytest.approx(
        1e-4 * (N - 1)
    )
    slow = "\n".join(["Time (s),x (um)", *[f"{10 * i},{i}" for i in range(N)]])  # creep may be logged so
    (tmp_path / "a.csv").write_text(slow)
    assert ss.read_recording(tmp_path / "a.csv").time[-1] == 10 * (N - 1)
