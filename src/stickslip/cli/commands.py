"""Commands on models and recordings: simulate, run, identify, campaign, verify, design, demo, cite."""

from __future__ import annotations

import math
import time
import warnings
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import completion
from .changes import OPTIONS, changed_model, drive_of, parts_of
from .frame import (
    CONTINUES,
    FINISHED,
    Arm,
    Changes,
    Out,
    RequirementError,
    Traceback,
    app,
    arming,
    check_output,
    errors_in_one_line,
    only_reading,
    progress_bar,
    write,
)

if TYPE_CHECKING:
    from ..physics.actuator import Actuator, PulledSlider
    from ..report import Document, Number
    from ..waveform.signal import Waveform


# Largest number of samples of a trajectory, because its report needs memory for each sample.
MOST_SAMPLES = 10_000_000
_OF_THE_DEMO = "finished recordings and stages of its campaign are kept, and the same command continues"

ModelChanges = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="FIELD=VALUE",
        autocompletion=completion.changes,
        help="Change a field: end_effector_mass=0.1kg, friction.sigma_0='1.4 N/um', waveform.offset=5V.",
    ),
]


@app.command()
def simulate(
    parameters: Annotated[
        str,
        typer.Argument(metavar="[SET|FILE.toml]", help="Parameter set.", autocompletion=completion.sets),
    ] = "kang2007",
    waveform: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE.py:NAME",
            autocompletion=completion.waveforms,
            help="Drive: sawtooth, reverse-sawtooth, ...; stickslip list waveforms.",
        ),
    ] = "sawtooth",
    law: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE.py:NAME",
            autocompletion=completion.laws,
            help="Use another friction law; it keeps the parameters that both laws have.",
        ),
    ] = "",
    amplitude: Annotated[str, typer.Option(help='Amplitude, such as "65 V".')] = "",
    frequency: Annotated[str, typer.Option(help='Frequency, such as "5 Hz".')] = "",
    periods: Annotated[str, typer.Option(help="Number of periods.")] = "",
    duration: Annotated[
        str, typer.Option(help='Time to simulate, such as "1.6 s"; by default the length of the drive.')
    ] = "",
    sample_rate: Annotated[str, typer.Option(help="Sampling rate of the trajectory.")] = "1 kHz",
    tolerance: Annotated[str, typer.Option(help="Tolerance of the end-effector's position.")] = "1 nm",
    stack: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE.toml",
            autocompletion=completion.stacks,
            help="Piezo stack that the drive charges: adds its current, charge, power and temperature.",
        ),
    ] = "",
    changes: ModelChanges = [],  # noqa: B006  # typer copies it
    out: Out = Path("out/simulate"),
    show_traceback: Traceback = False,
) -> None:
    """Simulate an actuator (or a pulled slider) of a parameter set; the trajectory goes to trajectory.nc."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback):
        check_output(out)
        from ..physics.electronics import load_stack
        from ..quantities.units import to_si
        from ..recording import save_recording
        from ..report.trajectory import trajectory_document
        from ..simulation import SimulationWarning
        from ..simulation import simulate as simulated

        parts = parts_of(changes)
        model = changed_model(parameters, parts["model"], parts["friction"], law)
        given = dict(zip(OPTIONS, (amplitude, frequency, periods), strict=True))
        drive = drive_of(waveform, model, {k: v for k, v in given.items() if v} | parts["waveform"])
        seconds = to_si(duration, "s", "--duration") if duration else None
        rate = to_si(sample_rate, "Hz", "--sample-rate")
        metres = to_si(tolerance, "m", "--tolerance")
        _check_samples(drive.duration if seconds is None else seconds, rate)
        with progress_bar() as progress, warnings.catch_warnings():
            # An incomplete simulation is reported at the end by one line.
            warnings.simplefilter("ignore", SimulationWarning)
            progress("simulating", 0.0)
            charged = load_stack(stack) if stack else None
            trajectory = simulated(model, drive, seconds, sample_rate=rate, tolerance=metres, stack=charged)
            progress("solving for the periodic motion", 0.6)
            step = _steady_step(model, drive)
            progress("writing", 0.8)
            document = trajectory_document(model, drive, trajectory, step)
            out.mkdir(parents=True, exist_ok=True)
            save_recording(trajectory, out / "trajectory.nc")
        write(document, out, begun)
    if trajectory.attrs["outcome"] != "complete":
        typer.echo(f"Error: the simulation {trajectory.attrs['outcome']}", err=True)
        raise typer.Exit(1)


def _check_samples(seconds: float, rate: float) -> None:
    """Raise ValueError if a trajectory of a duration [s] and sample rate [Hz] has more than `MOST_SAMPLES`
    samples, so that its report might not fit into memory."""
    count = seconds * rate
    if count > MOST_SAMPLES and math.isfinite(seconds):
        raise ValueError(
            f"--duration of {seconds:g} s at --sample-rate of {rate:g} Hz: {count:.3g} samples; "
            f"a trajectory has up to {MOST_SAMPLES:,}"
        )


def _steady_step(model: Actuator | PulledSlider, drive: Waveform) -> Number | None:
    from ..physics.actuator import Actuator
    from ..quantities.units import unit_for
    from ..report import Number
    from ..simulation import NotPeriodicError, steady_step

    if not isinstance(model, Actuator) or getattr(drive, "period", None) is None:
        return None
    try:
        return Number(steady_step(model, drive), unit_for(model, "m"))
    except NotPeriodicError as error:
        return Number(float("nan"), unit_for(model, "m"), note=str(error))


@app.command()
def run(
    file: Annotated[
        Path,
        typer.Argument(
            exists=True,
            dir_okay=False,
            metavar="FILE.yaml",
            help="A job file; or an experiment, campaign, identification, verification, design or move file.",
        ),
    ],
    figures: Annotated[
        bool, typer.Option("--figures/--no-figures", help="Draw figures of campaigns.")
    ] = True,
    changes: Changes = [],  # noqa: B006
    out: Out = Path("out/run"),
    arm: Arm = "",
    show_traceback: Traceback = False,
) -> None:
    """Carry out the steps of a file: record, identify, verify, compare, design, export, move, measure
    steps."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback, FINISHED):
        check_output(out)
        from ..jobs import run_job

        # Report on the finished steps if the job ends with an error. That error is shown to the user, and not
        # that a requirement is not met.
        def keep(finished: Document) -> None:
            with suppress(RequirementError):
                write(finished, out, begun)

        with progress_bar() as progress, arming(arm):
            document = run_job(file, out, progress, figures=figures, kept=keep, changes=changes)
        # After an interruption by the user the document contains the finished steps, and it is written too.
        write(document, out, begun)


@app.command()
def identify(
    file: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, metavar="FILE.yaml", help="An identification file.")
    ],
    changes: Changes = [],  # noqa: B006
    out: Out = Path("out/identify"),
    show_traceback: Traceback = False,
) -> None:
    """Fit models to recordings, as a file describes it, and verify them on parts that were not fitted."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback):
        check_output(out)
        from ..jobs.analysis import run_file

        with progress_bar() as progress:
            document = run_file(file, progress, changes)
        write(document, out, begun)


@app.command()
def campaign(
    file: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, metavar="FILE.yaml", help="The campaign.")
    ],
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="Draw figures.")] = True,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Also write report.pdf, by an installed Chromium browser.")
    ] = False,
    changes: Changes = [],  # noqa: B006
    out: Out = Path("out/campaign"),
    arm: Arm = "",
    show_traceback: Traceback = False,
) -> None:
    """Identify and verify a model from recordings of steps and walks, with the uncertainty of every
    number."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback, CONTINUES):
        check_output(out)
        from ..jobs.campaign import run_campaign
        from ..report import find_browser

        # The browser is searched before the work, so that a missing one is reported at once.
        browser = find_browser() if pdf else ""
        with progress_bar() as progress, arming(arm):
            document = run_campaign(file, out, progress, figures=figures, changes=changes)
        write(document, out, begun, browser)


@app.command()
def verify(
    fit: Annotated[
        Path,
        typer.Argument(
            exists=True,
            dir_okay=False,
            metavar="FILE.yaml|results.json",
            help="What to verify: a verification file, or the results of an identification.",
        ),
    ],
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(
            exists=True, dir_okay=False, metavar="[RECORDING]...", help="To predict, with results.json."
        ),
    ] = None,
    require: Annotated[
        list[str],
        typer.Option(
            metavar="'FIGURE > LIMIT'", help="Requirement: 'r_squared > 0.99', 'rmse < 100 nm', ..."
        ),
    ] = [],  # noqa: B006  # typer copies it
    column: Annotated[
        list[str],
        typer.Option(metavar="NAME=COLUMN", help="Column of a channel: end_effector_position='Disp (um)'."),
    ] = [],  # noqa: B006
    unit: Annotated[
        list[str], typer.Option(metavar="NAME=UNIT", help="Unit of a channel whose column names none.")
    ] = [],  # noqa: B006
    changes: Changes = [],  # noqa: B006
    out: Out = Path("out/verify"),
    show_traceback: Traceback = False,
) -> None:
    """Predict recordings with a fitted model; exit code 1 if a requirement is not met."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback):
        check_output(out)
        from ..jobs.analysis.running import run_analysis
        from ..jobs.analysis.verification import verification_analysis

        analysis, folder = verification_analysis(fit, recordings or [], require, column, unit, changes)
        # The notes name columns and units that were guessed from the recordings.
        if recordings and analysis.notes:
            typer.echo(analysis.notes, err=True)
        with progress_bar() as progress:
            document = run_analysis(analysis, folder, progress)
        write(document, out, begun)


@app.command()
def design(
    file: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, metavar="FILE.yaml", help="The map to compute.")
    ],
    changes: Changes = [],  # noqa: B006
    out: Out = Path("out/design"),
    show_traceback: Traceback = False,
) -> None:
    """Compute what a design file asks for: a map of the step over voltage, frequency, load and other fields,
    the best drive or actuator, a Pareto front, a plan; Ctrl-C keeps finished points."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback, FINISHED):
        check_output(out)
        from ..jobs.analysis.design import design_analysis
        from ..jobs.analysis.running import run_analysis
        from ..quantities.units import QuantityError

        analysis, folder = design_analysis(file, changes)
        try:
            with progress_bar() as progress:
                document = run_analysis(analysis, folder, progress)
        except QuantityError as error:
            raise ValueError(f"{file}: {error}") from error
        write(document, out, begun)


@app.command()
def demo(out: Out = Path("out/demo"), show_traceback: Traceback = False) -> None:
    """Run the campaign of Kang's thesis (2007) on a virtual rig, and fit models to published recordings."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback, _OF_THE_DEMO):
        check_output(out)
        from ..jobs.demo import run

        with progress_bar() as progress:
            document = run(out, progress)
        write(document, out, begun)


@app.command()
def cite(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME...",
            autocompletion=completion.cited,
            help="Parameter sets (or files), friction laws, citation keys.",
        ),
    ],
    show_traceback: Traceback = False,
) -> None:
    """Print BibTeX and, for a parameter set, the values that its source does not state."""
    with only_reading(show_traceback):
        typer.echo("\n\n".join(_citation(name) for name in names))


def _citation(name: str) -> str:
    from ..parameters import available_sets, bibtex, load_set
    from ..parameters import cite as cited
    from ..physics.actuator import load_actuator, load_pulled_slider
    from ..quantities import registry

    # For a parameter set, values that its source does not state are printed too.
    if name in available_sets() or name.endswith(".toml"):
        found = load_set(name)
        try:
            for text in (found.law, *(part.model for part in found.piezo.values())):
                registry.check_used(text, found.file.parent)
        except registry.RegistryError as error:
            heading = f"% Parameter set {found.name}: {found.title}."
            return "\n".join((bibtex(*found.citations), "", heading, f"% More sources may follow: {error}."))
        if found.kind == "actuator":
            return load_actuator(name).citation
        if found.kind == "pulled_slider":
            return load_pulled_slider(name).citation
    if name in registry.laws.names() or registry.own_path(name)[0]:
        return cited(registry.laws.find(name))
    return cited(name)
