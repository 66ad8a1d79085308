"""A connection to a rosbridge, protocol 2, that comes back: here alone this part imports websockets.

roslibpy 2.1 cannot offer actions ("not yet implemented"), waits up to an hour before it connects again, and
its default transport runs once in a process. What is needed of the protocol fits in a page.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from neugrasp.data.strict_json import parse_json
from neugrasp.errors import InputError, require

log = logging.getLogger(__name__)

FIRST_S, LONGEST_S = 0.5, 10.0
"""Seconds before a connection is tried again, doubled each time up to the second."""
LARGEST = 64 * 2**20
"""Bytes of a message: a raw photo of 12 megapixels in base64 has 48 MB."""
Message = dict[str, Any]
Handler = Callable[[Message], Awaitable[None]]


class Bridge:
    """Sends operations, and hands those that come to their handlers."""

    def __init__(self, url: str, greeting: list[Message], handlers: Mapping[str, Handler]):
        """`greeting` is said at every connection: what is offered, and listened to."""
        self._url, self._greeting, self._handlers = url, greeting, handlers
        self._connection: Any = None
        self._running: set[asyncio.Task[None]] = set()
        self.connections = 0
        """How often it connected."""

    async def run(self) -> None:
        """Until it is cancelled: connects, and connects again."""
        client = require("websockets.asyncio.client", extra="ros")
        failed = (OSError, TimeoutError, require("websockets.exceptions", extra="ros").WebSocketException)
        wait = FIRST_S
        while True:
            try:
                async with client.connect(self._url, max_size=LARGEST, proxy=None) as connection:
                    self._connection, wait = connection, FIRST_S
                    self.connections += 1
                    for message in self._greeting:
                        await connection.send(json.dumps(message))
                    log.info("connected to %s", self._url)
                    async for text in connection:
                        self._take(text)
                log.warning("%s closed the connection", self._url)
            except failed as error:
                log.warning("%s: %s; again in %.1f s", self._url, error or type(error).__name__, wait)
            finally:
                self._connection = None
            await asyncio.sleep(wait)
            wait = min(LONGEST_S, 2 * wait)

    async def send(self, message: Message) -> None:
        """Says something, if somebody listens: who asked over a connection that is gone asks again."""
        if self._connection is not None:
            await self._connection.send(json.dumps(message, allow_nan=False))

    def _take(self, text: str | bytes) -> None:
        try:
            message = parse_json(text, "a message", judges_values=False)
            handler = self._handlers.get(message["op"])
        except (InputError, KeyError, TypeError) as error:
            log.warning("%s: a message that is none (%s)", self._url, error)
            return
        if handler is not None:
            task = asyncio.ensure_future(self._guarded(handler, message))
            self._running.add(task)
            task.add_done_callback(self._running.discard)

    async def _guarded(self, handler: Handler, message: Message) -> None:
        """A message that cannot be used is told of, and the next one is taken."""
        try:
            await handler(message)
        except InputError as error:
            log.warning("%s", error)
        except Exception as error:
            log.error("a message could not be answered", exc_info=error)
