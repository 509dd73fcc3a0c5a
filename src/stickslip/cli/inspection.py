"""Commands that inspect a file, write a first one, or list known names."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import completion
from .frame import Traceback, app, only_reading

if TYPE_CHECKING:
    from ..recording.readers import Inspection


@app.command()
def inspect(
    file: Annotated[Path, typer.Argument(help="A measurement, of a format of `stickslip list readers`.")],
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.svg",
            help="File of the picture; by default FILE-inspect.svg here. No other file is overwritten.",
        ),
    ] = None,
    show_traceback: Traceback = False,
) -> None:
    """Print what a file contains (columns, units, sampling, gaps, noise) and YAML to paste, and draw it."""
    with only_reading(show_traceback):
        from ..recording.readers.inspection import inspect_file
        from ..recording.replacing import replaced_whole

        target = picture or Path(f"{file.stem}-inspect.svg")
        _check_picture(target)
        found = inspect_file(file)
        typer.echo(str(found))
        if found.log is not None:
            # The file is a table without a time column, which has no picture.
            return
        if found.recording is None and found.response is None:
            raise ValueError(f"{file}: {found.problem}")
        drawn = _drawn(found)
        target.parent.mkdir(parents=True, exist_ok=True)
        with replaced_whole(target) as temporary:
            temporary.write_text(drawn, encoding="utf-8")
        typer.echo(f"\n{target}")


def _drawn(found: Inspection) -> str:
    """Return the SVG text of the picture of an inspected file: its recording over time, or its frequency
    response. One of both must have been read."""
    from ..report.figures.style import svg

    if found.response is not None:
        from ..report.figures.frequency import Response, frequency_response

        frequency, values = found.response["frequency"].values, found.response["response"]
        shown = {
            found.path.name if values[0].size == 1 else f"output {o + 1}, input {i + 1}": Response(
                frequency, values.values[:, o, i]
            )
            for o in range(values.sizes["output"])
            for i in range(values.sizes["input"])
        }
        return svg(frequency_response(shown, unit=values.attrs["units"]))
    from ..report.figures.recordings import recordings_together

    assert found.recording is not None
    return svg(recordings_together({found.path.name: found.recording}))


def _check_picture(target: Path) -> None:
    """Raise ValueError unless the file `target` may be written: its name ends in .svg, and an existing file
    is an SVG picture as this command writes them. So the inspected file is never overwritten."""
    if target.suffix != ".svg":
        raise ValueError(f"--picture {target}: the name of a picture ends in .svg")
    above = next(one for one in target.absolute().parents if one.exists())
    if not above.is_dir():
        raise ValueError(f"--picture {target}: {above} is a file, not a folder")
    if target.exists():
        with target.open("rb") as there:
            if there.read(4) != b"<svg":
                raise ValueError(
                    f"--picture {target}: what is there is no picture, and nothing is overwritten"
                )


@app.command()
def new(
    kind: Annotated[
        str,
        typer.Argument(
            autocompletion=completion.skeletons,
            help="campaign, identification, experiment, design, actuator, law or waveform.",
        ),
    ],
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RECORDING]...", help="Recordings, to fill in columns, units and drives."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="File to write; no file is overwritten.")
    ] = None,
    show_traceback: Traceback = False,
) -> None:
    """Write a first file with comments, from your recordings or an example; it runs if nothing is missing."""
    with only_reading(show_traceback):
        from ..jobs.skeletons import new_file

        made = new_file(kind, recordings or (), out)
        for file in made.files:
            typer.echo(f"Written: {file}")
        for one in made.missing:
            typer.echo(f"To be completed: {one}", err=True)
        typer.echo(f"Run it: {made.command}")


@app.command(name="list")
def list_known(
    kinds: Annotated[
        list[str] | None,
        typer.Argument(
            autocompletion=completion.kinds,
            help="laws, actuators, 'piezo models', waveforms, sensors, readers, rigs, amplifiers, stacks, "
            "materials, 'friction pairs', benches, calibrations, datasets; all, if left out.",
        ),
    ] = None,
    show_traceback: Traceback = False,
) -> None:
    """List the names that commands and files accept, each with a one-line description."""
    with only_reading(show_traceback):
        from ..jobs.known import catalogue

        found = catalogue(*(kinds or ()))
        width = max(len(name) for of in found.values() for name in of)
        for kind, of in found.items():
            typer.echo(f"{kind}:")
            for name, line in of.items():
                typer.echo(f"  {name:{width}}  {line}")
