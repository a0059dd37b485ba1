# SPDX-License-Identifier: BSD-3-Clause
"""Attributes of stands: names in English, German, French and Italian, and limits."""

import re
import unicodedata
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from rockfall.case import keys_of
from rockfall.errors import RockfallError
from rockfall.io.vectors.layers import SHORT, plain
from rockfall.io.vectors.unused_attributes import note_marks, note_unused
from rockfall.scene.forest.trees import MAX_DBH, MAX_DENSITY

NAMES = {  # case key first, then English, German, French, Italian
    "stems": ("stems", "stems_ha", "stems_per_ha", "n_ha", "stammzahl", "stammzahl_ha", "tiges",
              "tiges_ha", "nb_tiges", "fusti", "fusti_ha", "piante_ha"),
    "dbh_mean": ("dbh_mean", "mean_dbh", "dbh", "bhd", "bhd_mittel", "mittl_bhd", "dhp",
                 "dhp_moyen", "dhp_moy", "dpu", "dpu_medio", "diametro_medio"),
    "dbh_std": ("dbh_std", "dbh_sd", "std_dbh", "bhd_std", "bhd_stabw", "dhp_std", "dhp_ecart_type",
                "ecart_type", "dpu_std", "dpu_dev_std", "dev_std"),
    "conifers": ("conifers", "conifer_pct", "conif_percent", "nadelholz", "nadelholzanteil",
                 "nadelanteil", "resineux", "part_resineux", "coniferes", "conifere"),
    "species": ("species", "tree_species", "baumart", "baumarten", "essence", "essences", "espece",
                "specie"),
    "name": ("name", "bezeichnung", "bestand", "nom", "peuplement", "nome", "label"),
    "density_factor": ("density_factor", "remaining", "restanteil", "part_restante",
                       "parte_restante"),
}  # fmt: skip
_CONIFERS = keys_of("forest")["uniform_conifers"]
LIMITS: dict[str, Any] = {  # minimum, maximum, and the rule as text
    "stems": (0.0, MAX_DENSITY, f"0 to {MAX_DENSITY:,.0f} stems per hectare"),
    "dbh_mean": (1e-2, MAX_DBH, f"> 0 and at most {MAX_DBH:g} cm"),
    "dbh_std": (0.0, MAX_DBH, f"0 to {MAX_DBH:g} cm"),
    "conifers": (_CONIFERS.low, _CONIFERS.high, f"{_CONIFERS.allowed} %"),
    "density_factor": (0.0, 1.0, "0 to 1"),
}


def plain_name(name: str) -> str:
    """Name in lower case without accents; other characters become single underscores.

    >>> plain_name("Écart-type")
    'ecart_type'
    """
    letters = unicodedata.normalize("NFKD", name.casefold())
    letters = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return re.sub(r"[^a-z0-9]+", "_", letters).strip("_")


def matching(key: str, columns: Iterable[str]) -> list[str]:
    """Layer attributes that match a stand value by name, including names truncated by shapefiles.

    >>> matching("dbh_mean", ["FID", "BHD", "Baumart"])
    ['BHD']
    """
    names = {name[:length].strip("_") for name in NAMES[key] for length in (SHORT, None)}
    return [name for name in columns if plain_name(name) in names]


class Attributes(NamedTuple):
    """Attributes of the polygons in a layer, found by the names in NAMES."""

    where: str
    columns: dict[str, np.ndarray]

    def own_name(self, key: str) -> str | None:
        """Name of an attribute in the layer; None if missing. Refuse several matches, but use the
        first for `name`."""
        matches = matching(key, self.columns)
        if len(matches) > 1 and key != "name":
            raise RockfallError(
                f"{self.where}: attributes {' and '.join(matches)}: both give {key}: keep one of "
                "them"
            )
        return matches[0] if matches else None

    def note_unused(self, remarks: list[str], keys: Iterable[str]) -> None:
        """Add remarks on missing values, and on attributes that give none of the values `keys`."""
        names = [name for key in keys for name in NAMES[key]]
        note_unused(remarks, self.where, self.columns, names, plain_name)
        note_marks(remarks, self.where, self.columns, names, plain_name)

    def refuse(self, k: int, key: str, value: Any, rule: str) -> RockfallError:
        return RockfallError(
            f"{self.where}: feature {k + 1}: {self.own_name(key)} = {value}: must be {rule}"
        )

    def texts(self, key: str) -> list[str | None]:
        """Texts of an attribute; None for empty or missing texts."""
        name = self.own_name(key)
        if name is None:
            return [None] * self.size
        return [None if (raw := plain(value)) is None else str(raw) for value in self.columns[name]]

    def numbers(self, key: str, needed: np.ndarray) -> np.ndarray | None:
        """Numbers of an attribute; None if the layer lacks it. Refuse numbers outside the limits,
        and missing numbers where `needed`."""
        name = self.own_name(key)
        if name is None:
            return None
        low, high, rule = LIMITS[key]
        column = self.columns[name]
        if column.dtype.kind not in "iuf":
            raise RockfallError(f"{self.where}: attribute {name}: must be a number: {rule}")
        values = column.astype(float)
        for k in np.flatnonzero(needed & np.isnan(values))[:1]:
            raise RockfallError(f"{self.where}: feature {k + 1}: has no {name}")
        for k in np.flatnonzero((values < low) | (values > high))[:1]:
            raise self.refuse(int(k), key, f"{values[k]:g}", rule)
        return values

    @property
    def size(self) -> int:
        return max(map(len, self.columns.values()), default=0)
