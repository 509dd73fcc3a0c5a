"""Frequency responses that other instruments and programs measured, and what is fitted to them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff
import scipy.io
import xarray as xr
from typer.testing import CliRunner

import stickslip as ss
from recording.readers.mat73 import write_mat73
from stickslip.cli import app
from stickslip.recording import RecordingError

F = np.logspace(1, 4, 150)
OMEGA, ZETA = 2 * np.pi * 800.0, 0.05
W = 2 * np.pi * F
G = 2.0 * OMEGA**2 / (OMEGA**2 - W**2 + 2j * ZETA * OMEGA * W)  # a ratio, or um/V
DB, DEG = 20 * np.log10(np.abs(G)), np.angle(G, deg=True)


def _table(path: Path, header: str, *columns: np.ndarray, sign: str = ",") -> Path:
    rows = "\n".join(sign.join(f"{one:.10g}" for one in row) for row in zip(*columns, strict=True))
    path.write_text(f"{header}\n{rows}\n", encoding="utf-8")
    return path


TABLES: dict[str, tuple[str, tuple[np.ndarray, ...], str]] = {
    "rohde_schwarz.csv": (
        "Frequency in Hz,Gain in dB,Phase in °,Amplitude in Vpp", (F, DB, DEG, 0 * F + 1), ",",
    ),
    "siglent.csv": ("Frequency(Hz),Ampl(dB),Phase(Deg)", (F, DB, DEG), ","),
    "keysight.csv": (
        "#,Frequency (Hz),Amplitude (Vpp),Gain (dB),Phase (°)", (np.arange(150.0), F, 0 * F, DB, DEG), ",",
    ),
    "bode100.csv": (
        "Frequency (Hz);Trace 1: Gain: Magnitude (dB);Trace 1: Gain: Phase (°)", (F, DB, DEG), ";",
    ),
    "picoscope.csv": (
        "Frequency Log(Hz),Frequency (Hz),Gain (dB),Phase (deg),Unwrapped Phase (deg)",
        (np.log10(F), F, DB, DEG, DEG), ",",
    ),
    "radians.txt": ("omega [rad/s]\tgain [1]\tphase [rad]", (W, np.abs(G), np.angle(G)), "\t"),
    "kilohertz.txt": ("f (kHz)\tmag (dB)\targ (rad)", (F / 1e3, DB, np.angle(G)), "\t"),
    "parts.csv": ("freq_Hz,Re,Im", (F, G.real, G.imag), ","),
    "backwards.csv": ("Frequency (Hz),Gain (dB),Phase (deg)", (F[::-1], DB[::-1], DEG[::-1] - 360.0), ","),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_bode_plots(tmp_path: Path, name: str) -> None:
    header, columns, sign = TABLES[name]
    path = _table(tmp_path / name, header, *columns, sign=sign)
    found = ss.recording.read_frequency_response(path)
    assert dict(found.sizes) == {"frequency": 150, "output": 1, "input": 1}
    np.testing.assert_allclose(found["frequency"], F, rtol=1e-8)
    np.testing.assert_allclose(found["response"].values[:, 0, 0], G, rtol=1e-6)
    assert found["response"].attrs["units"] == "1"
    looked = ss.inspect_file(path)
    assert looked.recording is None
    xr.testing.assert_identical(looked.response, found)
    assert not any("position" in one["guess"] for one in looked.columns)
    assert set(looked.named) in ({"frequency", "gain", "phase"}, {"frequency", "real", "imag"})
    assert "frequency response: 150 frequencies from 10 Hz to 10 kHz" in str(looked)


def test_identify_frequency_takes_it(tmp_path: Path) -> None:
    path = _table(tmp_path / "a.csv", "Frequency (Hz),Gain (dB),Phase (deg)", F, DB, DEG)
    response = ss.recording.read_frequency_response(path, scale="0.5 um/V")
    fit = ss.identify_frequency(response, 1, complex_modes=False, remainder=False)
    assert fit.values["natural_frequency_1"] == pytest.approx(OMEGA, rel=1e-6)
    assert fit.values["damping_ratio_1"] == pytest.approx(ZETA, rel=1e-6)
    assert fit.values["gain_1"] == pytest.approx(1e-6, rel=1e-6)
    assert response["response"].attrs["units"] == "m/V"


def _mat(path: Path, version: str, variables: dict[str, Any]) -> Path:
    if version == "7.3":
        write_mat73(path, variables)
    else:
        scipy.io.savemat(path, variables)
    return path


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_complex_numbers_of_matlab(tmp_path: Path, version: str) -> None:
    run = {"freq": F.reshape(-1, 1), "G": np.stack([G, 3 * G], axis=1)}
    path = _mat(tmp_path / "a.mat", version, {"run": run} if version == "5" else run)
    found = ss.recording.read_frequency_response(path)
    np.testing.assert_allclose(found["response"].values[:, 0, 0], G)
    np.testing.assert_allclose(found["response"].values[:, 1, 0], 3 * G)
    name = "run.G" if version == "5" else "G"
    columns = {"frequency": "run.freq" if version == "5" else "freq"}
    columns |= {part: f"{part}({name})(:,2)" for part in ("real", "imag")}
    one = ss.recording.read_frequency_response(path, columns, {"gain": "um/V"})
    np.testing.assert_allclose(one["response"].values[:, 0, 0], 3e-6 * G)


def test_what_bode_of_matlab_gives(tmp_path: Path) -> None:
    """[mag, phase, wout] = bode(sys): numbers without a unit, which is asked for."""
    variables = {"mag": np.abs(G).reshape(1, 1, -1), "phase": DEG.reshape(1, 1, -1), "wout": W.reshape(-1, 1)}
    path = _mat(tmp_path / "a.mat", "5", variables)
    units: dict[str, str] = {}
    for name, words, said in (
        ("frequency", r"'wout': no unit is said.*'rad/s'", "rad/s"),
        ("gain", r"'mag': no unit is said.*'dB'", "1"),
        ("phase", r"'phase': no unit is said.*'deg'", "deg"),
    ):
        with pytest.raises(RecordingError, match=words):
            ss.recording.read_frequency_response(path, units=units)
        units[name] = said
    found = ss.recording.read_frequency_response(path, units=units)
    np.testing.assert_allclose(found["response"].values[:, 0, 0], G)
    assert "no unit is said" in ss.inspect_file(path).problem


def test_complex_numbers_of_numpy_and_hdf5(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", f=F, response=G)
    found = ss.recording.read_frequency_response(tmp_path / "a.npz")
    np.testing.assert_allclose(found["response"].values[:, 0, 0], G)
    data = xr.Dataset({"real": ("f", G.real), "imag": ("f", G.imag)}, {"f": ("f", F, {"units": "Hz"})})
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    found = ss.recording.read_frequency_response(tmp_path / "a.nc")
    np.testing.assert_allclose(found["response"].values[:, 0, 0], G)


def test_a_universal_file(tmp_path: Path) -> None:
    def function(node: int, values: np.ndarray) -> dict[str, Any]:
        return {
            "type": 58, "func_type": 4, "rsp_node": node, "rsp_dir": 3, "ref_node": 7, "ref_dir": 3,
            "data": values, "x": F, "abscissa_spacing": 0, "id1": "H", "rsp_ent_name": "NONE",
            "ref_ent_name": "NONE", "abscissa_spec_data_type": 18, "ordinate_spec_data_type": 8,
            "orddenom_spec_data_type": 13, "z_axis_spec_data_type": 0, "ordinate_axis_units_lab": "um",
            "orddenom_axis_units_lab": "N",
        }  # fmt: skip

    pyuff.UFF(str(tmp_path / "a.uff")).write_sets([function(1, G), function(2, -2 * G)], "overwrite")
    found = ss.recording.read_frequency_response(tmp_path / "a.uff")
    assert dict(found.sizes) == {"frequency": 150, "output": 2, "input": 1}
    np.testing.assert_allclose(found["response"].values[:, 1, 0], -2e-6 * G, rtol=1e-5, atol=1e-14)
    assert found["response"].attrs["units"] == "m/N"
    looked = ss.inspect_file(tmp_path / "a.uff").response
    xr.testing.assert_identical(looked, found)


@pytest.mark.parametrize(
    ("header", "columns", "words"),
    [
        ("Frequency (Hz),Gain,Phase (deg)", (F, DB, DEG), r"'Gain': no unit is said.*units=\{'gain': 'dB'\}"),
        ("Frequency (Hz),Gain (dB),Phase", (F, DB, DEG), r"'Phase': no unit is said"),
        ("Frequency (Hz),Gain (dB),Phase (um)", (F, DB, DEG), r"'um' is no phase"),
        ("Frequency (s),Gain (dB),Phase (deg)", (F, DB, DEG), r"'s' is no frequency"),
        ("Frequency (Hz),Gain (dB),Phase (deg)", (F * 0 + 5.0, DB, DEG), "two lines at 5 Hz"),
        ("Frequency (Hz),Gain (dB),Phase (deg)", (F - 20.0, DB, DEG), "below 0"),
        ("Frequency (Hz),Gain (dB)", (F, DB), "no columns are called frequency, gain and phase"),
    ],
)
def test_what_is_not_clear_is_asked_for(
    tmp_path: Path, header: str, columns: tuple[np.ndarray, ...], words: str
) -> None:
    with pytest.raises(RecordingError, match=words) as caught:
        ss.recording.read_frequency_response(_table(tmp_path / "a.csv", header, *columns))
    assert str(caught.value).startswith(f"{tmp_path / 'a.csv'}: ")


def test_arguments_are_checked(tmp_path: Path) -> None:
    path = _table(tmp_path / "a.csv", "a,b,c", F, DB, DEG)
    columns = {"frequency": "a", "gain": "b", "phase": "c"}
    with pytest.raises(RecordingError, match="must say frequency, gain and phase"):
        ss.recording.read_frequency_response(path, {"frequency": "a"})
    with pytest.raises(RecordingError, match="units has 'time'"):
        ss.recording.read_frequency_response(path, columns, {"time": "s"})
    with pytest.raises(RecordingError, match=r"in m/V already: scale"):
        ss.recording.read_frequency_response(path, columns, {"gain": "um/V", "phase": "deg"}, scale="2 N/V")
    found = ss.recording.read_frequency_response(path, columns, {"gain": "dB", "phase": "deg"})
    np.testing.assert_allclose(found["response"].values[:, 0, 0], G, rtol=1e-6)


def test_inspect_draws_it(tmp_path: Path) -> None:
    path = _table(tmp_path / "a.csv", "Frequency (Hz),Gain (dB),Phase (deg)", F, DB, DEG)
    result = CliRunner().invoke(app, ["inspect", str(path), "--picture", str(tmp_path / "a.svg")])
    assert result.exit_code == 0, result.output
    assert 'stickslip.recording.read_frequency_response("a.csv")' in result.output
    assert "end_effector_position" not in result.output
    assert (tmp_path / "a.svg").read_text().startswith("<svg")


def test_a_recording_of_a_lock_in_amplifier_stays_one(tmp_path: Path) -> None:
    """Gain and phase over time, at frequencies that are set: there is a clock."""
    header = "Time (s),Frequency (Hz),Gain (V),Phase (deg)"
    path = _table(tmp_path / "a.csv", header, np.arange(150.0) / 10, F, np.abs(G), DEG)
    assert ss.inspect_file(path).response is None
