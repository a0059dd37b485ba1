# SPDX-License-Identifier: BSD-3-Clause
"""Ctrl-C, SIGTERM (which batch systems send at a time limit), and stop requests from other threads,
without loss of work."""

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import FrameType

from rockfall.system import STOPS, signal_channel

#: Signals within this time [s] count as one: `timeout` signals both a process and its group.
TOGETHER = 0.1

_is_stopped: ContextVar[Callable[[], bool]] = ContextVar("is_stopped", default=lambda: False)
_number: int = signal.SIGINT  # signal received last
_hit: threading.Event | None = None  # event that a signal within `interrupts` sets; None outside


def exit_status() -> int:
    """Exit status after a signal, as in shells: 130 for Ctrl-C, 143 for SIGTERM."""
    return 128 + _number


@contextmanager
def interrupts() -> Iterator[Callable[[], bool]]:
    """Defer the first Ctrl-C or SIGTERM within the block; the yielded function then returns True.
    A second signal ends the process at once, even while the kernel runs. Nested blocks act as a
    single block; in another thread, the function also returns True after a stop request
    (`stopped_by`)."""
    global _hit
    if threading.current_thread() is not threading.main_thread() or _hit is not None:
        signalled, stopped = (_hit or threading.Event()).is_set, _is_stopped.get()
        yield lambda: signalled() or stopped()
        return
    hit = _hit = threading.Event()

    def note(number: int, _: FrameType | None) -> None:
        global _number
        _number = number
        hit.set()

    # Python's own handlers wait for the kernel to return; this channel works immediately.
    reader, writer = signal_channel()
    threading.Thread(target=_end_at_second, args=(reader,), daemon=True).start()
    woken = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    before = {number: signal.signal(number, note) for number in STOPS}
    try:
        yield hit.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(woken)
        writer.close()
        _hit = None


def _end_at_second(reader: socket.socket) -> None:
    """Read signal numbers from a channel until it is closed, and exit at the second signal, if it
    comes more than TOGETHER after the first."""
    first = None
    while numbers := reader.recv(64):
        stops = [number for number in numbers if number in STOPS]
        if not stops:
            continue
        if first is None:
            first = time.monotonic()
        elif time.monotonic() - first > TOGETHER:
            os._exit(128 + stops[-1])
    reader.close()


@contextmanager
def stoppable() -> Iterator[None]:
    """Raise KeyboardInterrupt on SIGTERM within the block, as on Ctrl-C, so that partial files are
    removed. Signals within TOGETHER count as one."""
    global _number
    _number, last = signal.SIGINT, -TOGETHER
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, _: FrameType | None) -> None:
        nonlocal last
        global _number
        now = time.monotonic()
        if now - last > TOGETHER:
            _number, last = number, now
            raise KeyboardInterrupt

    heard = [number for number in STOPS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, stop) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Stopped(Exception):
    """Exception raised when a request stops the work; see `stopped_by`."""


@contextmanager
def stopped_by(is_wanted: Callable[[], bool]) -> Iterator[None]:
    """Within the block, make `check_stop` raise Stopped once `is_wanted` returns True; runs in
    this thread then end as on Ctrl-C."""
    token = _is_stopped.set(is_wanted)
    try:
        yield
    finally:
        _is_stopped.reset(token)


def check_stop() -> None:
    """Raise Stopped if a stop was requested."""
    if _is_stopped.get()():
        raise Stopped
