# SPDX-License-Identifier: BSD-3-Clause
"""Strength and relief of a ground from field data: impact scars, and elevations of a patch
(lab/docs/14b-blocks.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rockfall.case import keys_of
from rockfall.errors import RockfallError
from rockfall.grounds import YIELDING, check_yielding, shipped_rows, yielding_ground
from rockfall.grounds.impact_tables import CONSTANTS, YieldingGround
from rockfall.grounds.random_numbers import Uniform
from rockfall.grounds.relief import Spectrum, measure, slope_between
from rockfall.grounds.shapes import SHAPES, Surface, hull, random_block, refine, volume
from rockfall.io.rasters.dem import read_dem
from rockfall.io.tables import Row, check_columns, read_table
from rockfall.kernel_rules import USUAL_DENSITY
from rockfall.limits import MAX_NAME

GRAVITY = float(keys_of("flight")["gravity"].default)  # [m/s2]
UPRIGHT = 0.4  # pressure on an upright ploughing facet relative to a flat facet, as in pressure.f90
SPHERE = "sphere"
BAND = Spectrum(0.0, longest=CONSTANTS["ploughed"]["longest"])  # wavelengths in planes of tables
BLOCKS, ATTITUDES, STEPS = 12, 8, 200  # blocks, attitudes of each block, depth steps
EDGE = 0.25  # longest edge of facets, in R_b
DEGREES_OF_TWO = 4.5  # change of relief [degree] that affects speeds like a factor of 2 in strength
COLUMNS = (
    "depth", "depth_error", "mass", "volume", "density", "fall", "fall_error", "speed",
    "speed_error",
)  # fmt: skip
ONE_SLOPE = (
    "One slope cannot separate a factor of 2 in strength from 4 to 5 degrees of relief: their "
    "heights differ."
)

Scars = str | Path | Sequence[Mapping[str, float]]  # path of a table, or its rows


class Scar(NamedTuple):
    """Scar of a vertical impact on flat ground, or of the normal velocity on a slope."""

    depth: float  # lowest point below the undisturbed ground [m]
    depth_error: float  # standard error of the depth [m]
    radius: float  # R_b of the block [m]
    density: float  # [kg/m3]
    speed: float  # impact speed normal to the ground [m/s]
    speed_error: float  # [m/s]


@dataclass(frozen=True)
class MeasuredGround:
    """A ground derived from measurements; NaN for missing data.

    `strength` [Pa] is the median of a lognormal distribution over boulders; `strength_sigma` is
    the standard deviation of its logarithm. `relief` [degree] is the slope of the relief for
    blocks of `radius` (R_b, m). Errors are standard errors; for strength, that of its logarithm.
    `strengths` has a value for each scar, `scar_errors` the error from the readings of depth and
    fall, `attitude_sigma` the scatter due to the unknown attitude of the blocks. `nearest` is the
    most similar shipped ground.
    """

    model: str
    radius: float
    strength: float
    strength_error: float
    strength_sigma: float
    strength_sigma_error: float
    strengths: np.ndarray
    scar_errors: np.ndarray
    attitude_sigma: float
    relief: float
    relief_error: float
    hurst: float
    rest_angle: float
    nearest: str
    proportional: bool = False
    remarks: tuple[str, ...] = field(default=())

    def row(self, name: str, source: str) -> dict[str, str]:
        """Row for a ground table, as text by column. Refuses incomplete rows and names that a table
        cannot contain."""
        for key, text in (("name", name), ("source", source)):
            if not (text.strip() and text.isprintable()):
                raise RockfallError(f"{key} = {text!r}: must be a line of text")
        if len(name) > MAX_NAME:
            raise RockfallError(f"name = {name}: must be at most {MAX_NAME} characters")
        values = {
            "strength": self.strength,
            "strength_sigma": 0.0 if math.isnan(self.strength_sigma) else self.strength_sigma,
            "strength_radius": self.radius if self.proportional else 0.0,
            "relief": self.relief,
            "relief_radius": self.radius,
            "hurst": self.hurst,
            "rest_angle": self.rest_angle,
        }
        for column, value in values.items():
            if math.isnan(value):
                needed = "scars" if column == "strength" else "a patch"
                raise RockfallError(f"{name}: a row in a table of grounds requires {needed}")
        numbers = {column: float(f"{value:.3g}") for column, value in values.items()}
        check_yielding(name, self.model, numbers)
        texts = {column: f"{value:g}" for column, value in numbers.items()}
        return {"name": name, "model": self.model, **texts, "source": source}


def measure_ground(
    scars: Scars | None = None,
    patch: str | Path | None = None,
    *,
    model: str = "ploughed",
    shape: str = "compact",
    radius: float | None = None,
    shortest: float = 2.0,
    longest: float = 32.0,
    proportional: bool = False,
    rest_angle: float | None = None,
) -> MeasuredGround:
    """Measure strength and relief of a ground, each with its standard error.

    `scars` are rows, or a CSV, with `depth` [m], `mass` [kg] or `volume` [m3], `fall` [m] or normal
    `speed` [m/s], and optionally `density` [kg/m3], `depth_error`, `fall_error`, `speed_error`.
    `patch` is a raster of elevations [m]. The relief includes waves from 2 to 32 R_b for blocks of
    `radius` (R_b, m; default: geometric mean of the scars); if the patch only has waves from
    `shortest` to `longest` R_b, its Hurst exponent is used to extrapolate. `shape` is sphere,
    compact, elongated or platy. `proportional` makes the strength proportional to R_b. Raises
    RockfallError for implausible data.

    >>> import rockfall
    >>> scar = {"depth": 0.2, "depth_error": 0.02, "mass": 780.0, "fall": 10.0}
    >>> rockfall.measure_ground([scar]).nearest
    'meadow'
    """
    if model not in YIELDING:
        raise RockfallError(f"model = '{model}': must be {' or '.join(YIELDING)}")
    if shape not in (SPHERE, *SHAPES):
        raise RockfallError(f"shape = '{shape}': must be {', '.join((SPHERE, *SHAPES))}")
    if scars is None and patch is None:
        raise RockfallError("a ground needs scars for its strength, or a patch for its relief")
    read = [] if scars is None else _scars(scars)
    if radius is None and not read:
        raise RockfallError("a patch needs the radius R_b of the blocks: give --radius")
    if not 0 < shortest < longest < math.inf:
        raise RockfallError(f"waves from {shortest:g} to {longest:g} R_b: must be > 0 and increase")
    _check("radius", radius, 0.01, 100.0)
    _check("rest_angle", rest_angle, 0.0, 90.0)
    if radius is None:
        radius = float(np.exp(np.mean(np.log([scar.radius for scar in read]))))
    by_scars = _strength(read, model, shape, radius if proportional else None)
    relief, relief_error, hurst = (math.nan,) * 3
    remarks = list(by_scars.remarks)
    if patch is not None:
        band = Spectrum(0.0, shortest, longest)
        heights, grid = read_dem(patch)
        spectrum, relief_error = measure(heights, grid.cell, radius, band, str(patch))
        relief, hurst = slope_between(spectrum, BAND), spectrum.hurst
        relief_error *= relief / spectrum.slope if spectrum.slope else 1.0
        if (shortest, longest) != (BAND.shortest, BAND.longest):
            remarks.append(
                f"Waves of {shortest:g} to {longest:g} R_b give {spectrum.slope:.1f} degrees; "
                f"those of {BAND.shortest:g} to {BAND.longest:g} R_b follow from hurst."
            )
    nearest = _nearest(model, radius, by_scars.strength, relief)
    usual = yielding_ground(shipped_rows().rows[nearest])[1].rest_angle
    return MeasuredGround(
        model, radius, by_scars.strength, by_scars.error, by_scars.sigma, by_scars.sigma_error,
        by_scars.strengths, by_scars.errors, by_scars.attitude, relief, relief_error, hurst,
        usual if rest_angle is None else rest_angle, nearest, proportional, tuple(remarks),
    )  # fmt: skip


def _check(name: str, value: float | None, low: float, high: float) -> None:
    if value is not None and not low <= value <= high:
        raise RockfallError(f"{name} = {value:g}: must be {low:g} to {high:g}")


# ---- Strength


class _Strength(NamedTuple):
    strengths: np.ndarray = np.empty(0)
    errors: np.ndarray = np.empty(0)
    attitude: float = math.nan
    strength: float = math.nan
    error: float = math.nan
    sigma: float = math.nan
    sigma_error: float = math.nan
    remarks: tuple[str, ...] = ()


def _strength(scars: list[Scar], model: str, shape: str, radius: float | None) -> _Strength:
    """Lognormal distribution of the strength [Pa], at R_b = radius if proportional to R_b."""
    if not scars:
        return _Strength()
    by_scar = [_of_scar(scar, model, shape) for scar in scars]
    logs, errors, attitudes = (np.array(column) for column in zip(*by_scar, strict=True))
    if radius is not None:
        logs = logs - np.log([scar.radius / radius for scar in scars])
    n, attitude = len(logs), float(np.sqrt(np.mean(attitudes**2)))
    read_error = float(np.mean(errors**2 + attitudes**2))
    spread = float(np.var(logs, ddof=1)) if n > 1 else math.nan
    sigma = math.sqrt(max(0.0, spread - read_error)) if n > 1 else math.nan
    # Includes the standard error of the variance.
    of_square = spread * math.sqrt(2 / (n - 1)) if n > 1 else math.nan
    sigma_error = math.sqrt(sigma**2 + of_square) - sigma
    error = math.sqrt(max(read_error, spread if n > 1 else 0.0) / n)
    remarks = () if n > 1 else ("One scar gives no scatter: strength_sigma is 0 in the row.",)
    return _Strength(
        np.exp(logs), errors, attitude, float(np.exp(logs.mean())), error, sigma, sigma_error,
        remarks,
    )  # fmt: skip


def _of_scar(scar: Scar, model: str, shape: str) -> tuple[float, float, float]:
    """Logarithm of the strength [Pa] from a scar, its standard error due to depth and speed, and
    its scatter due to the block's attitude."""

    def log_strength(depth: float, speed: float) -> np.ndarray:
        depth, froude = depth / scar.radius, speed**2 / (2 * GRAVITY * scar.radius)
        scaled = scaled_strength(depth, froude, scar.density, model, shape)
        return np.log(scaled * scar.density * GRAVITY * scar.radius)

    best = log_strength(scar.depth, scar.speed)
    rates = []
    for k, value in enumerate((scar.depth, scar.speed)):
        low, high = ([scar.depth, scar.speed] for _ in range(2))
        low[k], high[k] = value * 0.98, value * 1.02
        rates.append((log_strength(*high) - log_strength(*low)).mean() / (0.04 * value))
    errors = rates[0] * scar.depth_error, rates[1] * scar.speed_error
    return float(best.mean()), math.hypot(*errors), float(best.std())


def scaled_strength(
    depth: float, head: float, density: float, model: str, shape: str
) -> np.ndarray:
    """Strength of flat ground divided by rho_b g R_b, at which a block that does not rotate comes
    to rest at `depth`, for each attitude (attitudes,).

    `depth` and `head` = V_n^2/(2 g) are divided by R_b; `density` is that of the block [kg/m3].
    The contact model is as in the laboratory: yield pressure, inertia of displaced soil and
    friction on submerged facets (lab/docs/14b-blocks.md, eqs. 14.21 to 14.25a).
    """
    soil = CONSTANTS[model]["soil_density"] / density
    z, push, inertia = _resistance(model, shape)
    at = np.linspace(0.0, depth, STEPS)
    mass, step = 4 / 3 * np.pi, at[1]
    strengths = []
    for k in range(len(z)):
        below = np.searchsorted(z[k], at, "right")
        grow = np.exp(2 * soil / mass * _integral(inertia[k][below], step))
        work = _integral(push[k][below] * grow, step)[-1]
        strengths.append(mass * (head + _integral(grow, step)[-1]) / work)
    return np.array(strengths)


def _integral(values: np.ndarray, step: float) -> np.ndarray:
    return np.append(0.0, np.cumsum(values[1:] + values[:-1]) * step / 2)


@cache
def _resistance(model: str, shape: str) -> tuple[list[np.ndarray], ...]:
    """For each attitude, by increasing height above the block's lowest point: this height, and the
    vertical forces on the facets below it per yield pressure and per soil density times V^2.
    Lengths are in R_b."""
    constants, draw = CONSTANTS[model], Uniform(1, 0)
    profiles: tuple[list[np.ndarray], ...] = ([], [], [])
    blocks = [_sphere()] if shape == SPHERE else [
        random_block(SHAPES[shape], 1, k) for k in range(BLOCKS)
    ]  # fmt: skip
    for block in blocks:
        surface = refine(block, EDGE)
        scale = np.cbrt(3 * volume(surface) / (4 * np.pi))
        a, b, c = (surface.vertices[surface.triangles[:, k]] / scale for k in range(3))
        normal, middle = np.cross(b - a, c - a) / 2, (a + b + c) / 3
        area = np.linalg.norm(normal, axis=1)
        for down in draw.directions(1 if shape == SPHERE else ATTITUDES):
            facing = normal @ down / area
            lowest = (surface.vertices @ down).max() / scale
            order = np.argsort(lowest - middle @ down)
            order = order[facing[order] > 0]
            face, depth = facing[order], (lowest - middle @ down)[order]
            force = area[order] * face
            if constants["plough"]:
                rub = constants["friction"] * np.sqrt(np.maximum(0.0, 1 - face**2))
                force = area[order] * (UPRIGHT + (1 - UPRIGHT) * face) * (face + rub)
            for values, profile in zip(profiles, (depth, force, force * face**2), strict=True):
                values.append(profile if profile is depth else np.append(0.0, np.cumsum(profile)))
    return profiles


def _sphere() -> Surface:
    """Sphere with 1,000 vertices on a spiral."""
    k = np.arange(1000)
    z, turn = (2 * k + 1) / 1000 - 1, np.pi * (3 - np.sqrt(5)) * k
    side = np.sqrt(1 - z**2)
    return hull(np.column_stack([side * np.cos(turn), side * np.sin(turn), z]))


def _scars(scars: Scars) -> list[Scar]:
    if isinstance(scars, (str, Path)):
        where, columns, rows = read_table(scars)
        check_columns(where, columns, COLUMNS)
        return [_scar(row) for row in rows]
    read = []
    for k, values in enumerate(scars, 1):
        check_columns(f"scar {k}", list(values), COLUMNS)
        read.append(_scar(Row(f"scar {k}", {key: str(value) for key, value in values.items()})))
    if not read:
        raise RockfallError("scars: the table is empty")
    return read


def _scar(row: Row) -> Scar:
    """Scar from a table row, in SI units. Raises a RockfallError for implausible values."""

    def either(first: str, second: str, low: float, high: float, low2: float, high2: float
               ) -> tuple[float, float]:  # fmt: skip
        values = row.maybe(first, low, high), row.maybe(second, low2, high2)
        if sum(math.isnan(value) for value in values) != 1:
            raise RockfallError(f"{row.where}: needs either {first} or {second}")
        return values

    depth = row.maybe("depth", 1e-3)
    if math.isnan(depth):
        raise RockfallError(f"{row.where}: needs the depth of the scar [m]")
    density = row.maybe("density", 500.0, 8000.0)
    density = USUAL_DENSITY if math.isnan(density) else density
    mass, size = either("mass", "volume", 1e-2, 1e8, 1e-5, 1e5)
    radius = float(np.cbrt(3 * (mass / density if math.isnan(size) else size) / (4 * np.pi)))
    if depth > 2 * radius:
        row.refuse("depth", f"must be in m and at most the block diameter, {2 * radius:.2g} m")
    fall, speed = either("fall", "speed", 1e-2, 1000.0, 0.1, 150.0)
    errors = {key: row.maybe(f"{key}_error", 0.0) for key in ("depth", "fall", "speed")}
    for key, value in (("depth", depth), ("fall", fall), ("speed", speed)):
        if math.isnan(errors[key]):
            errors[key] = 0.0
        elif math.isnan(value):
            row.refuse(f"{key}_error", f"needs {key}")
        elif errors[key] >= value:
            row.refuse(f"{key}_error", f"must be below {key} = {value:g}")
    if math.isnan(speed):
        speed = math.sqrt(2 * GRAVITY * fall)
        errors["speed"] = speed * errors["fall"] / (2 * fall)
    return Scar(depth, errors["depth"], radius, density, speed, errors["speed"])


# ---- Most similar shipped ground


def _nearest(model: str, radius: float, strength: float, relief: float) -> str:
    """Shipped ground of a model with the most similar strength and relief at R_b = radius [m];
    NaN is ignored."""
    grounds = shipped_rows()
    distances: dict[str, float] = {}
    for name in grounds.yielding:
        own, ground = yielding_ground(grounds.rows[name])
        if own == model:
            distances[name] = _distance(ground, radius, strength, relief)
    return min(distances, key=distances.__getitem__)


def _distance(ground: YieldingGround, radius: float, strength: float, relief: float) -> float:
    scale = radius / ground.strength_radius if ground.strength_radius else 1.0
    factors = np.log2(strength / (ground.strength * scale))
    slopes = (relief - ground.reliefs(np.array(radius))) / DEGREES_OF_TWO
    return float(np.hypot(*np.nan_to_num([factors, slopes])))
