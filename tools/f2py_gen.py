# SPDX-License-Identifier: BSD-3-Clause
"""Run f2py for meson, and fail if f2py only prints a warning: a guessed type would give wrong
numbers."""

import re
import subprocess
import sys
from pathlib import Path

DOUBT = re.compile(r"is mapped to C|could not crack|could not parse|ignoring", re.IGNORECASE)


def main(module: str, folder: str, *sources: str) -> int:
    """Write the C and Fortran wrappers of `sources` to `folder`; return the exit status."""
    f2py = [sys.executable, "-m", "numpy.f2py", "--lower"]
    done = subprocess.run(
        [*f2py, *sources, "-m", module, "--build-dir", folder],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    doubts = [line for line in done.stdout.splitlines() if DOUBT.search(line)]
    if done.returncode or doubts:
        print("f2py:", *(doubts or [done.stdout]), sep="\n", file=sys.stderr)
        return 1
    define_bytes(Path(folder) / f"{module}module.c")
    return 0


def define_bytes(wrapper: Path) -> None:
    """Define signed_char, f2py's C type for int8 arrays, if the wrapper lacks it."""
    text, define = wrapper.read_text(), "typedef signed char signed_char;"
    if "signed_char" in text and define not in text:
        wrapper.write_text(f"{define}\n{text}")


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
