# SPDX-License-Identifier: BSD-3-Clause
"""Detection of finished outputs, which `--resume` and a repeated `merge` leave unchanged."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rockfall.case import case_in
from rockfall.errors import RockfallError
from rockfall.io.netcdf import open_netcdf
from rockfall.result.dataset import DAMAGED, open_result
from rockfall.result.validate import check_result
from rockfall.scene.scene import Scene
from rockfall.simulation.parts.part_file import read_part
from rockfall.simulation.simulate import start
from rockfall.simulation.tally import Origin, origin_of

#: Message about an output that stays unchanged.
FINISHED = "already contains the finished run of this case: nothing was changed"


def contains_run(path: Path, scene: Scene, shard: tuple[int, int] = (1, 1)) -> bool:
    """Return True if a file contains the finished run of a scene, or of its shard."""
    empty = start(scene, threads=1, shard=shard)
    boulders = range(empty.before + 1, empty.before + empty.boulders + 1)
    return is_finished(path, origin_of(empty), boulders)


def is_finished(path: Path, origin: Origin, boulders: range) -> bool:
    """Return True if a file contains exactly these boulders (from 1) of a run: a part, or the
    result if they are all boulders. False for other or damaged files."""
    try:
        with open_netcdf(path) as file:
            attrs = {name: file.getncattr(name) for name in file.ncattrs()}
        if "part_layout" in attrs:
            part = read_part(path)
            return len(boulders) < origin.boulders and _is_same(
                origin, part.origin, boulders, range(part.first, part.last + 1)
            )
        with open_result(path) as data:
            check_result(data, path)
        theirs = range(int(attrs["boulder_first"]), int(attrs["boulder_last"]) + 1)
        return _is_same(origin, _origin(attrs, origin), boulders, theirs)
    except (RockfallError, *DAMAGED):
        return False


def _is_same(origin: Origin, other: Origin, boulders: range, theirs: range) -> bool:
    return theirs == boulders and not origin.difference(other, boulders, theirs)


def _origin(attrs: Mapping[str, Any], origin: Origin) -> Origin:
    """Origin of a result; its grid follows from its case and inputs."""
    return replace(
        origin,
        case=case_in(attrs),
        boulders=int(attrs["boulders_requested"]),
        checksums=json.loads(attrs["input_checksums"]),
        decoded=json.loads(attrs["decoded_checksums"]),
        version=str(attrs["version"]),
    )
