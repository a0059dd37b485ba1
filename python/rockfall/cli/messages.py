# SPDX-License-Identifier: BSD-3-Clause
"""Messages of a command on stderr, and its exit status."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from rockfall.errors import BAD_INPUT, OUR_FAULT

# for interrupts see `rockfall.interrupts.exit_status`
DONE, FAULT, REFUSED = 0, OUR_FAULT, BAD_INPUT


def say(line: str, status: int) -> int:
    """Print a text as one line to stderr, and return the exit status."""
    print("rockfall:", " ".join(line.splitlines()), file=sys.stderr)
    return status


def warn(text: str) -> None:
    """Print a warning as one line to stderr."""
    print(f"rockfall: warning: {text}", file=sys.stderr)


def warn_each(texts: Iterable[str]) -> None:
    """Print warnings, one a line."""
    for text in texts:
        warn(text)


@contextmanager
def warnings_told() -> Iterator[list[str]]:
    """Print the warnings of products within the block, each once, and none of libraries. Yields a
    list that has them afterwards."""
    told: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")  # from libraries
        ours = r"rockfall\.(products|result\.export|result\.motion)"
        warnings.filterwarnings("always", module=ours)
        yield told
    told += dict.fromkeys(str(warning.message) for warning in caught)
    warn_each(told)
