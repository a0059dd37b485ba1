# SPDX-License-Identifier: BSD-3-Clause
"""What is uncertain in a case, and scenes in which it has been drawn."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.impact_sets import set_path
from rockfall.scene.coefficients import SetFile, draws_in
from rockfall.scene.kernel_scene import known_at
from rockfall.scene.scene import Scene

INPUTS = ("volume", "drop_height", "source", "sets", "dem", "radius")
NUMBERS = (2, 1, 2, 1, 0, None)  # that an input needs in a draw; radius: one for each zone
STREAMS = ("boulders", "design", "dem", "source")  # of random numbers; a new one goes to the end
REACH = 6  # correlation lengths; exp(-6) is a quarter of a per cent
BITS = 30  # of a number of the design
TRIES = 1000  # shifts of the sources, before they are refused


@dataclass
class Draw:
    """An input as drawn: what it changes in a scene, and its numbers, to be kept."""

    arrays: dict[str, Any] = field(default_factory=dict)  # by names of Scene
    groups: dict[str, dict[str, Any]] = field(default_factory=dict)  # as in Case.replace
    kept: dict[str, Any] = field(default_factory=dict)


def drawn_scene(scene: Scene, draws: Iterable[Draw], seed: int) -> Scene:
    """The scene with all that has been drawn, for boulders of this seed."""
    arrays: dict[str, Any] = {}
    groups: dict[str, Any] = {"case": {"seed": seed}}
    for one in draws:
        arrays |= one.arrays
        groups |= one.groups
    return replace(scene, case=scene.case.replace(**groups), **arrays)


class Uncertain:
    """The uncertain inputs of a case (`names`), as its group &ensemble has them."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.given = scene, scene.case.ensemble
        self.sets: list[SetFile] = []
        self.set_checksums: dict[str, str] = {}
        for name in self.given.get("sets", []):
            path = set_path(scene.case, name, "ensemble")
            draws = draws_in(path, scene.case.impact["turning"])
            self.set_checksums[name] = draws[0].checksum
            self.sets += draws
        self.names = [name for name in INPUTS if self._varies(name)]
        if not self.names:
            raise RockfallError(
                f"{scene.case.name}: &ensemble: nothing is uncertain: give radius_factor, "
                "volume_factor, volume_std_factor, drop_height_factor, dem_error, source_shift "
                "or two sets"
            )
        told = scene.features is not None and scene.features.law is not None
        for name in {"volume", "drop_height"} & {*self.names} if told else ():
            raise RockfallError(
                f"{scene.case.name}: &ensemble {name}_factor: has no meaning where the layer "
                "of the sources says what is released"
            )
        radii = 1 if scene.values is not None else len(scene.sizes)
        self.ends = np.cumsum([0, *(radii if n is None else n for n in NUMBERS)])
        self.design = self._design()
        longest = max(scene.grid.shape) * scene.grid.cell
        if self.given["dem_error"] > 0 and self.given["dem_correlation"] > longest:
            raise RockfallError(
                f"{scene.case.name}: &ensemble dem_correlation = "
                f"{self.given['dem_correlation']:g}: must be at most {longest:g} m, the longer "
                "side of the DEM"
            )

    def _varies(self, name: str) -> bool:
        if name == "sets":
            return len(self.sets) > 1
        if name in ("dem", "source"):
            return self.given["dem_error" if name == "dem" else "source_shift"] > 0
        keys = [f"{name}_factor"] + ["volume_std_factor"] * (name == "volume")
        return max(self.given[key] for key in keys) > 1

    def _design(self) -> np.ndarray:
        """Uniform numbers (runs, 2, numbers) of the inputs in A and B: a scrambled Sobol' sequence
        (Owen 1998), the same for whatever is uncertain, and longer for more runs."""
        from scipy.stats import qmc

        numbers, runs = int(self.ends[-1]), self.given["runs"]
        if 2 * numbers > qmc.Sobol.MAXDIM:
            raise RockfallError(
                f"{self.scene.case.name}: &ensemble: {numbers} numbers are uncertain, most of them "
                f"rows of the table of zones: must be at most {qmc.Sobol.MAXDIM // 2}"
            )
        random = np.random.default_rng(self._sequence("design", 0))
        points = qmc.Sobol(2 * numbers, seed=random, bits=BITS).random_base2(
            (runs - 1).bit_length()
        )
        return points[:runs].reshape(runs, 2, numbers) + 0.5 ** (BITS + 1)  # never 0

    def draw(self, name: str, run: int, side: int) -> Draw:
        """An input of a run, as in A (side 0) or B (side 1). It depends on the seed of the case, on
        the input, run and side; not on how many runs there are, nor on what else is uncertain."""
        k = INPUTS.index(name)
        numbers = self.design[run, side, self.ends[k] : self.ends[k + 1]]
        if name in STREAMS:
            random = np.random.default_rng(self._sequence(name, 2 * run + side))
            return getattr(self, f"_{name}")(numbers, random)
        return getattr(self, f"_{name}")(numbers)

    def boulders_seed(self, run: int) -> int:
        """The seed of the boulders in all variants of a run."""
        return int(self._sequence("boulders", run).generate_state(1, "u8")[0]) >> 2

    def _sequence(self, name: str, number: int) -> np.random.SeedSequence:
        return np.random.SeedSequence((self.scene.case.case["seed"], STREAMS.index(name), number))

    def _factor(self, numbers: np.ndarray, key: str) -> np.ndarray:
        """Log-normal factors of median 1, with the geometric standard deviation of a key."""
        return self.given[key] ** _normal(numbers)

    def _radius(self, numbers: np.ndarray) -> Draw:
        """One factor for each row of the table of zones, on R_m or on its three Rg; one factor
        everywhere, where rasters or one value give the sizes."""
        scene = self.scene
        factor = self._factor(numbers, "radius_factor")
        if scene.values is not None:
            return Draw({"values": scene.values * np.float32(factor)}, kept={"radius": factor})
        return Draw({"sizes": scene.sizes * factor[:, None]}, kept={"radius": factor})

    def _volume(self, numbers: np.ndarray) -> Draw:
        """A factor on all volumes of the distribution, another on its standard deviation."""
        boulder = self.scene.case.boulder
        size = self._factor(numbers[0], "volume_factor")
        spread = self._factor(numbers[1], "volume_std_factor")
        keys = ("volume_mean", "volume_std", "volume_min", "volume_max", "volumes")
        changed = {key: np.asarray(boulder[key]) * size for key in keys if key in boulder}
        if "volume_std" in boulder:
            changed["volume_std"] *= spread
        return Draw(groups={"boulder": changed}, kept={"volume": size, "volume_std": spread})

    def _drop_height(self, numbers: np.ndarray) -> Draw:
        factor = self._factor(numbers[0], "drop_height_factor")
        height = self.scene.case.release["drop_height"] * factor
        return Draw(groups={"release": {"drop_height": height}}, kept={"drop_height": factor})

    def _dem(self, _: np.ndarray, random: np.random.Generator) -> Draw:
        z, cells = self.scene.z, self.given["dem_correlation"] / self.scene.grid.cell
        error = self.given["dem_error"] * gaussian_field(z.shape, cells, random)
        return Draw({"z": (z + error).astype(z.dtype)})

    def _source(self, numbers: np.ndarray, random: np.random.Generator) -> Draw:
        """One shift for all sources, drawn again until all of them lie on known terrain."""
        deviation = self.given["source_shift"]
        for tried in range(TRIES):
            east, north = deviation * (random.standard_normal(2) if tried else _normal(numbers))
            x, y = self.scene.x + east, self.scene.y + north
            if known_at(self.scene, x, y).all():
                kept = {"source_east": east, "source_north": north, "source_redrawn": tried}
                return Draw({"x": x, "y": y}, kept=kept)
        raise RockfallError(
            f"{self.scene.case.name}: &ensemble source_shift = {deviation:g}: none of {TRIES} "
            "shifts leaves all sources on known terrain: must be smaller"
        )

    def _sets(self, numbers: np.ndarray) -> Draw:
        which = int(numbers[0] * len(self.sets))
        return Draw({"sets": self.sets[which]}, kept={"set": which})


def _normal(uniform: np.ndarray) -> np.ndarray:
    from scipy.special import ndtri

    return ndtri(uniform)


def gaussian_field(
    shape: tuple[int, int], length: float, random: np.random.Generator
) -> np.ndarray:
    """A Gaussian field (ny, nx) of mean 0, variance 1, correlation exp(-r/length); length in cells.

    White noise is filtered by FFT on a torus larger than the raster, so that opposite edges do not
    know of each other (circulant embedding, Dietrich and Newsam 1997). On a raster of `REACH`
    lengths or more the correlation is exact within exp(-REACH); on any, the variance within 2 %.
    Takes 50 bytes a cell, up to 150 where `length` is as long as the raster.
    """
    torus = tuple(size + min(size, int(np.ceil(REACH * length))) for size in shape)
    y, x = (np.minimum(np.arange(n), n - np.arange(n)) for n in torus)
    power = np.fft.rfft2(np.exp(-np.hypot(y[:, None], x) / length)).real.clip(0.0)
    white = np.fft.rfft2(random.standard_normal(torus))
    return np.fft.irfft2(np.sqrt(power) * white, torus)[: shape[0], : shape[1]]
