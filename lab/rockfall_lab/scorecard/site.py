# SPDX-License-Identifier: BSD-3-Clause
"""Impact sets on the slope of cases/vaujany, by methods A and B of the paper: statistics printed by
Bourrier et al. (2009), and additional ones."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.case import read_case
from rockfall.errors import RockfallError
from rockfall.result.crossings import at_lines as crossed
from rockfall.result.motion import are_met
from rockfall.scene.rebounds.kernel_rebounds import ratio_class
from rockfall.scene.rebounds.sets import Sets, restitution
from rockfall.studies.runs import run
from rockfall_lab.scorecard.vaujany_slope import CELL, NORTH, WEST, Talus
from rockfall_lab.sets.fit import ImpactSet
from rockfall_lab.sets.lateral import incidence
from rockfall_lab.sets.setfile import write_sets

if TYPE_CHECKING:
    import xarray as xr

#: Quantities of table 2, with their variables and units in the paper.
QUANTITIES = {
    "speed": ("line_speed", 1.0),
    "passing_height": ("line_passing_height", 1.0),
    "energy_translational": ("line_energy_translational", 1e-3),
}
CASES = {"A": "case_A.nml", "B": "case.nml"}
TURNS = 22.5, 45.0  # limits between classes of turns [degree]
SHORT = 20.0, 40.0  # range along the slope from the release in which boulders slid to a stop [m]
TANGENTIAL = 0.75  # fraction of the incident energy
MIN_PASSED = 20  # minimum number of boulders for a mean
MIN_REBOUNDS = 20  # minimum number of rebounds for a mean, per incidence class and ratio


class Site:
    """Stand-in for the experimental slope. Raises a RockfallError if the folder has no case.nml."""

    def __init__(self, folder: str | Path, boulders: int = 2000, trajectories: int = 200) -> None:
        folder = Path(folder)
        if not (folder / CASES["B"]).exists():
            raise RockfallError(
                f"{folder}: no case.nml there: the scorecard needs the folder cases/vaujany"
            )
        output = {"trajectories": min(boulders, trajectories), "maps": None}
        self._cases = {
            method: read_case(folder / name).replace(case={"boulders": boulders}, output=output)
            for method, name in CASES.items()
        }

    def run(
        self, sets: Sets, *, seed: int = 1,
        talus: Talus | None = None, reading: str = "radius", turning: str = "past_aspect",
        threads: int = 0, methods: str = "AB", ratio: str = "nearest",
    ) -> dict[str, xr.Dataset]:  # fmt: skip
        """Results by method, on the terrain of the case or a slope with the same parameters."""
        import rasterio

        terrain = {}
        if talus is not None:
            transform = rasterio.Affine(CELL, 0, WEST, 0, -CELL, NORTH)
            terrain = {"dem": talus.elevation(), "transform": transform}
        results = {}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "sets.nml"
            write_sets(path, _as_fitted(sets), [])
            for method in methods:
                results[method] = run(
                    self._cases[method].replace(
                        case={"seed": seed, "threads": threads},
                        impact={"sets": str(path), "turning": turning, "ratio": ratio},
                        surface={"rg_reading": reading},
                    ),
                    **terrain,
                )
        return results

    def numbers(self, sets: Sets, **how) -> dict[str, float]:
        """Statistics of the sets; `how` as in `run`."""
        results = self.run(sets, **how)
        numbers: dict[str, float] = {}
        for method, result in results.items():
            numbers |= at_lines(method, result)
        numbers["a_slower"] = numbers["B_EL1_speed"] - numbers["A_EL1_speed"]
        return numbers | _over_rebounds(sets, results["B"])


def _as_fitted(sets: Sets) -> dict[int, ImpactSet]:
    """Sets in the form that a set file stores."""
    lateral = sets.lateral or (None,) * len(sets.mean)
    rows = zip(sets.mean, sets.covariance, lateral, strict=True)
    nothing = np.zeros(9), np.zeros((9, 9)), 0, 0.0
    return {
        ratio: ImpactSet(mean, covariance, *nothing, turns)
        for ratio, (mean, covariance, turns) in enumerate(rows, 1)
    }


def at_lines(method: str, result: xr.Dataset) -> dict[str, float]:
    """Statistics at the lines of a result, with names that begin with its method."""
    numbers: dict[str, float] = {}
    dense = crossed(result)
    for line in dense["line"].values:
        numbers |= _at_line(dense.sel(line=line), f"{method}_{line}")
    return numbers


def _at_line(at: xr.Dataset, name: str) -> dict[str, float]:
    """Statistics at a line: passing fraction; moments and maximum of each quantity, rotational
    fraction and spread, all NaN if too few boulders pass."""
    passed = at["line_speed"].notnull().values
    numbers = {f"{name}_passing": _mean(passed)}
    if passed.sum() < MIN_PASSED:
        passed = np.zeros_like(passed)
    for quantity, (variable, scale) in QUANTITIES.items():
        values = at[variable].values[passed] * scale
        numbers[f"{name}_{quantity}"] = _mean(values)
        numbers[f"{name}_{quantity}_std"] = values.std(ddof=1) if values.size else np.nan
        numbers[f"{name}_{quantity}_max"] = values.max() if values.size else np.nan
    rotation, motion = at["line_energy_rotational"], at["line_energy_translational"]
    fraction = (rotation / (rotation + motion)).values[passed]
    numbers[f"{name}_rotational_share"] = _mean(fraction)
    numbers[f"{name}_rotational_share_std"] = fraction.std(ddof=1) if fraction.size else np.nan
    across = at["line_x"].values[passed]
    numbers[f"{name}_spread"] = across.std(ddof=1) if across.size else np.nan
    return numbers


def _over_rebounds(sets: Sets, result: xr.Dataset) -> dict[str, float]:
    """R_t, R_n and turns of rebounds in recorded trajectories, and fractions over all boulders.

    R_n by incidence class is averaged for each R_b/R_m separately, then over the ratios, weighted
    with their recorded frequency. Without this standardisation, a class would reflect the
    ground of its few steep rebounds rather than the effect of the angle.
    """
    t, n = result["trajectory_in_t"].values, result["trajectory_in_n"].values
    hit = np.isfinite(t) & (t > 0) & (n < 0)
    angle = incidence(np.stack([t[hit], n[hit]], axis=1))
    r_t = result["trajectory_out_t"].values[hit] / t[hit]
    r_n = -result["trajectory_out_n"].values[hit] / n[hit]
    ratio = ratio_class(result["trajectory_ratio"].values[hit])
    used = np.array([(ratio == k).mean() if ratio.size else np.nan for k in range(1, 6)])

    def over(values: np.ndarray, low: float, high: float) -> float:
        inside = (angle >= low) & (angle < high)
        classes = [values[inside & (ratio == k)] for k in range(1, 6)]
        enough = np.array([class_.size >= MIN_REBOUNDS for class_ in classes])
        if not enough.any():
            return np.nan
        means = [values.mean() for values, many in zip(classes, enough, strict=True) if many]
        return float(np.average(means, weights=used[enough]))

    vertical = [_mean(restitution(sets.mean[k], sets.covariance[k], 90.0)[1]) for k in range(5)]
    along = result["plan_distance"].values / np.cos(np.radians(Talus().angle))
    turns = _turns(result)
    return {
        "rt": float(np.median(r_t)) if r_t.size else np.nan,
        "rn_5_15": over(r_n, 5, 15),
        "rn_vertical": float(np.sum(used[used > 0] * np.array(vertical)[used > 0])),
        "tangential": tangential_above(result, TANGENTIAL),
        "stop_short": _mean((along >= SHORT[0]) & (along < SHORT[1])),
        "turns_small": _mean(turns < TURNS[0]),
        "turns_large": _mean(turns >= TURNS[1]),
        **{f"used_{k + 1}": used[k] for k in range(5)},
    }


def _turns(result: xr.Dataset) -> np.ndarray:
    """Absolute turns in plan at the contacts of recorded trajectories [degree]."""
    boulder, leg = result["trajectory_boulder"].values, result["trajectory_leg"].values
    met = are_met(boulder, leg)
    x, y = (result[f"trajectory_velocity_{axis}"].values[met] for axis in "xy")
    boulder = boulder[met]
    same = boulder[1:] == boulder[:-1]
    cross = x[:-1] * y[1:] - y[:-1] * x[1:]
    turn = np.degrees(np.abs(np.arctan2(cross, x[:-1] * x[1:] + y[:-1] * y[1:])))
    moving = (np.hypot(x, y)[1:] > 0) & (np.hypot(x, y)[:-1] > 0)
    return turn[same & moving & np.isfinite(turn)]


def tangential_above(result: xr.Dataset, limit: float) -> float:
    """Fraction of rebounds whose tangential fraction of the incident energy exceeds a limit; values
    in the bin of the limit are assumed uniform."""
    rebounds = result["tangential_share_histogram"].values
    low, high = result["tangential_share_bin_bounds"].values.T
    above = np.clip((high - limit) / (high - low), 0, 1)
    return float((above * rebounds).sum() / max(1, rebounds.sum()))


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else np.nan
