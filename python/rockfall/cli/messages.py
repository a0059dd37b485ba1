# SPDX-License-Identifier: BSD-3-Clause
"""Messages of a command on stderr, and its exit status."""

import sys
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rockfall.errors import BAD_INPUT, OUR_FAULT

# For interrupts see `rockfall.interrupts.exit_status`.
DONE, FAULT, REFUSED = 0, OUR_FAULT, BAD_INPUT
OF_PRODUCTS = (
    r"rockfall\.(products|dossiers|cli\.|files\.|result\.)"  # commands print their warnings
)
MOST_FILES, FEW_OF_A_KIND = 8, 4  # files listed individually: in total, and of a kind


def say(line: str, status: int) -> int:
    """Print a text as a line to stderr, and return the exit status."""
    print("rockfall:", " ".join(line.splitlines()), file=sys.stderr)
    return status


def warn(text: str) -> None:
    """Print a warning as a line to stderr."""
    print(f"rockfall: warning: {text}", file=sys.stderr)


def warn_each(texts: Iterable[str]) -> None:
    """Print warnings, one per line."""
    for text in texts:
        warn(text)


@contextmanager
def warnings_told() -> Iterator[list[str]]:
    """Collect warnings of products (not of libraries) within the block; print each once after it.
    Yields a list that then contains the warnings."""
    told: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")  # library warnings
        warnings.filterwarnings("always", module=OF_PRODUCTS)
        yield told
    told += dict.fromkeys(str(warning.message) for warning in caught)
    warn_each(told)


def print_files(paths: Sequence[Path]) -> None:
    """Print the files that a command wrote, one per line, or grouped by kind if there are many."""
    if len(paths) <= MOST_FILES or len({path.parent for path in paths}) > 1:
        print(*paths, sep="\n")
        return
    kinds = Counter(path.suffix for path in paths)
    few = [path.name for path in paths if kinds[path.suffix] <= FEW_OF_A_KIND]
    many = [f"{n} {kind}" for kind, n in kinds.items() if n > FEW_OF_A_KIND]
    print(f"{paths[0].parent}: {', '.join([*few, *many])}")
