# SPDX-License-Identifier: BSD-3-Clause
"""Cases of other programs."""

from __future__ import annotations

import argparse

from rockfall.cli.messages import DONE
from rockfall.rockyfor3d.imported import CASE, import_rockyfor3d


def import_rockyfor3d_command(arguments: argparse.Namespace) -> int:
    notes = import_rockyfor3d(arguments.dir, arguments.output, crs=arguments.crs)
    print("not taken over, or not as there:", *(f"  {note}" for note in notes), sep="\n")
    print(arguments.output / CASE)
    return DONE
