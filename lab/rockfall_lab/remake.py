# SPDX-License-Identifier: BSD-3-Clause
"""Reproduction of impact sets and tables from the provenance in their files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

from rockfall.errors import RockfallError
from rockfall.grounds.impact_tables import ImpactTable, open_table
from rockfall.io.files import read_text
from rockfall_lab.blocks.case import block_case_of
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.case import LabCase, lab_case_of, names_ground
from rockfall_lab.sets.contacts import Contacts, contacts_behind, contacts_provenance, fit_contacts
from rockfall_lab.sets.fit import fit_impacts
from rockfall_lab.sets.setfile import origin, provenance, write_sets
from rockfall_lab.spheres.experiment import run_impacts
from rockfall_lab.spheres.sequences import rebounds_of, run_sequences, sequences_provenance
from rockfall_lab.tables import KEPT, cases_of, table_of

if TYPE_CHECKING:
    import xarray as xr


def remake(
    paths: Iterable[str | Path], threads: int = 0, progress: bool = False
) -> Iterator[tuple[Path, str, str]]:
    """Reproduce each set file or table. Yield its path, its origin if that is not a laboratory
    case, and the first line that differs ("its numbers" for a table), or ""."""
    for path, source in {Path(path): _source(Path(path)) for path in paths}.items():
        if isinstance(source, ImpactTable):
            same = _is_made_again(path, source, threads, progress)
            yield path, "", "" if same else "its numbers"
            continue
        if isinstance(source, Contacts):
            # ratios without contacts are taken from the existing file
            sets, attrs = fit_contacts(source, nearest=True), contacts_provenance(source)
            name = f"the measured contacts in {source.name}"
        elif source[0].throws:
            data = run_sequences(source[0], progress=progress, threads=threads)
            contacts = rebounds_of(data, path.name)
            sets, attrs = fit_contacts(contacts, nearest=True), sequences_provenance(data, contacts)
            name = ""
        else:
            case, state = source
            data = run_impacts(case, progress=progress, threads=threads)
            sets, attrs, name = fit_impacts(data, state), provenance(data, state), ""
        with tempfile.TemporaryDirectory() as folder:
            again = Path(folder) / path.name
            write_sets(again, sets, attrs)
            yield path, name, _first_difference(path.read_text("utf-8"), again.read_text("utf-8"))


def _is_made_again(path: Path, table: ImpactTable, threads: int, progress: bool) -> bool:
    """Return True if a table is reproduced bit for bit."""
    kept = int(table.attrs.get("kept", KEPT))
    again = table_of(list(_contacts(path, table, threads, progress)), kept)
    return again.equals(table)


def _contacts(path: Path, table: ImpactTable, threads: int, progress: bool) -> Iterator[xr.Dataset]:
    """Yield the laboratory contacts of each case behind a table, simulated again. Raises a
    RockfallError for a table without cases."""
    texts = cases_of(table.attrs)
    if not texts:
        raise RockfallError(f"{path}: does not say which case of the laboratory made it")
    for text in texts:
        if names_ground(text, str(path)):
            yield run_throws(block_case_of(text, str(path)), progress=progress, threads=threads)
        else:
            yield run_sequences(lab_case_of(text, str(path)), progress=progress, threads=threads)


def _source(path: Path) -> Contacts | ImpactTable | tuple[LabCase, str]:
    if path.suffix == ".nc":
        return open_table(path)
    return contacts_behind(path, read_text(path)) or origin(path)


def _first_difference(old: str, new: str) -> str:
    lines = zip_longest(old.splitlines(), new.splitlines(), fillvalue="(end)")
    for number, (before, after) in enumerate(lines, 1):
        if before != after:
            return f"line {number}: {before!r} is now {after!r}"
    return ""
