# SPDX-License-Identifier: BSD-3-Clause
"""What is known of rebounds on rocky slopes, beside what an impact set gives.

The numbers known are those that Bourrier et al. (2009) print: R_t and R_n of their impacts, and the
results of their methods A and B on the slope of Vaujany, here on the stand-in of cases/vaujany.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rockfall.errors import RockfallError
from rockfall.lab.bounce import admissible
from rockfall.lab.fit import ImpactSet
from rockfall.lab.setfile import write_sets

LEAST_REBOUNDS = 20  # of a class of incidence angles, for a mean
DRAWS = 4000  # of A, for the means of R_t and R_n of a set alone


@dataclass(frozen=True)
class Target:
    """What a number should be: from `least` to `most`, or beyond the only one of them that there
    is; `known` is what the paper prints."""

    name: str
    label: str
    least: float
    most: float
    known: str
    check_only: bool = False  # kept out of every calibration


def _about(name, label, value, share, check_only=False) -> Target:
    return Target(name, label, value * (1 - share), value * (1 + share), f"{value:g}", check_only)


INF = float("inf")
TARGETS = (
    Target("rn_vertical", "R_n at vertical impact", 0.35, 0.45, "0.4"),
    Target("rt_15_30", "R_t at 15-30 degrees", 0.65, 0.75, "0.7"),
    Target("rn_15", "R_n below 15 degrees", 1.0, INF, "> 1"),
    _about("speed", "EL1, B: speed, mean [m/s]", 12.7, 0.10),
    _about("speed_std", "EL1, B: speed, deviation [m/s]", 4.3, 0.20),
    _about("height", "EL1, B: passing height, mean [m]", 1.4, 0.10),
    _about("height_std", "EL1, B: passing height, deviation [m]", 1.0, 0.20),
    Target("rotation", "EL1, B: E_rot / E_tot, mean", 0.03, 0.10, "0.06"),
    Target("tangential", "B: rebounds with tangential share > 0.75", 0.90, 0.96, "0.93"),
    Target("a_slower", "EL1: speed of B less that of A [m/s]", 0.0, INF, "1.2"),
    Target("a1_trend", "a1 of R_b/R_m = 5 less that of 1", 0.0, INF, "(lab) > 0"),
    Target("a4_trend", "a4 of R_b/R_m = 5 less that of 1", -INF, 0.0, "(lab) < 0"),
    _about("el2_speed", "EL2, B: speed, mean [m/s]", 12.1, 0.10, True),
    _about("el2_speed_std", "EL2, B: speed, deviation [m/s]", 5.1, 0.20, True),
    _about("el2_height", "EL2, B: passing height, mean [m]", 1.4, 0.10, True),
    _about("el2_height_std", "EL2, B: passing height, deviation [m]", 1.1, 0.20, True),
    Target("el2_rotation", "EL2, B: E_rot / E_tot, mean", 0.04, 0.12, "0.08", True),
    _about("speed_max", "EL1, B: speed, greatest [m/s]", 30.3, 0.20, True),
    _about("height_max", "EL1, B: passing height, greatest [m]", 11.0, 0.20, True),
    _about("el2_speed_max", "EL2, B: speed, greatest [m/s]", 31.8, 0.20, True),
    _about("el2_height_max", "EL2, B: passing height, greatest [m]", 12.7, 0.20, True),
)


@dataclass(frozen=True)
class Sets:
    """The five sets of a file: means (5, 9), covariances (5, 9, 9), points behind them (5,)."""

    name: str
    mean: np.ndarray
    covariance: np.ndarray
    points: np.ndarray  # 0: not said, the set is taken as exact


def read_sets(source: str | Path) -> Sets:
    """A set file, or a set that is shipped with the program, by its name."""
    from rockfall._core import rockfall_f2py as core
    from rockfall.scene import TURNINGS, shipped_sets

    path = shipped_sets().get(str(source), Path(source))
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RockfallError(f"{source}: cannot be read: {error}") from error
    turning = TURNINGS["past_aspect"]  # needs nothing but the matrices
    mean, covariance, *_, code, message = core.read_sets(
        text.encode() or b"\n", str(source).encode(), turning
    )
    if code:
        raise RockfallError(message.decode().strip(), code)
    found = re.findall(r"^! (\d+) (?:points|impacts);", text, re.MULTILINE)
    points = np.array(found, int) if len(found) == 5 else np.zeros(5, int)
    return Sets(Path(source).stem, mean.T, covariance.T, points)


def restitution(
    mean: np.ndarray, covariance: np.ndarray, angle: float, seed: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """R_t and R_n (draws,) of one set at an incidence angle [degrees] without spin.

    Only admissible draws: V_n_out > 0, no energy gained (model, section 4). At 90 degrees R_t is
    NaN.
    """
    generator = np.random.Generator(np.random.PCG64(seed))
    draws = generator.multivariate_normal(
        mean, covariance, DRAWS, method="eigh", check_valid="ignore"
    )
    t, n = np.cos(np.radians(angle)), -np.sin(np.radians(angle))
    if angle == 90:
        t = 0.0
    v_in = np.array([t, n, 0.0])
    out = draws.reshape(-1, 3, 3) @ v_in
    out = out[admissible(v_in[None], out)]
    return out[:, 0] / (t or np.nan), -out[:, 1] / n


class Site:
    """The slope of cases/vaujany, by methods A and B."""

    def __init__(self, folder: str | Path, boulders: int = 10_000, trajectories: int = 500):
        from rockfall.case import read_case

        folder = Path(folder)
        if not (folder / "case.nml").exists():
            raise RockfallError(
                f"{folder}: no case.nml there: the scorecard needs the folder cases/vaujany"
            )
        self._trajectories = trajectories
        self._cases = {
            method: read_case(folder / name).replace(case={"boulders": boulders})
            for method, name in (("A", "case_A.nml"), ("B", "case.nml"))
        }

    def numbers(self, mean: np.ndarray, covariance: np.ndarray, seed: int = 1) -> dict[str, float]:
        """What the five sets give, under the names of TARGETS and some more."""
        import rockfall

        result = {}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "sets.nml"
            nothing = np.zeros(9)
            exact = {
                k + 1: ImpactSet(mean[k], covariance[k], nothing, np.zeros((9, 9)), 0, 0.0)
                for k in range(5)
            }
            write_sets(path, exact, [])
            for method, case in self._cases.items():
                output = {"trajectories": self._trajectories if method == "B" else 0, "maps": None}
                changed = case.replace(
                    case={"seed": seed}, impact={"sets": str(path)}, output=output
                )
                result[method] = rockfall.run(changed)
        return self._summary(mean, covariance, **result)

    @staticmethod
    def _summary(mean, covariance, A, B) -> dict[str, float]:
        numbers = {"a1_trend": mean[4, 0] - mean[0, 0], "a4_trend": mean[4, 3] - mean[0, 3]}
        for line, start in (("EL1", ""), ("EL2", "el2_")):
            at = B.sel(line=line)
            passed = at["line_speed"].notnull().values
            numbers[f"{start}passing"] = _mean(passed)
            for name, variable in (("speed", "line_speed"), ("height", "line_passing_height")):
                values = at[variable].values[passed]
                enough = values.size > 1
                numbers[start + name] = _mean(values)
                numbers[f"{start}{name}_std"] = values.std(ddof=1) if enough else np.nan
                numbers[f"{start}{name}_max"] = values.max() if enough else np.nan
            rotation, motion = at["line_energy_rotational"], at["line_energy_translational"]
            share = (rotation / (rotation + motion)).values[passed]
            numbers[f"{start}rotation"] = _mean(share)
        of_a = A.sel(line="EL1")["line_speed"].values
        numbers["a_slower"] = numbers["speed"] - _mean(of_a[np.isfinite(of_a)])
        numbers["tangential"] = tangential_above(B, 0.75)
        return numbers | _over_rebounds(mean, covariance, B)


def tangential_above(result, limit: float) -> float:
    """Share of the rebounds with a larger tangential share of their incident energy; those of a bin
    across the limit lie evenly in it."""
    rebounds = result["tangential_share_histogram"].values
    low, high = result["tangential_share_bin_bounds"].values.T
    above = np.clip((high - limit) / (high - low), 0, 1)
    return float((above * rebounds).sum() / max(1, rebounds.sum()))


def _over_rebounds(mean: np.ndarray, covariance: np.ndarray, result) -> dict[str, float]:
    """R_t and R_n by classes of incidence angle, and R_n of the sets at vertical impact.

    For each R_b/R_m apart, over its rebounds of the recorded trajectories; then over the ratios,
    each with its share of all rebounds. Without this standard mixture a class would tell what
    ground the few steep rebounds met rather than how R_t and R_n depend on the angle.
    """
    t, n = result["trajectory_in_t"].values, result["trajectory_in_n"].values
    hit = np.isfinite(t) & (t > 0) & (n < 0)
    angle = np.degrees(np.arctan2(-n[hit], t[hit]))
    r_t = result["trajectory_out_t"].values[hit] / t[hit]
    r_n = -result["trajectory_out_n"].values[hit] / n[hit]
    ratio = np.clip(np.rint(result["trajectory_ratio"].values[hit]), 1, 5)
    used = np.array([(ratio == k).mean() for k in range(1, 6)])

    def over(values: np.ndarray, least: float, most: float) -> float:
        inside = (angle >= least) & (angle < most)
        classes = [values[inside & (ratio == k)] for k in range(1, 6)]
        enough = np.array([one.size >= LEAST_REBOUNDS for one in classes])
        if not enough.any():
            return np.nan
        means = [one.mean() for one, known in zip(classes, enough, strict=True) if known]
        return float(np.average(means, weights=used[enough]))

    vertical = [_mean(restitution(mean[k], covariance[k], 90.0)[1]) for k in range(5)]
    return {
        "rt_15_30": over(r_t, 15, 30),
        "rn_15": over(r_n, 5, 15),
        "rn_vertical": float(used @ np.nan_to_num(vertical)),
        **{f"used_{k + 1}": used[k] for k in range(5)},
    }


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else np.nan


def standard_errors(
    sets: Sets, site: Site, replicates: int, advance: Callable[[int], None] = lambda _: None
) -> dict[str, float]:
    """Standard errors of the numbers of `Site.numbers`: deviation over replicates, each with other
    boulders and with a set that as many points might as well have given (means normal, covariances
    Wishart)."""
    from scipy.stats import wishart

    generator = np.random.Generator(np.random.PCG64(1))
    found = []
    for k in range(replicates):
        mean, covariance = sets.mean.copy(), sets.covariance.copy()
        for r, n in enumerate(sets.points):
            if n > 10:
                values, vectors = np.linalg.eigh(covariance[r])
                root = vectors * np.sqrt(np.maximum(values, 0))
                mean[r] += root @ generator.normal(size=9) / np.sqrt(n)
                scatter = wishart(n - 1, np.eye(9)).rvs(random_state=generator) / (n - 1)
                covariance[r] = root @ scatter @ root.T
        found.append(site.numbers(mean, covariance, seed=k + 2))
        advance(1)
    return {name: float(np.nanstd([one[name] for one in found], ddof=1)) for name in found[0]}


def met(target: Target, value: float) -> bool:
    if target.most == INF:
        return value > target.least
    if target.least == -INF:
        return value < target.most
    return target.least <= value <= target.most


def table(rows: Iterable[tuple[str, dict[str, float], dict[str, float]]]) -> str:
    """The scorecard of sets (name, numbers, standard errors), as text."""
    rows = list(rows)
    width = max(12, *(len(name) for name, _, _ in rows)) + 12
    head = f"{'':44}{'paper':>10}{'asked':>15}"
    lines = [head + "".join(f"{name:>{width}}" for name, _, _ in rows)]
    for check_only in (False, True):
        if check_only:
            lines += ["", "Kept for the check, in no calibration:"]
        for target in (t for t in TARGETS if t.check_only == check_only):
            line = f"{target.label:44}{target.known:>10}{_range(target):>15}"
            for _, numbers, errors in rows:
                value, error = numbers[target.name], errors[target.name]
                verdict = "met" if met(target, value) else "NOT"
                line += f"{f'{value:.2f} +- {error:.2f} {verdict}':>{width}}"
            lines.append(line)
    lines.append("")
    for name, label in (("passing", "Passing EL1"), ("el2_passing", "Passing EL2")):
        line = f"{label:44}{'-':>10}{'-':>15}"
        for _, numbers, errors in rows:
            line += f"{f'{numbers[name]:.2f} +- {errors[name]:.2f}    ':>{width}}"
        lines.append(line)
    for name, numbers, _ in rows:
        asked = [t for t in TARGETS if not t.check_only]
        good = sum(met(t, numbers[t.name]) for t in asked)
        lines.append(f"{name}: {good} of {len(asked)} met")
    return "\n".join(lines)


def by_ratio(sets: Sets) -> str:
    """R_t and R_n of each ratio alone, without spin: mean +- deviation over admissible draws."""
    angles = 10.0, 15.0, 22.5, 30.0, 90.0
    lines = [f"{sets.name}: R_t | R_n at incidence angles, no spin, mean +- deviation"]
    lines.append("  R_b/R_m" + "".join(f"{angle:>32g}" for angle in angles))
    for k in range(5):
        cells = []
        for angle in angles:
            r_t, r_n = restitution(sets.mean[k], sets.covariance[k], angle)
            left = "-" if angle == 90 else f"{r_t.mean():.2f} +- {r_t.std():.2f}"
            cells.append(f"{f'{left} | {r_n.mean():.2f} +- {r_n.std():.2f}':>32}")
        lines.append(f"  {k + 1:7d}" + "".join(cells))
    return "\n".join(lines)


def _range(target: Target) -> str:
    if target.most == INF:
        return f"> {target.least:g}"
    if target.least == -INF:
        return f"< {target.most:g}"
    return f"{target.least:.3g} to {target.most:.3g}"
