"""The panel's stream under load: memory and what pages get, at 20 times the speed of a real rig.

python -m benchmarks.panel_streaming [--minutes 10] [--clients 50]

A run of a minute of signal, 20 kHz on three channels, is fed at 20 times real time, over and over, to the
application as the rig feeds it; clients of another process watch all of it. The slope of the memory is
that of a straight line through the second half: 8 hours of streaming fit into it.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import socket
import tempfile
import threading
import time
from multiprocessing.queues import Queue
from pathlib import Path

import numpy as np
import uvicorn
from websockets.asyncio.client import connect

from benchmarks.panel_results import record
from stickslip.panel import create_app
from stickslip.panel.live import Live

RATE, BLOCK, SPEED, LENGTH = 20_000, 1000, 20, 60 * 20_000  # Hz, samples, times real time, samples of a run
COLUMNS = [
    {"name": n, "unit": u, "label": n} for n, u in (("drive", "V"), ("elongation", "m"), ("position", "m"))
]


def resident() -> float:
    """Memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


async def _watch(url: str, until: float, got: list[int]) -> None:
    """A page that takes everything, and comes back if it was let go."""
    while time.monotonic() < until:
        try:
            async with connect(url, proxy=None, max_size=2**26) as stream:
                await stream.send(json.dumps({"client": "watcher"}))
                while time.monotonic() < until:
                    message = await asyncio.wait_for(stream.recv(), 5.0)
                    got[0] += isinstance(message, bytes)
                    got[1] += len(message)
        except (OSError, TimeoutError):
            got[2] += 1
        except Exception:  # let go, because it was too slow
            got[2] += 1


def clients(url: str, seconds: float, count: int, answer: Queue[list[list[int]]]) -> None:
    """All pages, in a process of their own."""

    async def all_of_them() -> list[list[int]]:
        counts = [[0, 0, 0] for _ in range(count)]
        until = time.monotonic() + seconds
        await asyncio.gather(*(_watch(url, until, got) for got in counts))
        return counts

    answer.put(asyncio.run(all_of_them()))


def main() -> None:
    """Run it, print and keep the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--clients", type=int, default=50)
    asked = parser.parse_args()
    seconds = 60.0 * asked.minutes
    app = create_app(Path(tempfile.mkdtemp(prefix="stickslip-")))
    listening = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(app, log_level="error", ws_per_message_deflate=False))
    threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True).start()
    answer: Queue[list[list[int]]] = multiprocessing.get_context("spawn").Queue()
    url = f"ws://127.0.0.1:{listening.getsockname()[1]}/stream"
    watching = multiprocessing.get_context("spawn").Process(
        target=clients, args=(url, seconds, asked.clients, answer)
    )
    watching.start()

    live: Live = app.state.live
    source = {one["name"]: np.random.default_rng(i).standard_normal(BLOCK) for i, one in enumerate(COLUMNS)}
    begun = time.monotonic()
    fed, late, times, memory = 0, 0.0, [], []
    while (now := time.monotonic() - begun) < seconds:
        due = fed / (RATE * SPEED)
        if due > now:
            time.sleep(due - now)
        late = max(late, now - due)
        if fed % LENGTH == 0:
            live.begin("run", COLUMNS, RATE, LENGTH, 0)
        live.add(source)
        fed += BLOCK
        if not times or now - times[-1] >= 1.0:
            times.append(now)
            memory.append(resident())
    counts = np.array(answer.get(timeout=60))
    watching.join()
    server.should_exit = True
    half = len(times) // 2
    slope = np.polyfit(times[half:], memory[half:], 1)[0] * 3600 / SPEED
    shares = counts[:, 0].min(), counts[:, 0].max()
    megabytes = counts[:, 1].sum() / seconds / 1e6
    record(
        "streaming",
        [
            ("signal", f"{fed / RATE / 60:.0f} min in {seconds / 60:.3g} min, at most {late:.2f} s late"),
            (
                "clients",
                f"{asked.clients}, {shares[0]} to {shares[1]} blocks each, {megabytes:.2f} MB/s together",
            ),
            ("fell behind, were let go and came back", f"{counts[:, 2].sum()} times"),
            ("memory", f"{memory[0]:.0f} MB at first, {memory[half]:.0f} half way, {memory[-1]:.0f} at last"),
            ("slope of the second half", f"{slope:.2f} MB per hour of signal"),
            ("8 h of streaming", f"{8 * slope:.1f} MB more"),
        ],
        {"slope_MB_per_hour_of_signal": slope, "memory_MB": memory[:: max(len(memory) // 60, 1)]},
    )


if __name__ == "__main__":
    main()
