# SPDX-License-Identifier: BSD-3-Clause
"""Laboratory experiments: pack layers, simulate impacts in chunks, save the results."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.errors import RockfallError, check_kernel
from rockfall.interrupts import interrupts
from rockfall.io.atomic import atomic_write
from rockfall.io.netcdf import load_dataset, write_compressed
from rockfall.simulation.progress import progress_bar
from rockfall.simulation.simulate import check_team
from rockfall.version import __version__
from rockfall_lab._lab import lab_f2py as _lab
from rockfall_lab.case import LabCase, lab_case_of, names

if TYPE_CHECKING:
    import xarray as xr

STATUS = {name: k for k, name in enumerate(("not_done", *names("status")))}
ENDED = "rebounded", "lifted", "rolled_on"  # results; other impacts are counted, not averaged
STATES = {
    "peak": "at the max upward kinetic energy, at the end if there was none",
    "loss": "at the first loss of contact upwards, as at the peak if there was none",
    "clear": "when nothing lay in the way, as at the peak if that never was",
}
SHOTS_IN_CHUNK = 16  # shots per thread and kernel call, some seconds
SAVE_SECONDS = 30.0  # time between saves of a long experiment

UNITS = {"speed": "m s-1", "angle": "degree", "duration": "s", "travel": "m", "depth": "m"}
UNITS |= {"surface": "m", "top": "m", "width": "m"}
MEANING = {
    "speed": "speed of the sphere before the impact",
    "angle": "angle of its path from the surface, 90 = vertical",
    "spin": "W/V before the impact, W = R_b omega",
    "aim_x": "where the path meets the mean surface, of the width of the layer",
    "aim_y": "where the path meets the mean surface, of the width of the layer",
    "heading_x": "unit vector of the path in plan",
    "heading_y": "unit vector of the path in plan",
    "duration": "from the first contact until the peak",
    "travel": "distance along the heading until then",
    "depth": "deepest point of the sphere below the mean surface",
    "overlap": "deepest overlap of two bodies over the smaller radius",
    "status": "how the impact ended",
    "trouble": "what stopped it, if it exploded",
    "halvings": "times the step was halved",
    "steps": "time steps",
    "surface": "mean height of the layer's surface",
    "top": "highest point of the layer",
    "solid": "volume of the spheres over that below the mean surface",
    "width": "width of the periodic box",
    "floor_share": "force of the floor over the weight of the layer",
}
for _symbol, _meaning in {
    "vt": "V_t, horizontal speed, < 0 thrown back",
    "vn": "V_n, positive away from the surface",
    "w": "W = R_b omega about the horizontal normal of V_t",
    "lateral": "sine of the angle of V_t from the heading before, left > 0",
}.items():
    for _state, _when in {"in": "before the impact", **STATES}.items():
        MEANING[f"{_symbol}_{_state}"] = f"{_meaning}, {_when}"
        UNITS[f"{_symbol}_{_state}"] = "1" if _symbol == "lateral" else "m s-1"


class Layers:
    """Settled layers, in the form used by the kernel."""

    def __init__(self, x: np.ndarray, radius: np.ndarray, bodies: np.ndarray, facts: np.ndarray):
        self.x, self.radius, self.bodies, self.facts = x, radius, bodies, facts

    def __len__(self) -> int:
        return len(self.bodies)

    def one(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Centres (n, 3) and radii (n,) of the bodies of layer k [m], and its properties."""
        n = self.bodies[k]
        return self.x[:, :n, k].T, self.radius[:n, k], self.facts[:, k]


def pack_layers(
    case: LabCase, ratio: float, first: int = 1, count: int = 1, threads: int = 0
) -> Layers:
    """Pack layers `first` to `first + count - 1` of the case's seed: rocks that are dropped and
    settle, deep and wide enough for a boulder of a given R_b/R_m."""
    check_team(threads)
    room, code, message = _lab.room_for_layer(case.row("packing", ratio))
    check_kernel(code, message, case.name)
    *arrays, code, message = _lab.pack(
        case.row("material"), case.row("packing", ratio), seed=case.lab["seed"], first=first,
        threads=threads, room=room, n=count,
    )  # fmt: skip
    check_kernel(code, message, case.name)
    return Layers(*arrays)


def run_impacts(
    case: LabCase,
    *,
    progress: bool = False,
    threads: int = 0,
    path: str | Path | None = None,
    resume: bool = False,
) -> xr.Dataset:
    """Simulate all impacts of a case: an xarray.Dataset over (ratio, layer, point, impact).

    With `path`, the dataset is also written to a file every half minute, at the end, and on Ctrl-C,
    which raises KeyboardInterrupt; `resume` continues from such a file, and raises a RockfallError
    for a file of another case or version. The result does not depend on threads, interruptions or
    resumptions.
    """
    check_team(threads)
    if path is not None and resume and Path(path).exists():
        data = open_impacts(path)
        if lab_case_of(data.attrs["lab_case"], str(path)) != case:
            raise RockfallError(f"{path}: is of another laboratory case: cannot resume")
        if data.attrs["version"] != __version__:
            raise RockfallError(f"{path}: is of another version of rockfall: cannot resume")
    else:
        data = _blank(case)
    total = data["status"].size
    if (data["status"].values > 0).all():
        return data
    saved = time.monotonic()
    with interrupts() as interrupted, progress_bar(total, progress, "impacts") as advance:
        advance(int((data["status"].values > 0).sum()))
        for done in _chunks(case, data, threads, interrupted):
            advance(done)
            if path is not None and time.monotonic() - saved > SAVE_SECONDS:
                save_impacts(data, path)
                saved = time.monotonic()
        if path is not None:
            save_impacts(data, path)
    if not (data["status"].values > 0).all():
        raise KeyboardInterrupt
    return data


def save_impacts(data: xr.Dataset, path: str | Path) -> None:
    """Write impacts as netCDF."""
    with atomic_write(path) as part:
        write_compressed(data, part, 1)


def load_measured(path: str | Path, what: str) -> xr.Dataset:
    """Load a netCDF file of the laboratory; `what` describes its contents in messages. Raises a
    RockfallError if it cannot be read."""
    try:
        data = load_dataset(path)
    except RockfallError:
        raise
    except FileNotFoundError as error:
        raise RockfallError(f"{path}: cannot be read: no such file") from error
    except (OSError, ValueError, RuntimeError) as error:
        raise RockfallError(f"{path}: is not a netCDF file of {what}: {error}") from error
    return data


def open_impacts(path: str | Path) -> xr.Dataset:
    """Read impacts from a file written by `run_impacts`; raises a RockfallError for other files."""
    data = load_measured(path, "impacts")
    variables = {*names("outcome"), *names("outcome_counts"), *names("layer")[:-1]}
    attributes = {"title", "lab_case", "version", "cpu_seconds"}
    if not (variables <= set(data) and attributes <= set(data.attrs)):
        raise RockfallError(f"{path}: is not a file of impacts")
    return data


def checksum(data: xr.Dataset) -> str:
    """SHA-256 of all numbers of the outcomes."""
    digest = hashlib.sha256()
    for name in (*names("outcome"), *names("outcome_counts")):
        digest.update(np.ascontiguousarray(data[name].values).tobytes())
    return digest.hexdigest()


def _blank(case: LabCase) -> xr.Dataset:
    """Empty dataset of an experiment; refuses one that does not fit in memory."""
    import xarray as xr

    plan = case.lab
    sizes = len(plan["ratios"]), plan["layers"], plan["points"], plan["impacts"]
    dims = "ratio", "layer", "point", "impact"
    try:
        data: dict[str, tuple] = {
            name: (dims, np.full(sizes, np.nan), _about(name)) for name in names("outcome")
        }
        data |= {
            name: (dims, np.zeros(sizes, "i4"), _about(name)) for name in names("outcome_counts")
        }
    except (MemoryError, ValueError) as error:
        text = f"{case.name}: {math.prod(sizes)} impacts"
        raise RockfallError(f"{text} do not fit in memory") from error
    for name in names("layer")[:-1]:
        data[name] = (dims[:2], np.full(sizes[:2], np.nan), _about(name))
    flags = {"flag_values": np.array(list(STATUS.values()), "i4")}
    data["status"][2].update(flags | {"flag_meanings": " ".join(STATUS)})
    attributes = {"title": plan["title"], "lab_case": case.text(), "version": __version__}
    attributes["cpu_seconds"] = 0.0
    ratios = {"ratio": ("ratio", plan["ratios"], {"long_name": "R_b/R_m"})}
    return xr.Dataset(data, ratios, attributes)


def _about(name: str) -> dict[str, Any]:
    return {"units": UNITS.get(name, "1"), "long_name": MEANING[name]}


def _chunks(
    case: LabCase, data: xr.Dataset, threads: int, interrupted: Callable[[], bool]
) -> Iterator[int]:
    """Simulate the remaining impacts, one layer per thread at a time. Yield the number done in each
    chunk."""
    team = max(1, _lab.team(threads))
    status = data["status"].values
    for k, ratio in enumerate(case.lab["ratios"]):
        for first in range(0, case.lab["layers"], team):
            these = slice(first, min(first + team, case.lab["layers"]))
            todo = np.argwhere(status[k, these] == 0)  # indices of layer, point, impact
            if not todo.size:
                continue
            if interrupted():
                return
            clock = time.process_time()
            layers = pack_layers(case, ratio, first + 1, these.stop - first, threads)
            for name, values in zip(names("layer")[:-1], layers.facts, strict=False):
                data[name].values[k, these] = values
            data.attrs["cpu_seconds"] += time.process_time() - clock
            for shots in np.array_split(todo, -(-len(todo) // (SHOTS_IN_CHUNK * team))):
                if interrupted():
                    return
                clock = time.process_time()
                _fire(case, data, layers, k, first, shots, threads)
                data.attrs["cpu_seconds"] += time.process_time() - clock
                yield len(shots)


def _fire(
    case: LabCase, data: xr.Dataset, layers: Layers, k: int, first: int, shots: np.ndarray,
    threads: int,
) -> None:  # fmt: skip
    """Simulate the impacts `shots` (n, 3: layer, point, impact) at ratio k, into `data`."""
    ratio = case.lab["ratios"][k]
    place, point, number = (shots + 1).T.astype("i8")
    outcome, counts, code, message = _lab.impact(
        case.row("material"), case.row("packing", ratio), case.row("shot", ratio),
        case.row("range"), seed=case.lab["seed"], threads=threads, x=layers.x,
        radius=layers.radius, bodies=layers.bodies, facts=layers.facts, place=place.astype("i4"),
        layer=place + first, point=point, number=number,
    )  # fmt: skip
    check_kernel(code, message, case.name)
    at = (k, shots[:, 0] + first, shots[:, 1], shots[:, 2])
    for name, values in zip(
        names("outcome") + names("outcome_counts"), [*outcome, *counts], strict=True
    ):
        data[name].values[at] = values
