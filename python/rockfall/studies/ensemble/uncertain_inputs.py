# SPDX-License-Identifier: BSD-3-Clause
"""Uncertain inputs of a case, and scenes with drawn values."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from itertools import product, starmap
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.grounds import (
    ENSEMBLE,
    TABLES,
    GroundRule,
    ensemble_grounds,
    ensemble_names,
    find_operator,
    scaled_pair,
    table_names,
    usual_name,
)
from rockfall.grounds.impact_sets import set_path
from rockfall.io.tables import check_columns, read_table
from rockfall.scene.layers import file_checksum
from rockfall.scene.rebounds.coefficients import SetFile, draws_in
from rockfall.scene.releases.source_attributes import VALUES, VOLUMES
from rockfall.scene.scene import Scene

INPUTS = ("volume", "drop_height", "source", "sets", "dem", "radius", "draws", "ground")
#: Random numbers for a draw of each of the first INPUTS; the others need one for each zone
#: (radius), one (draws), and two for each ground with strength and relief (ground).
NUMBERS = (2, 1, 2, 1, 0)
PAIR = ("strength", "relief")
PAIR_FACTORS = tuple(f"{key}_factor" for key in PAIR)
STREAMS = ("boulders", "design", "dem", "source")  # random streams; add new streams only at the end
REACH = 6  # [correlation lengths] exp(-6) is a quarter of a per cent
BITS = 30  # bits of each number in the design
TRIES = 1000  # maximum shifts tried before an error is raised


class Operator(NamedTuple):
    """Impact sets and grounds of a rebound model that can be drawn."""

    sets: SetFile | None  # replaces the case's impact sets
    grounds: dict[str, GroundRule]  # replacement grounds by original name


@dataclass
class Draw:
    """A drawn input: its changes to a scene, and its values for the output."""

    arrays: dict[str, Any] = field(default_factory=dict)  # changes by attribute of Scene
    groups: dict[str, dict[str, Any]] = field(default_factory=dict)  # arguments of Case.replace
    factors: dict[str, float] = field(default_factory=dict)  # factors on VALUES of the source layer
    kept: dict[str, Any] = field(default_factory=dict)

    def __or__(self, other: Draw) -> Draw:
        """Combine two draws that change different inputs."""
        pairs = ((getattr(self, item.name), getattr(other, item.name)) for item in fields(Draw))
        return Draw(*(own | theirs for own, theirs in pairs))


def drawn_scene(scene: Scene, draws: Iterable[Draw], seed: int) -> Scene:
    """Scene with all drawn inputs, for boulders with this seed."""
    arrays: dict[str, Any] = {}
    groups: dict[str, Any] = {"case": {"seed": seed}}
    factors: dict[str, float] = {}
    for drawn in draws:
        arrays |= drawn.arrays
        groups |= drawn.groups
        factors |= drawn.factors
    if factors and scene.features is not None and scene.features.value is not None:
        by = np.array([factors.get(name, 1.0) for name in VALUES])
        arrays["features"] = scene.features._replace(value=scene.features.value * by)
    return scene.replace(case=scene.case.replace(**groups), **arrays)


class Uncertain:
    """Uncertain inputs of a case (`names`), from its group &ensemble."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.given = scene, scene.case.ensemble
        self.set_checksums: dict[str, str] = {}
        self.sets = self._operators()
        self.radii = 1 if scene.rasters.values is not None else len(scene.rasters.sizes)
        #: Indices of the grounds with strength and relief.
        self.pairs = [k for k, rule in enumerate(scene.grounds) if rule.plane is not None]
        self.rows: list[dict[str, float]] = []
        if "draws" in self.given:
            path = scene.case.path(self.given["draws"])
            self.rows = read_draws(path, self.radii, len(self.sets), len(self.pairs))
        self.names = [name for name in INPUTS if self._varies(name)]
        if not self.names:
            raise RockfallError(
                f"{scene.case.name}: &ensemble: nothing is uncertain: give radius_factor, "
                "volume_factor, volume_std_factor, drop_height_factor, strength_factor, "
                "relief_factor, dem_error, source_shift or two sets"
            )
        self._check_factors()
        self._check_pairs()
        of_pairs = 2 * len(self.pairs) * ("ground" in self.names)
        self.ends = np.cumsum([0, *NUMBERS, self.radii, int("draws" in self.names), of_pairs])
        self.design = self._design()
        longest = max(scene.grid.shape) * scene.grid.cell
        if self.given["dem_error"] > 0 and self.given["dem_correlation"] > longest:
            raise RockfallError(
                f"{scene.case.name}: &ensemble dem_correlation = "
                f"{self.given['dem_correlation']:g}: must be at most {longest:g} m, the longer "
                "side of the DEM"
            )

    def _operators(self) -> list[Operator]:
        """Rebound models for the names in `sets`, one for each combination of draws. Impact sets
        replace the case's impact sets; tables replace its grounds: each draw in `talus-ensemble`
        replaces `talus`, any other table the default ground. Refuses tables without effect."""
        case, files = self.scene.case, list[SetFile]()
        stand_ins: dict[str, list[GroundRule]] = {}
        for name in self.given.get("sets", []):
            if (path := self._table(name)) is None:
                draws = draws_in(set_path(case, name, "ensemble"), case.impact["turning"])
                self.set_checksums[name] = draws[0].checksum
                files += draws
                continue
            self.set_checksums[name] = file_checksum(path)
            of_ground = name in ensemble_names()
            ground = name.removesuffix(ENSEMBLE) if of_ground else usual_name(case)
            grounds = [rule.name for rule in self.scene.grounds if rule.model in TABLES]
            if ground not in grounds:
                raise RockfallError(
                    f"{case.name}: &ensemble sets = '{name}': has no effect: it replaces the "
                    f"impact table {ground}, which no ground of the case uses: remove it"
                    if of_ground
                    else f"{case.name}: &ensemble sets = '{name}': is an impact table, which can "
                    f"only replace an impact table, not {ground}"
                )
            stand_ins.setdefault(ground, []).extend(ensemble_grounds(case, name))
        if not (files or stand_ins):
            return []
        together = [
            dict(zip(stand_ins, rules, strict=True)) for rules in product(*stand_ins.values())
        ]
        sets: list[SetFile | None] = [*files] or [None]
        return list(starmap(Operator, product(sets, together)))

    def _table(self, name: str) -> Path | None:
        """File of a table named in `sets`; None for impact sets. Refuses unknown names."""
        case = self.scene.case
        path, is_table = find_operator(case, name)
        if case.impact["form"] == "table" and not is_table:
            names = ", ".join((*ensemble_names(), *table_names()))
            raise RockfallError(
                f"{case.name}: &ensemble sets = '{name}': no such impact table (known: {names}), "
                "and impact sets have no effect with form = 'table'"
            )
        return path if is_table else None

    def _check_factors(self) -> None:
        """Raise a RockfallError for factors on values that neither case nor source layer gives (the
        kernel checks cases without a layer), or on rocks if no zone has any."""
        scene = self.scene
        of_case, features = {**scene.case.boulder, **scene.case.release}, scene.features
        for name in ("volume_std", "drop_height") if features is not None else ():
            own = np.zeros(1)
            if features is not None and features.value is not None:
                own = np.nan_to_num(features.value[:, VALUES.index(name)])
            if self.given[f"{name}_factor"] > 1 and not max(of_case.get(name, 0), own.max()) > 0:
                raise RockfallError(
                    f"{scene.case.name}: &ensemble {name}_factor: is only valid with a "
                    f"{name}, in the case or in the layer of the sources"
                )
        if self.given["radius_factor"] > 1 and scene.rasters.values is None:
            if not any(map(has_rocks, scene.rasters.sizes)):
                raise RockfallError(
                    f"{scene.case.name}: &ensemble radius_factor: has no effect: no zone has rocks "
                    "(R_m > 0): remove it"
                )

    def _check_pairs(self) -> None:
        """Raise a RockfallError for factors on grounds that have no strength and relief, or that
        `sets` replaces."""
        given = [key for key in PAIR_FACTORS if self.given[key] > 1]
        given += ["draws"] * ("strength_1" in dict(*self.rows[:1]))
        for key in given[:1]:
            where = f"{self.scene.case.name}: &ensemble {key}"
            if not self.pairs:
                raise RockfallError(
                    f"{where}: has no effect: no ground has strength and relief: remove it"
                )
            if any(operator.grounds for operator in self.sets):
                raise RockfallError(
                    f"{where}: is not valid together with tables in sets, which replace grounds"
                )

    def _varies(self, name: str) -> bool:
        if name == "draws":
            return bool(self.rows)
        if name == "sets":
            return len(self.sets) > 1 and not any("set" in row for row in self.rows[:1])
        if name in ("dem", "source"):
            return self.given["dem_error" if name == "dem" else "source_shift"] > 0
        keys = [f"{name}_factor"] + ["volume_std_factor"] * (name == "volume")
        keys = [*PAIR_FACTORS] if name == "ground" else keys
        return max(self.given[key] for key in keys) > 1

    def _design(self) -> np.ndarray:
        """Uniform numbers (runs, 2, numbers) of the inputs in A and B: a scrambled Sobol' sequence
        (Owen 1998) that does not depend on the choice of uncertain inputs; more runs extend it.
        Refuses more numbers than the sequence has."""
        from scipy.stats import qmc

        numbers, runs = int(self.ends[-1]), self.given["runs"]
        if 2 * numbers > qmc.Sobol.MAXDIM:
            raise RockfallError(
                f"{self.scene.case.name}: &ensemble: {numbers} values are uncertain, most of them "
                f"rows of the table of zones: must be at most {qmc.Sobol.MAXDIM // 2}"
            )
        random = np.random.default_rng(self._sequence("design", 0))
        points = qmc.Sobol(2 * numbers, seed=random, bits=BITS).random_base2(
            (runs - 1).bit_length()
        )
        return points[:runs].reshape(runs, 2, numbers) + 0.5 ** (BITS + 1)  # excludes 0

    def draw(self, name: str, run: int, side: int) -> Draw:
        """Draw of an input for a run, for A (side 0) or B (side 1). It depends on the case's seed,
        the input, run and side, but not on the number of runs or on other uncertain inputs."""
        return self.at(name, self.design[run, side], 2 * run + side)

    def at(self, name: str, point: np.ndarray, number: int) -> Draw:
        """Draw of an input at a point of the unit cube (uniform numbers of all inputs). `number`
        seeds the other random numbers, for terrain errors and repeated shifts."""
        k = INPUTS.index(name)
        numbers = point[self.ends[k] : self.ends[k + 1]]
        if name in STREAMS:
            random = np.random.default_rng(self._sequence(name, number))
            return getattr(self, f"_{name}")(numbers, random)
        return getattr(self, f"_{name}")(numbers)

    def boulders_seed(self, run: int) -> int:
        """Seed of the boulders in all variants of a run."""
        return int(self._sequence("boulders", run).generate_state(1, "u8")[0]) >> 2

    def _sequence(self, name: str, number: int) -> np.random.SeedSequence:
        return np.random.SeedSequence((self.scene.case.case["seed"], STREAMS.index(name), number))

    def _factor(self, numbers: np.ndarray, key: str) -> np.ndarray:
        """Log-normal factors with median 1 and the geometric standard deviation from a key."""
        return self.given[key] ** normal_scores(numbers)

    def _radius(self, numbers: np.ndarray) -> Draw:
        """Draw of a factor on R_m or the three Rg for each row of the zone table, or of a single
        factor if rasters or uniform values give the sizes."""
        return self._radii_by(self._factor(numbers, "radius_factor"))

    def _radii_by(self, factor: np.ndarray) -> Draw:
        cells = self.scene.rasters
        if cells.values is not None:
            return Draw({"values": cells.values * np.float32(factor)}, kept={"radius": factor})
        return Draw({"sizes": cells.sizes * factor[:, None]}, kept={"radius": factor})

    def _volume(self, numbers: np.ndarray) -> Draw:
        """Draw of a factor on all volumes of the case, layer or rasters, and a factor on standard
        deviations."""
        size = self._factor(numbers[0], "volume_factor")
        spread = self._factor(numbers[1], "volume_std_factor")
        return self._volumes_by(float(size), float(spread))

    def _volumes_by(self, size: float, spread: float) -> Draw:
        boulder = self.scene.case.boulder
        keys = ("volume_mean", "volume_std", "volume_min", "volume_max", "volumes")
        changed = {key: np.asarray(boulder[key]) * size for key in keys if key in boulder}
        if "volume_std" in boulder:
            changed["volume_std"] *= spread
        factors = dict.fromkeys(VOLUMES, size) | {"volume_std": size * spread}
        boulders, arrays = self.scene.source_boulders, {}
        if boulders is not None:
            arrays["source_boulders"] = boulders._replace(volume=boulders.volume * size)
        kept = {"volume": size, "volume_std": spread}
        return Draw(arrays, {"boulder": changed} if changed else {}, factors, kept)

    def _drop_height(self, numbers: np.ndarray) -> Draw:
        return self._height_by(float(self._factor(numbers[0], "drop_height_factor")))

    def _height_by(self, factor: float) -> Draw:
        height = self.scene.case.release["drop_height"] * factor
        return Draw(
            groups={"release": {"drop_height": height}},
            factors={"drop_height": factor},
            kept={"drop_height": factor},
        )

    def _draws(self, numbers: np.ndarray) -> Draw:
        """Draw from a row of the file of joint draws; refuses a shift of sources off the
        terrain."""
        k = int(numbers[0] * len(self.rows))
        row, draw = self.rows[k], Draw(kept={"draw": k})
        if "radius_1" in row:
            draw |= self._radii_by(np.array([row[f"radius_{i + 1}"] for i in range(self.radii)]))
        if "volume" in row:
            draw |= self._volumes_by(row["volume"], row["volume_std"])
        if "drop_height" in row:
            draw |= self._height_by(row["drop_height"])
        if "source_east" in row:
            moved = self._shifted(row["source_east"], row["source_north"])
            if moved is None:
                where = self.scene.case.path(self.given["draws"])
                raise RockfallError(f"{where}: draw {k + 1}: moves a source off the terrain")
            draw |= moved
        if "set" in row:
            draw |= self._set(int(row["set"]))
        if "strength_1" in row:
            names = [f"{key}_{i + 1}" for i in range(len(self.pairs)) for key in PAIR]
            draw |= self._pairs_by(np.array([row[name] for name in names]).reshape(-1, 2))
        return draw

    def _ground(self, numbers: np.ndarray) -> Draw:
        """Draw of factors on strength and relief for each ground that has them."""
        deviations = np.log([self.given[key] for key in PAIR_FACTORS])
        return self._pairs_by(np.exp(deviations * normal_scores(numbers.reshape(-1, 2))))

    def _pairs_by(self, factors: np.ndarray) -> Draw:
        """Draw of grounds with factors (grounds, 2) on strength and relief."""
        scene = self.scene
        grounds = [*scene.grounds]
        for k, (strength, relief) in zip(self.pairs, factors.tolist(), strict=True):
            grounds[k] = scaled_pair(grounds[k], strength, relief, scene.case)
        return Draw({"grounds": tuple(grounds)}, kept=dict(zip(PAIR, factors.T, strict=True)))

    def _dem(self, _: np.ndarray, random: np.random.Generator) -> Draw:
        z, cells = self.scene.rasters.z, self.given["dem_correlation"] / self.scene.grid.cell
        error = self.given["dem_error"] * gaussian_field(z.shape, cells, random)
        return Draw({"z": (z + error).astype(z.dtype)})

    def _source(self, numbers: np.ndarray, random: np.random.Generator) -> Draw:
        """Draw of a common shift of all sources, repeated until all are on known terrain. Raises a
        RockfallError after TRIES failures."""
        deviation = self.given["source_shift"]
        for tried in range(TRIES):
            shift = deviation * (random.standard_normal(2) if tried else normal_scores(numbers))
            if moved := self._shifted(*shift):
                return moved | Draw(kept={"source_redrawn": tried})
        raise RockfallError(
            f"{self.scene.case.name}: &ensemble source_shift = {deviation:g}: none of {TRIES} "
            "shifts leaves all sources on known terrain: must be smaller"
        )

    def _shifted(self, east: float, north: float) -> Draw | None:
        """Draw of sources shifted by these distances [m]; None if one leaves the known terrain."""
        x, y = self.scene.x + east, self.scene.y + north
        if not self.scene.known_at(x, y).all():
            return None
        return Draw({"x": x, "y": y}, kept={"source_east": east, "source_north": north})

    def _sets(self, numbers: np.ndarray) -> Draw:
        return self._set(int(numbers[0] * len(self.sets)))

    def _set(self, which: int) -> Draw:
        sets, grounds = self.sets[which]
        arrays: dict[str, Any] = {} if sets is None else {"sets": sets}
        if grounds:
            own = self.scene.grounds
            arrays["grounds"] = tuple(grounds.get(ground.name, ground) for ground in own)
        return Draw(arrays, kept={"set": which})


def has_rocks(sizes: np.ndarray) -> bool:
    """Return True if a row of rock sizes, R_m or three Rg [m], is completely known and not all
    0."""
    return bool(np.isfinite(sizes).all() and (sizes > 0).any())


def read_draws(path: Path, radii: int, sets: int, pairs: int) -> list[dict[str, float]]:
    """Read joint draws of inputs from a CSV file with one draw in each row. Raises a RockfallError
    for unknown or missing columns, invalid values, and sets that the case lacks.

    Groups of columns, each complete or absent:

    - radius_1, radius_2, ...: factors for the rows of the zone table;
    - volume, volume_std; drop_height: factors;
    - strength_1, relief_1, strength_2, ...: factors for the grounds that have these parameters;
    - source_east, source_north [m];
    - set: index, from 0.

    A column draw is allowed but ignored.
    """
    groups = (
        [f"radius_{i + 1}" for i in range(radii)], ["volume", "volume_std"], ["drop_height"],
        ["source_east", "source_north"], ["set"],
        [f"{key}_{i + 1}" for key in PAIR for i in range(pairs)],
    )  # fmt: skip
    where, columns, rows = read_table(path)
    check_columns(where, columns, ["draw", *(name for group in groups for name in group)])
    for group in groups:
        if 0 < len({*group} & {*columns}) < len(group):
            missing = ", ".join(name for name in group if name not in columns)
            raise RockfallError(f"{where}: {missing}: is missing, but related columns are given")
    if "set" in columns and not sets:
        raise RockfallError(f"{where}: column set: the case has no &ensemble sets")
    drawn = []
    for row in rows:
        limits = {name: (0.01, 100.0) for name in columns if not name.startswith("source")}
        limits |= {"set": (0.0, sets - 1.0), "draw": (1.0, 1e9)}
        drawn.append({name: row.number(name, *limits.get(name, ())) for name in columns})
        if drawn[-1].get("set", 0.0) % 1:
            row.refuse("set", "must be an integer")
    return drawn


def normal_scores(uniform: np.ndarray) -> np.ndarray:
    """Standard normal quantiles for uniform numbers."""
    from scipy.special import ndtri

    return ndtri(uniform)


def gaussian_field(
    shape: tuple[int, int], length: float, random: np.random.Generator
) -> np.ndarray:
    """Gaussian field (ny, nx) with mean 0, variance 1 and correlation exp(-r/length); `length` in
    cells.

    White noise is filtered by FFT on a torus larger than the raster, so that opposite edges are
    uncorrelated (circulant embedding, Dietrich and Newsam 1997). The correlation is accurate
    within exp(-REACH) on a raster of at least `REACH` lengths, the variance within 2 % on any
    raster. Needs 50 bytes per cell, or up to 150 if `length` is as long as the raster.
    """
    torus = tuple(size + min(size, int(np.ceil(REACH * length))) for size in shape)
    y, x = (np.minimum(np.arange(n), n - np.arange(n)) for n in torus)
    power = np.fft.rfft2(np.exp(-np.hypot(y[:, None], x) / length)).real.clip(0.0)
    white = np.fft.rfft2(random.standard_normal(torus))
    return np.fft.irfft2(np.sqrt(power) * white, torus)[: shape[0], : shape[1]]
