"""The plot in a notebook: built from a recording, and drawn by a browser from nothing but its own module."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from playwright.sync_api import Browser, Route

import stickslip as ss

# A page of another origin than the panel, with nothing but what the notebook hands over.
PAGE = """<!doctype html><link rel="stylesheet" href="w.css">
<div id="here"></div><script type="module" src="m.js"></script>"""
MAIN = """import widget from "./esm.js";
const values = VALUES;
const bytes = new Uint8Array([0, 0, 0, 0, 0, 0, 0, 0, ...values.frame]);
values.frame = new DataView(bytes.buffer, 8);  // as a notebook hands it over: a view into something longer
const model = { get: (name) => values[name] };
window.unmount = widget.render({ model, el: document.getElementById("here") });
"""


def recording() -> xr.Dataset:
    """A walk of the thesis's actuator."""
    return ss.simulate(ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 5.0), 0.6, sample_rate=2e3)


def test_the_frame_holds_the_channels() -> None:
    walk = recording()
    widget = ss.panel.plot_widget(walk, ["end_effector_position", "friction_force"], height=300)
    assert widget.series == [
        {"label": "end-effector position", "unit": "m"},
        {"label": walk["friction_force"].attrs["long_name"], "unit": "N"},
    ]
    size = int.from_bytes(widget.frame[:4], "little")
    header = json.loads(widget.frame[4 : 4 + size])
    numbers = np.frombuffer(widget.frame[4 + size :], "<f4").reshape(3, -1)
    assert header == {"start": 0.0, "lengths": [1201, 1201, 1201]}
    np.testing.assert_allclose(numbers[0], walk["time"].values, rtol=1e-6)
    np.testing.assert_allclose(numbers[1], walk["end_effector_position"].values, rtol=1e-6)


def test_left_out_channels_are_the_usual_ones() -> None:
    assert [one["unit"] for one in ss.panel.plot_widget(recording()).series] == ["m", "m", "V"]


def test_an_unknown_channel_is_refused() -> None:
    with pytest.raises(
        ss.recording.RecordingError, match=r"no channel 'stage_positon' \(did you mean 'stage_position'"
    ):
        ss.panel.plot_widget(recording(), ["stage_positon"])


def test_it_needs_no_server() -> None:
    program = "import sys, stickslip as ss; ss.panel.plot_widget; print('fastapi' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_browser_draws_it(browser: Browser, scheme: str) -> None:
    walk = recording().assign_coords(time=recording()["time"] + 3.0)
    widget = ss.panel.plot_widget(walk)
    values = {"frame": list(widget.frame), "series": widget.series, "height": widget.height}
    colour = "white" if scheme == "dark" else "black"
    files = {
        "/": ("text/html", PAGE),
        "/w.css": ("text/css", f"body {{ color: {colour}; }} {widget._css}"),
        "/esm.js": ("text/javascript", widget._esm),
        "/m.js": ("text/javascript", MAIN.replace("VALUES", json.dumps(values))),
    }
    page = browser.new_page(viewport={"width": 860, "height": 460})
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    elsewhere: list[str] = []

    def answer(route: Route) -> None:
        path = route.request.url.removeprefix("http://notebook.test")
        if path not in files:
            elsewhere.append(route.request.url)
            route.abort()
            return
        kind, body = files[path]
        route.fulfill(content_type=f"{kind}; charset=utf-8", body=body)

    page.route("http://**/*", answer)
    page.goto("http://notebook.test/")
    page.locator(".plot canvas").first.wait_for()
    page.wait_for_timeout(500)
    # Both strips carry ink of their series, on the ground of the theme.
    pixels = page.evaluate(
        """() => [...document.querySelectorAll(".plot canvas")].map((canvas) => {
          const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
          const colours = new Set();
          for (let i = 0; i < data.length; i += 4)
            if (data[i + 3] > 250) colours.add(data.slice(i, i + 3).join());
          return [...colours];
        })"""
    )
    expected = {"light": ["0,103,184", "0,121,90"], "dark": ["86,180,233", "46,204,154"]}[scheme]
    assert len(pixels) == 2
    assert expected[0] in pixels[0]
    assert expected[1] in pixels[1]
    page.evaluate("window.unmount()")
    assert page.locator(".plot").count() == 0
    assert faults == []
    assert [url for url in elsewhere if "favicon" not in url] == []
    page.close()
