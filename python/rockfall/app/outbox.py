# SPDX-License-Identifier: BSD-3-Clause
"""Queue of messages for a page: a slow page gets the latest results instead of a backlog."""

import asyncio
from collections import deque
from collections.abc import Callable
from pathlib import Path

from rockfall.app.messages import Message
from rockfall.language import LANGUAGES

#: Kinds of waiting messages that a new message replaces, by its kind.
REPLACED = {
    "batch": ("batch", "lines"),
    "state": ("state", "batch", "lines", "trajectories", "section", "net", "hazard", "origins"),
    "section": ("section",), "net": ("net",), "hazard": ("hazard", "origins"),
    "origins": ("origins",),
    "trajectories": ("trajectories",), "terrain": ("terrain",), "progress": ("progress",),
    "background": ("background",), "objects": ("objects",), "basemap": ("basemap",),
    "document": ("document",), "variant batch": ("variant batch",), "unfinished": ("unfinished",),
}  # fmt: skip


class Client:
    """A page, and the queue of its messages."""

    def __init__(self, send: Callable[[str, Message], None]) -> None:
        self.send, self.language = send, LANGUAGES[0]
        self.recent: list[Path] = []  # recent files listed on this page


class Outbox:
    """A queue that any thread can fill and an event loop empties."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop, self._waiting = loop, deque[tuple[str, Message]]()
        self._filled = asyncio.Event()

    def put(self, kind: str, message: Message) -> None:
        """Add a message. It replaces the waiting messages of the kinds in `REPLACED`; further
        trajectories of a run (kind "more") replace none."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._put, kind, message)

    def _put(self, kind: str, message: Message) -> None:
        stale = REPLACED.get(kind, ())
        if "trajectories" in stale:
            stale = (*stale, "more")
        self._waiting = deque(entry for entry in self._waiting if entry[0] not in stale)
        self._waiting.append((kind, message))
        self._filled.set()

    async def get(self) -> Message:
        """Wait for the next message and return it."""
        while not self._waiting:
            self._filled.clear()
            await self._filled.wait()
        return self._waiting.popleft()[1]
