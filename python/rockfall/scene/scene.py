# SPDX-License-Identifier: BSD-3-Clause
"""Checked inputs of a run: a case with its rasters and sources."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.grounds import TABLES, GroundRule, grounds_by_shape
from rockfall.grounds.impact_tables import BLOCK_SHAPES, possible_shapes
from rockfall.io.input_warnings import InputWarning
from rockfall.io.rasters.grid import Box, Grid
from rockfall.scene.forest.trees import Stand, Trees
from rockfall.scene.ground import Ground, ground_of
from rockfall.scene.kernel_scene import KernelScene, kernel_arrays
from rockfall.scene.layers import Inputs
from rockfall.scene.parts import Rasters, Sources
from rockfall.scene.rebounds.coefficients import Coefficients, SetFile
from rockfall.scene.releases.reach import Survey
from rockfall.scene.releases.source_attributes import values_of
from rockfall.scene.stages import FRESH, Stages
from rockfall.scene.surface import read_window
from rockfall.scene.windows import Windows
from rockfall.terrain.dams import DamShape
from rockfall.terrain.line_beyond import LinesBeyond

OF_RASTERS = {field.name for field in fields(Rasters)}


@dataclass
class Findings:
    """Warnings about a scene; scenes derived from it share them."""

    warnings: list[InputWarning] | None = None  # see `plausible.input_warnings`; None: not checked
    beyond: LinesBeyond = field(default_factory=dict)  # filled with the warnings


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene(Sources):
    """Checked inputs of a run, including its sources."""

    case: Case
    rasters: Rasters
    trees: Trees | None = None
    stands: tuple[Stand, ...] = ()  # stands of a polygon layer, with numbers of stems
    sets: SetFile = SetFile(b"", "")
    dams: tuple[DamShape, ...] = ()  # dams as rasterised
    checksums: dict[str, str] = field(default_factory=dict)  # keys: input files
    decoded: dict[str, str] = field(default_factory=dict)  # checksums of decoded inputs
    remarks: tuple[str, ...] = ()  # remarks of the readers, one per line
    windows: Windows | None = None  # terrain read in windows; the scene then has no rasters
    findings: Findings = field(default_factory=Findings)
    stages: Stages = FRESH  # results of stages that an open session reuses

    def __getstate__(self) -> dict[str, Any]:
        own = {key: value for key, value in vars(self).items() if key != "kernel"}
        return own | {"stages": FRESH}

    def replace(self, **changes: Any) -> Scene:
        """Copy of the scene with changed fields of itself or its rasters."""
        cells = {key: changes.pop(key) for key in OF_RASTERS & changes.keys()}
        rasters = replace(self.rasters, **cells) if cells else self.rasters
        return replace(self, **{"rasters": rasters} | changes)

    @property
    def grid(self) -> Grid:
        """Grid of the whole terrain."""
        return self.rasters.grid

    @property
    def grounds(self) -> tuple[GroundRule, ...]:
        """Grounds; empty if all use the impact sets."""
        return self.rasters.grounds

    @property
    def warnings(self) -> list[InputWarning] | None:
        """Warnings about the inputs; None if not checked."""
        return self.findings.warnings

    @property
    def beyond(self) -> LinesBeyond:
        """Stretches of lines off the terrain; empty if not checked."""
        return self.findings.beyond

    @cached_property
    def boulders(self) -> int:
        """Number of boulders in the full run."""
        return int(_core.boulders(self.kernel.handle))

    @cached_property
    def kernel(self) -> KernelScene:
        own = self.source_boulders
        arrays: dict[str, Any] = {
            "impact_sets": np.frombuffer(self.sets.text, "i1"),
            "impact_sets_file": np.frombuffer(self.sets.name.encode(), "i1"),
            "source_x": self.x, "source_y": self.y, "area_ratio": self.area,
            "source_frequency": self.frequency,
            **{f"source_{name}": array for name, array in (own._asdict() if own else {}).items()},
            "source_shape": self.source_shape,
        }  # fmt: skip
        if self.features is not None:
            _, feature, law, value, _ = self.features
            arrays |= {"source_feature": feature, "feature_law": law, "feature_value": value}
        if self.trees is not None:
            arrays |= {f"tree_{name}": array for name, array in self.trees._asdict().items()}
        rasters = self.rasters
        if self.shapes:
            grounds, serving = grounds_by_shape(self.grounds, self.shapes)
            rasters = replace(rasters, grounds=grounds)
            arrays["shape_ground"] = serving if len(grounds) > len(self.grounds) else None
        return KernelScene(self.case, rasters, self.sets.draw, kernel_arrays(arrays))

    @property
    def release_values(self) -> np.ndarray:
        """Density [kg/m3], drop height [m] and velocity [m/s] of the boulders (sources, 5); a
        single row if the sources give none of them."""
        values, own = values_of(self.case, self.features), self.source_boulders
        if values is not None and self.features is not None:
            values = values[self.features.number - 1]
        else:
            release = self.case.release
            usual = [self.case.boulder["density"], release["drop_height"], *release["velocity"]]
            values = np.array([usual])
        if own is not None and own.density is not None:
            rest = np.broadcast_to(values[:, 1:], (own.density.size, 4))
            values = np.column_stack([own.density, rest])
        return values

    @property
    def source_shape(self) -> np.ndarray | None:
        """Block shape (number from 1) of each source's boulders; 0: as in the case. None if no
        source gives a shape, or no ground has an impact table."""
        features, own = self.features, self.source_boulders
        if all(ground.model not in TABLES for ground in self.grounds):
            return None
        by_sides = own.shape if own else None
        if features is None or features.shape is None:
            return by_sides
        shape = features.shape[features.number - 1]
        return shape if by_sides is None else np.where(shape > 0, shape, by_sides)

    @property
    def shapes(self) -> list[str]:
        """Block shapes that the boulders can have; [] if all have the shape of the case."""
        own, shapes = self.source_shape, {*possible_shapes(self.case)}
        by_axes = "block_axes" in self.case.boulder
        if by_axes and self.features is not None and self.features.law is not None:
            shapes |= {*self.case.boulder["block_shape"]}  # some volumes are outside all lists
        if own is None:
            return sorted(shapes) if by_axes or len(shapes) > 1 else []
        given = {BLOCK_SHAPES[number - 1] for number in np.unique(own) if number}
        return sorted(given | shapes if (own == 0).any() else given)

    @cached_property
    def coefficients(self) -> Coefficients:
        return self.sets.read(self.case.impact["turning"])[0]

    @cached_property
    def ground(self) -> Ground:
        if self.windows:
            return self.windows.ground
        rasters, box, at = self.rasters, self.grid.box, (self.x, self.y)
        terrain = self.stages.take("ground", self.case, (rasters,), lambda _: ground_of(rasters))
        return self.stages.take(
            "ground with sources", self.case, (terrain, *at),
            lambda _: terrain.with_sources(rasters, box, *at),
        )  # fmt: skip

    @property
    def weight(self) -> np.ndarray | None:
        """Weight of each source in the number of boulders; None if equal."""
        total = "boulders_total" in self.case.case
        return self.frequency if total and self.frequency is not None else self.area

    def survey(self) -> Survey:
        """Data about the terrain that a run needs. Raises a RockfallError for a source from which
        no boulder can start."""
        if self.windows:
            return self.windows.survey
        uses = (self.rasters.z,)
        survey = Survey(self.case, self.grid, self.stages.find("minima", uses))
        survey.take(self.kernel, 0, self.grid.ny)
        if "maps" in self.case.output:
            self.stages.keep("minima", uses, survey.minima)
        return survey

    def known_at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Mask of points [m] where boulders can start: between four cells with elevations."""
        return _core.known_at(self.kernel.handle, x, y).astype(bool)

    def lines_outside(self) -> list[str]:
        """Names of evaluation lines and barriers that lie entirely outside the terrain."""
        grid = self.grid
        place = grid.west, grid.north, grid.cell, (grid.nx, grid.ny)
        return [
            line["name"]
            for line in self.case.lines
            if _core.points_outside(*place, line["x"], line["y"])
        ]

    def sources_of(self, numbers: np.ndarray) -> np.ndarray:
        """0-based source index of each boulder (numbered from 1)."""
        return _core.sources_of_boulders(self.kernel.handle, numbers) - 1

    def numbers_of(self, source: int) -> range:
        """Numbers of the boulders from a source (0-based index)."""
        first, last = _core.boulders_of_source(self.kernel.handle, source + 1)
        return range(int(first), int(last) + 1)

    def around(self, first: int, boulders: int) -> tuple[Scene, int]:
        """Scene with the rasters for boulders from number `first` (the whole scene, or a window),
        and the number of boulders for which it is valid, at most `boulders`."""
        windows = self.windows
        if windows is None:
            return self, boulders
        source = int(self.sources_of(np.array([first]))[0])
        if windows.owner is not self or source not in windows.sources:
            windows.owner, windows.window = self, None  # free its memory before the next is read
            box = windows.fit(self.grid, self, source)
            begin = time.process_time()
            windows.window = self._within(box)
            windows.reading += time.process_time() - begin
        stop = self.numbers_of(windows.sources.stop - 1).stop
        return windows.window, min(boulders, stop - first)

    def _within(self, box: Box) -> Scene:
        """The scene with rasters for a box of cells."""
        inputs = Inputs(self.case, self.grid, checksums=dict(self.checksums))
        return replace(self, rasters=read_window(inputs, box), windows=None)

    def forget_rasters(self) -> None:
        """Free the memory of the rasters; the scene cannot run afterwards."""
        self.rasters.free()
        self.kernel.close()
