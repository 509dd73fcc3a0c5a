"""Command that serves the control panel."""

from __future__ import annotations

import os
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from .frame import Traceback, app, errors_in_one_line

_LOOPBACK = ("127.0.0.1", "localhost", "::1")
# Nice value (priority) of the panel's process: before programs that only compute, after the rig's process.
_NICE = -5


@app.command()
def panel(
    folder: Annotated[
        Path, typer.Argument(file_okay=False, help="Folder of recordings and experiments; made if missing.")
    ] = Path("out/panel"),
    host: Annotated[str, typer.Option(help="Address to serve; by default this machine only.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="TCP port; 0 takes a free one.", min=0, max=65535)] = 8080,
    token: Annotated[
        str,
        typer.Option(
            envvar="STICKSLIP_PANEL_TOKEN",
            help="Token that a browser must send. Without one a token is made, except on this machine alone.",
        ),
    ] = "",
    need_token: Annotated[
        bool,
        typer.Option("--need-token", help="Require a token on this machine too, if it has other users."),
    ] = False,
    roles: Annotated[
        list[str],
        typer.Option(
            "--role",
            metavar="watch|operate|maintain",
            help="Make another token, with this role; the role of --token is maintain.",
        ),
    ] = [],  # noqa: B006  # typer copies it
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    show_traceback: Traceback = False,
) -> None:
    """Serve the control panel until Ctrl-C and open it in the browser: recording, identification, design."""
    with errors_in_one_line(show_traceback):
        from ..gate.priority import come_first
        from ..rig.memory import give_memory_back

        come_first(_NICE)
        give_memory_back()
        import secrets

        import uvicorn

        from ..panel import create_app
        from ..panel.connections import server_config
        from ..panel.guard import LOOPBACK
        from ..panel.roles import ROLES

        local = host in _LOOPBACK
        if token and len(token) < 16:
            raise ValueError("--token: at least 16 characters")
        for role in roles:
            if role not in ROLES:
                raise ValueError(f"--role {role}: there are {', '.join(ROLES)}")
        open_to_all = local and not need_token and not roles
        secret = token or (None if open_to_all else secrets.token_urlsafe(24))
        tokens = {secrets.token_urlsafe(24): role for role in dict.fromkeys(roles) if role != "maintain"}
        folder.mkdir(parents=True, exist_ok=True)
        listening = socket.create_server(
            (host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET
        )
        # Without the option TCP_NODELAY every answer of the server waits 40 ms for an acknowledgement. The
        # package asyncio sets this option only for sockets that it has made itself.
        listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        number = listening.getsockname()[1]
        shown = f"[{host}]" if ":" in host else host
        names = LOOPBACK | {shown.lower(), socket.gethostname().lower()}
        served = create_app(folder, token=secret, tokens=tokens, hosts=names, any_address=not local)
        plain = f"http://{shown}:{number}/"
        address = plain + (f"?token={secret}" if secret else "")
        typer.echo(f"Panel: {address}")
        for one, role in tokens.items():
            typer.echo(f"Panel, to {role}: {plain}?token={one}")
        if browser:
            _open(address)
        server = uvicorn.Server(server_config(served))
        # The server (uvicorn) handles all other signals itself.
        if hasattr(signal, "SIGHUP"):
            signal.signal(signal.SIGHUP, server.handle_exit)
        # Ctrl-C is the usual end of a panel and no error.
        with suppress(KeyboardInterrupt):
            server.run(sockets=[listening])
        # The server has released the rig and ended all processes. A normal exit of Python would still wait
        # for threads of requests that nobody needs any more, which may take minutes (a map of steps, for
        # example). So the process ends at once.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _open(address: str) -> None:
    """Open the address in a browser after a moment, because the server is not ready yet."""
    import threading
    import webbrowser

    threading.Timer(0.5, webbrowser.open, (address,)).start()
