# SPDX-License-Identifier: BSD-3-Clause
"""Impact tables from the contacts of a laboratory (theory, chapter 5)."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.grounds.impact_tables import (
    FIELDS,
    INPUTS,
    KINDS,
    MAPPED,
    ImpactTable,
    YieldingGround,
)
from rockfall.limits import MAX_HELD
from rockfall.version import __version__
from rockfall_lab.blocks.case import block_case_of
from rockfall_lab.case import lab_case_of

if TYPE_CHECKING:
    import xarray as xr

FLIGHT, ROLLING = 0, 1  # entry codes
ROLLS_ON = 1  # exit code
BINS: dict[str, tuple[int, ...]] = {  # number of bins for each key, if there are enough records
    "flight": (4, 4, 12),
    "roll": (6, 4, 1),
}
ENOUGH = 24  # records per bin; the number of bins is reduced to have this many
KEPT = 32_000  # maximum number of contacts per table
ALONE = 2 / 3  # fraction of the records, on rocks, that need no preceding contact
RIDGE = 0.01  # regularisation of a bin's least squares, over the variance of each input
USUAL = 0.02, 0.98  # quantiles of W/V while a block rolls: values beyond are clipped
SLOWEST = 0.05  # V/sqrt(g R_b) of a flight, below which its direction is not significant
ALIKE = "ground", "shape", "density", "rest_angle"  # attributes that all contacts of a table share
DIGITS = 9  # bits kept of a record's numbers: noise does not compress


@dataclass(frozen=True)
class _Contacts:
    """Contacts of boulders of one size: dimensionless record, entry code, throw, and order."""

    record: np.ndarray  # (n, FIELDS) without derived fields
    entry: np.ndarray
    sequence: np.ndarray
    order: np.ndarray

    def __getitem__(self, name: str) -> np.ndarray:
        return self.record[:, FIELDS.index(name)]


@dataclass(frozen=True)
class _Part:
    """Contacts of boulders of one size on one relief."""

    size: float  # size as in ImpactTable
    relief: float  # slope of the relief [degree]
    data: xr.Dataset


def table_of(files: Sequence[xr.Dataset], kept: int = KEPT) -> ImpactTable:
    """Make a table from contacts. It has one part per R_b/R_m, from a column or an attribute, or on
    yielding ground one part per size/strength and relief, from one file each. At most `kept`
    contacts become records; bins and maps use all contacts. Raises RockfallError for too few
    contacts, or files that do not belong together."""
    parts, columns, rows = _grid(_parts(files))
    for name in ALIKE:
        if len({str(part.data.attrs[name]) for part in parts}) > 1:
            raise RockfallError(f"contacts: files that differ in {name} do not make one table")
    tried = [_dimensionless(part.data) for part in parts]
    edges: dict[str, list[np.ndarray]] = {}
    bins: list[_Bin] = []
    sizes_of_bins: list[int] = []
    records: list[np.ndarray] = []
    chosen = _chosen(tried, kept, rocks="ratio" in files[0])
    for k, contacts in enumerate(tried):
        kept_rows: list[np.ndarray] = []
        for kind in KINDS:
            own = _bins_for(kind, int(_of_kind(contacts, kind).sum()))
            groups, of_kind = _padded(*_sort_into_bins(contacts, kind, own), BINS[kind])
            bins += [_bin(contacts.record[group], kind) for group in groups]
            kept_rows += [_kept_rows(contacts, group, chosen[k]) for group in groups]
            for key, values in enumerate(of_kind, start=1):
                edges.setdefault(f"{kind}_edge_{key}", []).append(values)
        sizes_of_bins += [len(group) for group in kept_rows]
        before = sum(map(len, records))
        records.append(_with_followers(contacts, np.concatenate(kept_rows), before))
    return ImpactTable(
        size=columns,
        relief=rows,
        edges={name: np.stack(values).astype("f4") for name, values in edges.items()},
        first=np.cumsum([0, *sizes_of_bins]).astype("i4"),
        map=np.stack([bin_.map for bin_ in bins]).astype("f4"),
        low=np.stack([bin_.low for bin_ in bins]).astype("f4"),
        high=np.stack([bin_.high for bin_ in bins]).astype("f4"),
        record=np.concatenate(records),
        inertia=float(np.mean([part.data.attrs["inertia_factor"] for part in parts])),
        ground=_ground(parts[0].data),
        attrs=_provenance([part.data for part in parts]) | {"kept": kept},
    )


def _parts(files: Sequence[xr.Dataset]) -> list[_Part]:
    """Contacts by size and relief; size 0 means that the size is irrelevant."""
    parts = []
    for data in files:
        if "ratio" in data:
            parts += [
                _Part(float(ratio), 0.0, data.isel(contact=data["ratio"].values == ratio))
                for ratio in np.unique(data["ratio"].values)
            ]
        elif (strength := float(data.attrs["yield_pressure"])) > 0:
            numbers = (float(data.attrs[name]) for name in ("density", "gravity", "radius"))
            relief = block_case_of(data.attrs["lab_case"], "contacts").ground["relief"]
            parts.append(_Part(math.prod(numbers) / strength, relief, data))
        else:
            parts.append(_Part(float(data.attrs.get("ratio", 0.0)), 0.0, data))
    return parts


def _grid(parts: Sequence[_Part]) -> tuple[list[_Part], np.ndarray, np.ndarray]:
    """Parts in the order of a table, sizes of its columns and reliefs of its rows: all
    combinations, or only sizes if these determine the relief. Refuses other combinations."""
    columns = np.unique([part.size for part in parts])
    rows = np.unique([part.relief for part in parts])
    if len(parts) == len(columns):
        rows = rows[:1]
    places = {(part.relief, part.size) for part in parts}
    if len(places) < len(parts) or len(parts) != len(columns) * len(rows):
        raise RockfallError(
            "contacts: files must be of different sizes over strength, or of all pairs of some "
            "sizes and reliefs"
        )
    if columns[0] == 0 and len(parts) > 1:
        raise RockfallError("contacts: files of boulders without a size make no table together")
    return sorted(parts, key=lambda part: (part.relief * (len(rows) > 1), part.size)), columns, rows


def _ground(data: xr.Dataset) -> YieldingGround:
    """Ground of a table, from the laboratory's attributes. Refuses other yield exponents than 0 and
    1."""
    rest_angle = float(data.attrs["rest_angle"])
    if not float(data.attrs["yield_pressure"]) > 0:
        return YieldingGround(rest_angle)
    ground = block_case_of(data.attrs["lab_case"], "contacts").ground
    grows, radius = ground["yield_exponent"], float(data.attrs["radius"])
    if grows not in (0, 1):
        raise RockfallError(f"contacts: yield_exponent = {grows:g}: must be 0 or 1 for a table")
    return YieldingGround(
        rest_angle, ground["yield_pressure"], strength_radius=radius * grows,
        relief=ground["relief"],
    )  # fmt: skip


def _provenance(files: list[xr.Dataset]) -> dict[str, str | int]:
    """Provenance attributes of a table, sufficient to reproduce it."""
    digest = hashlib.sha256()
    for data in files:
        for name in sorted(map(str, data)):
            digest.update(np.ascontiguousarray(data[name].values).tobytes())
    first = files[0].attrs
    return {
        "ground": str(first["ground"]),
        "shape": str(first["shape"]),
        "contacts": int(sum(data.sizes["contact"] for data in files)),
        "contacts_sha256": digest.hexdigest(),
        **_case_attributes(files),
        "version": __version__,
    }


def _case_attributes(files: list[xr.Dataset]) -> dict[str, str]:
    """Attributes `lab_case`, `lab_case_2`, ...: the laboratory cases behind a table."""
    cases = dict.fromkeys(str(data.attrs["lab_case"]) for data in files)
    return {f"lab_case_{k}" if k > 1 else "lab_case": text for k, text in enumerate(cases, 1)}


def cases_of(attrs: Mapping[str, Any]) -> list[str]:
    """Texts of the laboratory cases behind a table, from its attributes."""
    return [str(text) for name, text in attrs.items() if re.fullmatch(r"lab_case(_\d+)?", name)]


def _dimensionless(data: xr.Dataset) -> _Contacts:
    """Dimensionless contacts: velocities over U = sqrt(g R_b), times over sqrt(R_b/g). Contacts are
    mirrored so that the ground falls to the left; the excluded impulse of gravity is restored."""
    radius, gravity = float(data.attrs["radius"]), float(data.attrs["gravity"])
    unit = np.sqrt(gravity * radius)
    column = {name: data[name].values.astype(float) for name in data}
    speed = column["speed"] / unit
    incidence, heading, slope, lateral = (
        np.radians(column[name]) for name in ("incidence", "heading", "slope", "lateral")
    )
    along = np.sin(slope) * np.cos(heading)
    across = -np.sin(slope) * np.sin(heading)
    left = np.where(across < 0, -1.0, 1.0)
    duration = column["duration"] / np.sqrt(radius / gravity)
    out = column["vt_out"] * speed
    record = np.zeros((len(speed), len(FIELDS)))
    values = {
        "vt_in": speed * np.cos(incidence), "vn_in": -speed * np.sin(incidence),
        "w_in": column["spin"] * speed, "speed_in": speed, "height_in": column["height"],
        "along_out": out * np.cos(lateral) + along * duration,
        "across_out": left * (out * np.sin(lateral) + across * duration),
        "vn_out": column["vn_out"] * speed, "w_out": column["w_out"] * speed,
        "duration": duration, "advance": column["advance"], "rise": column["rise"],
        "pull_along": along, "pull_across": left * across, "exit": column["exit"],
    }  # fmt: skip
    for name, quantity in values.items():
        record[:, FIELDS.index(name)] = quantity
    if _has_facets(data):
        _end_on_mean_ground(record, float(data.attrs["inertia_factor"]))
    throws = data["sequence"].values, data["order"].values
    return _Contacts(_rounded(record), data["entry"].values, *throws)


def _has_facets(data: xr.Dataset) -> bool:
    """Return True if the ground of the contacts consists of facets, such as rocks with a relief."""
    if "ratio" not in data:
        return False
    case = lab_case_of(data.attrs["lab_case"], "contacts")
    return case.relief_of(float(data["ratio"].values[0])) > 0


def _end_on_mean_ground(record: np.ndarray, inertia: float) -> None:
    """Let rolling contacts end where the next contact begins: on another facet, at the height of
    the mean ground. Energy used to climb is converted back to motion, and energy gained by sinking
    is subtracted; blocks too slow to climb out come to rest (theory, eq. 5.28)."""
    column = {name: record[:, FIELDS.index(name)] for name in FIELDS}
    on = column["exit"] == ROLLS_ON
    motion = column["along_out"] ** 2 + column["across_out"] ** 2 + inertia * column["w_out"] ** 2
    left = np.maximum(0.0, motion + 2 * column["rise"])
    moves = on & (motion > 0)
    factor = np.sqrt(np.divide(left, motion, out=np.ones_like(motion), where=moves))
    for name in ("along_out", "across_out", "w_out"):
        column[name] *= factor
    column["rise"][on] = 0.0


def _rounded(record: np.ndarray) -> np.ndarray:
    """Numbers in single precision, with mantissas rounded to DIGITS bits."""
    bits = np.ascontiguousarray(record, "f4").view("u4")
    drop = 23 - DIGITS
    return ((bits + np.uint32(1 << (drop - 1))) >> drop << drop).view("f4")


def _of_kind(contacts: _Contacts, kind: str) -> np.ndarray:
    """Mask (n,) of contacts that begin with this kind of entry, without those too slow for a
    table."""
    if kind == "roll":
        return (contacts.entry == ROLLING) & (contacts["speed_in"] > 0)
    falls = (contacts["vn_in"] < 0) & (contacts["speed_in"] > SLOWEST)
    return (contacts.entry == FLIGHT) & falls


def _keys(contacts: _Contacts, kind: str) -> list[np.ndarray]:
    """Keys by which contacts are sorted into bins, as in the kernel."""
    speed = contacts["speed_in"].astype(float)
    speed2 = contacts["vt_in"].astype(float) ** 2 + contacts["vn_in"].astype(float) ** 2
    if kind == "roll":
        return [speed2, contacts["height_in"].astype(float), contacts["vn_in"].astype(float)]
    return [contacts["vn_in"] ** 2 / speed2, contacts["w_in"] / speed, speed2]


def _bins_for(kind: str, contacts: int) -> tuple[int, ...]:
    """Number of bins that the contacts of a kind can fill; refuses too few contacts."""
    if contacts < ENOUGH:
        what = {"flight": "from a flight", "roll": "that roll on"}[kind]
        raise RockfallError(
            f"contacts: {contacts} {what}: at least {ENOUGH} are needed for a table"
        )
    bins = list(BINS[kind])
    while np.prod(bins) * ENOUGH > contacts:
        bins[int(np.argmax(bins))] -= 1
    return tuple(bins)


@dataclass(frozen=True)
class _Bin:
    map: np.ndarray
    low: np.ndarray
    high: np.ndarray


def _sort_into_bins(
    contacts: _Contacts, kind: str, sizes: tuple[int, ...]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Contacts in each bin of a kind, and the edges of each key: quantiles within the bin of the
    previous key. Refuses contacts that leave a bin empty."""
    keys = _keys(contacts, kind)
    groups = [np.flatnonzero(_of_kind(contacts, kind))]
    edges = []
    for key, size in zip(keys, sizes, strict=True):
        cuts = np.array(
            [np.quantile(key[group], np.arange(1, size) / size) for group in groups], "f4"
        ).reshape(len(groups), size - 1)
        edges.append(cuts)
        groups = [
            group[place == k]
            for group, cut in zip(groups, cuts, strict=True)
            for place in [np.searchsorted(cut.astype(float), key[group])]
            for k in range(size)
        ]
    if min(len(group) for group in groups) == 0:
        raise RockfallError("contacts: too many are alike for a table")
    shapes = (sizes[0] - 1,), (sizes[0], sizes[1] - 1), (*sizes[:2], sizes[2] - 1)
    cut = [edge.reshape(shape) for edge, shape in zip(edges, shapes, strict=True)]
    return groups, cut


def _chosen(parts: Sequence[_Contacts], kept: int, rocks: bool) -> list[np.ndarray]:
    """Mark the contacts of each part that become records, `kept` in total. Evenly spaced throws are
    chosen, so that records have followers. On rocks, with many throws, records without predecessors
    (after flights, or too fast to be followed) come from more throws."""
    alone = [
        rocks & ((contacts.entry == FLIGHT) | (contacts["speed_in"] > MAX_HELD))
        for contacts in parts
    ]
    fraction = min(1.0, ALONE * kept / max(1, sum(int(which.sum()) for which in alone)))
    chosen = [
        _of_throws(contacts, which, fraction * which.sum())
        for contacts, which in zip(parts, alone, strict=True)
    ]
    most = (kept - sum(int(which.sum()) for which in chosen)) // len(parts)
    return [
        already | _of_throws(contacts, ~which, most)
        for contacts, which, already in zip(parts, alone, chosen, strict=True)
    ]


def _of_throws(contacts: _Contacts, which: np.ndarray, most: float) -> np.ndarray:
    """Mark about `most` of some contacts, from evenly spaced throws."""
    numbers = np.unique(contacts.sequence)
    of_throw = max(1, int(which.sum())) / len(numbers)
    n = min(len(numbers), int(most / of_throw))
    return which & np.isin(contacts.sequence, numbers[(np.arange(n) * len(numbers)) // max(1, n)])


def _kept_rows(contacts: _Contacts, group: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Contacts of a bin to keep, at least one, ordered by gravity along the heading."""
    kept = group[chosen[group]]
    rows = kept if len(kept) else group[:1]
    return rows[np.lexsort((contacts["speed_in"][rows], contacts["pull_along"][rows]))]


def _with_followers(contacts: _Contacts, rows: np.ndarray, before: int) -> np.ndarray:
    """Records of ordered contacts, each with the index (from 1) of the next contact in its throw,
    or 0 if that is not kept. `before` records precede them."""
    place = {
        key: before + k + 1
        for k, key in enumerate(zip(contacts.sequence[rows], contacts.order[rows], strict=True))
    }
    record = contacts.record[rows]
    record[:, FIELDS.index("follower")] = [
        place.get((sequence, order + 1), 0)
        for sequence, order in zip(contacts.sequence[rows], contacts.order[rows], strict=True)
    ]
    return record


def _padded(
    groups: list[np.ndarray], edges: list[np.ndarray], sizes: tuple[int, ...]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Pad the bins of each part to a common number, with unreachable bins of one contact each."""
    own = [edge.shape[-1] + 1 for edge in edges]
    padded = [
        groups[int(np.ravel_multi_index(at, own))] if np.less(at, own).all() else groups[0][:1]
        for at in np.ndindex(*sizes)
    ]
    shapes = [(*sizes[:key], sizes[key] - 1) for key in range(len(sizes))]
    padded_edges = []
    for edge, shape in zip(edges, shapes, strict=True):
        values = np.full(shape, np.finfo("f4").max, "f4")
        values[tuple(slice(n) for n in edge.shape)] = edge
        padded_edges.append(values)
    return padded, padded_edges


def _bin(record: np.ndarray, kind: str) -> _Bin:
    """Least-squares map of a bin, and the range of its inputs."""
    value = {name: record[:, k].astype(float) for k, name in enumerate(FIELDS)}
    scale = value["speed_in"] if kind == "flight" else np.ones(len(record))
    inputs = np.stack([value[name] / scale for name in ("vt_in", "vn_in", "w_in")])
    inputs = np.vstack([inputs, np.zeros(len(record)) if kind == "flight" else value["height_in"]])
    free = value["along_out"] - value["pull_along"] * value["duration"]
    outputs = np.stack([free, value["vn_out"], value["w_out"]]) / scale
    x, y = (side - side.mean(axis=1, keepdims=True) for side in (inputs, outputs))
    variance = np.maximum((x**2).mean(axis=1), 1e-4)
    normal = x @ x.T + RIDGE * len(record) * np.diag(variance)
    solution = np.linalg.solve(normal, x @ y.T).T
    low, high = inputs.min(axis=1), inputs.max(axis=1)
    if kind == "roll":  # rare values of W/V must not widen the range
        low[2], high[2] = np.quantile(value["w_in"] / value["speed_in"], USUAL)
    return _Bin(solution.reshape(MAPPED, INPUTS), low, high)
