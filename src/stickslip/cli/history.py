"""Commands on a lab's history: runs, log."""

from __future__ import annotations

import json
import os
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from .frame import Traceback, app, only_reading


@app.command()
def runs(
    folder: Annotated[
        Path, typer.Argument(help="Folder of recordings and fits; its subfolders are searched too.")
    ] = Path("out"),
    search: Annotated[str, typer.Option(help="Words that a row must all contain.")] = "",
    where: Annotated[
        list[str],
        typer.Option(metavar="COLUMN=TEXT", help="Rows whose column starts with a text: outcome=stopped."),
    ] = [],  # noqa: B006  # typer copies it
    compare: Annotated[
        list[str], typer.Option(metavar="NAME", help="Print how runs differ; give it twice or more.")
    ] = [],  # noqa: B006
    to_bin: Annotated[list[str], typer.Option(metavar="NAME", help="Move a run to the bin.")] = [],  # noqa: B006
    notes: Annotated[str, typer.Option(metavar="NAME=TEXT", help="Write a recording's notes.")] = "",
    tags: Annotated[str, typer.Option(metavar="NAME=A,B", help="Write a recording's tags.")] = "",
    rebuild: Annotated[bool, typer.Option("--rebuild", help="Read every file again.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print all columns, as JSON.")] = False,
    show_traceback: Traceback = False,
) -> None:
    """List recordings and fits of a folder: finished, stopped, unreadable; search, compare, tag, delete."""
    with only_reading(show_traceback):
        from ..history import Index, differences
        from ..history.describing import annotate
        from ..history.storable import real_name

        if len(compare) == 1:
            raise ValueError(f"--compare {compare[0]}: with what? Give --compare twice, or more often")
        with Index(folder) as index:
            _check_present(index.folder, to_bin)
            for name in to_bin:
                typer.echo(f"{name} -> {index.to_bin(name).relative_to(index.folder)}")
            for text, what in ((notes, "notes"), (tags, "tags")):
                name, equals, value = text.partition("=")
                if text and not equals:
                    raise ValueError(f"--{what} {text}: write NAME=TEXT")
                if text:
                    new: dict[str, Any] = {what: value.split(",") if what == "tags" else value}
                    annotate(index.folder / real_name(name), **new)
            if rebuild:
                index.rebuild()
            equal = dict(_pair(one) for one in where)
            found = index.rows(search, **equal)
            if compare:
                named = {row["name"]: row for row in index.rows()}
                for name in compare:
                    if name not in named:
                        raise ValueError(f"--compare {name}: there is no such run")
                table = differences([named[name] for name in compare])
                typer.echo(json.dumps({"name": compare, **table}, indent=1, ensure_ascii=False))
                return
        if as_json:
            typer.echo(json.dumps(found, indent=1, ensure_ascii=False))
            return
        for row in found:
            typer.echo(_line(row))
        typer.echo(f"{len(found)} in {folder}")


@app.command()
def log(
    place: Annotated[
        Path,
        typer.Argument(
            exists=True, metavar="FILE.yaml|FOLDER", help="An experiment file of a rig, or a panel's folder."
        ),
    ] = Path("out/panel"),
    search: Annotated[str, typer.Option(help="Words that a line must all contain.")] = "",
    last: Annotated[int, typer.Option(help="Most lines to show, the newest.", min=1)] = 100,
    as_json: Annotated[bool, typer.Option("--json", help="Print all fields, as JSON.")] = False,
    show_traceback: Traceback = False,
) -> None:
    """Show who did what to a rig, when, from where and why: the log of a rig, or of a panel and its rig."""
    with only_reading(show_traceback):
        from ..rig.experiment.laboratory import rigs_of
        from ..rig.experiment.running import read_experiment
        from ..rig.logbook import FILE, read_log

        if place.is_dir():
            folders = {"panel": place, "rig": place / ".rig"}
        else:
            folders = {"rig": rigs_of(read_experiment(place), place.parent / ".rig", place.parent)}
        found = [
            {**one._asdict(), "of": of}
            for of, folder in folders.items()
            for one in read_log(folder / FILE, search, last)
        ]
        found = sorted(found, key=lambda one: one["time"])[-last:]
        if as_json:
            typer.echo(json.dumps(found, indent=1, ensure_ascii=False))
            return
        for one in found:
            when = datetime.fromisoformat(one["time"]).astimezone().strftime("%Y-%m-%d %H:%M:%S")
            by = ", ".join(filter(None, (one["who"], one["where"])))
            more = "".join(
                f"  {text}" for text in (one["why"] and f"({one['why']})", by and f"[{by}]") if text
            )
            typer.echo(f"{when}  {one['of']:5}  {one['what']}{more}")
        typer.echo(f"{len(found)} lines")


def _check_present(folder: Path, names: list[str]) -> None:
    """Raise ValueError for a missing or repeated name of --to-bin, before any file is moved."""
    from ..history.storable import real_name

    for name in names:
        if name.startswith(".") or not os.path.lexists(folder / real_name(name)):
            raise ValueError(f"--to-bin {name}: there is no such run in {folder}; nothing is moved")
        if names.count(name) > 1:
            raise ValueError(f"--to-bin {name}: it is named twice; nothing is moved")


def _pair(text: str) -> tuple[str, str]:
    column, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"--where {text}: write COLUMN=TEXT")
    return column, value


def _line(row: dict[str, Any]) -> str:
    try:
        when = datetime.fromtimestamp(row["changed"]).strftime("%Y-%m-%d %H:%M:%S")
    # The time of the file's last change is outside the range of dates.
    except (OverflowError, ValueError, OSError):
        when = "-" * 19
    said = row["problem"] or row["outcome"] or "-"
    shown = f"{when}  {row['kind']:9}  {row['name']}  {said}"
    more = " · ".join(one for one in (row["title"], row["operator"], row["tags"]) if one)
    return f"{shown}  {more}".rstrip()
