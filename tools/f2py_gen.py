# SPDX-License-Identifier: BSD-3-Clause
"""Run f2py for meson, and fail on what f2py only prints: a guessed type is a wrong number."""

import re
import subprocess
import sys

DOUBT = re.compile(r"is mapped to C|could not crack|could not parse|ignoring", re.IGNORECASE)


def main(source: str, module: str, folder: str) -> int:
    """Write the C and Fortran wrappers of `source` to `folder`; return the exit status."""
    f2py = [sys.executable, "-m", "numpy.f2py", "--lower"]
    done = subprocess.run(
        [*f2py, source, "-m", module, "--build-dir", folder],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    doubts = [line for line in done.stdout.splitlines() if DOUBT.search(line)]
    if done.returncode or doubts:
        print("f2py:", *(doubts or [done.stdout]), sep="\n", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
