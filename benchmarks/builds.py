# SPDX-License-Identifier: BSD-3-Clause
"""Release builds of a commit and of the current sources, which take turns in a benchmark."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

from benchmarks.machine import ROOT


def build(sources: Path) -> str:
    """PYTHONPATH of the package built from a source tree, and of the benchmarks there. Packages
    that only an older commit needs must be installed (f90nml)."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    for words in (["setup", "build"], ["compile", "-C", "build"]):
        done = subprocess.run(
            ["meson", *words], cwd=sources, env=os.environ | {"PATH": path}, capture_output=True
        )
        if done.returncode:
            sys.exit(f"meson {' '.join(words)} failed:\n{done.stdout.decode()}")
    package = sources / "python/rockfall"
    for extension in sources.glob(f"build/**/*{sysconfig.get_config_var('EXT_SUFFIX')}"):
        (package / extension.name).symlink_to(extension)
    about = sources / "python/rockfall-1.0.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: rockfall\nVersion: 1.0.0\n")
    return os.pathsep.join(map(str, (package.parent, sources)))


def extracted(commit: str, folder: Path) -> Path:
    """Extract the files of a commit to `folder`; without a commit, the tracked files as they are
    now. Return the folder."""
    folder.mkdir()
    if commit:
        pack = ["git", "archive", commit]
    else:
        pack = ["sh", "-c", "git ls-files -z | tar c --null --files-from -"]
    packed = subprocess.run(pack, cwd=ROOT, capture_output=True, check=True)
    subprocess.run(["tar", "x"], cwd=folder, input=packed.stdout, check=True)
    return folder


def pythons_of(commits: list[str], others: list[str], folder: Path) -> list[str]:
    """Python programs with rockfall: `others`, builds of `commits`, and last the current sources,
    also built if there are commits (two minutes of CPU each)."""
    made = []
    for name in [*commits, "here"] if commits else []:
        path = build(extracted("" if name == "here" else name, folder / f"built_{name}"))
        made.append(folder / f"python_{name}")
        made[-1].write_text(f'#!/bin/sh\nPYTHONPATH={path} exec {sys.executable} -P "$@"\n')
        made[-1].chmod(0o755)
    return [*others, *(map(str, made) if made else [sys.executable])]
