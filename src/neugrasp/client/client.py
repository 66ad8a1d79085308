"""A connection to a server, for programs that wait for one thing, and for those that wait for many."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from neugrasp.client.messages import (
    Answer,
    Photos,
    Request,
    ServerError,
    answer_of,
    asking,
    asking_at,
    content_of,
    keeping,
)
from neugrasp.data.fields import Fields
from neugrasp.detection.contract import Detection
from neugrasp.detection.options import Steering
from neugrasp.errors import InputError, require
from neugrasp.observation import Views

log = logging.getLogger(__name__)

TRIES = 6
"""How often a request is sent to a server that is busy, or going down."""
AGAIN = (429, 503)
LONGEST_WAIT_S = 30.0


class Client:
    """A connection to a server, to be closed, or used in a with statement. Several threads may share it."""

    def __init__(self, url: str, token: str | None = None, timeout_s: float = 60.0, tries: int = TRIES):
        """`timeout_s` is for one try. Raises `InputError` where the address is none, `MissingExtra` without
        httpx."""
        self._http = require("httpx", extra="client").Client(**_settings(url, token, timeout_s))
        self._url, self._tries, self._findings = url, tries, _Findings()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the connection."""
        self._http.close()

    def weights(self) -> dict[str, Any]:
        """What the server answers with."""
        return self._send(Request("GET", "/v1/weights")).data

    def keep_cell(self, name: str, scene: str | Path | Views) -> None:
        """Gives the server cameras and photos of the empty table, to be kept under a name."""
        self._send(keeping(name, scene))

    def detect(self, scene: str | Path | Views, steering: Steering | None = None) -> Detection:
        """Grasps of a whole scene: a folder, or photos in memory.

        Raises `InputError` with the server's words where it cannot be used, and `ServerError` where there is
        no answer. What the doctor noticed is logged, once.
        """
        return self._findings.told(self.ask(scene, steering)).detection

    def detect_at(self, cell: str, images: Photos, steering: Steering | None = None) -> Detection:
        """Grasps of photos at a cell that was given before, in the order of its views. Raises as `detect`."""
        return self._findings.told(self.ask_at(cell, images, steering)).detection

    def ask(self, scene: str | Path | Views, steering: Steering | None = None, force: bool = False) -> Answer:
        """As `detect`, with what else the server says; `force`: even where the doctor says red."""
        request = asking(scene, steering, force)
        return answer_of(self._send(request), request)

    def ask_at(
        self, cell: str, images: Photos, steering: Steering | None = None, force: bool = False
    ) -> Answer:
        """As `detect_at`, with what else the server says."""
        request = asking_at(cell, images, steering, force)
        return answer_of(self._send(request), request)

    def _send(self, request: Request) -> Fields:
        for tried in range(1, self._tries + 1):
            try:
                response = self._http.request(request.method, request.path, **request.options())
            except _errors() as error:
                raise _unreachable(self._url, error) from error
            if response.status_code not in AGAIN or tried == self._tries:
                break
            time.sleep(_wait(response.headers, tried))
        return content_of(response.status_code, response.content, self._url)


class AsyncClient:
    """As `Client`, for programs that wait for many things."""

    def __init__(self, url: str, token: str | None = None, timeout_s: float = 60.0, tries: int = TRIES):
        """As of `Client`."""
        self._http = require("httpx", extra="client").AsyncClient(**_settings(url, token, timeout_s))
        self._url, self._tries, self._findings = url, tries, _Findings()

    async def __aenter__(self) -> AsyncClient:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Ends the connection."""
        await self._http.aclose()

    async def weights(self) -> dict[str, Any]:
        """What the server answers with."""
        return (await self._send(Request("GET", "/v1/weights"))).data

    async def keep_cell(self, name: str, scene: str | Path | Views) -> None:
        """As of `Client`."""
        await self._send(keeping(name, scene))

    async def detect(self, scene: str | Path | Views, steering: Steering | None = None) -> Detection:
        """As of `Client`."""
        request = asking(scene, steering, force=False)
        return self._findings.told(answer_of(await self._send(request), request)).detection

    async def detect_at(self, cell: str, images: Photos, steering: Steering | None = None) -> Detection:
        """As of `Client`."""
        request = asking_at(cell, images, steering, force=False)
        return self._findings.told(answer_of(await self._send(request), request)).detection

    async def _send(self, request: Request) -> Fields:
        for tried in range(1, self._tries + 1):
            try:
                response = await self._http.request(request.method, request.path, **request.options())
            except _errors() as error:
                raise _unreachable(self._url, error) from error
            if response.status_code not in AGAIN or tried == self._tries:
                break
            await asyncio.sleep(_wait(response.headers, tried))
        return content_of(response.status_code, response.content, self._url)


def _settings(url: str, token: str | None, timeout_s: float) -> dict[str, Any]:
    """Settings of an httpx client; nothing on the way is asked but the server itself."""
    if not url.startswith(("http://", "https://")):
        raise InputError(f"{url!r}: the address of a server begins with http:// or https://")
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    return {"base_url": url, "headers": headers, "timeout": timeout_s, "trust_env": False}


def _errors() -> type[Exception]:
    kind: type[Exception] = require("httpx", extra="client").HTTPError
    return kind


def _unreachable(url: str, error: Exception) -> ServerError:
    return ServerError(
        f"{url}: no answer ({error or type(error).__name__}); is `neugrasp serve` running there?"
    )


def _wait(headers: Mapping[str, str], tried: int) -> float:
    """Seconds until the next try, as the server says, else longer each time."""
    said = headers.get("retry-after", "")
    return min(LONGEST_WAIT_S, float(said) if said.isdecimal() else 0.5 * 2**tried)


class _Findings:
    """What the doctor noticed, each told once."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def told(self, answer: Answer) -> Answer:
        """The answer, what is new in it told."""
        for line in answer.findings:
            if line not in self._known:
                self._known.add(line)
                log.warning("%s", line)
        return answer
