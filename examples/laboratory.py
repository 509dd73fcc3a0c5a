"""Make the figures of docs/laboratory.md: recordings of the virtual rig.

    python examples/laboratory.py [FOLDER]

writes FOLDER/*.svg; FOLDER is out/laboratory if left out.
"""

from __future__ import annotations

import sys
import tempfile
from importlib import resources
from pathlib import Path

import stickslip as ss
from stickslip.report.figures.recordings import recording_detail, recordings_together
from stickslip.report.figures.style import svg


def main(folder: Path) -> None:
    """Record, draw, write."""
    experiment = Path(str(resources.files("stickslip") / "examples" / "kang2007_experiment.yaml"))
    with tempfile.TemporaryDirectory() as out:
        recorded = {
            one.cell.name: ss.open_recording(one.path) for one in ss.rig.run_experiment(experiment, out)
        }
    walks = {name: recorded[name] for name in ("sawtooth_5Hz_35V", "sawtooth_5Hz_75V")}
    figures = {
        "recording-walk": recordings_together({n: r.sel(time=slice(0.0, 4.2)) for n, r in walks.items()}),
        "recording-step": recording_detail(recorded["step_60V"], 0.197, 0.206, 0.2),
        "recording-converter-steps": recording_detail(slow_ramp(), 0.0995, 0.104, 0.1),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        (folder / f"{name}.svg").write_text(svg(figure) + "\n", encoding="utf-8")
    print(f"{len(figures)} figures: {folder}")


def slow_ramp():
    """The first milliseconds of a sawtooth, every sample of the rig, with nothing done to the sensors."""
    rig = ss.rig.VirtualRig(ss.load_actuator("kang2007"), ss.rig.load_bench("kang2007-bench"), seed=3)
    gauge = ss.rig.Channel(
        "strain_gauge", (ss.recording.calibration.load_calibration("kang2007-strain-gauge"),)
    )
    channels = {"drive_voltage": ss.rig.Channel("drive"), "piezo_elongation": gauge}
    channels["inductive_sensor"] = ss.rig.Channel("inductive")
    capture = ss.rig.Capture(length=0.12, interval=50e-6, pre_trigger=0.1)
    return ss.rig.measure(rig, ss.Sawtooth(65.0, 5.0), channels, capture, ss.rig.Limits())


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/laboratory"))
