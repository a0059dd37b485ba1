# SPDX-License-Identifier: BSD-3-Clause
"""Terrain, impact sets and cases for tests."""

from pathlib import Path

import numpy as np

import rockfall
from rockfall.io.rasters.grid import Grid
from rockfall.result import variables

#: Factors of standards, which are not shipped: only numbers for tests.
FACTORS = Path(__file__).with_name("factors.csv")


def rough(nx=60, ny=80, cell=5.0, gradient=0.8, relief=3.0, seed=1, dtype="f8"):
    """South-facing slope with bumps of all sizes down to one cell."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[ny - 1 : -1 : -1, 0:nx] * cell
    z = gradient * y + 1000.0
    for wave in (4, 8, 16, 32):
        phase = random.uniform(0, 2 * np.pi, 2)
        size = relief * wave / 32
        z += size * np.sin(2 * np.pi * x / (wave * cell) + phase[0])
        z += size * np.sin(2 * np.pi * y / (wave * cell) + phase[1])
    return (z + random.normal(0, 0.1 * relief, z.shape)).astype(dtype)


#: Rough slope: boulders bounce back, spin both ways, and some draws are rejected.
LIVELY_MEAN = np.array([0.62, 0.02, 0.13, 0.19, -0.45, -0.19, 0.24, 0.05, 0.34])
LIVELY_SPREAD = np.array([0.12, 0.15, 0.1, 0.08, 0.1, 0.05, 0.15, 0.2, 0.15])
LIVELY_COVARIANCE = np.outer(LIVELY_SPREAD, LIVELY_SPREAD) * (0.8 * np.eye(9) + 0.2)


#: Set without backward throws, so that headings are known: mean, lower triangle row by row.
CALM_MEAN = "0.6209, 0.0000, 0.1313, 0.1899, -0.4122, -0.1923, 0.2351, 0.0000, 0.3376"
CALM_ROWS = """    0.002672,
    0.000000, 0.002672,
    0.000000, 0.000000, 0.002672,
    -0.000681, 0.000000, 0.000000, 0.000894,
    0.000000, 0.000000, 0.000000, 0.000000, 0.000894,
    0.000000, 0.000000, 0.000000, 0.000000, 0.000000, 0.000894,
    0.002697, 0.000000, 0.000000, 0.000000, 0.000000, 0.000000, 0.022968,
    0.000000, 0.000000, 0.000000, 0.000000, 0.000000, 0.000000, 0.000000, 0.022968,
    0.000000, 0.000000, 0.000000, 0.000000, 0.000000, 0.000000, 0.000000, 0.000000, 0.022968
"""
#: File with this set for all ratios.
CALM_SETS = "".join(
    f"&impact_set ratio = {k}\n  mean = {CALM_MEAN}\n  covariance =\n{CALM_ROWS}/\n"
    for k in range(1, 6)
)


def sets(scatter=1.0):
    """Means (5, 9) and covariances (5, 9, 9) of sets with scatter, slightly harder for each larger
    ratio."""
    harder = 1 + 0.02 * np.arange(5)
    return np.outer(harder, LIVELY_MEAN), np.repeat(scatter * LIVELY_COVARIANCE[None], 5, axis=0)


#: Quantiles of a lateral deviation, over its standard deviation.
SPREAD = np.array([0, 0.13, 0.25, 0.39, 0.52, 0.67, 0.84, 1.04, 1.28, 1.64, 1.96, 2.58, 3.5])


def lateral(ratio):
    """Keys with the lateral deviations of a set, which are larger for steeper impacts and smaller
    ratios."""
    bounds = 15.0 + ratio, 40.0 + ratio
    classes = [spread / (1 + 0.2 * ratio) * SPREAD for spread in (7.0, 14.0, 25.0)]
    values = ", ".join(repr(float(one)) for one in np.concatenate(classes))
    return f" incidence = {bounds[0]}, {bounds[1]}\n lateral = {values}\n"


#: Covariances (5, 3, 3) of an impact's noise: V_t, V_n, W over |V_in|, smaller for larger ratios.
NOISE = np.array([[0.004, 0.001, -0.0015], [0.001, 0.0025, 0.0005], [-0.0015, 0.0005, 0.006]])
NOISE = NOISE / np.arange(1, 6)[:, None, None]


def fitted(ratio):
    """Keys with the fit ranges of a set; in most scenes some rebounds are outside."""
    return f" speed_range = {0.5 * ratio}, {10 + ratio}\n angle_range = {3 + ratio}, {50 + ratio}\n"


def usual(ratio):
    return lateral(ratio) + fitted(ratio)


def noise(ratio):
    """Keys of `usual` with the noise of a set."""
    lower = ", ".join(repr(float(one)) for one in NOISE[ratio - 1][np.tril_indices(3)])
    return f"{usual(ratio)} noise = {lower}\n"


def sets_text(mean, covariance, more=lambda ratio: ""):
    """Text of five impact sets with all digits; `more(ratio)` adds keys to each set."""
    groups = []
    for k in range(5):
        lower = ", ".join(repr(float(c)) for i in range(9) for c in covariance[k, i, : i + 1])
        means = ", ".join(repr(float(m)) for m in mean[k])
        head = f"&impact_set\n ratio = {k + 1}\n mean = {means}\n covariance = {lower}\n"
        groups.append(f"{head}{more(k + 1)}/\n")
    return "".join(groups)


def write_sets(path, *sets):
    path.write_text(sets_text(*sets))
    return path


def make_case(folder, mean, covariance, line=(), more=usual, **groups):
    """Case for an array of elevations, whose impact sets are written to `folder`."""
    write_sets(folder / "sets.nml", mean, covariance, more)
    case = {
        "case": {"boulders": 50, "seed": 20090601, "threads": 1},
        "boulder": {"volume": "fixed", "volume_mean": 0.8},
        "release": {"drop_height": 5.0},
    }
    case = {name: case.get(name, {}) | groups.get(name, {}) for name in {**case, **groups}}
    case["surface"] = case.get("surface") or {"uniform_mean_radius": 0.25}
    case["impact"] = {"sets": "sets.nml"} | case.get("impact", {})
    return rockfall.Case(folder=folder, line=line, **case)


def grid(z, cell=5.0, west=0.0, south=0.0):
    ny, nx = z.shape
    return Grid(west, south + ny * cell, cell, nx, ny)


def cut_below(z, y, cell=5.0):
    """Part of a slope north of `y`, and its grid, for boulders that end soon after a line there."""
    z = z[: z.shape[0] - round(y / cell)]
    return z, grid(z, cell, south=y)


def status(result):
    names = result.status.attrs["flag_meanings"].split()
    return [names[k - 1] for k in result.status.values]


#: Boulders of `case_in` per source.
BOULDERS = 403


def case_in(folder, **groups):
    """Case on `rough` with every map, a line, histograms and some trajectories."""
    line = [{"name": "L", "x": [0.0, 300.0], "y": [280.0, 280.0]}]
    output = {"maps": list(variables.MAP), "rebounds": True, "trajectories": 90}
    groups = {"case": {"boulders": BOULDERS}, "output": output, **groups}
    return make_case(folder, *sets(2.0), line=line, terrain={}, **groups)


def place(x=150.0, y=380.0):
    """Group &release with one point, for `case_in`."""
    return {"release": {"x": [x], "y": [y], "drop_height": 5.0}}
