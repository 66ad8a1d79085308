"""The gate before the application: who may come in, how much they may bring, and how long they may take.

Everything here is decided before a body is read, or while it comes; to refuse costs next to nothing.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import logging
import re
import time
from collections.abc import Awaitable, Callable, MutableMapping
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Protocol
from uuid import uuid4

from neugrasp.viewer.door import is_welcome

log = logging.getLogger(__name__)

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Message, Receive, Send], Awaitable[None]]

OPEN = ("/", "/healthz", "/readyz", "/v2/health/live", "/v2/health/ready", "/docs", "/openapi.json")
"""Paths that need no token: none of them says anything of a scene."""
GIVEN_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}")
"""What a client may call its request (X-Request-ID)."""
HEADERS = {
    "x-content-type-options": "nosniff",
    "content-security-policy": "default-src 'self' data: blob: 'unsafe-inline'; frame-ancestors 'none'",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
}


@dataclass(frozen=True)
class Rules:
    """What is let in."""

    host: str
    """Where the server listens."""
    token: str | None
    largest_body: int
    """Bytes."""
    patience_s: float
    """For a body."""


class Refusal(Exception):
    """A request that is not let in, or that brings too much."""

    def __init__(self, status: int, reason: str, detail: str, **headers: str):
        super().__init__(detail)
        self.status, self.reason, self.detail = status, reason, detail
        self.headers = headers


class Rooms(Protocol):
    """Where requests with photos find a place."""

    def enter(self, staying: ExitStack) -> None:
        """Holds a place until `staying` is closed. Raises `Refusal` where there is none."""
        ...


class Counters(Protocol):
    """Who counts."""

    def answered(self, route: str, status: int) -> None: ...

    def refused(self, reason: str) -> None: ...


class Gate:
    """Wraps an ASGI application."""

    def __init__(self, inside: Application, rules: Rules, rooms: Rooms, counters: Counters):
        self._inside, self._rules, self._rooms, self._counters = inside, rules, rooms, counters

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Lets a request in, or answers it."""
        if scope["type"] != "http":
            await self._inside(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        given = headers.get("x-request-id", "")
        visit = Visit(given if GIVEN_NAME.fullmatch(given) else uuid4().hex[:16], scope, send)
        scope.setdefault("state", {})["visit"] = visit
        with ExitStack() as staying:
            try:
                self._check(scope, headers)
                if scope["method"] in ("POST", "PUT"):
                    self._rooms.enter(staying)
                receive = _Body(receive, self._rules, visit).receive
                await self._inside(scope, receive, visit.send)
            except Refusal as refusal:
                await visit.refuse(refusal)
            except Exception as error:
                log.error("request %s failed", visit.request, exc_info=error)
                await visit.refuse(Refusal(500, "crashed", "a mistake of the server; its log says more"))
            finally:
                self._tell(visit)

    def _check(self, scope: Message, headers: MutableMapping[str, str]) -> None:
        """Raises `Refusal`."""
        rules = self._rules
        origin, asked = headers.get("origin"), headers.get("host")
        # Who has the token may come by any name; without one, the name must be this machine's.
        named = rules.host if rules.token is None else (asked or "").rsplit(":", 1)[0]
        if not is_welcome(origin, asked, named):
            raise Refusal(403, "foreign page", "this server does not talk to pages of other sites")
        is_open = scope["path"] in OPEN or scope["path"].startswith("/static-offline-docs/")
        if rules.token is not None and not is_open:
            given = headers.get("authorization", "").removeprefix("Bearer ").encode("utf-8")
            if not hmac.compare_digest(given, rules.token.encode("utf-8")):
                detail = "send the server's token: Authorization: Bearer TOKEN"
                raise Refusal(401, "no token", detail, **{"www-authenticate": "Bearer"})
        length = headers.get("content-length", "0")
        if length.isdecimal() and int(length) > rules.largest_body:
            raise _too_large(rules)

    def _tell(self, visit: Visit) -> None:
        """One line of JSON for each request; nothing of its photos is in it."""
        self._counters.answered(visit.route, visit.status)
        if visit.reason:
            self._counters.refused(visit.reason)
        line = {
            "request": visit.request,
            "method": visit.scope["method"],
            "route": visit.route,
            "status": visit.status,
            "seconds": round(time.perf_counter() - visit.begun, 4),
            "bytes": visit.received,
            **({"refused": visit.reason} if visit.reason else {}),
            **visit.facts,
        }
        # Those who ask whether it lives ask often.
        is_quiet = visit.scope["path"] in OPEN and visit.status == 200
        log.log(logging.DEBUG if is_quiet else logging.INFO, "%s", json.dumps(line))


class Visit:
    """One request and what becomes of it."""

    def __init__(self, request: str, scope: Message, send: Send):
        self.request, self.scope = request, scope
        self.begun = time.perf_counter()
        self.received = 0
        """Bytes of the body so far."""
        self.status = 499
        """Status of the answer; 499 where nobody waited for one."""
        self.reason = ""
        """Why there was no detection."""
        self.facts: dict[str, Any] = {}
        """What else the log may say."""
        self.broken: Refusal | None = None
        """What ended the body before it was whole."""
        self._send = send
        self._has_begun = self._is_over = False

    @property
    def route(self) -> str:
        """The path as it is declared: names of cells do not become names of counters."""
        return str(getattr(self.scope.get("route"), "path", "other"))

    async def send(self, message: Message) -> None:
        """Passes the application's answer on, with the headers of every answer; in place of what it says to a
        body that broke off, why that is."""
        if self.broken is not None and not self._has_begun:
            await self.refuse(self.broken)
        elif not self._is_over:
            await self._pass(message)

    async def _pass(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.status, self._has_begun = message["status"], True
            own = {"x-request-id": self.request, **HEADERS}
            told = {name.lower() for name, _ in message.get("headers", [])}
            added = [(k.encode(), v.encode()) for k, v in own.items() if k.encode() not in told]
            message = {**message, "headers": [*message.get("headers", []), *added]}
        await self._send(message)

    async def refuse(self, refusal: Refusal) -> None:
        """Answers in place of the application, unless its answer has begun."""
        self.reason = refusal.reason
        if self._has_begun:
            return
        body = json.dumps(problem(refusal.status, refusal.detail, self.request)).encode()
        headers = {"content-type": "application/problem+json", "content-length": str(len(body))}
        if refusal.status in (408, 413):
            # What is still to come is not read.
            headers["connection"] = "close"
        listed = [(k.encode(), v.encode()) for k, v in {**headers, **refusal.headers}.items()]
        await self._pass({"type": "http.response.start", "status": refusal.status, "headers": listed})
        await self._pass({"type": "http.response.body", "body": body})
        self._is_over = True


class _Body:
    """The body of a request as it comes."""

    def __init__(self, receive: Receive, rules: Rules, visit: Visit):
        self._receive, self._rules, self._visit = receive, rules, visit
        self._ends = time.monotonic() + rules.patience_s
        self._is_whole = False

    async def receive(self) -> Message:
        """The next part. Raises `Refusal` where there is too much of it, or it takes too long."""
        if self._is_whole:
            return await self._receive()
        try:
            message = await asyncio.wait_for(self._receive(), self._ends - time.monotonic())
        except TimeoutError:
            detail = f"the body did not come within {self._rules.patience_s:g} s"
            raise self._break(Refusal(408, "slow body", detail)) from None
        if message["type"] == "http.request":
            self._visit.received += len(message.get("body", b""))
            self._is_whole = not message.get("more_body", False)
            if self._visit.received > self._rules.largest_body:
                raise self._break(_too_large(self._rules))
        return message

    def _break(self, refusal: Refusal) -> Refusal:
        """Notes why there is no more of the body: who reads it has an error of its own for that."""
        self._visit.broken = refusal
        return refusal


def problem(status: int, detail: str, request: str, **more: Any) -> dict[str, Any]:
    """The body of an answer that is none, as RFC 9457 has it."""
    return {"status": status, "detail": detail, "request": request, **more}


def _too_large(rules: Rules) -> Refusal:
    most = rules.largest_body / 1e6
    return Refusal(413, "large body", f"the body is larger than the {most:g} MB that this server reads")
