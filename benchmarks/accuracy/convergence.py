# SPDX-License-Identifier: BSD-3-Clause
"""What a digit costs: statistical and numerical errors of cases/vaujany against CPU time.

    python -m benchmarks.accuracy.convergence [DIR] [--reference 1000000]

Prints the tables of `rockfall convergence`; with DIR also writes its files and its figure.
"""

import argparse
from pathlib import Path

import rockfall
from benchmarks.machine import ROOT, machine
from rockfall.analysis.convergence import REFERENCE, converge
from rockfall.cli.studies import write_convergence
from rockfall.text.convergence import text

VAUJANY = ROOT / "cases/vaujany/case.nml"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", metavar="DIR", type=Path, nargs="?")
    parser.add_argument("--reference", type=int, default=REFERENCE)
    options = parser.parse_args()
    print(machine(), "\n")
    found = converge(rockfall.read_case(VAUJANY), reference=options.reference, progress=True)
    print(text(found))
    if options.folder:
        write_convergence(found, options.folder)


if __name__ == "__main__":
    main()
