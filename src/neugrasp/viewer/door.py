"""Where the viewer listens, and whose pages may come in."""

from __future__ import annotations

import errno
import ipaddress
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from neugrasp.errors import InputError, require

FIRST, TRIED = 8080, 100
"""Without a port that was asked for, the first free one of so many from here on is taken."""


def free_port(host: str, port: int | None) -> int:
    """The port to listen at: the one that is asked for, else the first free one from 8080 on.

    Raises `InputError` where the host is none of this machine's, or the port is taken, kept for the system,
    or no number of a port.
    """
    if port is not None and not 0 <= port < 2**16:
        raise InputError(f"--port {port}: must be from 0 to 65535; 0 takes any free one")
    for number in range(FIRST, FIRST + TRIED) if port is None else (port,):
        refused = _refused(host, number)
        if refused is None:
            return number
        if refused.errno == errno.EACCES:
            raise InputError(
                f"--port {number}: is kept for the system's own services; choose one from 1024 to 65535"
            )
        if refused.errno != errno.EADDRINUSE:
            reason = refused.strerror or refused
            raise InputError(f"--host {host}: is no address of this machine ({reason}); 127.0.0.1 is")
    if port is None:
        raise InputError(f"the ports {FIRST} to {FIRST + TRIED - 1} are all in use; choose another: --port N")
    raise InputError(
        f"--port {port}: is in use by another program; choose another, or leave --port away: then the first "
        f"free one from {FIRST} on is taken"
    )


def _refused(host: str, port: int) -> OSError | None:
    """Why the system does not let us listen there, or nothing."""
    if not host or "\0" in host:
        raise InputError(f"--host {host!r}: give an address or a name; 127.0.0.1 is this machine alone")
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as tried:
            if os.name == "posix":
                # As the server does: a port that was used a moment ago is free.
                tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind(address)
            tried.listen()
    except UnicodeError as error:
        return OSError(errno.EINVAL, str(error))
    except OSError as error:
        return error
    return None


def is_welcome(origin: str | None, asked: str | None, host: str) -> bool:
    """Whether a page of `origin` may talk to the viewer that it calls `asked` (two headers of its request).

    A page of another site may not, be its name one that now leads to this machine. What is no page, such as
    a program of the user, says no origin and may. `host` is where the viewer listens.
    """
    if asked is None or not _is_here(asked, host):
        return False
    if origin is None:
        return True
    parts = urlsplit(origin)
    return parts.scheme in ("http", "https") and parts.netloc.lower() == asked.lower()


def _is_here(asked: str, host: str) -> bool:
    """Whether a name is one of this machine's, as nobody else can give it: an address, or its own name."""
    try:
        name = urlsplit(f"//{asked}").hostname or ""
    except ValueError:
        return False
    try:
        ipaddress.ip_address(name)
    except ValueError:
        own = {"localhost", host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
        return name in own or name.endswith(".localhost")
    return True


@contextmanager
def guarded(host: str) -> Iterator[None]:
    """Servers that viser starts meanwhile answer pages of other sites with 403.

    Viser has no such switch; what it starts is `serve` of websockets, which has a place for it.
    """
    server: Any = require("websockets.asyncio.server", extra="view")
    serve = server.serve

    def guarded_serve(*arguments: Any, process_request: Callable[..., Any], **options: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            is_page = request.headers.get("Upgrade", "").lower() != "websocket"
            headers = request.headers.get("Origin"), request.headers.get("Host")
            if is_page or is_welcome(*headers, host):
                return process_request(connection, request)
            return connection.respond(403, "This viewer does not talk to pages of other sites.\n")

        return serve(*arguments, process_request=process, **options)

    server.serve = guarded_serve
    try:
        yield
    finally:
        server.serve = serve
