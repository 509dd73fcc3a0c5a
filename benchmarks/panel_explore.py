"""How often the Explore page redraws while a slider moves: server, network and drawing, headless.

    python -m benchmarks.panel_explore [--chromium /usr/bin/chromium] [--seconds 5]

A slider is moved in every frame. What counts is the number of pictures: frames with an answer of the server
that had not been shown before, for an experiment of 1 s.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from benchmarks.panel_results import record

# The slider is moved in every frame, as a hand does; the page counts the answers that it has drawn.
_DRAG = """([slider, milliseconds]) => new Promise((done) => {
  const root = document.querySelector(".explore");
  const start = performance.now(), home = slider.value, gaps = [];
  const before = Number(root.dataset.curves);
  let frames = 0, last = root.dataset.drawn, at = start;
  const frame = () => {
    const now = performance.now();
    frames += 1;
    if (root.dataset.drawn !== last) {
      last = root.dataset.drawn;
      gaps.push(now - at);
      at = now;
    }
    if (now - start < milliseconds) {
      slider.value = String(Math.round(500 + 150 * Math.sin((now - start) / 400)));
      slider.dispatchEvent(new Event("input", { bubbles: true }));
      requestAnimationFrame(frame);
      return;
    }
    slider.value = home;
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    slider.dispatchEvent(new Event("change", { bubbles: true }));
    const elapsed = (now - start) / 1000;
    gaps.sort((a, b) => a - b);
    done({
      pictures: gaps.length / elapsed,
      frames: frames / elapsed,
      curves: (Number(root.dataset.curves) - before) / elapsed,
      slow: gaps[Math.floor(0.95 * gaps.length)] ?? NaN,
    });
  };
  requestAnimationFrame(frame);
})"""


def drag(page: Page, label: str, seconds: float) -> dict[str, float]:
    """Per second: pictures (frames with new curves), frames, step curves; and ms below which 95 % of the gaps
    between pictures are ("slow"), while a slider is dragged for some seconds."""
    slider = page.get_by_role("slider", name=label, exact=True)
    return page.evaluate(_DRAG, [slider.element_handle(), 1000 * seconds])


def processor_time() -> float:
    """Of all processes below this one (server, browser, its driver), s: a busy machine changes it little."""
    by_parent: dict[int, list[tuple[int, float]]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended meanwhile
            fields = path.read_text().rpartition(")")[2].split()
            used = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
            by_parent.setdefault(int(fields[1]), []).append((int(path.parent.name), used))

    def below(pid: int) -> float:
        return sum(used + below(child) for child, used in by_parent.get(pid, []))

    return below(os.getpid())


def main() -> None:
    """Serve, drag, print and keep the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--chromium", default="/usr/bin/chromium")
    parser.add_argument("--seconds", type=float, default=5.0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "stickslip", "panel", folder, "--port", "0", "--no-browser"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ)
        try:
            assert server.stdout is not None
            found = re.search(r"http://\S+", server.stdout.readline())
            assert found is not None, "the panel did not start"
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=asked.chromium, args=["--no-sandbox"])
                page = browser.new_page(viewport={"width": 1280, "height": 720})
                page.goto(f"{found[0]}#explore")
                page.locator(".explore[data-curves]").wait_for(timeout=120_000)
                rows, numbers = [], {}
                for label in ("Amplitude", "Bristle stiffness", "Mass of the end-effector"):
                    before = processor_time()
                    figures = drag(page, label, asked.seconds)
                    figures["processor_ms"] = (
                        1e3 * (processor_time() - before) / (figures["pictures"] * asked.seconds)
                    )
                    numbers[label] = figures
                    said = (
                        f"{figures['pictures']:.1f} pictures/s, {figures['frames']:.0f} frames/s",
                        f"95 % of gaps below {figures['slow']:.0f} ms",
                        f"{figures['processor_ms']:.0f} ms of processor a picture",
                    )
                    rows.append((label, "; ".join(said)))
                record("explore", rows, numbers)
                browser.close()
        finally:
            server.terminate()
            server.wait()


if __name__ == "__main__":
    main()
