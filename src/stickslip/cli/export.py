"""Commands that export a model as code: export c, export fmu."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import completion
from .frame import Traceback, app, errors_in_one_line

if TYPE_CHECKING:
    from ..waveform.signal import Waveform

export = typer.Typer(help="Export a model as C or as an FMU.", no_args_is_help=True)
app.add_typer(export, name="export")

ModelArgument = Annotated[
    str,
    typer.Argument(
        metavar="SET|FILE.toml|results.json",
        autocompletion=completion.sets,
        help="Parameter set, by name or file, or results.json of stickslip identify on a walk.",
    ),
]
Folder = Annotated[Path, typer.Option(help="New folder for the export; it must not exist yet.")]
StepSize = Annotated[
    str, typer.Option(help="Time step of the example programs; for an FMU its longest internal step.")
]
BenchName = Annotated[
    str,
    typer.Option(
        autocompletion=completion.benches,
        help="Put the amplifier of this bench (its name or file) before the actuator.",
    ),
]


class FmuKind(StrEnum):
    """Kind of a functional mock-up unit, which determines its inputs and outputs: the plant, an observer of
    its state, or a feedforward control."""

    PLANT = "plant"
    OBSERVER = "observer"
    FEEDFORWARD = "feedforward"


@export.command("c")
def export_as_c(
    source: ModelArgument,
    out: Folder = Path("out/c"),
    step: StepSize = "20 us",
    amplitude: Annotated[
        str, typer.Option(help='Amplitude of the sawtooth in the examples, such as "65 V".')
    ] = "",
    frequency: Annotated[str, typer.Option(help="Frequency of this sawtooth; 5 Hz if left out.")] = "",
    periods: Annotated[int | None, typer.Option(help="Its number of periods; 8 if left out.", min=1)] = None,
    bench: BenchName = "",
    show_traceback: Traceback = False,
) -> None:
    """Write the model in C99 for a PC and a microcontroller; `make` in the folder builds and runs it."""
    with errors_in_one_line(show_traceback):
        from ..export import export_c

        made = export_c(
            source, out, step=step, waveform=_waveform(amplitude, frequency, periods), **_amplifier(bench)
        )
        typer.echo(f"Exported to {made}; build and run it with: make -C {made}")


@export.command("fmu")
def export_as_fmu(
    source: ModelArgument,
    out: Folder = Path("out/fmu"),
    fmi: Annotated[int, typer.Option(help="Version of the FMI standard, 2 or 3.")] = 2,
    mode: Annotated[FmuKind, typer.Option(help="Inputs and outputs of the unit.")] = FmuKind.PLANT,
    step: StepSize = "20 us",
    compiler: Annotated[str, typer.Option(help='Compiler of the binary; "" for no binary.')] = "gcc",
    bench: BenchName = "",
    show_traceback: Traceback = False,
) -> None:
    """Write a functional mock-up unit for co-simulation, with sources and a binary for 64-bit Linux."""
    with errors_in_one_line(show_traceback):
        from ..export import export_fmu

        made = export_fmu(
            source, out, fmi=fmi, mode=mode.value, step=step, compiler=compiler, **_amplifier(bench)
        )
        typer.echo(f"Exported: {made}")


def _waveform(amplitude: str, frequency: str, periods: int | None) -> Waveform | None:
    from ..waveform.periodic import Sawtooth

    if amplitude:
        fields: dict[str, Any] = {"frequency": frequency or "5 Hz", "periods": periods or 8}
        return Sawtooth(amplitude, **fields)  # type: ignore[arg-type]
    if frequency or periods:
        raise ValueError(
            "--amplitude is missing: --frequency and --periods are of the sawtooth that it makes"
        )
    return None


def _amplifier(bench: str) -> dict[str, Any]:
    if not bench:
        return {}
    from ..rig import load_bench

    found = load_bench(bench)
    return {"amplifier": found.amplifier, "piezo_capacitance": found.piezo_capacitance}
