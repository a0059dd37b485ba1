# SPDX-License-Identifier: BSD-3-Clause
"""Drive the laboratory: pack layers, fire impacts in chunks, keep what is done."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall._lab import lab_f2py as _lab
from rockfall.errors import RockfallError
from rockfall.files import whole_file
from rockfall.interrupts import interrupts
from rockfall.lab.case import LabCase, lab_case_of, names
from rockfall.progress import progress_bar
from rockfall.simulate import MOST_THREADS, check_team

if TYPE_CHECKING:
    import xarray as xr

STATUS = {"not_done": 0, "rebounded": 1, "lifted": 2, "captured": 3, "exploded": 4, "misfit": 5}
SHOTS_IN_CHUNK = 128  # a call of the kernel with one thread, about a second
SAVE_SECONDS = 60.0  # between savings of a long experiment

UNITS = dict.fromkeys(("vt_in", "vn_in", "w_in", "vt_out", "vn_out", "w_out", "speed"), "m s-1")
UNITS |= {"angle": "degree", "duration": "s", "travel": "m", "depth": "m"}
UNITS |= {"surface": "m", "top": "m"}
MEANING = {
    "speed": "speed of the sphere before the impact",
    "angle": "angle of its path from the surface, 90 = vertical",
    "spin": "W/V before the impact, W = R_b omega",
    "aim": "where the path meets the mean surface, of the width of the layer",
    "vt_in": "V_t before the impact, along the surface",
    "vn_in": "V_n before the impact, positive away from the surface",
    "w_in": "W before the impact",
    "vt_out": "V_t when the upward kinetic energy was greatest",
    "vn_out": "V_n when the upward kinetic energy was greatest",
    "w_out": "W when the upward kinetic energy was greatest",
    "duration": "from the first contact until then",
    "travel": "way along the surface until then",
    "depth": "deepest point of the sphere below the mean surface",
    "overlap": "deepest overlap of two bodies over the smaller radius",
    "status": "how the impact ended",
    "trouble": "what stopped it, if it exploded",
    "halvings": "times the step was halved",
    "steps": "time steps",
    "surface": "mean height of the layer's surface",
    "top": "highest point of the layer",
    "solid": "area of the spheres over that below the mean surface",
    "floor_share": "force of the floor over the weight of the layer",
}


class Layers:
    """Settled layers, as the kernel takes them."""

    def __init__(self, x: np.ndarray, radius: np.ndarray, bodies: np.ndarray, facts: np.ndarray):
        self.x, self.radius, self.bodies, self.facts = x, radius, bodies, facts

    def __len__(self) -> int:
        return len(self.bodies)

    def one(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Centres (n, 2) and radii (n,) of the bodies of layer k [m], and its facts."""
        n = self.bodies[k]
        return self.x[:, :n, k].T, self.radius[:n, k], self.facts[:, k]


def pack_layers(case: LabCase, first: int = 1, count: int = 1, threads: int = 0) -> Layers:
    """Layers `first` to `first + count - 1` of the case's seed, let fall and settled."""
    room, code, message = _lab.room_for_layer(case.row(2))
    _raise(case, code, message)
    *arrays, code, message = _lab.pack(
        case.row(1), case.row(2), seed=case.lab["seed"], first=first,
        threads=_checked(threads), room=room, n=count,
    )  # fmt: skip
    _raise(case, code, message)
    return Layers(*arrays)


def run_impacts(
    case: LabCase,
    *,
    progress: bool = False,
    threads: int = 0,
    path: str | Path | None = None,
    resume: bool = False,
) -> xr.Dataset:
    """All impacts of a case: an xarray.Dataset over (ratio, point, impact).

    With `path` it is also a file, saved every minute, at the end, and on Ctrl-C, which raises
    KeyboardInterrupt; `resume` goes on from such a file. The result does not depend on threads,
    interruptions or resumptions.
    """
    if path is not None and resume and Path(path).exists():
        data = open_impacts(path)
        if lab_case_of(data.attrs["lab_case"], str(path)) != case:
            raise RockfallError(f"{path}: is of another laboratory case: cannot resume")
        if data.attrs["version"] != _version():
            raise RockfallError(f"{path}: is of another version of rockfall: cannot resume")
    else:
        data = _blank(case)
    total = data["status"].size
    saved = time.monotonic()
    with interrupts() as interrupted, progress_bar(total, progress, "impacts") as advance:
        advance(int((data["status"].values > 0).sum()))
        for done in _chunks(case, data, _checked(threads), interrupted):
            advance(done)
            if path is not None and time.monotonic() - saved > SAVE_SECONDS:
                save_impacts(data, path)
                saved = time.monotonic()
        if path is not None:
            save_impacts(data, path)
    if not (data["status"].values > 0).all():
        raise KeyboardInterrupt
    return data


def film(
    case: LabCase, ratio: float, point: int, speed: float, angle: float, frames: int = 200,
    interval: float = 1e-3,
) -> dict[str, Any]:  # fmt: skip
    """One impact without spin, with pictures every `interval` seconds: time (frames,), centres
    (frames, n, 2) [m] and velocities (frames, n, 3) of all bodies, the sphere last, their radius,
    the layer's `surface` [m] and the `outcome`."""
    layers = pack_layers(case, first=point)
    shot = dict(zip(names(3), case.row(3, ratio), strict=True))
    shot |= {"speed": speed, "angle": angle, "spin": 0.0}
    n = layers.bodies[0]
    taken, time_, x, v, outcome, counts, code, message = _lab.film(
        case.row(1), case.row(2), list(shot.values()), layers.x[:, :n, 0], layers.radius[:n, 0],
        layers.facts[:, 0], interval, most=frames,
    )  # fmt: skip
    _raise(case, code, message)
    return {
        "time": time_[:taken],
        "centres": x.T[:taken],
        "velocities": v.T[:taken],
        "radius": np.append(layers.radius[:n, 0], shot["radius"]),
        "surface": layers.facts[0, 0],
        "outcome": dict(zip(names(5) + names(6), [*outcome, *counts], strict=True)),
    }


def save_impacts(data: xr.Dataset, path: str | Path) -> None:
    """Write impacts as netCDF."""
    with whole_file(path) as part:
        data.to_netcdf(part, encoding={name: {"zlib": True, "complevel": 1} for name in data})


def open_impacts(path: str | Path) -> xr.Dataset:
    """Impacts from a file that `run_impacts` has written."""
    import xarray as xr

    try:
        data = xr.load_dataset(path)
    except FileNotFoundError as error:
        raise RockfallError(f"{path}: cannot be read: no such file") from error
    except (OSError, ValueError, RuntimeError) as error:
        raise RockfallError(f"{path}: is not a netCDF file of impacts: {error}") from error
    wanted = {*names(5), *names(6), *names(7)[:-1]}
    told = {"title", "lab_case", "version", "cpu_seconds"}
    if not (wanted <= set(data) and told <= set(data.attrs)):
        raise RockfallError(f"{path}: is not a file of impacts")
    return data


def checksum(data: xr.Dataset) -> str:
    """SHA-256 of all numbers of the outcomes."""
    digest = hashlib.sha256()
    for name in (*names(5), *names(6)):
        digest.update(np.ascontiguousarray(data[name].values).tobytes())
    return digest.hexdigest()


def _blank(case: LabCase) -> xr.Dataset:
    """Nothing done yet."""
    import xarray as xr

    plan = case.lab
    sizes = len(plan["ratios"]), plan["points"], plan["impacts"]
    dims = "ratio", "point", "impact"
    try:
        data = {name: (dims, np.full(sizes, np.nan), _about(name)) for name in names(5)}
        data |= {name: (dims, np.zeros(sizes, "i4"), _about(name)) for name in names(6)}
    except (MemoryError, ValueError) as error:
        about = f"{case.name}: {np.prod(sizes)} impacts"
        raise RockfallError(f"{about} do not fit in memory") from error
    for name in names(7)[:-1]:
        data[name] = ("point", np.full(plan["points"], np.nan), _about(name))
    flags = {"flag_values": np.array(list(STATUS.values()), "i4")}
    data["status"][2].update(flags | {"flag_meanings": " ".join(STATUS)})
    attributes = {"title": plan["title"], "lab_case": case.text(), "version": _version()}
    attributes["cpu_seconds"] = 0.0
    ratios = {"ratio": ("ratio", plan["ratios"], {"long_name": "R_b/R_m"})}
    return xr.Dataset(data, ratios, attributes)


def _about(name: str) -> dict[str, Any]:
    return {"units": UNITS.get(name, "1"), "long_name": MEANING[name]}


def _chunks(
    case: LabCase, data: xr.Dataset, threads: int, interrupted: Callable[[], bool]
) -> Iterator[int]:
    """Do what is not done, some points at a time, a layer for each; yields how many impacts."""
    size = max(1, SHOTS_IN_CHUNK * max(1, _lab.team(threads)) // case.lab["impacts"])
    status = data["status"].values
    for first in range(0, case.lab["points"], size):
        points = slice(first, min(first + size, case.lab["points"]))
        if (status[:, points] > 0).all():
            continue
        if interrupted():
            return
        clock = time.process_time()
        layers = pack_layers(case, first + 1, points.stop - first, threads)
        for name, values in zip(names(7)[:-1], layers.facts, strict=False):
            data[name].values[points] = values
        data.attrs["cpu_seconds"] += time.process_time() - clock
        for k, ratio in enumerate(case.lab["ratios"]):
            if (status[k, points] > 0).all():
                continue
            if interrupted():
                return
            clock = time.process_time()
            _fire(case, data, layers, k, ratio, points, threads)
            data.attrs["cpu_seconds"] += time.process_time() - clock
            yield status[k, points].size


def _fire(
    case: LabCase, data: xr.Dataset, layers: Layers, k: int, ratio: float, points: slice,
    threads: int,
) -> None:  # fmt: skip
    """All impacts of a ratio at some points, into their places."""
    each = case.lab["impacts"]
    place = np.repeat(np.arange(1, len(layers) + 1, dtype="i4"), each)
    layer = place.astype("i8") + points.start
    outcome, counts, code, message = _lab.impact(
        case.row(1), case.row(2), case.row(3, ratio), case.row(4), seed=case.lab["seed"],
        threads=threads, x=layers.x, radius=layers.radius, bodies=layers.bodies,
        facts=layers.facts, place=place, layer=layer, point=np.ones_like(layer),
        number=np.tile(np.arange(1, each + 1, dtype="i8"), len(layers)),
    )  # fmt: skip
    _raise(case, code, message)
    for name, values in zip(names(5) + names(6), [*outcome, *counts], strict=True):
        data[name].values[k, points] = values.reshape(-1, each)


def _version() -> str:
    from rockfall import __version__

    return __version__


def _checked(threads: int) -> int:
    if not 0 <= threads <= MOST_THREADS:
        raise RockfallError(f"threads = {threads}: must be 0 (all cores) to {MOST_THREADS}")
    check_team(threads)
    return threads


def _raise(case: LabCase, code: int, message: bytes) -> None:
    if code:
        raise RockfallError(f"{case.name}: {message.decode().strip()}", code)
