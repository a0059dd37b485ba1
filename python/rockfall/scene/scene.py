# SPDX-License-Identifier: BSD-3-Clause
"""Checked inputs of a run: a case, and the rasters and sources that it names."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.grounds import GroundRule
from rockfall.io.grid import Grid, row_blocks
from rockfall.scene.coefficients import Coefficients, SetFile
from rockfall.scene.forest.trees import Trees
from rockfall.scene.ground import Ground, Lowest, ground_of
from rockfall.scene.kernel_scene import KernelScene
from rockfall.terrain.dams import DamShape

if TYPE_CHECKING:
    from rockfall.scene.windows import Windows


class SourceBoulders(NamedTuple):
    """Boulder properties given by the sources."""

    volume: np.ndarray  # [m3]
    inertia: np.ndarray  # I/(m R**2) [-]
    density: np.ndarray | None = None  # [kg/m3]; None: that of the case

    def of(self, sources: np.ndarray) -> SourceBoulders:
        """Select sources, counted from 0."""
        density = None if self.density is None else self.density[sources]
        return SourceBoulders(self.volume[sources], self.inertia[sources], density)


class Features(NamedTuple):
    """Polygons or points of a source layer, and their release attributes."""

    names: list[str]
    of: np.ndarray  # int32: feature of each source, from 1
    law: np.ndarray | None = None  # int32: distribution, from 1; 0: case's; None: not given
    value: np.ndarray | None = None  # (features, 9): `sources.attributes.VALUES`, or NaN

    def at(self, sources: np.ndarray) -> Features:
        """Select sources, counted from 0."""
        return self._replace(of=self.of[sources])


class InputWarning(NamedTuple):
    """An input that is likely a mistake."""

    where: str  # file, group and key, with the names used in the case
    text: str  # its literal meaning, and what may have been meant; reports translate it


@dataclass
class Scene:
    """Checked inputs of a run. Rasters are (ny, nx), row 0 the northernmost."""

    case: Case
    grid: Grid
    z: np.ndarray  # elevations [m], NaN = none
    sizes: np.ndarray  # (materials, 1 or 3): R_m, or Rg70, Rg20, Rg10 [m]
    zone: np.ndarray | None = None  # int8 or int16: 1-based row of `sizes`
    values: np.ndarray | None = None  # float32 (1 or 3, ny, nx): sizes of each cell [m]
    x: np.ndarray = field(default_factory=lambda: np.empty(0))  # of each source [m]
    y: np.ndarray = field(default_factory=lambda: np.empty(0))
    area: np.ndarray | None = None  # surface over plan area of each, for release by area
    frequency: np.ndarray | None = None  # weight of each source in boulders_total
    features: Features | None = None  # of the source layer
    source_boulders: SourceBoulders | None = None  # where sources define their boulders
    trees: Trees | None = None
    sets: SetFile = SetFile(b"", "")
    grounds: tuple[GroundRule, ...] = ()  # only if any differs from the impact sets
    material_ground: np.ndarray | None = None  # int8: 1-based ground of each row of `sizes`, or
    cell_ground: np.ndarray | None = None  # int8 (ny, nx): of each cell; neither: the first
    ground_ids: dict[int, str] = field(default_factory=dict)  # names by id in a ground raster
    checksums: dict[str, str] = field(default_factory=dict)  # of the input files
    decoded: dict[str, str] = field(default_factory=dict)  # checksums: see `digest`
    at: tuple[int, int] = (0, 0)  # row and column of the grid at which its rasters begin
    windows: Windows | None = None  # terrain read in windows: no rasters here
    source_values: Lowest = field(default_factory=Lowest)  # negative values of the source cells
    remarks: list[str] = field(default_factory=list)  # remarks of the readers, one line each
    dams: list[DamShape] = field(default_factory=list)  # as rasterised
    warnings: list[InputWarning] | None = None  # see `plausible.input_warnings`; None: not checked

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute and drop the kernel's scene, which was built from the old values."""
        if name != "warnings":  # not used by the kernel
            self.__dict__.pop("kernel", None)
            self.__dict__.pop("boulders", None)
        self.__dict__[name] = value

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in self.__dict__.items() if key != "kernel"}

    @cached_property
    def boulders(self) -> int:
        """Number of boulders of the complete run."""
        return int(_core.boulders(self.kernel.handle))

    @cached_property
    def kernel(self) -> KernelScene:
        """The scene in the kernel, built on first use."""
        return KernelScene(self)

    @cached_property
    def coefficients(self) -> Coefficients:
        """Numbers of its impact sets."""
        return self.sets.read(self.case.impact["turning"])[0]

    @cached_property
    def ground(self) -> Ground:
        """Ground statistics of its terrain."""
        return self.windows.ground if self.windows else ground_of(self)

    @property
    def weight(self) -> np.ndarray | None:
        """Weight of each source in the number of boulders; None if all are equal."""
        total = "boulders_total" in self.case.case
        return self.frequency if total and self.frequency is not None else self.area

    def source_of(self, number: int) -> int:
        """The source of a boulder (1..), counted from 0."""
        return int(self.sources_of(np.array([number]))[0])

    def sources_of(self, numbers: np.ndarray) -> np.ndarray:
        """The sources of boulders (1..), counted from 0."""
        return _core.sources_of_boulders(self.kernel.handle, numbers) - 1

    def numbers_of(self, source: int) -> range:
        """The boulders of a source, counted from 0."""
        first, last = _core.boulders_of_source(self.kernel.handle, source + 1)
        return range(int(first), int(last) + 1)

    def forget_rasters(self) -> None:
        """Free the memory of the rasters; the scene can no longer be run."""
        self.__dict__.pop("kernel", None)
        self.z, self.zone, self.values = np.empty((0, 0), self.z.dtype), None, None
        self.cell_ground = None


def lines_outside(scene: Scene) -> list[str]:
    """Names of the evaluation lines that lie entirely outside the terrain."""
    grid = scene.grid
    place = grid.west, grid.north, grid.cell, (grid.nx, grid.ny)
    return [
        line["name"]
        for line in scene.case.lines
        if _core.points_outside(*place, line["x"], line["y"])
    ]


def used_zones(scene: Scene) -> np.ndarray:
    """Rows of `sizes`, counted from 0, that occur in some cell."""
    found = np.zeros(len(scene.sizes) + 1, bool)
    assert scene.zone is not None
    for rows in row_blocks(scene.zone.shape):
        found[scene.zone[rows]] = True
    return np.flatnonzero(found[1:])
