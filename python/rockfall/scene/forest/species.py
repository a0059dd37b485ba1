# SPDX-License-Identifier: BSD-3-Clause
"""Toughness of stems by species, relative to silver fir: a table that users may edit."""

import importlib.resources
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io.tables import check_needed, read_table
from rockfall.scene.forest.attributes import plain_name
from rockfall.scene.layers import Inputs, file_checksum

CONIFER, BROADLEAF = "conifer", "broadleaf"  # used if only the fraction of conifers is known
MAX_FACTOR = 100.0
_SHIPPED = Path(str(importlib.resources.files("rockfall") / "data" / "species.csv"))


class Species:
    """Toughness factors by name of a species or genus (`spruce`, `Picea abies`, `Fichte`),
    ignoring case and accents."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.factors: dict[str, float] = {}  # keys: plain names
        self._shown: list[str] = []  # names used in messages
        where, columns, rows = read_table(path)
        check_needed(where, columns, ("species", "factor"))
        for row in rows:
            factor = row.number("factor", 0.0, MAX_FACTOR)
            if not factor > 0:
                row.refuse("factor", "must be > 0")
            names = [row.text("species").lower(), row.cells.get("genus", "").lower()]
            self._shown += [name for name in dict.fromkeys(names) if name]
            names += row.cells.get("other_names", "").split(";")
            for name in {plain_name(name) for name in names} - {""}:
                if name in self.factors:
                    raise RockfallError(f"{row.where}: {name}: occurs twice in the table")
                self.factors[name] = factor
        for name in (CONIFER, BROADLEAF):
            if name not in self.factors:
                raise RockfallError(f"{path}: no row for the species {name}")

    def factor(self, name: str, where: str) -> float:
        """Toughness factor of a species, from its name in a list; refuses unknown names."""
        words = plain_name(name).split("_")
        for key in ("_".join(words), words[0]):
            if key in self.factors:
                return self.factors[key]
        names = ", ".join(self._shown)
        raise RockfallError(f"{where}: species = {name}: is not in {self.path} (species: {names})")


def read_species(inputs: Inputs) -> Species:
    """Read the species table of a case, or else the default table."""
    named = inputs.case.forest.get("species_table")
    path = _SHIPPED if named is None else inputs.case.path(named)
    inputs.checksums["species_table"] = file_checksum(path)
    return Species(path)
