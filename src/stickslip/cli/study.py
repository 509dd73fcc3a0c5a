"""Commands on studies: run or resume, show, stop, compare, merge, export."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from .frame import CONTINUES, Changes, Traceback, app, errors_in_one_line, progress_bar

if TYPE_CHECKING:
    from ..study import StudyState


class _FileOrCommand(TyperGroup):
    """Command group in which `stickslip study FILE.yaml ...` means `stickslip study run FILE.yaml ...`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        known = {*self.commands, "--help", "--install-completion", "--show-completion"}
        if args and args[0] not in known:
            args = ["run", *args]
        return super().parse_args(ctx, args)


study = typer.Typer(
    cls=_FileOrCommand,
    no_args_is_help=True,
    help="Run many simulations on one or several machines: study FILE.yaml --store DIR; show, stop, "
    "compare, merge, export.",
    rich_markup_mode=None,
)
app.add_typer(study, name="study")

StoreFolder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a study's results.")]


@study.command()
def run(
    file: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, metavar="FILE.yaml", help="The study.")
    ],
    store: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the results, a Zarr group.")],
    workers: Annotated[int, typer.Option(min=0, help="Number of processes; 0: all processors.")] = 0,
    shard: Annotated[str, typer.Option(metavar="K/N", help="Compute every N-th task, from the K-th.")] = "",
    scheduler: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Dask scheduler: tcp://host:8786, tls://host:8786.")
    ] = "",
    estimate: Annotated[bool, typer.Option("--estimate", help="Print the expected cost, and end.")] = False,
    changes: Changes = [],  # noqa: B006
    show_traceback: Traceback = False,
) -> None:
    """Run a study. After an interruption, the same command resumes it."""
    with errors_in_one_line(show_traceback, CONTINUES):
        from ..jobs.analysis.study import study_of_file
        from ..study import estimate_study, run_study

        part = _shard(shard)
        if part and scheduler:
            raise ValueError("--shard and --scheduler: one or the other")
        asked = study_of_file(file, changes)
        if estimate or not store.exists():
            typer.echo(f"{file}: {estimate_study(asked)}", err=not estimate)
        if estimate:
            return
        with progress_bar() as progress:
            run_study(
                asked,
                store,
                workers=workers or None,
                shard=part,
                scheduler=scheduler or None,
                progress=progress,
            )
        _show(store)


def _shard(text: str) -> tuple[int, int] | None:
    if not text:
        return None
    found = re.fullmatch(r"(\d+)/(\d+)", text)
    if not found or not 1 <= int(found[1]) <= int(found[2]):
        raise ValueError(f"--shard {text}: write K/N, with K from 1 to N")
    return int(found[1]), int(found[2])


@study.command()
def show(store: StoreFolder, show_traceback: Traceback = False) -> None:
    """Show the progress of a study (tasks, members by status, rate, time left), and check its results."""
    with errors_in_one_line(show_traceback):
        from ..study.store import Store

        _show(store)
        Store(store).check_results()


def _show(store: Path) -> None:
    from ..study import StudyError, study_state

    state = study_state(store)
    for line in _lines(state):
        typer.echo(line)
    typer.echo(f"Store: {store}")
    if state.damage:
        raise StudyError(state.damage)


def _lines(state: StudyState) -> list[str]:
    from ..study.running import duration, pace

    lines = [f"{state.title}: {state.done:,} of {state.tasks:,} tasks, {state.members:,} members"]
    lines += [f"  {name.replace('_', ' ')}: {n:,}" for name, n in state.statuses.items() if n]
    if not state.finished and state.last == state.last:
        ago = duration(time.time() - state.last)
        lines.append(f"  last written {ago} ago")
        if state.rate == state.rate:
            lines.append(f"  {pace(state.rate)} lately, {duration(state.left)} left")
    return lines


@study.command()
def stop(store: StoreFolder, show_traceback: Traceback = False) -> None:
    """Stop all processes that work on a study, on any machine. The command that ran the study resumes it."""
    with errors_in_one_line(show_traceback):
        from ..study import stop_study

        stop_study(store)
        typer.echo(f"{store}: asked to stop")


@study.command()
def compare(first: StoreFolder, second: StoreFolder, show_traceback: Traceback = False) -> None:
    """Compare the results of two studies over the same members, and print how they differ; exit code 1 if
    they do."""
    with errors_in_one_line(show_traceback):
        from ..study import compare_studies

        with progress_bar() as progress:
            found = compare_studies(first, second, progress)
        for said in found.said:
            typer.echo(f"  {said}")
        typer.echo(f"{found.both:,} members in both, {found.only_first:,} and {found.only_second:,} in one")
        for one in found.variables:
            typer.echo(f"  {one.name}: {_difference(one)}")
    if not found.equal:
        raise typer.Exit(1)


def _difference(one: Any) -> str:
    if not one.members:
        return "equal"
    most = f", by up to {one.greatest:.3g} {one.unit}".rstrip() if one.greatest == one.greatest else ""
    alone = f", {one.alone:,} of them have a number in one store alone" if one.alone else ""
    return f"{one.members:,} members differ{most}{alone}"


@study.command()
def merge(
    stores: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Stores of one study.")],
    into: Annotated[Path, typer.Option(metavar="DIR", help="Store for all results; may be one of those.")],
    show_traceback: Traceback = False,
) -> None:
    """Merge shards of a study that were computed in separate stores into one store."""
    with errors_in_one_line(show_traceback, CONTINUES):
        from ..study import merge_studies

        with progress_bar() as progress:
            missing = merge_studies(stores, into, progress)
        typer.echo(f"{into}: " + (f"{missing} tasks are missing" if missing else "all tasks are there"))


@study.command()
def export(
    store: StoreFolder,
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="New file; its name ends in .nc, .parquet or .csv.")
    ],
    show_traceback: Traceback = False,
) -> None:
    """Write the results computed so far as NetCDF, Parquet or CSV."""
    with errors_in_one_line(show_traceback):
        from ..study import export_study

        if file.exists():
            raise FileExistsError(17, "it is there already, and nothing is overwritten", str(file))
        with progress_bar() as progress:
            count = export_study(store, file, progress)
        typer.echo(f"{file}: {count:,} members")
