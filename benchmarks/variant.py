# SPDX-License-Identifier: BSD-3-Clause
"""Build of the kernel with changed sources, in a separate folder."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from benchmarks.machine import ROOT


def copy_sources(folder: Path) -> None:
    """Copy all files of a build, in order to change them."""
    for name in ("fortran", "python", "tools", "benchmarks"):
        shutil.copytree(ROOT / name, folder / name)
    for name in ("meson.build", "meson.options", "LICENSE"):
        shutil.copy(ROOT / name, folder)


def replace(file: Path, old: str, new: str, times: int = 1) -> None:
    """Replace a text in a source file; stop unless it occurs `times` times."""
    text = file.read_text()
    if text.count(old) != times:
        sys.exit(f"{file.name}: '{old}' should be there {times} times; mend the benchmark")
    file.write_text(text.replace(old, new))


def go_one_by_one(folder: Path) -> None:
    """Switch lanes off, because their flights do not call `fly`."""
    lanes = "integer :: lanes = "
    scene = folder / "fortran/src/trace/scene_type.f90"
    replace(scene, f"{lanes}masked_lanes", f"{lanes}one_by_one")


def build(folder: Path, *targets: str) -> list[Path]:
    """Build the changed sources with the product's flags; return the programs."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    setup = ["meson", "setup", "-Dpython=false", "-Dbuildtype=release", "build"]
    for command in (setup, ["ninja", "-C", "build", "--quiet", *targets]):
        done = subprocess.run(
            command, cwd=folder, env=os.environ | {"PATH": path}, capture_output=True, text=True
        )
        if done.returncode:
            sys.exit(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")
    return [folder / "build" / target for target in targets]
