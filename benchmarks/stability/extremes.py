# SPDX-License-Identifier: BSD-3-Clause
"""Extreme terrain, scales and impact sets, as cases for `stability.py` and the tests.

The default is an impact set with high rebounds on rough ground of 40 degrees. Local and map
coordinates are equal there, and cells are 2 m, so that points on the side of a cell are exactly on
it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import rockfall
from rockfall.io.rasters.grid import Grid
from scenes import LIVELY_COVARIANCE as COVARIANCE
from scenes import LIVELY_MEAN as MEAN
from scenes import LIVELY_SPREAD as SPREAD
from scenes import write_sets

EPSILON = 2.0**-52
SHAPE = (60, 40)


@dataclass
class Scene:
    """Case on an array of elevations, and the numerical risk that it tests."""

    name: str
    risk: str
    z: np.ndarray
    cell: float = 2.0
    west: float | None = None  # default: local coordinates are map coordinates
    south: float | None = None
    points: list[tuple[float, float]] = field(default_factory=list)  # local [m]; default: scattered
    mean: np.ndarray = field(default_factory=lambda: MEAN)
    covariance: np.ndarray = field(default_factory=lambda: COVARIANCE)
    surface: float = 0.35  # R_m [m]; Inf absorbs
    statuses: set[str] = field(default_factory=set)  # statuses that may occur; empty: any
    groups: dict[str, dict[str, Any]] = field(default_factory=dict)

    @property
    def grid(self) -> Grid:
        ny, nx = self.z.shape
        west = -self.cell / 2 if self.west is None else self.west
        south = -self.cell / 2 if self.south is None else self.south
        return Grid(west, south + ny * self.cell, self.cell, nx, ny)

    @property
    def gravity(self) -> float:
        return self.groups.get("flight", {}).get("gravity", 9.81)

    def case(self, folder: Path, boulders: int = 500, **groups: dict[str, Any]) -> rockfall.Case:
        """Case with at least `boulders` boulders; its impact sets are written to `folder`."""
        alike = np.tile(self.mean, (5, 1)), np.tile(self.covariance, (5, 1, 1))
        write_sets(folder / "sets.nml", *alike)
        points = np.array(self.points or scattered(self))
        release = {
            "x": points[:, 0] + self.grid.west + self.cell / 2,
            "y": points[:, 1] + self.grid.south + self.cell / 2,
            "drop_height": 5.0,
        }
        usual = {
            "case": {"boulders": math.ceil(boulders / len(points)), "title": self.name, "seed": 7},
            "surface": {"mean_radius": "given"},
            "impact": {"sets": "sets.nml", "impact_limit": 1000},
            "boulder": {"volume": "lognormal", "volume_mean": 1.0, "volume_std": 1.0},
            "release": release,
        }
        names = {*usual, *self.groups, *groups}
        merged = {
            name: usual.get(name, {}) | self.groups.get(name, {}) | groups.get(name, {})
            for name in names
        }
        return rockfall.Case(folder=folder, name=self.name, **merged)

    def arrays(self) -> dict[str, Any]:
        """Rasters as arguments of `rockfall.run`."""
        rocks = np.full(self.z.shape, self.surface, "f4")
        return {"dem": self.z, "transform": self.grid, "mean_radius": rocks}

    def size(self, case: rockfall.Case) -> float:
        """Length [m] whose rounding limits double precision: the sum of the highest elevation, the
        height to which a boulder's energy could lift it, the extent of the terrain, and the rise of
        its steepest patch over this extent."""
        z = self.z[np.isfinite(self.z)]
        rises = [np.nanmax(np.abs(np.diff(self.z, axis=axis)), initial=0) for axis in (0, 1)]
        lift = case.release["drop_height"] + sum(
            v * v for v in case.release.get("velocity", [0])
        ) / (2 * self.gravity)
        nodes = max(self.z.shape)
        return float(np.abs(z).max() + np.ptp(z) + lift + (self.cell + sum(rises)) * nodes)


def scattered(scene: Scene) -> list[tuple[float, float]]:
    """Draw 25 points in the upper third of a terrain, away from its edge."""
    ny, nx = (n - 1 for n in scene.z.shape)
    share = np.random.default_rng(4).uniform(0.1, 0.9, (25, 2)) * [1, 0.3] + [0, 0.65]
    return [(x, y) for x, y in share * [nx * scene.cell, ny * scene.cell]]


def nodes(step: float = 0.0) -> list[tuple[float, float]]:
    """Nodes in the upper half of the usual terrain; with `step` [m], points next to them."""
    return [(x + step, y + step) for x, y in itertools.product(range(8, 72, 8), range(60, 110, 8))]


def across(shape: tuple[int, int] = SHAPE) -> tuple[np.ndarray, np.ndarray]:
    """Row from the south and column of each node."""
    row, column = np.mgrid[shape[0] - 1 : -1 : -1, 0 : shape[1]]
    return row.astype(float), column.astype(float)


def plane(gradient: float, cell: float = 2.0) -> np.ndarray:
    """Elevations of a slope that descends to the south."""
    return gradient * cell * across()[0]


def rough(cell: float = 2.0) -> np.ndarray:
    """Elevations of a slope of 40 degrees with bumps at cell scale."""
    return plane(0.84, cell) + np.random.default_rng(3).normal(0, 0.15 * cell, SHAPE)


def diagonal(r_t: float, r_n: float, r_w: float = 1.0) -> dict[str, np.ndarray]:
    """Impact set without scatter that multiplies V_t, V_n and W separately."""
    return {"mean": np.diag([r_t, -r_n, r_w]).ravel(), "covariance": np.zeros((9, 9))}


def conditioned(condition: float) -> np.ndarray:
    """Covariance of the usual size with a given condition number."""
    q, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(9, 9)))
    c = q * np.logspace(0, -math.log10(condition), 9) @ q.T * 0.01
    return (c + c.T) / 2


def scenes() -> list[Scene]:
    """All scenes: terrain first, then scales, then impact sets."""
    return [*_terrain(), *_arcs(), *_scales(), *_sets()]


def _terrain() -> list[Scene]:
    row, column = across()
    odd = (row + column) % 2
    pits = rough() - 4.0 * ((row % 3 == 0) & (column % 3 == 0))
    known = np.full(SHAPE, np.nan)
    known[30:32, 20:22] = [[3.0, 1.0], [2.0, 0.0]]
    east = {"release": {"velocity": [5.0, 0.5, 0.0]}}
    return [
        Scene("step of 1000 m", "tunnels through a wall one cell thick",
              rough() + 1000.0 * (row > 30), points=[(x, 63.0) for x in range(10, 60, 2)],
              groups={"release": {"velocity": [0.0, -3.0, 0.0]}}),
        Scene("wall of 1000 m ahead", "enters the wall",
              rough() + 1000.0 * (row < 20), groups={"release": {"velocity": [0.0, -30.0, 9.0]}}),
        Scene("slope 0", "no descent: a heading is 0/0", plane(0.0), groups=east),
        Scene("slope 0, straight down", "no heading at all", plane(0.0)),
        Scene("slope 1e-12", "descent lost in rounding", plane(2.0**-40), groups=east),
        Scene("slope 45 degrees", "-", plane(1.0)),
        Scene("slope 89.9 degrees", "normal and rate cancel", plane(572.9375),
              groups={"release": {"velocity": [0.0, 0.0, 0.0]}}),
        Scene("saw-tooth of one cell", "hops from tooth to tooth are missed",
              plane(0.84) + 3.0 * (row % 2)),
        Scene("saddles", "the quadratic degenerates, double roots", plane(0.5) + 3.0 * odd),
        Scene("pits", "no way out, endless hops", pits),
        Scene("terraces", "flats and edges in turn", np.floor(rough() / 8) * 8),
        Scene("ridges", "kinks between patches", plane(0.6) + 2.0 * np.abs(row % 8 - 4)),
        Scene("nodata but one patch", "reads nodata", known, points=[(41.0, 57.0)],
              groups={"release": {"drop_height": 1.0}}),
    ]  # fmt: skip


def _arcs() -> list[Scene]:
    row, column = across()
    saddles = 4.0 * ((row + column) % 2)
    crests = nodes(1.0)  # crests of the dome along the diagonal of a patch

    def release(*velocity: float, drop: float = 0.0) -> dict[str, dict[str, Any]]:
        return {"release": {"velocity": list(velocity), "drop_height": drop}}

    return [
        Scene("along edges", "which patch?", rough(), points=nodes(),
              groups=release(0.0, -9.0, 4.0)),
        Scene("through corners", "the walk skips a patch", rough(), points=nodes(),
              groups=release(6.0, -6.0, 5.0)),
        Scene("falls onto corners and edges", "no plan speed: 0/0", rough(),
              points=nodes() + [(x, y + 0.75) for x, y in nodes()], groups=release(drop=50.0)),
        Scene("grazes domes", "a double root is missed", plane(0.0) + saddles,
              points=crests, groups=release(6.0, 6.0, 0.0, drop=1e-12)),
        Scene("starts at rest on the ground", "no first contact", rough(), groups=release()),
        Scene("no quadratic term", "divides by zero", saddles, points=nodes(0.25),
              groups={"flight": {"gravity": 8.0}} | release(2.0, 2.0, 3.0, drop=1.0)),
        Scene("almost no plan speed", "1/v overflows", rough(),
              groups=release(1e-300, -1e-290, 0.0, drop=5.0)),
    ]  # fmt: skip


def _scales() -> list[Scene]:
    def lift(**groups: dict[str, Any]) -> dict[str, Any]:
        return {"groups": groups}

    slow = {"impact": {"stop_speed": 1e-9}}
    volumes = {"volume": "fixed", "volume_std": None}
    return [
        Scene("cells of 0.1 m", "0.1 is no binary number", rough(0.1), cell=0.1),
        Scene("cells of 100 m", "long flights", rough(100.0), cell=100.0),
        Scene("elevations at 1e6 m", "cancellation", rough() + 1e6),
        Scene("UTM coordinates at 1e7 m", "cancellation", rough(), west=5e5 - 1, south=1e7 - 1),
        Scene("gravity 0.1", "-", rough(), **lift(flight={"gravity": 0.1})),
        Scene("gravity 100", "-", rough(), **lift(flight={"gravity": 100.0})),
        Scene("released at 1e-6 m/s", "taken for rest", rough(),
              **lift(release={"velocity": [0.0, -1e-6, 0.0], "drop_height": 0.0}, **slow)),
        Scene("from 1e-6 to 1e-12 m/s", "hops below rounding", plane(0.125),
              **lift(flight={"gravity": 0.1},
                     impact={"stop_speed": 1e-12},
                     release={"velocity": [0.0, 1e-6, 1e-6], "drop_height": 0.0})),
        Scene("released at 1000 m/s", "passes through a bump", rough(100.0), cell=100.0,
              **lift(release={"velocity": [100.0, 900.0, 420.0]})),
        Scene("boulders of 1e-9 m3", "energies underflow", rough(),
              **lift(boulder={**volumes, "volume_mean": 1e-9})),
        Scene("boulders of 1e6 m3", "energies overflow", rough(),
              **lift(boulder={**volumes, "volume_mean": 1e6})),
        Scene("R_b/R_m = 1e-3", "no set for it", rough(), surface=620.0),
        Scene("R_b/R_m = 1e4", "no set for it", rough(), surface=6.2e-5),
        Scene("R_m = Inf", "Inf in the ratio", rough(), surface=math.inf, statuses={"absorbed"}),
    ]  # fmt: skip


def _sets() -> list[Scene]:
    row, column = across()
    bowl = 0.01 * ((2 * row - 59) ** 2 + (2 * column - 39) ** 2)
    rank = np.outer(SPREAD, SPREAD)
    twins = conditioned(10.0)
    twins[3], twins[:, 3] = twins[0], twins[:, 0]
    never = {"mean": np.array([1.5, 0, 0, 0, 5.0, 0, 0, 0, 1.5]), "covariance": np.zeros((9, 9))}
    return [
        *(Scene(f"covariance of condition 1e{k}", "the factor fails", rough(),
                covariance=conditioned(10.0**k)) for k in (0, 8, 16)),
        Scene("covariance of rank 1", "the factor fails", rough(), covariance=rank),
        Scene("two rows perfectly correlated", "the factor fails", rough(), covariance=twins),
        Scene("covariance 0", "the factor fails", rough(), covariance=np.zeros((9, 9))),
        Scene("no admissible draw", "endless drawing", rough(), **never),
        Scene("R_t, R_n = 1 in a bowl", "energy drifts", bowl, **diagonal(1.0, 1.0),
              statuses={"impact_limit", "left_domain"}),
        Scene("R_t, R_n = 0.9999 in a bowl", "energy drifts", bowl, **diagonal(0.9999, 0.9999)),
        Scene("R_n = 1e-9, R_t = 1", "ever shorter hops", plane(0.84), **diagonal(1.0, 1e-9)),
        Scene("R_n = 0.5, R_t = 1", "ever shorter hops", plane(0.84), **diagonal(1.0, 0.5)),
        Scene("R_n = 0.5, R_t = 0.99 on the flat", "ever shorter hops", plane(0.0),
              **diagonal(0.99, 0.5), groups={"release": {"velocity": [9.0, 0.0, 0.0]}}),
        Scene("R_n = 0, R_t = 1", "V_n = 0 for ever", plane(0.84), **diagonal(1.0, 0.0)),
        Scene("gains energy in the mean", "runs away", rough(), mean=1.6 * MEAN),
    ]  # fmt: skip
