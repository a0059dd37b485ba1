# SPDX-License-Identifier: BSD-3-Clause
"""Sources of Debian packages."""

import subprocess
from pathlib import Path


def fetch(place: Path, *packages: str) -> None:
    """Download Debian source packages from the repositories configured for binary packages."""
    folder = place / "apt"
    for part in ("lists/partial", "sources"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    for path in Path("/etc/apt/sources.list.d").glob("*.sources"):
        text = path.read_text().replace("Types: deb\n", "Types: deb-src\n")
        (folder / "sources" / path.name).write_text(text)
    options = [
        f"-oDir::State::Lists={folder}/lists", f"-oDir::Etc::SourceParts={folder}/sources",
        "-oDir::Etc::SourceList=/dev/null", f"-oDir::Cache={folder}", "-oAPT::Sandbox::User=",
    ]  # fmt: skip
    subprocess.run(["apt-get", "-qq", *options, "update"], check=True)
    download = "source", "--download-only", "--tar-only", *packages
    subprocess.run(["apt-get", "-qq", *options, *download], cwd=place, check=True)
