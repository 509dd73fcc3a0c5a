"""Common parts of all commands: the application, errors in one line, progress, reports."""

from __future__ import annotations

import errno
import os
import re
import shlex
import sys
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from .._version import __version__

_INSTALL = 'install what it needs with: pip install "stickslip[all]"'

try:
    import typer
except ModuleNotFoundError as missing:  # this module is imported first: no other could report it
    raise SystemExit(f"Error: the command line needs {missing.name}; {_INSTALL}") from None

if TYPE_CHECKING:
    from ..quantities.progress import Progress
    from ..report import Document
    from .interruption import Interruption

app = typer.Typer(
    help="Identify, verify, simulate and design piezoelectric stick-slip actuators from recordings.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: four times as fast, and the same in a log
)


# Texts on what remains after an interrupted command, for its error message.
FINISHED = "what was finished is kept"
CONTINUES = f"{FINISHED}, and the same command continues"
ROOM = 4_000_000  # bytes of free disk space that a report needs, checked before any work
_TRIES = 5  # further attempts to write into --out while another command makes and removes that folder

Out = Annotated[
    Path, typer.Option(help="Folder for results.json and report.html; other files in it are kept.")
]
Changes = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="FIELD=VALUE",
        help="Change the file for this run: bounds.sigma_0='[1e5, 1e7]', recordings.0.use=verify.",
    ),
]
Traceback = Annotated[
    bool,
    typer.Option(
        "--traceback", envvar="STICKSLIP_TRACEBACK", help="Show where in the program an error occurred."
    ),
]


Arm = Annotated[
    str,
    typer.Option(
        "--arm",
        metavar="WHY",
        help="Enable the output of a real rig for this command; the log keeps the reason WHY.",
    ),
]

_INTERRUPTIONS: list[Interruption] = []  # handlers of Ctrl-C of the running command, the current one last


@contextmanager
def errors_in_one_line(show_traceback: bool, kept: str = "nothing is kept") -> Iterator[None]:
    """Report errors in one line on stderr, and by the exit code; a warning is also one line.

    An interrupted command ends as described in `interruption`.

    Args:
        show_traceback: show where in the program an error occurred.
        kept: what remains after an interruption, in words.
    """
    from .interruption import CODE, Interruption

    told = set()  # each warning once, even if several fits cause it

    def say(message: Warning | str, *where: Any, **how: Any) -> None:
        text = _in_one_line(str(message))
        if text not in told:
            typer.echo(f"Warning: {text}", err=True)
        told.add(text)

    try:
        with warnings.catch_warnings(), Interruption() as interruption:
            warnings.showwarning = say
            _INTERRUPTIONS.append(interruption)
            try:
                yield
            finally:
                _INTERRUPTIONS.pop()
    except KeyboardInterrupt:
        typer.echo(f"Error: interrupted; {kept}", err=True)
        raise typer.Exit(CODE) from None
    except Exception as error:
        if isinstance(error, BrokenPipeError) and _reader_is_gone():
            raise  # "| head": the command-line library ends without a message
        if show_traceback:
            traceback.print_exc()
        typer.echo(f"Error: {_explained(error)}", err=True)
        raise typer.Exit(2 if isinstance(error, ValueError) else 1) from None


@contextmanager
def arming(why: str) -> Iterator[None]:
    """Context in which the output of a real rig may be enabled, if `why` has the user's reason.

    Without a reason ("") the context changes nothing.
    """
    if not why:
        yield
        return
    from ..rig.interlock import armed

    with armed(why):
        yield


@contextmanager
def only_reading(show_traceback: bool) -> Iterator[None]:
    """Context for commands that only read: errors are reported in one line, and no user's file is run.

    Files given with --use were run before; others that are named in a read file are not.
    """
    with errors_in_one_line(show_traceback):
        from ..quantities.registry import nothing_run

        with nothing_run():
            yield


def _reader_is_gone() -> bool:
    """Return True if the program that reads the printed output has ended, such as `head`.

    Otherwise a broken pipe has another cause, such as a lost connection to a rig, and is an error.
    """
    try:
        print(flush=True)  # prints a newline: an unbuffered output has nothing to flush, and shows no error
    except BrokenPipeError:
        return True
    return False


def _in_one_line(text: str) -> str:
    """Return a text as one line, with unprintable characters escaped, because a file's name could control the
    terminal."""
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in " ".join(text.split()))


def _explained(error: Exception) -> str:
    text = _in_one_line(". ".join((str(error), *getattr(error, "__notes__", ()))))
    if isinstance(error, ModuleNotFoundError) and not str(error.name).startswith("stickslip"):
        return text if "pip install" in text else f"this command needs {error.name}; {_INSTALL}"
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return _in_one_line(f"{error.filename}: {error.strerror}")
    if isinstance(error, ValueError | OSError) or type(error).__module__.startswith("stickslip"):
        return text
    return f"unexpected {type(error).__name__}: {text} (--traceback shows where)"


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """Context that gives a progress callback (text, finished fraction).

    On a terminal it shows a bar, otherwise it prints a line to stderr when the text changes. If the user has
    interrupted the command, the callback ends it by a KeyboardInterrupt.
    """
    with _shown_progress() as progress:
        yield _INTERRUPTIONS[-1].ending(progress) if _INTERRUPTIONS else progress


@contextmanager
def _shown_progress() -> Iterator[Progress]:
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


def check_output(out: Path) -> None:
    """Check before the work that a report can be written to a folder; raise an error if not."""
    for name in ("jinja2", "matplotlib"):
        if find_spec(name) is None:
            raise ModuleNotFoundError(name=name)
    existing = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    if not existing.is_dir():
        raise ValueError(f"--out {out}: {existing} is a file, not a folder; name another folder")
    for tries_left in range(_TRIES, -1, -1):
        try:
            return _try_to_write(out)
        except FileNotFoundError as error:  # another command has tried and removed the same new folder
            if not tries_left:
                raise OSError(error.errno, f"{error.strerror}; name another folder", f"--out {out}") from None
        except OSError as error:
            raise OSError(error.errno, f"{error.strerror}; name another folder", f"--out {out}") from None


def _try_to_write(out: Path) -> None:
    """Test that a report fits: write a file of its size into the folder, and remove it again.

    Folders that were made for the test are removed too.
    """
    probe = out / f".room.{os.getpid()}.part"
    made: list[Path] = []
    try:
        for folder in reversed((out, *out.parents)):
            with suppress(FileExistsError):  # what another command makes meanwhile must not be removed
                if not folder.exists():
                    folder.mkdir()
                    made.insert(0, folder)
        with probe.open("wb") as file:  # only writing shows whether it is permitted
            file.write(bytes(ROOM))
            file.flush()
            os.fsync(file.fileno())
    finally:
        probe.unlink(missing_ok=True)
        for folder in made:  # the folder must not exist before there is a result
            _remove_if_empty(folder)


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    except OSError as error:  # another command uses or has removed it
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOENT):
            raise


class RequirementError(Exception):
    """Error: a requirement of the user on the results is not met, such as a largest rms error."""


def write(document: Document, out: Path, begun: float, browser: str = "") -> None:
    """Write the report and print the main results.

    Args:
        document: the report.
        out: folder for it.
        begun: time at which the command started, from `time.perf_counter`, s.
        browser: path of a browser, with which report.pdf is written too; "" for no PDF.

    Raises:
        RequirementError: a requirement is not met.
        KeyboardInterrupt: the user interrupted the work; the report shows the finished part.
    """
    from ..report import write_pdf, write_report
    from ..report.text import shown_number

    command = shlex.join(["stickslip", *sys.argv[1:]])
    try:
        report = write_report(document, out, command=command, elapsed=time.perf_counter() - begun)
    except OSError as error:  # on a full disk the error names no file
        raise OSError(error.errno, error.strerror, error.filename or f"--out {out}") from error
    for sentence in re.split(r"(?<=\.) (?=[A-Z])", document.summary):
        typer.echo(sentence)
    for what, number in document.highlights:
        typer.echo(f"  {what}: {shown_number(number)}")
    typer.echo(f"Report: {report}")
    if browser:
        typer.echo(f"PDF: {write_pdf(report, browser)}")
    if document.interrupted:
        typer.echo("; ".join(document.failures), err=True)
        raise KeyboardInterrupt
    for failure in document.failures[:-1]:
        typer.echo(f"Error: not as required: {_in_one_line(failure)}", err=True)
    if document.failures:
        raise RequirementError(f"not as required: {document.failures[-1]}")


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"stickslip {__version__}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
    use: Annotated[
        list[Path],
        typer.Option(
            metavar="FILE.py",
            help="Run a Python file of yours first: its laws, waveforms, ... are then known by name.",
        ),
    ] = [],  # noqa: B006  # typer copies it
) -> None:
    """Handle the options that come before the command: --version and --use."""
    if use:
        with errors_in_one_line(False):
            from ..quantities.registry import use_file

            for file in use:
                use_file(file)
