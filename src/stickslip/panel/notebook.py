"""The panel's plots in a notebook: the same JavaScript, through anywidget (extra ``stickslip[jupyter]``)."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import anywidget
import traitlets

from ..quantities.records import did_you_mean
from ..recording import RecordingError, validate_recording
from .packing import packed

if TYPE_CHECKING:
    import xarray as xr

_STATIC = Path(__file__).parent / "static"
_IMPORT = re.compile(r'^import\s+(?P<what>.+?)\s+from\s+"(?P<file>[^"]+)";\s*$', re.MULTILINE)


def _bundled(name: str, addresses: dict[str, str]) -> str:
    """Return the text of a JavaScript module of the page, with its imports embedded as data URLs.

    Args:
        name: file of the module, relative to the folder of the page's files.
        addresses: data URL of each module embedded so far, by file; the function adds further ones.
    """
    folder = (_STATIC / name).parent

    def inside(found: re.Match[str]) -> str:
        path = (folder / found["file"]).resolve().relative_to(_STATIC.resolve()).as_posix()
        if path not in addresses:
            text = _bundled(path, addresses).encode()
            addresses[path] = f"data:text/javascript;base64,{base64.b64encode(text).decode()}"
        return f'import {found["what"]} from "{addresses[path]}";'

    return _IMPORT.sub(inside, (_STATIC / name).read_text(encoding="utf-8"))


def _style() -> str:
    """Return the CSS rules of the panel that plots need, as text, limited to the widget's element."""
    text = (_STATIC / "style.css").read_text(encoding="utf-8")
    light, dark = (
        re.search(rf"^{re.escape(where)} \{{(.*?)\}}", text, re.MULTILINE | re.DOTALL)
        for where in (":root", ':root[data-theme="dark"]')
    )
    assert light is not None
    assert dark is not None
    plots = "\n".join(line for line in text.splitlines() if line.startswith((".plot", "button")))
    uplot = (_STATIC / "vendor" / "uplot.css").read_text(encoding="utf-8")
    return (
        f'{uplot}\n.stickslip-plot {{ {light[1]} }}\n.stickslip-plot[data-theme="dark"] {{ {dark[1]} }}\n'
        f".stickslip-plot {{ background: var(--panel); color: var(--text); padding: 8px; border-radius: 8px; "
        "box-sizing: border-box;\n& * { box-sizing: border-box; }\n[hidden] { display: none; }\n"
        f"{plots}\n}}\n"
    )


class PlotWidget(anywidget.AnyWidget):
    """Widget with a plot that has zoom, pan, and cursors that show differences; made by `plot_widget`."""

    _esm = _bundled("widget.js", {})
    _css = _style()
    frame = traitlets.Bytes().tag(sync=True)
    series = traitlets.List().tag(sync=True)
    height = traitlets.Int(420).tag(sync=True)


def plot_widget(
    recording: xr.Dataset, channels: Sequence[str] | None = None, *, height: int = 420
) -> PlotWidget:
    """Return a notebook widget that plots a recording or a simulation, as the control panel does.

    Args:
        recording: dataset over "time" from `simulate`, `read_recording` or a rig.
        channels: names of the channels to draw; channels of one unit share an axis. Default: all positions,
            elongations and voltages, or all channels if the recording has none of these.
        height: height of the plot, in pixels.

    Raises:
        RecordingError: `recording` is not a recording, or has no such channel.
    """
    validate_recording(recording)
    known = [str(name) for name in recording.data_vars]
    if channels is None:
        usual = [n for n in known if n.endswith(("_position", "_elongation", "_voltage"))]
        channels = usual or known
    for name in channels:
        if name not in known:
            raise RecordingError(
                f"there is no channel {name!r}{did_you_mean(name, known)}: {', '.join(known)}"
            )
    series = [
        {
            "label": str(recording[name].attrs["long_name"]),
            "unit": str(recording[name].attrs["units"]),
        }
        for name in channels
    ]
    # Times count from the first sample, because float32 has the smallest steps near 0.
    time = recording["time"].values
    frame = packed({"start": float(time[0])}, time - time[0], *(recording[n].values for n in channels))
    return PlotWidget(frame=frame, series=series, height=height)
