# SPDX-License-Identifier: BSD-3-Clause
"""Partial factors of the standards: a shipped table with the source of each number, which may be
replaced."""

from __future__ import annotations

import importlib.resources
import math
from dataclasses import dataclass
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io.tables import check_columns, read_table

COLUMNS = ["standard", "factor", "condition", "value", "source"]
UNCONFIRMED = "unconfirmed"  # in a source
BACK_ANALYSED = "back-analysed"  # of the rebound: fitted to observations of the slope

#: Condition that selects the row of a factor; other factors have a single row.
DECIDES = {
    "gamma_dp": "survey",
    "gamma_vol": "blocks",
    "gamma_tr": "calibration",
    "gamma_E": "limit_state",
    "energy_share": "limit_state",
    "gamma_F_energy": "consequence",
    "gamma_F_height": "consequence",
}
COMMON = ["quantile_speed", "quantile_height", "quantile_volume"]
COMMON += ["gamma_E", "energy_share", "free_border"]
NEEDED = {
    "UNI": [*COMMON, "gamma_dp", "gamma_tr", "gamma_vol", "gamma_gamma"],
    "ONR": [*COMMON, "quantile_energy", "gamma_F_energy", "gamma_F_height"],
}


@dataclass(frozen=True)
class Conditions:
    """A designer's knowledge of the site; defaults are conservative."""

    standard: str = "UNI"
    survey: str = "poor"  # of the topography: good, poor
    blocks: str = "poor"  # survey of the blocks: good, poor
    calibration: str = "literature"  # of the rebound: back-analysed, literature
    limit_state: str = "MEL"  # MEL: one large impact; SEL: several
    consequence: str = "CC2"  # of a failure: CC1, CC2, CC3


@dataclass(frozen=True)
class Factors:
    """The factors of a standard under the given conditions, with their sources."""

    conditions: Conditions
    values: dict[str, float]
    sources: dict[str, str]

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    @property
    def unconfirmed(self) -> list[str]:
        """Factors for which the standard itself, or the work that quotes it, has not been read."""
        return [name for name, source in self.sources.items() if UNCONFIRMED in source]


def shipped(name: str) -> Path:
    """Path of a shipped table."""
    return Path(str(importlib.resources.files("rockfall") / "data" / name))


def read_factors(conditions: Conditions, path: str | Path | None = None) -> Factors:
    """Factors of a standard under these conditions, from the shipped table or a replacement."""
    path = path or shipped("design_factors.csv")
    if conditions.standard not in NEEDED:
        raise RockfallError(f"standard = '{conditions.standard}': must be {', '.join(NEEDED)}")
    rows = _rows(path, conditions.standard)
    values, sources = {}, {}
    for name in NEEDED[conditions.standard]:
        by_condition = rows.get(name, {})
        decides = DECIDES.get(name)
        condition = getattr(conditions, decides) if decides else ""
        if condition not in by_condition:
            if not by_condition or not decides:
                raise RockfallError(f"{path}: {conditions.standard}: has no factor {name}")
            raise RockfallError(f"{decides} = '{condition}': must be {', '.join(by_condition)}")
        values[name], sources[name] = by_condition[condition]
    return Factors(conditions, values, sources)


def _rows(path: str | Path, standard: str) -> dict[str, dict[str, tuple[float, str]]]:
    """Value and source by factor and condition."""
    where, columns, rows = read_table(path)
    check_columns(where, columns, COLUMNS)
    if missing := [name for name in COLUMNS if name not in columns]:
        raise RockfallError(f"{where}: column {missing[0]}: is missing")
    factors: dict[str, dict[str, tuple[float, str]]] = {}
    for row in rows:
        if row.text("standard") != standard:
            continue
        name, condition = row.text("factor"), row.cells["condition"]
        if condition in factors.setdefault(name, {}):
            row.refuse("factor", "is there twice")
        value = row.number("value", 0.0, 1.0 if name.startswith("quantile") else math.inf)
        if not value or (value == 1 and name.startswith("quantile")):
            row.refuse("value", "must be > 0, of a quantile also < 1")
        factors[name][condition] = value, row.cells["source"]
    return factors
