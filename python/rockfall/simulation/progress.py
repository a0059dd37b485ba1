# SPDX-License-Identifier: BSD-3-Clause
"""Progress of work: on a terminal, a bar with completed fraction, rate and time left; otherwise a
line every ten seconds, or lines for another program.
"""

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

from rockfall.interrupts import check_stop

Item = TypeVar("Item")

BETWEEN = 10.0  # seconds between lines if stderr is not a terminal
PATIENCE = 2.0  # seconds before the bar appears


@contextmanager
def progress_bar(
    total: int, shown: bool, what: str = "boulders", patience: float = 0.0
) -> Iterator[Callable[..., None]]:
    """Yield a function that advances a progress bar by a count and can change the total.

    The bar appears after `patience` seconds. If stderr is not a terminal, a line is printed every
    ten seconds; ROCKFALL_PROGRESS=lines gives a line for each call, =none no output.
    """
    wanted = os.environ.get("ROCKFALL_PROGRESS")
    if not shown or wanted == "none":
        yield lambda *_: None
    elif wanted == "lines":
        yield _lines(total, what)
    elif not sys.stderr.isatty():
        yield _seldom(total, what)
    else:
        with _bar(total, what, patience) as advance:
            yield advance


@contextmanager
def _bar(total: int, what: str, patience: float) -> Iterator[Callable[..., None]]:
    """Show a progress bar on a terminal."""
    from rich import progress
    from rich.console import Console

    columns = (
        what, progress.BarColumn(), progress.MofNCompleteColumn(), "{task.fields[rate]}",
        progress.TimeRemainingColumn(compact=True), "left",
    )  # fmt: skip
    bar = progress.Progress(*columns, console=Console(stderr=True))
    task = bar.add_task("", total=total, rate="")
    begun = time.monotonic()

    def advance(done: int, total: int | None = None) -> None:
        speed = bar.tasks[task].speed
        bar.update(task, advance=done, total=total, rate=f"{speed:,.0f}/s" if speed else "")
        if time.monotonic() - begun > patience:
            bar.start()

    try:
        if not patience:
            bar.start()
        yield advance
    finally:
        bar.stop()


def _lines(total: int, what: str) -> Callable[..., None]:
    """Function that reports progress as lines on stderr, for a program that displays it."""
    made = 0

    def advance(done: int, new_total: int | None = None) -> None:
        nonlocal made, total
        made, total = made + done, total if new_total is None else new_total
        print(f"rockfall: {made} of {total} {what}", file=sys.stderr, flush=True)

    return advance


def _seldom(total: int, what: str) -> Callable[..., None]:
    """Function that logs progress and the time left every ten seconds."""
    made, begun = 0, time.monotonic()
    last = begun

    def advance(done: int, new_total: int | None = None) -> None:
        nonlocal made, total, last
        made, total = made + done, total if new_total is None else new_total
        now = time.monotonic()
        if now - last >= BETWEEN and 0 < made < total:
            last = now
            left = (now - begun) * (total - made) / made
            text = f"rockfall: {made:,} of {total:,} {what}, {left:,.0f} s left"
            print(text, file=sys.stderr, flush=True)

    return advance


class _Work:
    """Progress shared by several functions."""

    def __init__(self, advance: Callable[..., None]) -> None:
        self.advance, self.made, self.total = advance, 0, 0

    def add(self, steps: int) -> None:
        self.total += steps
        self.advance(0, self.total)

    def step(self) -> None:
        self.made += 1
        self.total = max(self.made, self.total)
        self.advance(1, self.total)


_work: ContextVar[_Work | None] = ContextVar("work", default=None)


@contextmanager
def working(shown: bool = True) -> Iterator[None]:
    """Show progress within the block; `add_steps` adds steps of work."""
    with progress_bar(0, shown, "steps", PATIENCE) as advance:
        token = _work.set(_Work(advance))
        try:
            yield
        finally:
            _work.reset(token)


def add_steps(steps: int) -> None:
    """Add steps of work, such as lines or figures, to the total of `working`."""
    if work := _work.get():
        work.add(steps)


def step(*_: Any) -> None:
    """Count a completed step; raises Stopped if a stop was requested."""
    check_stop()
    if work := _work.get():
        work.step()


def stepped(items: Iterable[Item]) -> Iterator[Item]:
    """Yield items, counting each as a step of work."""
    for item in items:
        yield item
        step()
