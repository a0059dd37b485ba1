# SPDX-License-Identifier: BSD-3-Clause
"""Throw blocks, and keep the records of their contacts."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall._lab import lab_f2py as _lab
from rockfall.errors import RockfallError, check_kernel
from rockfall.interrupts import interrupts
from rockfall.io.files import atomic_write
from rockfall.lab.blocks.case import CONTACT, COUNTS, GROUND, THROW, BlockCase
from rockfall.lab.blocks.relief import patches
from rockfall.lab.case import names
from rockfall.lab.experiment import load_measured
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.simulate import check_team
from rockfall.version import __version__

if TYPE_CHECKING:
    import xarray as xr

ENTRIES = "flight", "rolling"
EXITS = "flies", "rolls_on", "stops"
THROWS_IN_CHUNK = 256  # of a thread: about a second
ATTRIBUTES = "title", "lab_case", "version", "ground", "shape", "radius", "yield_pressure"

UNITS = dict.fromkeys(("slope", "heading", "incidence", "lateral"), "degree")
UNITS |= {"speed": "m s-1", "duration": "s"}
TYPES = {"sequence": "i4", "order": "i1", "block": "i2", "entry": "i1", "exit": "i1"}
MEANING = {
    "sequence": "number of the throw",
    "order": "place of the contact in its throw",
    "block": "number of the block",
    "entry": "how the contact begins: at a touch, or where a long contact was cut",
    "exit": "how it ends: the block flies, rolls on (the contact was cut), or stops",
    "slope": "of the laboratory's mean plane",
    "downhill": "from the throw to the beginning, along the fall line, over R_b",
    "heading": "of V_t before, from the fall line, left > 0",
    "speed": "|V_in|, in the plane of V_t and V_n, of the centre of mass",
    "incidence": "angle of V_in from the mean plane, 90 = at right angles",
    "spin": "W/|V_in|, W = R_b omega about the axis in the plane across V_t, > 0 forward",
    "s": "rho_b V_n**2/(2 p_y)",
    "vt_out": "V_t/|V_in| without gravity's work along the slope, < 0 thrown back",
    "vn_out": "V_n/|V_in|, away from the mean plane",
    "w_out": "W/|V_in|, about the axis across the V_t that the block has then, > 0 forward",
    "lateral": "turn of V_t from the heading before, left > 0",
    "duration": "from the first touch to the last, or to the cut",
    "advance": "displacement along the heading before, over R_b",
    "rise": "displacement of the centre away from the mean plane, over R_b",
    "height": "of the centre above the mean plane at the first touch, over R_b",
    "energy_out": "kinetic energy with all of the spin, after / before; nothing taken out",
}


def run_throws(
    case: BlockCase, *, progress: bool = False, threads: int = 0, step: float = 1.0
) -> xr.Dataset:
    """All contacts of a case, one after the other: an xarray.Dataset over `contact`.

    Velocities are over |V_in|, lengths over R_b. The result does not depend on threads. Raises
    KeyboardInterrupt on Ctrl-C.
    """
    check_team(threads)
    surfaces = case.surfaces()
    heights, width = patches(case.spectrum(), case.ground["patches"], case.lab["seed"])
    radius, density = case.block["radius"], case.block["density"]
    block = {
        "radius": radius, "density": density,
        "x": np.concatenate([one.vertices for one in surfaces]).T,
        "corner": np.concatenate([one.triangles for one in surfaces]).T + 1,
        "vertices": [len(one.vertices) for one in surfaces],
        "facets": [len(one.triangles) for one in surfaces],
    }  # fmt: skip
    ground = {"heights": radius * heights, "width": radius * width}
    plan = {"seed": case.lab["seed"], "contacts": case.lab["contacts"]}
    plan |= {"step": step * case.throw["step_factor"]}
    total, chunk = case.lab["throws"], THROWS_IN_CHUNK * max(1, _lab.team(threads))
    parts, unfinished, inertia = [], 0, np.zeros(len(surfaces))
    clock = time.process_time()
    with interrupts() as interrupted, progress_bar(total, progress, "throws") as advance:
        for first in range(1, total + 1, chunk):
            if interrupted():
                raise KeyboardInterrupt
            n = min(chunk, total + 1 - first)
            rows, counts, found, complete, inertia, code, message = _lab.throw(
                case.row(GROUND), case.row(THROW), **block, **ground, **plan, first=first,
                threads=threads, n=n,
            )  # fmt: skip
            check_kernel(code, message, case.name)
            parts.append(_records(rows, counts, found, first))
            unfinished += int((complete == 0).sum())
            advance(n)
    data = _dataset(case, {name: np.concatenate([p[name] for p in parts]) for name in parts[0]})
    data.attrs |= {
        "inertia_factor": float(inertia.mean()),
        "unfinished": unfinished,
        "cpu_seconds": time.process_time() - clock,
    }
    return data


def _records(
    rows: np.ndarray, counts: np.ndarray, found: np.ndarray, first: int
) -> dict[str, np.ndarray]:
    """Contacts of throws `first` and on, throw by throw: rows (fields, contacts, throws)."""
    throw, order = np.nonzero(np.arange(rows.shape[1])[None, :] < found[:, None])
    return {
        "sequence": throw + first,
        "order": order + 1,
        **{name: counts[k][order, throw] for k, name in enumerate(names(COUNTS))},
        **{name: rows[k][order, throw] for k, name in enumerate(names(CONTACT))},
    }


def _dataset(case: BlockCase, columns: dict[str, np.ndarray]) -> xr.Dataset:
    import xarray as xr

    data: dict[str, tuple] = {}
    for name, values in columns.items():
        about: dict[str, Any] = {"units": UNITS.get(name, "1"), "long_name": MEANING[name]}
        data[name] = ("contact", values.astype(TYPES.get(name, "f4")), about)
    for name, meanings in ("entry", ENTRIES), ("exit", EXITS):
        flags = {"flag_values": np.arange(len(meanings), dtype="i1")}
        data[name][2].update(flags | {"flag_meanings": " ".join(meanings)})
    radius, gravity = case.block["radius"], case.throw["gravity"]
    attributes = {
        "title": case.lab["title"], "lab_case": case.text(), "version": __version__,
        "ground": case.lab["ground"], "shape": case.lab["shape"],
        "radius": radius, "density": case.block["density"],
        "yield_pressure": case.ground["yield_pressure"], "gravity": gravity,
        "cut_time": float(_lab.cut_time(radius, gravity)), "sequences": case.lab["throws"],
    }  # fmt: skip
    return xr.Dataset(data, attrs=attributes)


def save_contacts(data: xr.Dataset, path: str | Path) -> None:
    """Write contacts as netCDF."""
    with atomic_write(path) as part:
        data.to_netcdf(part, encoding={name: {"zlib": True, "complevel": 4} for name in data})


def open_contacts(path: str | Path) -> xr.Dataset:
    """Contacts from a file that `save_contacts` has written."""
    data = load_measured(path, "contacts")
    if not ({*MEANING} <= set(data) and {*ATTRIBUTES} <= set(data.attrs)):
        raise RockfallError(f"{path}: is not a file of contacts of the laboratory of blocks")
    return data
