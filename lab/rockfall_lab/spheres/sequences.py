# SPDX-License-Identifier: BSD-3-Clause
"""Throws of boulders at layers of rocks, with records of their contacts, for impact tables and
impact sets."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import RockfallError, check_kernel
from rockfall.grounds import repose
from rockfall.interrupts import interrupts
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.simulate import check_team
from rockfall.version import __version__
from rockfall_lab._lab import lab_f2py as _lab
from rockfall_lab.case import LabCase, lab_case_of
from rockfall_lab.contact_records import (
    contact_columns,
    contact_dataset,
    open_contacts,
    save_contacts,
)
from rockfall_lab.sets.contacts import RATIOS, Contacts
from rockfall_lab.sets.fit import Impacts, as_rebounds
from rockfall_lab.sets.setfile import CASE_MARK, STATE_MARK
from rockfall_lab.spheres.experiment import SAVE_SECONDS, Layers, pack_layers

if TYPE_CHECKING:
    import xarray as xr

GROUND = "rocks"
END = "end of contact"  # boulder state for sets from throws
THROWS_IN_CHUNK = 2  # throws per thread in a chunk: up to minutes for large R_b/R_m
COUNTERS = "done", "unfinished", "solid", "cpu_seconds"  # attributes with one number per ratio


def run_sequences(
    case: LabCase, *, progress: bool = False, threads: int = 0, path: str | Path | None = None,
    resume: bool = False,
) -> xr.Dataset:  # fmt: skip
    """Simulate a case with throws and return all contacts, throw by throw: an xarray.Dataset over
    `contact`. Raises a RockfallError for a case without throws.

    Velocities are relative to |V_in|, lengths to R_b. With `path`, the result is saved at
    intervals, at the end, and on Ctrl-C (raises KeyboardInterrupt); `resume` continues from such a
    file with at most as many throws. The result does not depend on threads, interruptions or
    resumptions.
    """
    check_team(threads)
    if not case.throws:
        raise RockfallError(f"{case.name}: has no group &throw: it fires single impacts")
    ratios = case.lab["ratios"]
    total = [case.throws_of(ratio) for ratio in ratios]
    parts, counters = _start(case, path if resume else None)
    if (counters["done"] >= total).all():
        return _dataset(case, parts, counters)
    saved = time.monotonic()
    with interrupts() as interrupted, progress_bar(sum(total), progress, "throws") as advance:
        advance(int(counters["done"].sum()))
        for part, thrown in _chunks(case, total, counters, threads, interrupted):
            parts.append(part)
            advance(thrown)
            if path is not None and time.monotonic() - saved > SAVE_SECONDS:
                save_contacts(_dataset(case, parts, counters), path)
                saved = time.monotonic()
        data = _dataset(case, parts, counters)
        if path is not None:
            save_contacts(data, path)
    if (counters["done"] < total).any():
        raise KeyboardInterrupt
    return data


def _start(
    case: LabCase, path: str | Path | None
) -> tuple[list[dict[str, np.ndarray]], dict[str, np.ndarray]]:
    """Existing contacts, in at most one part, and the counters of each ratio. Refuses files of
    another case or version, or with too many throws."""
    if path is None or not Path(path).exists():
        return [], {name: np.zeros(len(case.lab["ratios"])) for name in COUNTERS}
    data = open_sequences(path)
    earlier = lab_case_of(data.attrs["lab_case"], str(path))
    if not earlier.throws or earlier.replace(throw={"throws": case.throw["throws"]}) != case:
        raise RockfallError(f"{path}: is of another laboratory case: cannot resume")
    if data.attrs["version"] != __version__:
        raise RockfallError(f"{path}: is of another version of rockfall: cannot resume")
    counters = {name: np.atleast_1d(data.attrs[name]).astype(float) for name in COUNTERS}
    before, asked = (
        np.array([lab_case.throws_of(ratio) for ratio in case.lab["ratios"]])
        for lab_case in (earlier, case)
    )
    if (counters["done"] > asked).any():
        raise RockfallError(f"{path}: has more throws than the case asks for: cannot resume")
    counters["solid"] *= before / asked  # each throw contributes its share of the mean
    columns = {str(name): values.values for name, values in data.items()}
    return [columns] if data.sizes["contact"] else [], counters


def _chunks(
    case: LabCase, total: list[int], counters: dict[str, np.ndarray], threads: int,
    interrupted: Callable[[], bool],
) -> Iterator[tuple[dict[str, np.ndarray], int]]:  # fmt: skip
    """Simulate the remaining throws by ratio, then throw number. Yield the contacts and the number
    of throws."""
    team = max(1, _lab.team(threads))
    on_layer = case.throw["on_layer"]
    for k, ratio in enumerate(case.lab["ratios"]):
        while counters["done"][k] < total[k]:
            first = int(counters["done"][k])  # counted from 0
            layer = first // on_layer  # each thread takes one layer at a time
            end = min(total[k], (layer + team) * on_layer)
            clock = time.process_time()
            layers = pack_layers(case, ratio, layer + 1, (end - 1) // on_layer - layer + 1, threads)
            solid = layers.facts[2].mean()
            for numbers in np.array_split(
                np.arange(first, end), -(-(end - first) // (THROWS_IN_CHUNK * team))
            ):
                if interrupted():
                    return
                part, unfinished = _throw(case, ratio, layers, layer, numbers, threads)
                thrown = len(numbers)
                counters["solid"][k] += thrown / total[k] * solid
                counters["done"][k] += thrown
                counters["unfinished"][k] += unfinished
                counters["cpu_seconds"][k] += time.process_time() - clock
                clock = time.process_time()
                yield part, thrown


def _throw(
    case: LabCase, ratio: float, layers: Layers, first_layer: int, numbers: np.ndarray, threads: int
) -> tuple[dict[str, np.ndarray], int]:
    """Contacts of some throws, numbered from 0, and the number of truncated throws."""
    layer = numbers // case.throw["on_layer"]
    rows, counts, n_contacts, complete, code, message = _lab.throw_at_rocks(
        case.row("material"), case.row("packing", ratio), case.row("boulder", ratio),
        case.row("throw"), seed=case.lab["seed"], threads=threads, x=layers.x, radius=layers.radius,
        bodies=layers.bodies, facts=layers.facts, place=(layer - first_layer + 1).astype("i4"),
        layer=(layer + 1).astype("i4"), number=numbers + 1, contacts=case.throw["contacts"],
    )  # fmt: skip
    check_kernel(code, message, case.name)
    columns = contact_columns(rows, counts, n_contacts, numbers + 1, "layer")
    columns["ratio"] = np.full(len(columns["sequence"]), ratio)
    return columns, int((complete == 0).sum())


def _dataset(
    case: LabCase, parts: list[dict[str, np.ndarray]], counters: dict[str, np.ndarray]
) -> xr.Dataset:
    """All contacts so far, ordered by ratio, then throw number."""
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    ranks = np.array([case.lab["ratios"].index(ratio) for ratio in columns["ratio"]])
    columns = {name: values[ranks.argsort(kind="stable")] for name, values in columns.items()}
    attributes = {
        "title": case.lab["title"], "lab_case": case.text(), "ground": GROUND,
        "shape": case.throw["shape"],
        "density": case.impact["density"], "yield_pressure": 0.0, "rest_angle": repose(),
        "inertia_factor": float(_lab.inertia_factor(case.row("boulder", case.lab["ratios"][0]))),
        "ratios": case.lab["ratios"], **counters,
    }  # fmt: skip
    return contact_dataset(columns, case.throw["radius"], case.packing["gravity"], attributes)


def open_sequences(path: str | Path) -> xr.Dataset:
    """Read contacts of boulders on rocks from a file written by `run_sequences`. Raises a
    RockfallError for other files."""
    data = open_contacts(path)
    if not ({"ratio", "layer"} <= set(data) and {*COUNTERS} <= set(data.attrs)):
        raise RockfallError(f"{path}: is not a file of contacts of boulders on rocks")
    return data


def rebounds_of(data: xr.Dataset, name: str) -> Contacts:
    """Contacts after flights, as rebounds for sets of R_b/R_m = 1 to 5; other ratios are omitted.
    Raises a RockfallError if none is left. Contacts on the same layer are dependent."""
    from_flight = (data["entry"].values == 0) & np.isin(data["ratio"].values, RATIOS)
    if not from_flight.any():
        raise RockfallError(f"{name}: no contacts of R_b/R_m = 1, 2, 3, 4 or 5, of which sets are")
    column = {key: data[key].values[from_flight].astype(float) for key in data}
    speed, angle = column["speed"], np.radians(column["incidence"])
    v_in = np.stack([speed * np.cos(angle), -speed * np.sin(angle), speed * column["spin"]], axis=1)
    v_out = np.stack([speed * column[key] for key in ("vt_out", "vn_out", "w_out")], axis=1)
    number = np.arange(len(speed))
    impacts = as_rebounds(Impacts(v_in, v_out, number, np.abs(column["lateral"])))
    ratio = np.rint(column["ratio"]).astype(int)[impacts.group]
    group = column["layer"].astype(int)[impacts.group]
    impacts = Impacts(impacts.v_in, impacts.v_out, group, impacts.lateral)
    return Contacts(name, checksum(data), tuple(map(str, data)), "", impacts, ratio, 0)


def checksum(data: xr.Dataset) -> str:
    """SHA-256 of all numbers of the contacts."""
    digest = hashlib.sha256()
    for name in sorted(map(str, data)):
        digest.update(np.ascontiguousarray(data[name].values).tobytes())
    return digest.hexdigest()


def sequences_provenance(data: xr.Dataset, contacts: Contacts) -> list[str]:
    """Provenance lines of a set file, sufficient to reproduce it. Raises a RockfallError if throws
    are missing."""
    case = lab_case_of(data.attrs["lab_case"], contacts.name)
    done = dict(
        zip(np.atleast_1d(data.attrs["ratios"]), np.atleast_1d(data.attrs["done"]), strict=True)
    )
    if missing := sum(case.throws_of(ratio) - int(done[ratio]) for ratio in done):
        raise RockfallError(f"{contacts.name}: {missing} throws are not done: no set yet")
    lines = [
        f"{data.attrs['title']}",
        "",
        "Means and covariances of a1..a9 from contacts of boulders that were thrown at rocks.",
        STATE_MARK[2:] + END,
        f"Made by rockfall {data.attrs['version']}; `rockfall lab remake FILE` makes it again.",
        f"SHA-256 of the contacts: {contacts.checksum}",
    ]
    given = contacts.by_ratio()
    for ratio in RATIOS:
        rebounds = (
            f"{len(given[ratio].v_in)} rebounds" if ratio in given else "the set of the nearest"
        )
        lines.append(f"R_b/R_m = {ratio}: {rebounds}")
    lines += ["The laboratory case:"]
    return lines + [CASE_MARK[2:] + line for line in case.text().splitlines()]
