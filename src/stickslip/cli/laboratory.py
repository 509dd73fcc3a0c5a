"""Commands of the laboratory: record, rigs, twin, schema, calibrate; and the server of simulated instruments,
until Ctrl-C."""

from __future__ import annotations

import json
import socket
import threading
import time
from contextlib import ExitStack
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import completion
from .frame import (
    CONTINUES,
    Arm,
    Changes,
    Out,
    Traceback,
    app,
    arming,
    check_output,
    errors_in_one_line,
    progress_bar,
    write,
)

if TYPE_CHECKING:
    from ..rig.twins.server import Twin


class FileKind(StrEnum):
    """Kinds of files for which `schema` prints a JSON Schema."""

    JOB = "job"
    EXPERIMENT = "experiment"
    CAMPAIGN = "campaign"
    IDENTIFICATION = "identification"
    DESIGN = "design"
    RESULTS = "results"


@app.command()
def record(
    file: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, metavar="FILE.yaml", help="Experiment file.")
    ],
    changes: Changes = [],  # noqa: B006
    out: Out = Path("out/record"),
    arm: Arm = "",
    show_traceback: Traceback = False,
) -> None:
    """Make the recordings of an experiment file, each as NAME.nc. Finished ones are kept; another file of
    such a name is moved to .bin in the folder."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback, CONTINUES):
        check_output(out)
        from ..report.recordings import recordings_document
        from ..rig.experiment import run_experiment
        from ..rig.experiment.running import read_experiment

        with progress_bar() as progress, arming(arm):
            recorded = run_experiment(file, out, progress, changes=changes)
        document = recordings_document(read_experiment(file, changes).title, recorded, out / "experiment.log")
        write(document, out, begun)


@app.command()
def rigs(
    at: Annotated[
        list[str], typer.Option(metavar="HOST[:PORT]", help="Address to search for a known controller.")
    ] = [],  # noqa: B006  # typer copies it
    show_traceback: Traceback = False,
) -> None:
    """List the back ends (drivers), what they were verified against, and the connected devices."""
    with errors_in_one_line(show_traceback):
        from ..rig.attached import attached_devices, known_devices, probe

        addresses = [_address(where) for where in at]
        for one in known_devices():
            about = one.about
            typer.echo(f"{one.name} ({one.kind}): {about.device}; {about.does}")
            if about.samples:
                typer.echo(f"    samples {about.samples}; safe state: {about.safe_state}")
            typer.echo(f"    verified against: {about.verified}")
        found = attached_devices()
        silent = []
        for where, address in zip(at, addresses, strict=True):
            answers = probe(*address)
            if not answers:
                silent.append(where)
                typer.echo(f"{where}: no controller that is known answers there", err=True)
            found += answers
        typer.echo("connected:" if found else "connected: nothing that can be seen from here")
        for one in found:
            typer.echo(f"    {one.where}: {one.says}" + (f", {one.name}" if one.name else ""))
    if silent:
        raise typer.Exit(1)


def _address(text: str) -> tuple[str, int | None]:
    """Return host and port of a text HOST[:PORT], [IPv6]:PORT or IPv6; the port is None if it is not given.
    Raises ValueError for another text or an unknown host."""
    host, colon, port = text.rpartition(":")
    if not colon or (":" in host and not host.startswith("[")) or text.endswith("]"):
        host, port = text, ""
    elif not port.isdecimal() or not 0 < int(port) < 65536:
        raise ValueError(
            f"--at {text}: {port!r} is no port; write HOST or HOST:PORT, with a port from 1 to 65535"
        )
    host = host.strip("[]")
    try:
        socket.getaddrinfo(host or "?", None)
    except (OSError, UnicodeError) as error:
        said = getattr(error, "strerror", None) or error
        raise ValueError(
            f"--at {text}: there is no host {host!r}: {said}; check name and network, or give its IP address"
        ) from None
    return host, int(port) if port else None


@app.command()
def twin(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Controller.", autocompletion=completion.twins)],
    port: Annotated[
        int,
        typer.Option(
            help="TCP port; an oscilloscope gets the next one; 0 takes free ones.", min=0, max=65535
        ),
    ] = 0,
    host: Annotated[str, typer.Option(help="Address to serve; by default this machine only.")] = "127.0.0.1",
    parameters: Annotated[
        str,
        typer.Option(
            "--actuator",
            metavar="SET|FILE.toml",
            help="Parameter set of the stages.",
            autocompletion=completion.sets,
        ),
    ] = "kang2007-hysteresis",
    load: Annotated[str, typer.Option(help="Force on the end-effectors, with its unit.")] = "0 N",
    travel: Annotated[str, typer.Option(help="Distance between the end stops, with its unit.")] = "4 mm",
    axes: Annotated[int, typer.Option(help="Number of stages; some controllers have one.", min=1, max=4)] = 3,
    seed: Annotated[int, typer.Option(help="Seed of scatter, noise and initial position.", min=0)] = 0,
    temperature: Annotated[str, typer.Option(help="Temperature of the stages, 1 K to 300 K.")] = "300 K",
    regular: Annotated[
        bool,
        typer.Option(
            "--regular",
            help="Make steps and end stops exactly as the model has them. By default those of a positioner "
            "scatter, depend on the direction, relax and yield, as on published stages.",
        ),
    ] = False,
    pty: Annotated[
        bool, typer.Option("--pty", help="Serve a pseudo terminal, for a controller with a serial port.")
    ] = False,
    show_traceback: Traceback = False,
) -> None:
    """Serve a simulated controller (twin) with simulated stages, until Ctrl-C."""
    with errors_in_one_line(show_traceback):
        from ..physics.actuator import load_actuator
        from ..physics.temperature import at_temperature
        from ..quantities import registry
        from ..rig import REGULAR, Irregularity
        from ..rig.twins import make_twin

        actuator = load_actuator(parameters).replace(external_force=load)
        actuator = at_temperature(actuator, temperature)
        exact = regular or name not in registry.positioners.names()
        steps = REGULAR if exact else Irregularity()
        made = make_twin(name, actuator, axes=axes, travel=travel, irregularity=steps, seed=seed)
        serve(made._asdict() if hasattr(made, "_asdict") else {"": made}, host, port, pty)


def serve(twins: dict[str, Twin], host: str, port: int, pty: bool) -> None:
    """Serve simulated instruments until Ctrl-C, and print the address of each.

    Args:
        twins: the instruments by their role, such as the oscilloscope of a controller.
        host: network address to serve.
        port: TCP port of the first instrument; each further one has the next port. 0: any free ports.
        pty: serve pseudo terminals instead of TCP ports.
    """
    from ..rig.twins import TwinServer, TwinTerminal

    with ExitStack() as at_last:
        servers = []
        for i, (role, made) in enumerate(twins.items()):
            server = TwinTerminal(made) if pty else TwinServer(made, host, port and port + i)
            servers.append(at_last.enter_context(server))
            typer.echo(f"{role} {server.where}".strip())
        for server in servers[1:]:
            threading.Thread(target=server.serve_forever, daemon=True).start()
        servers[0].serve_forever()


@app.command()
def schema(kind: Annotated[FileKind, typer.Argument(help="Kind of file.")] = FileKind.JOB) -> None:
    """Print the JSON Schema of one kind of file: of jobs, of a step's file, or of results.json."""
    if kind is FileKind.JOB:
        from ..jobs.file import json_schema
    elif kind is FileKind.EXPERIMENT:
        from ..rig.experiment.file import json_schema
    elif kind is FileKind.CAMPAIGN:
        from ..jobs.campaign.file import json_schema
    elif kind is FileKind.DESIGN:
        from ..jobs.analysis.design import json_schema
    elif kind is FileKind.RESULTS:
        from ..jobs.analysis.results import json_schema
    else:
        from ..jobs.analysis.running import json_schema
    typer.echo(json.dumps(json_schema(), indent=1))


@app.command()
def calibrate(
    file: Annotated[
        str, typer.Argument(metavar="TABLE|FILE.csv", help="True values, then readings, with units.")
    ],
    order: Annotated[
        str,
        typer.Option(help='Order of the polynomial; "auto": the one that best predicts points left out.'),
    ] = "auto",
    after: Annotated[
        list[str],
        typer.Option(
            autocompletion=completion.calibrations,
            help="Calibration that converts the readings first; the new one corrects its result.",
        ),
    ] = [],  # noqa: B006  # typer copies it
    name: Annotated[str, typer.Option(help="Name of the calibration; by default TABLE-ORDER.")] = "",
    out: Out = Path("out/calibrate"),
    show_traceback: Traceback = False,
) -> None:
    """Fit a sensor's calibration to a table of true values and readings; write it to calibration.json."""
    begun = time.perf_counter()
    with errors_in_one_line(show_traceback):
        check_output(out)
        from ..recording.calibration import cross_validation, fit_calibration, read_table, save_calibration
        from ..recording.calibration.applying import calibration_chain
        from ..report.calibration import calibration_document

        table = read_table(file)
        for calibration in calibration_chain(after, table.x_unit) if after else ():
            table = table._replace(x=calibration(table.x), x_unit=calibration.y_unit)
        if order != "auto" and not order.isdecimal():
            raise ValueError(f"--order {order}: a whole number, or auto")
        orders = range(1, 8)
        left_out = cross_validation(table.x, table.y, orders) if table.y.size > 3 else {}
        if order == "auto" and not left_out:
            raise ValueError(f"--order auto: {table.name} has too few points, name an order")
        power = min(left_out, key=left_out.__getitem__) if order == "auto" else int(order)
        made = fit_calibration(
            table.x,
            table.y,
            power,
            name=name or f"{table.name}-{power}",
            x_unit=table.x_unit,
            y_unit=table.y_unit,
            source=table.source,
        )
        document = calibration_document(made, table, left_out)
        out.mkdir(parents=True, exist_ok=True)
        save_calibration(made, out / "calibration.json")
        write(document, out, begun)
