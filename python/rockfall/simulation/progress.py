# SPDX-License-Identifier: BSD-3-Clause
"""A progress bar on a terminal: fraction done, rate, time left; or lines for another program."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(total: int, shown: bool, what: str = "boulders") -> Iterator[Callable[..., None]]:
    """Yield a function that advances a progress bar by a count, and may change the total.

    Silent unless stderr is a terminal, or ROCKFALL_PROGRESS=lines requests lines.
    """
    if shown and os.environ.get("ROCKFALL_PROGRESS") == "lines":
        yield _lines(total, what)
        return
    if not (shown and sys.stderr.isatty()):
        yield lambda *_: None
        return
    from rich import progress
    from rich.console import Console

    columns = (
        what, progress.BarColumn(), progress.MofNCompleteColumn(), "{task.fields[rate]}",
        progress.TimeRemainingColumn(compact=True), "left",
    )  # fmt: skip
    with progress.Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=total, rate="")

        def advance(done: int, total: int | None = None) -> None:
            speed = bar.tasks[task].speed
            bar.update(task, advance=done, total=total, rate=f"{speed:,.0f}/s" if speed else "")

        yield advance


def _lines(total: int, what: str) -> Callable[..., None]:
    """Function that reports progress as lines on stderr, for a program that displays it."""
    made = 0

    def advance(done: int, new_total: int | None = None) -> None:
        nonlocal made, total
        made, total = made + done, total if new_total is None else new_total
        print(f"rockfall: {made} of {total} {what}", file=sys.stderr, flush=True)

    return advance
