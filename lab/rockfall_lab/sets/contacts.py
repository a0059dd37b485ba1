# SPDX-License-Identifier: BSD-3-Clause
"""Impact sets from contacts measured in the field or on a rig (lab/docs/validation.md)."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.tables import Row, check_columns, read_table
from rockfall.scene.rebounds.kernel_rebounds import energy, ratio_class
from rockfall.version import __version__
from rockfall_lab.case import COEFFICIENTS
from rockfall_lab.sets.fit import GROUPS, Impacts, ImpactSet, as_rebounds, fit_set
from rockfall_lab.sets.lateral import incidence

LIMITS = {  # limits of each number required for a contact [m/s]
    "vt_in": (0.0, 1000.0), "vn_in": (-1000.0, -0.001), "w_in": (-1000.0, 1000.0),
    "vt_out": (-1000.0, 1000.0), "vn_out": (0.0, 1000.0), "w_out": (-1000.0, 1000.0),
}  # fmt: skip
TIED = "run", "point"  # contacts with equal values are not independent
OPTIONAL = "ratio", "ground", *TIED, "lateral", "note"
RATIOS = range(1, 6)  # ratios R_b/R_m of a set file
ALL = 0  # used instead of a ratio if none was measured
UNMEASURED = "a set needs the spin before and after: one that is assumed makes up a3 and a6 to a9"
CONTACTS_MARK = "! Measured contacts: "  # precedes the name of the file, next to the set file
CHECKSUM_MARK = "! SHA-256 of the contacts: "


@dataclass(frozen=True)
class Contacts:
    """Contacts from a file, as rebounds. `ratio` (n,) is the class of R_b/R_m of each contact, or
    None if the file has no ratios. `beyond` is the number of contacts with R_b/R_m below 0.5 or
    above 5.5, which no set covers."""

    name: str
    checksum: str
    columns: tuple[str, ...]
    ground: str
    impacts: Impacts
    ratio: np.ndarray | None
    beyond: int

    def by_ratio(self) -> dict[int, Impacts]:
        """Contacts by ratio, for ratios with contacts; by `ALL` if the file has no ratios."""
        if self.ratio is None:
            return {ALL: self.impacts}
        classes = np.unique(self.ratio).tolist()
        return {ratio: self.impacts.some(self.ratio == ratio) for ratio in classes}


def read_contacts(path: str | Path) -> Contacts:
    """Read contacts from a CSV file: columns `LIMITS` [m/s], and any of `OPTIONAL`.

    Raises a RockfallError for missing columns, invalid values, and a contact that gains energy.
    """
    path = Path(path)
    if not path.name.isprintable():
        raise RockfallError(f"{path.name!r}: a set file cannot name such a file")
    where, columns, rows = read_table(path)
    for name in LIMITS:
        if name not in columns:
            why = f": {UNMEASURED}" if name.startswith("w_") else ""
            raise RockfallError(f"{where}: column {name}: is missing{why}")
    check_columns(where, columns, (*LIMITS, *OPTIONAL))
    rows = list(rows)
    v = np.array([[_speed(row, name) for name in LIMITS] for row in rows])
    lateral = None
    if "lateral" in columns:
        lateral = np.abs([row.maybe("lateral", -90.0, 90.0) for row in rows])
    number = np.arange(len(rows))
    impacts = as_rebounds(Impacts(v[:, :3], v[:, 3:], number, lateral))
    for k in np.setdiff1d(number, impacts.group)[:1]:
        gain = (energy(v[k : k + 1, 3:]) / energy(v[k : k + 1, :3])).item()
        raise RockfallError(
            f"{rows[k].where}: V_t^2 + V_n^2 + 0.4 W^2 is {gain:.4g} of that before: "
            "no contact gains energy"
        )
    ties = [[row.text(name) for row in rows] for name in TIED if name in columns]
    ratio, beyond = None, 0
    if "ratio" in columns:
        given = np.array([row.number("ratio", 1e-3, 1e3) for row in rows])
        ratio = ratio_class(given)
        beyond = int(((given < 0.5) | (given > 5.5)).sum())
    return Contacts(
        path.name,
        hashlib.sha256(path.read_bytes()).hexdigest(),
        tuple(columns),
        _ground(rows) if "ground" in columns else "",
        replace(impacts, group=tied(len(rows), ties)),
        ratio,
        beyond,
    )


def _speed(row: Row, name: str) -> float:
    if name.startswith("w_") and not row.cells[name]:
        row.refuse(name, f"{UNMEASURED}; leave the contact out")
    return row.number(name, *LIMITS[name])


def _ground(rows: list[Row]) -> str:
    """Ground that all contacts share; different grounds are refused."""
    first = rows[0].text("ground")
    if not first.isprintable():
        rows[0].refuse("ground", "must be printable text")
    for row in rows:
        if row.text("ground") != first:
            row.refuse("ground", f"a set file is of one ground, and the first contact's is {first}")
    return first


def tied(n: int, ties: Iterable[list[str]]) -> np.ndarray:
    """Groups (n,) of dependent contacts: those that share a name in any of the `ties`, directly or
    through other contacts."""
    which = [np.unique(names, return_inverse=True)[1] for names in ties]
    group = np.arange(n)
    while True:
        before = group
        for labels in which:
            first = np.full(n, n)
            np.minimum.at(first, labels, group)
            group = first[labels]
        if np.array_equal(group, before):
            return group


def fit_contacts(contacts: Contacts, nearest: bool = False) -> dict[int, ImpactSet]:
    """Fit the sets for all five ratios. Raises a RockfallError for a ratio without contacts; with
    `nearest`, this ratio gets the set of the nearest ratio with contacts instead."""
    given = contacts.by_ratio()
    for ratio in RATIOS:
        if not (ratio in given or ALL in given or nearest):
            raise RockfallError(
                f"{contacts.name}: R_b/R_m = {ratio}: no contacts; --nearest-ratio takes the set "
                f"of {_nearest(ratio, given)}"
            )
    fitted = {
        ratio: _fit(f"{contacts.name}: {title(ratio)}", part) for ratio, part in given.items()
    }
    return {ratio: fitted[_nearest(ratio, given)] for ratio in RATIOS}


def _fit(where: str, impacts: Impacts) -> ImpactSet:
    """Fit a set. Raises a RockfallError with fewer than GROUPS groups to omit in turn, or if the
    standard error of a coefficient exceeds its standard deviation: a likelihood that allows for
    this error may then have no maximum."""
    try:
        impact_set = fit_set(impacts)
    except RockfallError as error:
        raise RockfallError(f"{where}: {error}") from error
    groups = len(np.unique(impacts.group))
    if groups < GROUPS:
        raise RockfallError(
            f"{where}: {impact_set.impacts} contacts that hang together by run or point in "
            f"{groups} groups: at least {GROUPS} groups are needed for standard errors"
        )
    deviation = np.sqrt(np.diag(impact_set.covariance))
    worst = np.argmax(impact_set.mean_error / deviation)
    if impact_set.mean_error[worst] > deviation[worst]:
        raise RockfallError(
            f"{where}: {impact_set.impacts} contacts are too few: the standard error of "
            f"{COEFFICIENTS[worst]}, {impact_set.mean_error[worst]:.2g}, is above its deviation, "
            f"{deviation[worst]:.2g}"
        )
    return impact_set


def _nearest(ratio: int, given: Iterable[int]) -> int:
    """Nearest ratio with contacts; of two equally near ratios the larger, with which boulders
    travel farther."""
    return min(given, key=lambda candidate: (abs(candidate - ratio), -candidate))


def title(ratio: int) -> str:
    """Title of the set for a ratio."""
    return "all ratios" if ratio == ALL else f"R_b/R_m = {ratio}"


def contacts_provenance(contacts: Contacts) -> list[str]:
    """Provenance lines of a set file, sufficient to reproduce it from the contacts."""
    lines = [
        "Means and covariances of a1..a9 from measured contacts of boulders with the ground.",
        f"Made by rockfall {__version__}; `rockfall lab remake FILE` makes it again.",
        CONTACTS_MARK[2:] + contacts.name,
        CHECKSUM_MARK[2:] + contacts.checksum,
        f"Columns: {', '.join(contacts.columns)}",
    ]
    if contacts.ground:
        lines.append(f"Ground: {contacts.ground}")
    if not any(name in contacts.columns for name in TIED):
        lines.append("Neither run nor point was told: contacts are taken as independent.")
    if contacts.impacts.lateral is None:
        lines.append("Lateral deviations were not measured: not for &impact turning = 'lab'.")
    if contacts.ratio is None:
        lines.append("R_b/R_m was not measured: the sets of all five ratios are the same.")
    if contacts.beyond:
        lines.append(
            f"{contacts.beyond} contacts have R_b/R_m below 0.5 or above 5.5, beyond all sets."
        )
    given = contacts.by_ratio()
    lines += [f"{title(ratio)}: {_about(impacts)}" for ratio, impacts in given.items()]
    for ratio in RATIOS:
        if not (ratio in given or ALL in given):
            near = _nearest(ratio, given)
            lines.append(f"{title(ratio)}: no contacts: the set of {near}, the nearest")
    return lines


def _about(impacts: Impacts) -> str:
    speed = np.hypot(impacts.v_in[:, 0], impacts.v_in[:, 1])
    ranges = {"V": speed, "incidence": incidence(impacts.v_in), "W/V": impacts.v_in[:, 2] / speed}
    units = {"V": " m/s", "incidence": " degrees", "W/V": ""}
    shown = ", ".join(
        f"{name} {v.min():.2g} to {v.max():.2g}{units[name]}" for name, v in ranges.items()
    )
    return f"{len(speed)} contacts in {len(np.unique(impacts.group))} groups; {shown}"


def contacts_behind(path: Path, text: str) -> Contacts | None:
    """Contacts from which a set file with this text was fitted; None if it was not fitted to
    contacts. Raises a RockfallError if the file of the contacts is not next to the set file, or has
    changed."""
    name, checksum = (
        next((line[len(mark) :] for line in text.splitlines() if line.startswith(mark)), "")
        for mark in (CONTACTS_MARK, CHECKSUM_MARK)
    )
    if not name:
        return None
    beside = path.parent / Path(name).name
    if not beside.exists():
        raise RockfallError(f"{path}: is from measured contacts: {name} is not beside it")
    contacts = read_contacts(beside)
    if contacts.checksum != checksum:
        raise RockfallError(
            f"{path}: is from measured contacts: {name} beside it is not what it was made from"
        )
    return contacts
