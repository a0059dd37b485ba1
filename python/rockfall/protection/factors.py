# SPDX-License-Identifier: BSD-3-Clause
"""Partial factors of standards from a table of the user. None are shipped, because the texts of
the standards were not available."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io.tables import check_columns, check_needed, read_table

COLUMNS = ["standard", "factor", "condition", "value", "source"]
BACK_ANALYSED = "back-analysed"  # rebounds were fitted to observations on the slope

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
    """Conditions that select the factors of a standard; the defaults are conservative."""

    standard: str = "UNI"
    survey: str = "poor"  # survey of the topography: good, poor
    blocks: str = "poor"  # survey of the blocks: good, poor
    calibration: str = "literature"  # calibration of the rebound: back-analysed, literature
    limit_state: str = "MEL"  # limit state: MEL (one large impact) or SEL (several)
    consequence: str = "CC2"  # consequence class of a failure: CC1, CC2, CC3


#: Allowed values for each condition.
ALLOWED = {
    "standard": tuple(NEEDED),
    "survey": ("good", "poor"),
    "blocks": ("good", "poor"),
    "calibration": (BACK_ANALYSED, "literature"),
    "limit_state": ("MEL", "SEL"),
    "consequence": ("CC1", "CC2", "CC3"),
}


@dataclass(frozen=True)
class Factors:
    """Factors of a standard under given conditions with their sources, NaN if not given."""

    conditions: Conditions
    values: dict[str, float]
    sources: dict[str, str]

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def condition(self, name: str) -> str:
        """Condition that selects the row of a factor; "" if there is none."""
        return getattr(self.conditions, DECIDES[name]) if name in DECIDES else ""

    @property
    def open(self) -> str:
        """Names and conditions of missing factors; "" if all are given."""
        names = (name for name, value in self.values.items() if math.isnan(value))
        return ", ".join(
            f"{name} ({self.condition(name)})" if name in DECIDES else name for name in names
        )

    def require(self, what: str) -> None:
        """Raise a RockfallError if factors are missing; `what` needs them."""
        if self.open:
            standard = self.conditions.standard
            raise RockfallError(f"{what} needs --factors TABLE.csv, with {standard}: {self.open}")


def read_factors(conditions: Conditions, path: str | Path | None = None) -> Factors:
    """Factors of a standard under `conditions`, from a table; all NaN without a table. Raises a
    RockfallError for conditions not in `ALLOWED`, and for a factor missing from the table."""
    for key, allowed in ALLOWED.items():
        if (given := getattr(conditions, key)) not in allowed:
            raise RockfallError(f"{key} = '{given}': must be one of {', '.join(allowed)}")
    names = NEEDED[conditions.standard]
    factors = Factors(conditions, dict.fromkeys(names, math.nan), dict.fromkeys(names, ""))
    rows = {} if path is None else _rows(path, conditions.standard)
    for name in names if path is not None else ():
        condition = factors.condition(name)
        if condition not in rows.get(name, {}):
            row = " ".join(filter(None, [name, condition]))
            raise RockfallError(f"{path}: {conditions.standard}: has no factor {row}")
        factors.values[name], factors.sources[name] = rows[name][condition]
    return factors


def _rows(path: str | Path, standard: str) -> dict[str, dict[str, tuple[float, str]]]:
    """Values and sources by factor and condition. Refuses repeated rows and invalid values."""
    where, columns, rows = read_table(path)
    check_columns(where, columns, COLUMNS)
    check_needed(where, columns, COLUMNS)
    factors: dict[str, dict[str, tuple[float, str]]] = {}
    for row in rows:
        if row.text("standard") != standard:
            continue
        name, condition = row.text("factor"), row.cells["condition"]
        if condition in factors.setdefault(name, {}):
            row.refuse("factor", "occurs twice")
        value = row.number("value", 0.0, 1.0 if name.startswith("quantile") else math.inf)
        if not value or (value == 1 and name.startswith("quantile")):
            row.refuse("value", "must be > 0, and < 1 for a quantile")
        factors[name][condition] = value, row.cells["source"]
    return factors
