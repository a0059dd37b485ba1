# SPDX-License-Identifier: BSD-3-Clause
"""Make dist/rockfall_qgis.zip: the plugin as QGIS installs it, with the version of meson.build."""

import re
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
PLUGIN = ROOT / "python/rockfall_qgis"


def write_zip(path):
    """Write the plugin's files and the licence; return the path."""
    version = re.search(r"version: '([^']+)'", (ROOT / "meson.build").read_text("utf-8"))[1]
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for one in sorted(PLUGIN.glob("*.py")):
            file.write(one, f"{PLUGIN.name}/{one.name}")
        metadata = (PLUGIN / "metadata.txt").read_text("utf-8")
        metadata = re.sub("(?m)^version=.*", f"version={version}", metadata)
        file.writestr(f"{PLUGIN.name}/metadata.txt", metadata)
        file.write(ROOT / "LICENSE", f"{PLUGIN.name}/LICENSE")
    return path


if __name__ == "__main__":
    print(write_zip(Path(*sys.argv[1:2]) if sys.argv[1:] else ROOT / "dist/rockfall_qgis.zip"))
