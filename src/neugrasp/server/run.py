"""The server's command."""

from __future__ import annotations

import importlib
import ipaddress
import socket

from neugrasp.client import read_token
from neugrasp.errors import InputError, require
from neugrasp.server.command import Serve
from neugrasp.viewer.door import free_port

NEEDED = ("fastapi", "uvicorn", "python_multipart", "prometheus_client", "fastapi_offline")


def run(config: Serve) -> str:
    """`neugrasp serve`: how many requests were answered, after Ctrl-C or SIGTERM."""
    for module in NEEDED:
        require(module, extra="serve")
    _check(config)
    token = read_token(config.token_file)
    if token is None and not _is_own(config.host):
        raise InputError(
            f"--host {config.host}: others can reach it, so clients must send a token: write one of at least "
            "16 letters and digits into a file and give it as --token-file"
        )
    port = free_port(config.host, 0 if config.check else config.port)
    listening = importlib.import_module("neugrasp.server.listening")
    said: str = listening.check(config, token) if config.check else listening.listen(config, port, token)
    return said


def _check(config: Serve) -> None:
    """Raises `InputError`."""
    for number, least, what in (
        (config.queue, 1, "--queue"),
        (config.cells, 1, "--cells"),
        (len(config.devices), 1, "--devices"),
        (config.largest_mb, 0.01, "--largest-mb"),
        (config.megapixels, 0.01, "--megapixels"),
        (config.patience_s, 0.1, "--patience-s"),
        (config.grace_s, 0, "--grace-s"),
    ):
        if not least <= number < 1e6:
            raise InputError(f"{what} {number:g}: must be at least {least:g}")


def _is_own(host: str) -> bool:
    """Whether only this machine can reach an address."""
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except OSError:
        return False
    return all(ipaddress.ip_address(str(address[0]).split("%")[0]).is_loopback for *_, address in found)
