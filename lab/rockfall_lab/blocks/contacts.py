# SPDX-License-Identifier: BSD-3-Clause
"""Simulation of block throws, and records of their contacts."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import check_kernel
from rockfall.grounds.relief import patches
from rockfall.interrupts import interrupts
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.simulate import check_team
from rockfall_lab._lab import lab_f2py as _lab
from rockfall_lab.blocks.case import BlockCase
from rockfall_lab.contact_records import contact_columns, contact_dataset

if TYPE_CHECKING:
    import xarray as xr

THROWS_IN_CHUNK = 256  # throws per thread in a chunk: about a second


def run_throws(
    case: BlockCase, *, progress: bool = False, threads: int = 0, step: float = 1.0
) -> xr.Dataset:
    """Simulate a case and return all contacts, throw by throw: an xarray.Dataset over `contact`.

    Velocities are relative to |V_in|, lengths to R_b. The result does not depend on threads. Raises
    KeyboardInterrupt on Ctrl-C.
    """
    check_team(threads)
    surfaces = case.surfaces()
    heights, width = patches(case.spectrum(), case.ground["patches"], case.lab["seed"])
    radius, density = case.block["radius"], case.block["density"]
    block = {
        "radius": radius, "density": density,
        "x": np.concatenate([surface.vertices for surface in surfaces]).T,
        "corner": np.concatenate([surface.triangles for surface in surfaces]).T + 1,
        "vertices": [len(surface.vertices) for surface in surfaces],
        "facets": [len(surface.triangles) for surface in surfaces],
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
            rows, counts, n_contacts, complete, inertia, code, message = _lab.throw(
                case.row("ground"), case.row("throw"), **block, **ground, **plan, first=first,
                threads=threads, n=n,
            )  # fmt: skip
            check_kernel(code, message, case.name)
            numbers = np.arange(first, first + n)
            parts.append(contact_columns(rows, counts, n_contacts, numbers, "block"))
            unfinished += int((complete == 0).sum())
            advance(n)
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    attributes = {
        "title": case.lab["title"], "lab_case": case.text(),
        "ground": case.lab["ground"], "shape": case.lab["shape"], "density": density,
        "yield_pressure": case.ground["yield_pressure"],
        "rest_angle": case.ground["rest_angle"], "sequences": total,
        "inertia_factor": float(inertia.mean()), "unfinished": unfinished,
        "cpu_seconds": time.process_time() - clock,
    }  # fmt: skip
    return contact_dataset(columns, radius, case.throw["gravity"], attributes)
