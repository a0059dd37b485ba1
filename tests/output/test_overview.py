# SPDX-License-Identifier: BSD-3-Clause
"""The overview: a picture for every result, with and without its optional parts, no warnings."""

import numpy as np
import pytest
import xarray as xr

from rockfall.io.grid import Grid
from rockfall.plots.overview import overview
from rockfall.result.trajectories import height, trajectories

pytest.importorskip("matplotlib", reason="the report extra is not installed").use("Agg")
pytestmark = pytest.mark.filterwarnings("error")

ENDS = {"flag_values": np.arange(5, dtype="i1"), "flag_meanings": "stopped absorbed left_domain impact_limit hit_nodata"}  # fmt: skip  # noqa: E501
OPTIONAL = {
    "maps": ["passages"],
    "lines": ["line_x", "line_y", "line_vertex_line", "line_vertex_x", "line_vertex_y"],
    "trajectories": [
        f"trajectory_{c}"
        for c in ("boulder", "x", "y", "z", "time", "velocity_x", "velocity_y", "velocity_z")
    ],
}


def scene(west: float = 0.0, north: float = 300.0) -> tuple[np.ndarray, Grid]:
    """A slope of 0.7 that falls southwards, with a corner of nodata."""
    grid = Grid(west, north, 5.0, 40, 60)
    dem = np.repeat(0.7 * (grid.y - grid.y[-1])[:, None], grid.nx, axis=1)
    dem[:5, :5] = np.nan
    return dem, grid


def result(grid: Grid, boulders: int = 200) -> xr.Dataset:
    """Boulders that run straight down for 50 to 250 m and hop 10 m at a time; two lines."""
    rng = np.random.default_rng(1)
    x0, y0 = grid.west + 100.0, grid.north - 20.0
    run = rng.uniform(50, 250, boulders)
    x = np.full(boulders, x0) + rng.normal(0, 5, boulders)
    lines = np.array([80.0, 160.0])
    crossed = np.where(run > lines[:, None], 1.0, np.nan)
    hops = np.arange(0, run[0], 10.0)
    about = {
        "start_x": ("boulder", np.full(boulders, x0)),
        "start_y": ("boulder", np.full(boulders, y0)),
        "stop_x": ("boulder", x),
        "stop_y": ("boulder", y0 - run),
        "status": ("boulder", np.zeros(boulders, "i1"), ENDS),
        "line_x": (("line", "boulder"), crossed * x),
        "line_y": (("line", "boulder"), crossed * (y0 - lines[:, None])),
        "line_vertex_line": ("line_vertex", [0, 0, 1, 1]),
        "line_vertex_x": ("line_vertex", grid.west + np.array([10.0, 190.0] * 2)),
        "line_vertex_y": ("line_vertex", y0 - np.repeat(lines, 2)),
        "passages": (("y", "x"), np.full(grid.shape, boulders // 50)),
        "x": grid.x,
        "y": grid.y,
        "trajectory_boulder": ("trajectory_vertex", np.ones(hops.size, "i8")),
        "trajectory_x": ("trajectory_vertex", np.full(hops.size, x0)),
        "trajectory_y": ("trajectory_vertex", y0 - hops),
        "trajectory_z": ("trajectory_vertex", 0.7 * (y0 - hops - grid.y[-1])),
        "trajectory_time": ("trajectory_vertex", hops / 10),
        "trajectory_velocity_x": ("trajectory_vertex", np.zeros(hops.size)),
        "trajectory_velocity_y": ("trajectory_vertex", np.full(hops.size, -10.0)),
        "trajectory_velocity_z": ("trajectory_vertex", np.full(hops.size, 9.81 / 2 - 7)),
    }
    return xr.Dataset(about, coords={"line": ["EL1", "EL2"]}, attrs={"title": "A slope"})


def is_picture(path) -> bool:
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and path.stat().st_size > 10_000


@pytest.mark.parametrize("absent", [[], list(OPTIONAL)])
def test_overview_draws_what_there_is(tmp_path, absent):
    dem, grid = scene()
    shown = result(grid).drop_vars([name for part in absent for name in OPTIONAL[part]])
    overview(shown, dem, grid, tmp_path / "overview.png")
    assert is_picture(tmp_path / "overview.png")


def test_overview_of_one_boulder_far_from_the_origin(tmp_path):
    dem, grid = scene(west=5e5, north=5.2e6)
    overview(result(grid, boulders=1), dem.astype("f4"), grid, tmp_path / "one.png")
    assert is_picture(tmp_path / "one.png")


def test_overview_when_no_boulder_passes_a_line(tmp_path):
    dem, grid = scene()
    shown = result(grid)
    for name in "line_x", "line_y":
        shown[name][1] = np.nan
    overview(shown, dem, grid, tmp_path / "overview.png")
    assert is_picture(tmp_path / "overview.png")


def test_trajectories_are_parabolas_above_the_ground():
    dem, grid = scene()
    (curve,) = trajectories(result(grid))
    jump = curve.z - height((dem, grid), curve.x, curve.y)
    assert jump.min() == pytest.approx(0, abs=1e-9)
    assert jump.max() == pytest.approx(9.81 / 8)  # g T^2 / 8 in the middle of a flight of 1 s
