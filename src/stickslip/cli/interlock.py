"""Command on the interlock of a rig."""

from __future__ import annotations

import getpass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .frame import Traceback, app, errors_in_one_line

if TYPE_CHECKING:
    from collections.abc import Mapping


@app.command()
def interlock(
    file: Annotated[
        Path,
        typer.Argument(
            exists=True,
            metavar="FILE.yaml|FOLDER",
            help="An experiment file of the rig; or a panel's folder.",
        ),
    ],
    acknowledge: Annotated[
        str, typer.Option(metavar="WHY", help="Acknowledge the fault; WHY says why that is safe.")
    ] = "",
    give: Annotated[str, typer.Option(metavar="PERMIT", help="Give a permit.")] = "",
    withdraw: Annotated[
        str, typer.Option(metavar="PERMIT", help="Withdraw a permit; an active run is stopped.")
    ] = "",
    why: Annotated[str, typer.Option(help="Reason for giving or withdrawing a permit.")] = "",
    show_traceback: Traceback = False,
) -> None:
    """Show whether a run of a rig may start; acknowledge a fault, give or withdraw a permit."""
    with errors_in_one_line(show_traceback):
        from ..rig.hosted import Link
        from ..rig.interlock import HostedInterlock

        if (give or withdraw) and not why:
            raise ValueError("--why: say why the permit is given or withdrawn")
        who = getpass.getuser()
        link = Link(_place(file), "stickslip interlock")
        try:
            asked = HostedInterlock(link.ask)
            if acknowledge:
                asked.acknowledge(who, acknowledge)
            for name, given in ((withdraw, False), (give, True)):
                if name:
                    asked.permit(name, given, who, why)
            said = asked.state()
        finally:
            link.close()
        for line in _lines(said):
            typer.echo(line)


def _place(file: Path) -> Path:
    """Return the folder in which the rig's process keeps its state, from an experiment file or a panel's
    folder.

    Raises:
        ValueError: the file is no experiment file, or describes a virtual rig, which has no lasting process.
    """
    if file.is_dir():
        return file / ".rig"
    from ..rig.experiment.laboratory import rigs_of
    from ..rig.experiment.running import read_experiment

    virtual = file.parent / ".rig"
    place = rigs_of(read_experiment(file), virtual, file.parent)
    if place == virtual:
        raise ValueError(
            f"{file}: a virtual rig of a file is created again for each command; name a panel's folder"
        )
    return place


def _lines(said: Mapping[str, Any]) -> list[str]:
    words = {"fault": "a fault is not acknowledged", "withheld": "a permit is missing", "armed": "armed"}
    lines = [words.get(said["state"], "not armed")]
    if said["fault"]:
        lines.append(f"    fault, {said['since']}: {said['fault']}")
    for name, one in said["permits"].items():
        by = f": {one['who']}, {one['when']}, {one['why']}" if one["who"] else ""
        lines.append(f"    permit {name}: {'given' if one['given'] else 'missing'}{by}")
    return lines
