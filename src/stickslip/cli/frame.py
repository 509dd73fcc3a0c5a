"""Common parts of all commands: the application and its options --version and --use, errors in one line,
permission to arm a rig, progress, reports."""

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
# A missing package is reported here, because this module of the command line is imported first.
except ModuleNotFoundError as missing:
    raise SystemExit(f"Error: the command line needs {missing.name}; {_INSTALL}") from None

if TYPE_CHECKING:
    from ..quantities.progress import Progress
    from ..report import Document
    from .interruption import Interruption

app = typer.Typer(
    help="Identify, verify, simulate and design piezoelectric stick-slip actuators from recordings.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    # The help is plain text without colours and boxes: it appears four times as fast, and looks the same in a
    # log.
    rich_markup_mode=None,
)


# Texts for the error message of an interrupted command, which say what remains of its work.
FINISHED = "what was finished is kept"
CONTINUES = f"{FINISHED}, and the same command continues"
# Number of bytes of free disk space that a report needs, which are checked before any work.
ROOM = 4_000_000
# Number of further attempts to write into the folder --out while another command makes and removes that
# folder.
_TRIES = 5

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

# Handlers of Ctrl-C of the running command and of commands within it, the innermost one last.
_INTERRUPTIONS: list[Interruption] = []


@contextmanager
def errors_in_one_line(show_traceback: bool, kept: str = "nothing is kept") -> Iterator[None]:
    """Context of a command, which reports errors and warnings in one line on stderr.

    An error ends the program by `typer.Exit`, with the exit code 2 for a ValueError (wrong input), 130 for an
    interruption (see `interruption`) and 1 otherwise.

    Args:
        show_traceback: True: also print where in the program an error occurred.
        kept: words for the message after an interruption: what remains of the work.
    """
    from .interruption import CODE, Interruption

    # Texts of warnings that were shown: each is shown once, even if several fits cause it.
    told = set()

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
            # For example, the output goes to `head`, which has read enough. The library typer then ends the
            # program without a message.
            raise
        if show_traceback:
            traceback.print_exc()
        typer.echo(f"Error: {_explained(error)}", err=True)
        raise typer.Exit(2 if isinstance(error, ValueError) else 1) from None


@contextmanager
def arming(why: str) -> Iterator[None]:
    """Context in which a command may enable the voltage output of a real rig.

    `why` is the user's reason (--arm), which the rig's log keeps. Without a reason ("") the context changes
    nothing, so the output of a real rig stays disabled.
    """
    if not why:
        yield
        return
    from ..rig.interlock import armed

    with armed(why):
        yield


@contextmanager
def only_reading(show_traceback: bool) -> Iterator[None]:
    """Context for commands that only read: errors are reported as by `errors_in_one_line`, and Python files
    that are named in a read file are not executed.

    Files that the user has given with --use were already executed before.
    """
    with errors_in_one_line(show_traceback):
        from ..quantities.registry import nothing_run

        with nothing_run():
            yield


def _reader_is_gone() -> bool:
    """Print a newline; return True if the program that reads the printed output, such as `head`, has ended.

    Otherwise a broken pipe has another cause, such as a lost connection to a rig, and is an error.
    """
    try:
        # A newline is printed, because flushing alone shows no error if the output is unbuffered.
        print(flush=True)
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
    """Context that yields a progress callback with two arguments: activity as text, and finished fraction.

    On a terminal the callback shows a bar; otherwise it prints a line to stderr when the text changes. If the
    user has interrupted the command, the callback raises KeyboardInterrupt.
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
    """Check before the work that a report can be written to a folder, by a test file of `ROOM` bytes.

    Raises:
        ModuleNotFoundError: a package for reports is missing.
        ValueError: the path or a part of it is a file.
        OSError: writing to the folder fails, for example on a full disk.
    """
    for name in ("jinja2", "matplotlib"):
        if find_spec(name) is None:
            raise ModuleNotFoundError(name=name)
    existing = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    if not existing.is_dir():
        raise ValueError(f"--out {out}: {existing} is a file, not a folder; name another folder")
    for tries_left in range(_TRIES, -1, -1):
        try:
            return _try_to_write(out)
        # Another command has made and removed the same new folder at this moment, so the test is repeated.
        except FileNotFoundError as error:
            if not tries_left:
                raise OSError(error.errno, f"{error.strerror}; name another folder", f"--out {out}") from None
        except OSError as error:
            raise OSError(error.errno, f"{error.strerror}; name another folder", f"--out {out}") from None


def _try_to_write(out: Path) -> None:
    """Test that a report can be written: write a file of `ROOM` bytes into a folder, and remove it again.

    Folders that were made for the test are removed too. Raises OSError if the file cannot be written.
    """
    probe = out / f".room.{os.getpid()}.part"
    made: list[Path] = []
    try:
        for folder in reversed((out, *out.parents)):
            # A folder that another command makes at this moment is not in `made`, because it must not be
            # removed.
            with suppress(FileExistsError):
                if not folder.exists():
                    folder.mkdir()
                    made.insert(0, folder)
        # Only writing a file shows that it is permitted and that there is room.
        with probe.open("wb") as file:
            file.write(bytes(ROOM))
            file.flush()
            os.fsync(file.fileno())
    finally:
        probe.unlink(missing_ok=True)
        # The folder for results must not exist before there is a result.
        for folder in made:
            _remove_if_empty(folder)


def _remove_if_empty(folder: Path) -> None:
    try:
        folder.rmdir()
    # Another command uses this folder or has removed it: no error.
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOENT):
            raise


class RequirementError(Exception):
    """Error: a requirement of the user on the results is not met, such as a largest rms error."""


def write(document: Document, out: Path, begun: float, browser: str = "") -> None:
    """Write the report (results.json, report.html) and print the main results.

    Args:
        document: content of the report.
        out: folder for the report.
        begun: time at which the command started, from `time.perf_counter`, s.
        browser: path of a browser, with which report.pdf is written too; "" for no PDF.

    Raises:
        RequirementError: a requirement is not met (after the report was written).
        KeyboardInterrupt: the user interrupted the work; the report shows the finished part.
        OSError: the report cannot be written.
    """
    from ..report import write_pdf, write_report
    from ..report.text import shown_number

    command = shlex.join(["stickslip", *sys.argv[1:]])
    try:
        report = write_report(document, out, command=command, elapsed=time.perf_counter() - begun)
    # The error of a full disk does not name a file, so the folder is added.
    except OSError as error:
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
