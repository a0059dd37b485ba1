# SPDX-License-Identifier: BSD-3-Clause
"""Detection of a finished hazard, which `--resume` leaves unchanged."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.analysis.objects.objects import Objects
from rockfall.analysis.objects.segments import Segments
from rockfall.case import Case, case_in
from rockfall.errors import RockfallError
from rockfall.io.netcdf import open_netcdf
from rockfall.result.dataset import DAMAGED
from rockfall.scene.scene import Scene
from rockfall.version import __version__

ENERGIES = np.geomspace(1.0, 1e9, 64)  # energies for comparing curves [J]


def layers_checksum(objects: Objects, segments: Segments) -> str:
    """SHA-256 checksum of the objects (with attributes and vulnerability curves) and segments as
    read."""
    harms = [
        (quantity, harm and (harm.scale, harm.length, harm.curve.fraction(ENERGIES).tolist()))
        for quantity, all_harms in objects.exposed.harms.items()
        for harm in all_harms
    ]
    steps = None if objects.vulnerability is None else objects.vulnerability.tolist()
    values = objects.exposure.tolist(), objects.value.tolist(), steps, objects.exposed.assumptions
    names = objects.names, objects.layers, objects.exposed.kinds, segments.labels
    shapes = [shape.wkb_hex for shape in objects.shapes]
    lines = objects.lines, segments.lines
    return hashlib.sha256(repr((shapes, names, values, harms, lines)).encode()).hexdigest()


def is_finished(path: Path, case: Case, scene: Scene, objects: Objects, segments: Segments) -> bool:
    """Return True if a file is a hazard made from this case and these inputs by this version;
    False for other or damaged files."""
    expected = {
        "version": __version__,
        "input_checksums": json.dumps(scene.checksums, sort_keys=True),
        "decoded_checksums": json.dumps(scene.decoded, sort_keys=True),
        "layers_checksum": layers_checksum(objects, segments),
    }
    try:
        with open_netcdf(path) as file:
            attrs = {name: file.getncattr(name) for name in file.ncattrs()}
        is_same = all(attrs.get(name) == value for name, value in expected.items())
        return is_same and is_same_case(case_in(attrs), case)
    except (RockfallError, *DAMAGED):
        return False


def is_same_case(case: Case, other: Case, **without: Any) -> bool:
    """Return True if two cases are equal, apart from threads and the keys in `without`."""
    changes = {"case": {"threads": 0}} | without
    return case.replace(**changes).text() == other.replace(**changes).text()
