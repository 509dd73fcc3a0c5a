"""The command line: parse, call the library, print. Nothing is computed here.

Imports stand inside the commands, so that ``stickslip --help`` need not wait for the solver. Exit codes:
0 done, 1 failed, 2 wrong input; what went wrong is one line on stderr.
"""

from __future__ import annotations

import os
import shlex
import sys
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ._version import __version__

_INSTALL = 'install what it needs with: pip install "stickslip[cli,report]"'

try:
    import typer
except ModuleNotFoundError as missing:  # this module is the command's entry: nobody else could say it
    raise SystemExit(f"Error: the command line needs {missing.name}; {_INSTALL}") from None

if TYPE_CHECKING:
    from .actuator import Actuator, PulledSlider
    from .report import Document, Number
    from .study.running import Progress
    from .waveform.signal import Waveform

app = typer.Typer(
    help="Identify, verify, simulate and design piezoelectric stick-slip actuators from recordings.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: four times as fast, and the same in a log
)


class Shape(StrEnum):
    """Waveforms that the command line knows; Python knows more."""

    SAWTOOTH = "sawtooth"
    REVERSE_SAWTOOTH = "reverse-sawtooth"
    TRIANGLE = "triangle"
    CYCLOID = "cycloid"
    SINE = "sine"
    STEP = "step"
    RAMP = "ramp"
    CHIRP = "chirp"


Out = Annotated[
    Path, typer.Option(help="Folder for results.json and report.html; other files in it are kept.")
]
Traceback = Annotated[
    bool,
    typer.Option(
        "--traceback", envvar="STICKSLIP_TRACEBACK", help="Show where in the program an error arose."
    ),
]


@contextmanager
def _errors_in_one_line(show_traceback: bool) -> Iterator[None]:
    try:
        yield
    except Exception as error:
        if show_traceback:
            traceback.print_exc()
        typer.echo(f"Error: {_explained(error)}", err=True)
        raise typer.Exit(2 if isinstance(error, ValueError) else 1) from None


def _explained(error: Exception) -> str:
    text = " ".join(str(error).split())
    if isinstance(error, ModuleNotFoundError) and not str(error.name).startswith("stickslip"):
        return f"this command needs {error.name}; {_INSTALL}"
    if isinstance(error, ValueError | OSError) or type(error).__module__.startswith("stickslip"):
        return text
    return f"unexpected {type(error).__name__}: {text} (--traceback shows where)"


@contextmanager
def _progress() -> Iterator[Progress]:
    """A bar on a terminal, otherwise one line on stderr for each thing that is begun."""
    if not sys.stderr.isatty():
        said = ""

        def tell(doing: str, done: float) -> None:
            nonlocal said
            if doing != said:
                said = doing
                typer.echo(f"[{done:4.0%}] {doing}", err=True)

        yield tell
        return
    from rich.console import Console
    from rich.progress import BarColumn, SpinnerColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (
        SpinnerColumn(),
        "{task.description}",
        BarColumn(),
        "{task.percentage:>3.0f} %",
        TimeElapsedColumn(),
    )
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda doing, done: bar.update(task, description=doing, completed=done)


def _check_output(out: Path) -> None:
    """That a report can be made and written: found out before the work, not after it."""
    for name in ("jinja2", "matplotlib"):
        if find_spec(name) is None:
            raise ModuleNotFoundError(name=name)
    existing = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    if not existing.is_dir():
        raise ValueError(f"--out {out}: {existing} is a file, not a folder")
    if not os.access(existing, os.W_OK):
        raise ValueError(f"--out {out}: {existing} cannot be written to")


def _write(document: Document, out: Path, begun: float) -> None:
    from .report import write_report

    command = shlex.join(["stickslip", *sys.argv[1:]])
    report = write_report(document, out, command=command, elapsed=time.perf_counter() - begun)
    typer.echo(document.summary)
    for what, number in document.highlights:
        typer.echo(f"  {what}: {_shown(number)}")
    typer.echo(f"Report: {report}")


def _shown(number: Number) -> str:
    from .units import with_prefix

    return number.note if number.value != number.value else with_prefix(number.value, number.unit)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"stickslip {__version__}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Only the options that come before a command."""


@app.command()
def simulate(
    parameters: Annotated[str, typer.Argument(metavar="[SET|FILE.toml]", help="Parameter set.")] = "kang2007",
    waveform: Annotated[Shape, typer.Option(help="Drive signal.")] = Shape.SAWTOOTH,
    amplitude: Annotated[str, typer.Option(help='Amplitude, such as "65 V".')] = "",
    frequency: Annotated[str, typer.Option(help='Frequency, such as "5 Hz".')] = "",
    periods: Annotated[str, typer.Option(help="Number of periods.")] = "",
    duration: Annotated[str, typer.Option(help='Time to simulate, such as "1.6 s"; that of the drive.')] = "",
    sample_rate: Annotated[str, typer.Option(help="Samples of the output.")] = "1 kHz",
    tolerance: Annotated[str, typer.Option(help="Greatest error of the end-effector's position.")] = "1 nm",
    changes: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="FIELD=VALUE",
            help="Change a field: end_effector_mass=0.1kg, friction.sigma_0='1.4 N/um', waveform.offset=5V.",
        ),
    ] = [],  # noqa: B006  # typer copies it
    out: Out = Path("out/simulate"),
    show_traceback: Traceback = False,
) -> None:
    """Simulate an actuator (or a pulled slider) of a parameter set; the trajectory goes to trajectory.nc."""
    begun = time.perf_counter()
    with _errors_in_one_line(show_traceback):
        _check_output(out)
        from .recording import save_recording
        from .report.trajectory import trajectory_document
        from .simulation import SimulationWarning
        from .simulation import simulate as simulated
        from .units import to_si

        parts = _parts(changes)
        model = _model(parameters, parts["model"], parts["friction"])
        given = {"amplitude": amplitude, "frequency": frequency, "periods": periods}
        drive = _drive(waveform, model, {k: v for k, v in given.items() if v} | parts["waveform"])
        seconds = to_si(duration, "s", "--duration") if duration else None
        rate = to_si(sample_rate, "Hz", "--sample-rate")
        metres = to_si(tolerance, "m", "--tolerance")
        with _progress() as progress, warnings.catch_warnings():
            warnings.simplefilter("ignore", SimulationWarning)  # said below, in one line
            progress("simulating", 0.0)
            trajectory = simulated(model, drive, seconds, sample_rate=rate, tolerance=metres)
            progress("solving for the periodic motion", 0.6)
            step = _steady_step(model, drive)
            progress("writing", 0.8)
            document = trajectory_document(model, drive, trajectory, step)
            out.mkdir(parents=True, exist_ok=True)
            save_recording(trajectory, out / "trajectory.nc")
        _write(document, out, begun)
    if trajectory.attrs["outcome"] != "complete":
        typer.echo(f"Error: the simulation {trajectory.attrs['outcome']}", err=True)
        raise typer.Exit(1)


def _parts(changes: list[str]) -> dict[str, dict[str, str]]:
    """The values of --set by what they belong to: model, friction or waveform."""
    parts: dict[str, dict[str, str]] = {"model": {}, "friction": {}, "waveform": {}}
    for change in changes:
        path, equals, value = change.partition("=")
        owner, dot, field = path.strip().rpartition(".")
        if not equals or not field or not value.strip() or (dot and owner not in ("friction", "waveform")):
            raise ValueError(
                f"--set {change}: write FIELD=VALUE, friction.FIELD=VALUE or waveform.FIELD=VALUE"
            )
        parts[owner or "model"][field] = value.strip()
    return parts


def _model(parameters: str, changes: dict[str, str], friction: dict[str, str]) -> Actuator | PulledSlider:
    from .actuator import load_actuator, load_pulled_slider
    from .parameters import load_set

    kind = load_set(parameters).kind
    model = load_pulled_slider(parameters) if kind == "pulled_slider" else load_actuator(parameters)
    law = model.friction._replace(
        **{field: _read(text, model.friction, field) for field, text in friction.items()}
    )
    return model.replace(
        **{field: _read(text, model, field) for field, text in changes.items()}, friction=law
    )


def _read(text: str, record: Any, field: str) -> Any:
    """The text as the field's record takes it, which then checks it."""
    now = getattr(record, field, None)
    if isinstance(now, bool):
        return {"true": True, "yes": True, "false": False, "no": False}.get(text.lower(), text)
    return text.split(",") if isinstance(now, tuple) else text


def _drive(shape: Shape, model: Actuator | PulledSlider, fields: dict[str, str]) -> Waveform:
    from .actuator import Actuator
    from .waveform import periodic, shapes

    name = "".join(word.capitalize() for word in shape.split("-"))
    made = getattr(periodic, name, None) or getattr(shapes, name)
    return made(**fields, unit="V" if isinstance(model, Actuator) else "m")


def _steady_step(model: Actuator | PulledSlider, drive: Waveform) -> Number | None:
    from .actuator import Actuator
    from .report import Number
    from .simulation import NotPeriodicError, steady_step

    if not isinstance(model, Actuator) or getattr(drive, "period", None) is None:
        return None
    try:
        return Number(steady_step(model, drive), "m")
    except NotPeriodicError as error:
        return Number(float("nan"), "m", note=str(error))


@app.command()
def identify(
    file: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, metavar="FILE.yaml", help="What to fit.")
    ],
    out: Out = Path("out/identify"),
    show_traceback: Traceback = False,
) -> None:
    """Fit models to recordings, as a file describes it, and verify them on parts that no fit has seen."""
    begun = time.perf_counter()
    with _errors_in_one_line(show_traceback):
        _check_output(out)
        from .study import run_file

        with _progress() as progress:
            document = run_file(file, progress)
        _write(document, out, begun)


@app.command()
def demo(out: Out = Path("out/demo"), show_traceback: Traceback = False) -> None:
    """Identify and verify models on published recordings, and simulate the actuator of the thesis."""
    begun = time.perf_counter()
    with _errors_in_one_line(show_traceback):
        _check_output(out)
        from .demo import run

        with _progress() as progress:
            document = run(progress)
        _write(document, out, begun)


@app.command()
def cite(
    names: Annotated[
        list[str],
        typer.Argument(metavar="NAME...", help="Parameter sets (or files), friction laws, citation keys."),
    ],
    show_traceback: Traceback = False,
) -> None:
    """Print BibTeX and, for a parameter set, what its source does not say."""
    with _errors_in_one_line(show_traceback):
        typer.echo("\n\n".join(_citation(name) for name in names))


def _citation(name: str) -> str:
    from .actuator import load_actuator, load_pulled_slider
    from .friction import LAWS
    from .parameters import available_sets, load_set
    from .parameters import cite as cited

    if name in available_sets() or name.endswith(".toml"):  # a set says more than its key
        kind = load_set(name).kind
        if kind == "actuator":
            return load_actuator(name).citation
        if kind == "pulled_slider":
            return load_pulled_slider(name).citation
    return cited({law.__name__: law for law in LAWS}.get(name, name))
