"""Decimation, the live run in memory, control: the parts behind the stream."""

from __future__ import annotations

import asyncio
import json
import struct
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stickslip.panel.control import Control, ControlError, shown
from stickslip.panel.decimation import extremes, window
from stickslip.panel.live import Live
from stickslip.panel.stream import MOST_WAITING, Client, Hub, packed


def unpacked(message: bytes) -> tuple[dict[str, Any], list[np.ndarray]]:
    (length,) = struct.unpack_from("<I", message)
    header = json.loads(message[4 : 4 + length])
    numbers = np.frombuffer(message, "<f4", offset=4 + length)
    return header, np.split(numbers, np.cumsum(header["lengths"])[:-1])


def test_a_message_holds_header_and_numbers() -> None:
    header, arrays = unpacked(packed({"kind": "x", "µ": 1}, [1.5, 2.0], [], np.array([3.25])))
    assert header == {"kind": "x", "µ": 1, "lengths": [2, 0, 1]}
    assert [one.tolist() for one in arrays] == [[1.5, 2.0], [], [3.25]]


def test_extremes_keep_every_peak() -> None:
    values = np.zeros((2, 1000), np.float32)
    values[0, 777], values[1, 13] = 5.0, -3.0
    shown = extremes(values, 10)
    assert shown.shape == (2, 200)
    assert shown[0, 2 * 77 + 1] == 5.0
    assert shown[1, 2 * 1] == -3.0
    assert np.count_nonzero(shown) == 2


@given(count=st.integers(1, 3000), points=st.integers(2, 500))
def test_a_window_has_few_points_and_the_same_range(count: int, points: int) -> None:
    random = np.random.default_rng(count)
    time = np.cumsum(random.uniform(0.1, 1.0, count))
    values = random.standard_normal((2, count)).astype(np.float32)
    times, shown = window(time, values, points)
    assert shown.shape == (2, times.size)
    assert times.size <= points + 2
    assert np.all(np.diff(times) > 0)
    np.testing.assert_array_equal(shown.min(axis=1), values.min(axis=1))
    np.testing.assert_array_equal(shown.max(axis=1), values.max(axis=1))


@given(count=st.integers(1, 3000), points=st.integers(2, 500))
def test_a_window_begins_and_ends_with_samples_as_they_are(count: int, points: int) -> None:
    """What a curve ends at is read off it: not the least of what lies before."""
    values = np.random.default_rng(count).standard_normal((2, count)).astype(np.float32)
    time = np.arange(count) * 1e-3
    times, shown = window(time, values, points)
    for end in (0, -1):
        assert times[end] == time[end]
        np.testing.assert_array_equal(shown[:, end], values[:, end])


class Listening(Hub):
    """A hub that keeps what it was told."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[Any] = []

    def send(self, message: str | bytes) -> None:
        self.told.append(message)


COLUMNS = [{"name": "a", "unit": "V", "label": "a"}, {"name": "b", "unit": "m", "label": "b"}]


def test_the_live_run_is_told_in_blocks_and_again_to_who_comes_late() -> None:
    hub = Listening()
    live = Live(hub)
    random = np.random.default_rng(1)
    samples = random.standard_normal((2, 10_000))
    live.begin("run", COLUMNS, 1000.0, 10_000, 250)
    for block in np.split(samples, 20, axis=1):
        live.add({"a": block[0], "b": block[1]})
    header = json.loads(hub.told[0])
    assert (header["begin"], header["bucket"], header["samples"]) == (-0.25, 8, 10_000)
    came = np.zeros((2, 2500), np.float32)
    for message in hub.told[1:]:
        said, arrays = unpacked(message)
        came[:, 2 * said["bucket"] : 2 * said["bucket"] + arrays[0].size] = arrays
    expected = samples.reshape(2, 1250, 8).astype(np.float32)
    pairs = came.reshape(2, 1250, 2)
    np.testing.assert_array_equal(pairs.min(axis=2), expected.min(axis=2))
    np.testing.assert_array_equal(pairs.max(axis=2), expected.max(axis=2))
    np.testing.assert_array_equal(pairs[..., 0] > pairs[..., 1], expected[..., 0] > expected[..., -1])

    live.triggered(260)  # 10 ms after the drive began
    assert json.loads(hub.told[-1])["zero"] == pytest.approx(0.01)

    late = [message for greet in hub.greetings for message in greet(Client("x", ""), {})]
    said, arrays = unpacked(late[1])  # type: ignore[arg-type]
    np.testing.assert_array_equal(np.array(arrays), came)
    np.testing.assert_allclose(said["latest"], samples[:, -1], rtol=1e-6)

    said, arrays = unpacked(live.window(header["trace"], 1.0, 1.1, 1000))  # full resolution where zoomed in
    low = 1249  # time 1 s is sample 1250; one more on each side
    np.testing.assert_array_equal(arrays[1], samples[0, low : low + arrays[1].size].astype(np.float32))
    np.testing.assert_allclose(arrays[0] + 1.0, (low + np.arange(arrays[0].size)) / 1000 - 0.25, atol=1e-6)
    with pytest.raises(ValueError, match="no longer"):
        live.window(header["trace"] + 1, 0, 1, 10)


def test_the_last_values_of_a_run_are_those_of_its_recording() -> None:
    """More is measured than is recorded, and the end may fill no bucket: pages say what the file says."""
    hub = Listening()
    live = Live(hub)
    live.begin("run", COLUMNS, 1000.0, 10_000, 250)
    samples = np.random.default_rng(3).standard_normal((2, 9_995))
    live.add({"a": samples[0, :9_992], "b": samples[1, :9_992]})
    live.add({"a": samples[0, 9_992:], "b": samples[1, 9_992:]})  # no whole bucket of 8: no block
    live.end()
    assert json.loads(hub.told[-1])["kind"] == "latest"
    np.testing.assert_allclose(json.loads(hub.told[-1])["values"], samples[:, -1], rtol=1e-6)
    live.recorded({"b": 2.5, "a": 1.5})
    assert json.loads(hub.told[-1]) == {"kind": "latest", "trace": 1, "values": [1.5, 2.5]}
    late = [message for greet in hub.greetings for message in greet(Client("x", ""), {})]
    assert unpacked(late[1])[0]["latest"] == [1.5, 2.5]  # type: ignore[arg-type]
    live.begin("run", COLUMNS, 1000.0, 10_000, 250)
    live.add({"a": samples[0], "b": samples[1]})
    np.testing.assert_allclose(unpacked(hub.told[-1])[0]["latest"], samples[:, -1], rtol=1e-6)


def test_blocks_wait_for_each_other_while_the_event_loop_is_behind() -> None:
    """Else each page would be written all of them, one after the other, before a stop is heard."""
    loop = asyncio.new_event_loop()  # that has no time until it is run
    hub, page = Hub(), Client("x", "")
    hub._loop = loop
    hub.clients.add(page)
    live = Live(hub)
    samples = np.random.default_rng(2).standard_normal((2, 5_000))
    live.begin("run", COLUMNS, 1000.0, 10_000, 250)

    def run() -> list[Any]:  # in a thread, for a browser may be driven by a loop of this one
        with ThreadPoolExecutor(1) as thread:
            thread.submit(loop.run_until_complete, asyncio.sleep(0)).result()
        return [page.waiting.get_nowait() for _ in range(page.waiting.qsize())]

    assert [json.loads(one)["kind"] for one in run()] == ["trace"]
    came = np.zeros((2, 1250), np.float32)
    messages = []
    for i, block in enumerate(np.split(samples, 50, axis=1)):
        live.add({"a": block[0], "b": block[1]})
        if i in (0, 30):
            messages += run()
    assert len(messages) == 2
    live.end()
    messages += run()
    assert len(messages) == 4
    for message in messages:
        said, arrays = unpacked(message)
        came[:, 2 * said["bucket"] : 2 * said["bucket"] + arrays[0].size] = arrays
    np.testing.assert_array_equal(
        came.reshape(2, 625, 2).max(axis=2), samples.reshape(2, 625, 8).max(axis=2).astype(np.float32)
    )
    loop.close()


def test_memory_is_bounded() -> None:
    with pytest.raises(MemoryError, match="too many"):
        Live(Listening()).begin("run", COLUMNS, 1000.0, 40_000_000, 0)


def test_a_page_that_is_too_slow_is_let_go() -> None:
    client = Client("x", "")
    for _ in range(MOST_WAITING + 10):
        client.put("message")
    assert client.waiting.qsize() == 1
    assert client.waiting.get_nowait() is None


def test_control_is_held_by_one_page_and_handed_over() -> None:
    now = 0.0
    hub = Listening()
    control = Control(hub, clock=lambda: now)
    first, second = Client("first", ""), Client("second", "")
    hub.clients |= {first, second}
    control.need("first")
    with pytest.raises(ControlError, match="another page"):
        control.need("second")
    control.ask("second")
    assert (control.holder, control.asking) == ("first", "second")
    control.hand_over(second)  # only the holder can
    assert control.holder == "first"
    control.hand_over(first)
    assert (control.holder, control.asking) == ("second", "")
    hub.clients.discard(second)
    now = 5.0
    control.watch()
    with pytest.raises(ControlError):  # it may be loading anew
        control.need("first")
    now = 20.0
    control.watch()
    assert control.holder == ""
    control.need("first")
    told = json.loads(hub.told[-1])
    assert told["holder"] == shown("first")
    assert "first" not in hub.told[-1], "nobody is told the secret of a page"
    with pytest.raises(ControlError, match="X-Client"):
        control.need("")


def test_only_the_watch_takes_control_from_a_lost_page_and_ends_what_that_had_armed() -> None:
    now, ended = 0.0, list[str]()
    control = Control(Listening(), clock=lambda: now)
    control.gone.append(lambda: ended.append(control.holder))
    control.need("first")  # which is not connected
    control.ask("")  # a page without a secret asks for nothing
    now = 20.0
    with pytest.raises(ControlError):
        control.need("second")
    control.ask("second")
    assert ended == []
    control.watch()
    assert ended == ["second"]
    control.need("second")
    control.watch()
    assert ended == ["second"]
