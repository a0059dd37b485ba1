# SPDX-License-Identifier: BSD-3-Clause
"""A live run, and a record of the results sent to the page."""

import time
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import Any

import xarray as xr

from rockfall.app.line_table import LineTable
from rockfall.app.messages import Message, binary_message
from rockfall.app.pictures import MAX_LINES, Ground, View, batch_message, masses, trajectory_message
from rockfall.app.sections import section_message
from rockfall.app.study_messages import net_message
from rockfall.result.trajectories import Terrain
from rockfall.session.batch import Batch

FIRST, SECOND = 0.0, 0.1  # time to the first message, and minimum time between later ones [s]
PATIENCE = 3.0  # [s] kernel time per second spent on statistics and pictures

#: Sends a message of a kind; it replaces waiting messages that it makes obsolete (see `Outbox`).
Send = Callable[[str, Message], None]


class Progress:
    """A run of a session that periodically sends its results."""

    def __init__(
        self, batches: Iterator[Batch], fields: dict[str, Any], view: View, ground: Ground,
        terrain: Terrain, send: Send, language: str, aside: bool = False,
    ) -> None:  # fmt: skip
        self.over, self.told_running = False, True
        self._batches, self._fields, self._view = batches, fields, view
        self._ground, self._terrain, self._send = ground, terrain, send
        self._language = language
        self._every_line = aside  # for a variant: its page shows all lines
        self._table: LineTable | None = None  # table of the last message
        self._sent: set[int] = set()  # boulders whose trajectories were sent
        self._begun = time.perf_counter()
        self._due = self._begun + FIRST  # time of the next message
        self._batch: Batch | None = None
        self._told = 0  # boulders in the last message

    def has_work(self, running: bool) -> bool:
        """Return True if there is work to simulate or to report."""
        return (running and not self.over) or self.told_running != running

    def step(self, running: bool) -> bool:
        """Advance the run and send results, in the end also for lines out of view; return False
        when done."""
        if not running:
            self._tell(running)
            return True
        if self._batch is not None and self._batch.complete and self.told_running:
            return self._tell_further()
        if self._batch is None or not self._batch.complete:
            batch = next(self._batches, None)
            if batch is None:  # cancelled
                return False
            self._batch = batch
        if self._batch.complete or time.perf_counter() >= self._due or not self.told_running:
            self._tell(running)
        return not self._batch.complete or self._has_missing()

    def look(self, view: View) -> None:
        """Set the view; send its trajectories, section, net and lines if they changed."""
        before, self._view = self._view, view
        if self._batch is not None and view.trajectories != before.trajectories:
            self._sent = set()
            self._tell_trajectories(self._batch, self._batch.dataset())
        if self._batch is not None and view.section != before.section:
            self._tell_section(self._batch.dataset())
        if self._batch is not None and view.net != before.net:
            self._tell_net(self._batch.dataset())
        self._tell_lines(view.lines)

    def _tell_section(self, result: xr.Dataset) -> None:
        vertices = self._view.section
        message = section_message(result, vertices, self._terrain, **self._fields)
        self._send("section", message)

    def _tell_net(self, result: xr.Dataset) -> None:
        self._send("net", net_message(result, self._view.net, self._language, **self._fields))

    def _tell(self, running: bool) -> None:
        """Send the results, and schedule the next message so that the kernel gets most of the
        time."""
        self.told_running = running
        batch = self._batch
        if batch is None:
            return
        begun = time.perf_counter()
        result = batch.dataset()
        left = None
        if batch.seconds and batch.boulders:
            left = batch.seconds / batch.boulders * (batch.total - batch.boulders)
        table = self._table = LineTable(result)
        few = self._every_line or len(table.names) <= MAX_LINES
        lines = table.entries(table.names if few else self._view.lines or table.names[:MAX_LINES])
        message = batch_message(
            result, batch.case, self._view.map, self._ground, self._language,
            **self._fields, lines=lines, boulders=batch.boulders, total=batch.total,
            complete=batch.complete, running=running and not batch.complete,
            seconds=batch.seconds, seconds_left=left,
        )  # fmt: skip
        self._send("batch", message)
        self._tell_trajectories(batch, result)
        if self._view.section:
            self._tell_section(result)
        if self._view.net and not self._every_line:
            self._tell_net(result)
        self._told = batch.boulders
        now = time.perf_counter()
        self._due = now + max(SECOND, PATIENCE * (now - begun))

    def _has_missing(self) -> bool:
        return self._table is not None and bool(self._table.missing)

    def _tell_further(self) -> bool:
        """Send statistics of some lines that were out of view; return False if none are left."""
        if self._table is not None:
            self._tell_lines(list(islice(self._table.missing, MAX_LINES)))
        return self._has_missing()

    def _tell_lines(self, names: Sequence[str]) -> None:
        """Send unsent statistics of these lines, for the boulders of the last message."""
        if self._table is not None and (lines := self._table.further(names)):
            fields = {**self._fields, "boulders": self._told, "lines": lines}
            self._send("lines", binary_message("lines", {}, **fields))

    def _tell_trajectories(self, batch: Batch, result: xr.Dataset) -> None:
        number = self._view.trajectories
        new = batch.trajectories(number, skip=self._sent)
        if not new and self._sent:
            return
        append = bool(self._sent)
        self._sent |= {trajectory.boulder for trajectory in new}
        mass = masses(result, [trajectory.boulder for trajectory in new], batch.case)
        message = trajectory_message(new, mass, self._ground, **self._fields, append=append)
        self._send("more" if append else "trajectories", message)
