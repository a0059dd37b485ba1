# SPDX-License-Identifier: BSD-3-Clause
"""Tables for every site and every rebound model, each written to a file in a folder.

    python -m benchmarks.physics.sites -o FOLDER [--only PIECE ...] [--data FOLDER]
        [--slopes N] [--boulders N] [--law NAME=TABLE ...] [--ground ROW ...]

Models are the given models, or all shipped impact sets, impact tables and grounds. Takes about
half an hour on one core. A piece is complete if its file begins with the same command, so another
call resumes after the last complete piece. Without --data, sites with field data are omitted.
"""

import argparse
import importlib
import shlex
import sys
import warnings
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import NamedTuple

from benchmarks.physics.laws import ground, table
from rockfall.grounds import ABSORBS, YIELDING, shipped_rows, table_names
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.io.atomic import atomic_write

PRINTED = "bourrier2009", "vaujany-observed"  # sets that `observed` always includes
HALVES = "calibration", "held-out"  # halves of Tschamut


class Piece(NamedTuple):
    """Tables printed by a script."""

    name: str  # name of the file with the tables
    script: str  # a module of benchmarks.physics
    words: tuple[str, ...]

    @property
    def command(self) -> str:
        return f"python -m benchmarks.physics.{self.script} {shlex.join(self.words)}"


def pieces(given: argparse.Namespace) -> Iterator[Piece]:
    """All pieces, the quick ones first."""
    laws = tuple(given.laws or shipped_laws())
    slopes = ("--slopes", str(given.slopes)) if given.slopes else ()
    boulders = ("--boulders", str(given.boulders)) if given.boulders else ()
    sets = [name for name in shipped_sets() if not name.endswith(("-ensemble", *PRINTED))]
    own = tuple(word for name in sets for word in ("--sets", name))
    yield Piece("shadow", "shadow", ("--plain", *table_names(), *boulders))
    yield Piece("runaway", "runaway", laws + boulders)
    yield Piece("pairs-talus", "pairs", ("talus", *slopes))
    yield Piece("vaujany-observed", "observed", laws + own + slopes + boulders)
    yield Piece("field-vaujany", "field", ("--site", "vaujany", *laws, *slopes, *boulders))
    if given.data is None:
        return
    data = str(given.data)
    yield Piece("pairs-meadow", "pairs", ("meadow", "--data", data))
    for half in HALVES:
        words = "--half", half, *laws, *boulders
        yield Piece(f"tschamut-{half}", "tschamut", (data, *words))
        words = "--site", "tschamut", "--data", data, *words
        yield Piece(f"field-tschamut-{half}", "field", words)
    for site in "impacts", "mel-de-la-niva":
        words = "--site", site, "--data", data, *laws, *boulders
        yield Piece(f"field-{site}", "field", words)


def shipped_laws() -> Iterator[str]:
    """Options for each shipped impact table and each ground with coefficients of restitution."""
    for name in table_names():
        yield from ("--law", name)
    for name, row in shipped_rows().rows.items():
        if row.cells["model"] not in (ABSORBS, *YIELDING):
            yield from ("--ground", name)


def remake(piece: Piece, folder: Path) -> bool:
    """Write the tables of a piece; return False if the file exists, from the same command."""
    path, head = folder / f"{piece.name}.md", f"    {piece.command}\n"
    if path.exists() and path.read_text(encoding="utf-8").startswith(head):
        return False
    printed = StringIO()
    with redirect_stdout(printed), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings about the models that are compared
        status = importlib.import_module(f"benchmarks.physics.{piece.script}").main(piece.words)
    if status:
        sys.exit(status)
    with atomic_write(path) as part:
        part.write_text(f"{head}\n{printed.getvalue()}", encoding="utf-8")
    return True


class _Kept(argparse.Action):
    """Store the words of a model option once its value is valid."""

    def __call__(self, parser, namespace, values, option=None):
        (ground if option == "--ground" else table)(values)
        namespace.laws = [*(namespace.laws or []), option, values]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--only", nargs="+", metavar="PIECE")
    parser.add_argument("--data", type=Path, help="folder of field data (benchmarks/field_data.py)")
    parser.add_argument("--slopes", type=int, help="of Vaujany")
    parser.add_argument("--boulders", type=int)
    for option in "--law", "--ground":
        parser.add_argument(option, action=_Kept, dest="laws", help="as in benchmarks.physics.laws")
    given = parser.parse_args()
    every = list(pieces(given))
    names = [piece.name for piece in every]
    if unknown := {*(given.only or names)} - {*names}:
        parser.error(f"--only {' '.join(sorted(unknown))}: must be {', '.join(names)}")
    given.output.mkdir(parents=True, exist_ok=True)
    for piece in every:
        if piece.name in (given.only or names):
            print(f"{piece.name}: {piece.command}", flush=True)
            print("  made" if remake(piece, given.output) else "  done before", flush=True)


if __name__ == "__main__":
    main()
