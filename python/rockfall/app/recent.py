# SPDX-License-Identifier: BSD-3-Clause
"""Recently opened files, in the user's state folder."""

import json
import os
from contextlib import suppress
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io.atomic import atomic_write

MOST = 10


def recent_files() -> list[Path]:
    """Recently opened files that still exist, latest first."""
    try:
        content = json.loads(_file().read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return []
    names = content if isinstance(content, list) else []
    return [Path(name) for name in names if isinstance(name, str) and os.path.isfile(name)][:MOST]


def note_recent(path: Path) -> None:
    """Move a file to the top of the list, if the list is writable."""
    path = path.absolute()
    files = [path, *(file for file in recent_files() if file != path)][:MOST]
    with suppress(OSError, RockfallError):
        _file().parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(_file()) as part:
            part.write_text(json.dumps([str(file) for file in files]), encoding="utf-8")


def _file() -> Path:
    home = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    return Path(home) / "rockfall" / "recent.json"
