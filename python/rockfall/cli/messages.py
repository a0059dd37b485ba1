# SPDX-License-Identifier: BSD-3-Clause
"""What a command says on stderr, and its exit status."""

from __future__ import annotations

import sys

DONE, FAULT, REFUSED = 0, 1, 2  # `rockfall.interrupts.exit_status` has the interrupted


def say(line: str, status: int) -> int:
    """One line, whatever the text, and the status to end with."""
    print("rockfall:", " ".join(line.splitlines()), file=sys.stderr)
    return status


def warn(text: str) -> None:
    """Print a warning as one line to stderr."""
    print(f"rockfall: warning: {text}", file=sys.stderr)
