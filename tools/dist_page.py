#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Add the bundled page of `rockfall app`, which git does not store, to a source distribution."""

import os
import shutil
import sys
from pathlib import Path

PAGE = Path("python/rockfall/app/page")


def main() -> str | None:
    source, target = (Path(os.environ[f"MESON_{one}_ROOT"]) / PAGE for one in ("SOURCE", "DIST"))
    if not (source / "app.js").exists():
        return f"{PAGE}/app.js is missing: ./run page"
    shutil.copytree(source, target)
    return None


if __name__ == "__main__":
    sys.exit(main())
