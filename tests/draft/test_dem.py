# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall dem`: elevations of points follow a formula, and edits have the described effect."""

import heapq

import numpy as np
import pytest
import rasterio

import scenes
from made import PLACE, hill, make_layer, make_raster
from rockfall.cli import main
from rockfall.draft.dem import dem_of_points
from rockfall.io.rasters.dem import read_dem
from rockfall.terrain.inverse_distance import Weights, interpolated, left_out
from rockfall.terrain.repairs import smoothed, without_holes, without_pits

W, N = PLACE.c, PLACE.f
NEAR = Weights(2.0, 12, 40.0)


def survey(n=150, seed=1):
    return np.random.default_rng(seed).uniform([0, 0, 1000], [100, 80, 1100], (n, 3))


def by_hand(points, x, y, weights):
    apart = np.hypot(points[:, 0] - x, points[:, 1] - y)
    order = np.argsort(apart)[: weights.neighbours]
    order = order[apart[order] <= weights.within]
    if not order.size:
        return np.nan
    weight = apart[order] ** -weights.power
    return (weight * points[order, 2]).sum() / weight.sum()


@pytest.mark.parametrize("weights", [NEAR, Weights(3.5, 4, 6.0), Weights(0.5, 1000, 1e9)])
def test_cells_are_the_mean_of_the_formula(weights):
    points, grid = survey(), scenes.grid(np.empty((20, 25)), 4.0)
    found = interpolated(points, grid, weights)
    wanted = [[by_hand(points, x, y, weights) for x in grid.x] for y in grid.y]
    np.testing.assert_allclose(found, wanted, rtol=1e-13)
    assert np.isnan(found).any() == (weights.within == 6.0)


def test_points_keep_their_elevation_and_a_level_stays_level():
    grid = scenes.grid(np.empty((16, 20)), 5.0)
    points = np.array([[grid.x[i], grid.y[j], 7.1 * i - j] for i in range(20) for j in range(16)])
    np.testing.assert_array_equal(interpolated(points, grid, NEAR), points[:, 2].reshape(20, 16).T)
    points = survey()
    points[:, 2] = 1234.1
    assert (interpolated(points, grid, NEAR) == 1234.1).all()
    tiny = np.array([[50 + 1e-200, 40, 1.0], [60, 40, 2.0]])  # no weight overflows
    assert np.isfinite(interpolated(tiny, grid, Weights(40.0, 2, 1e9))).all()


def test_each_point_is_foretold_by_the_others():
    points = survey(60)
    wanted = [
        by_hand(np.delete(points, k, axis=0), *points[k, :2], NEAR) - points[k, 2]
        for k in range(60)
    ]
    np.testing.assert_allclose(left_out(points, NEAR), wanted, rtol=1e-10)
    twice = np.repeat(points[:2], 20, axis=0)  # more points at one place than neighbours
    np.testing.assert_array_equal(left_out(twice, NEAR), 0.0)
    assert np.isnan(left_out(points[:1], NEAR)).all()


def test_a_survey_becomes_a_dem(tmp_path, capsys):
    path, out = tmp_path / "points.csv", tmp_path / "dem.tif"
    points = survey() + (W, N - 80, 0)
    path.write_text("id;x;y;z\n" + "".join(f"a;{x};{y};{z}\n" for x, y, z in points.tolist()))
    assert main(["dem", str(path), "-o", str(out), "--crs", "EPSG:32632"]) == 0
    said = capsys.readouterr().out
    dem, about = dem_of_points(path)
    assert f"{about.standard_error:.3g} m" in said and dem.grid.cell == 5.0 <= about.spacing < 10
    z, grid = read_dem(out)
    np.testing.assert_array_equal(z, dem.z)
    assert grid.crs.to_epsg() == 32632 and grid.matches(dem.grid)
    assert (grid.west <= points[:, 0]).all() and (grid.south <= points[:, 1]).all()
    with rasterio.open(out) as file:
        assert file.nodata == -9999 and "points.csv" in file.tags()["history"]


# ---- edits


def flooded(z):
    """Water levels at which each cell overflows, found from the rim inwards (Barnes et al.
    2014)."""
    level, heap = np.where(np.isnan(z), np.nan, np.inf), []
    padded = np.pad(z, 1, constant_values=np.nan)
    for r, c in np.argwhere(~np.isnan(z)).tolist():
        if np.isnan(padded[r : r + 3, c : c + 3]).any():
            level[r, c] = z[r, c]
            heap.append((z[r, c], r, c))
    heapq.heapify(heap)
    while heap:
        low, r, c = heapq.heappop(heap)
        for i, j in np.ndindex(3, 3):
            p, q = r + i - 1, c + j - 1
            if 0 <= p < z.shape[0] and 0 <= q < z.shape[1] and np.isinf(level[p, q]):
                level[p, q] = max(low, z[p, q])
                heapq.heappush(heap, (level[p, q], p, q))
    return level


def test_pits_are_filled_to_where_they_run_over_and_ditches_stay():
    z = np.random.default_rng(3).normal(0, 1, (30, 25)) + 500
    z[10:13, 5:8] = np.nan
    np.testing.assert_allclose(without_pits(z, 1e3), flooded(z), rtol=0, atol=1e-9)
    shallow = without_pits(z, 0.5)
    raised = shallow > z
    assert raised.any() and (shallow - z)[raised].max() <= 0.5
    np.testing.assert_allclose(shallow[raised], flooded(z)[raised], rtol=0, atol=1e-9)
    ditch = hill(9, 9)
    ditch[3:6, 3:6] -= 9.0
    np.testing.assert_array_equal(without_pits(ditch, 1.0), ditch)


def test_holes_are_filled_and_nothing_is_made_up_beyond_the_terrain():
    z = hill(20, 20)
    z[5:8, 5:8] = z[:, 16:] = np.nan
    done = without_holes(z, 5)
    hole = done[5:8, 5:8]
    assert (hole > z[4, 4]).all() and (hole < z[8, 8]).all()
    known = ~np.isnan(z)
    np.testing.assert_array_equal(done[known], z[known])
    assert np.isnan(done[:, 16:]).all()
    z[5:16, 3:14] = np.nan
    assert np.isnan(without_holes(z, 2)[10, 8])  # too far from the edge of the hole


def test_smoothing_takes_noise_and_leaves_planes():
    z = hill(40, 40)
    z[3, 3] = np.nan
    done = smoothed(z, 2.0)
    inner = slice(12, -12), slice(12, -12)
    np.testing.assert_allclose(done[inner], z[inner], atol=1e-9)
    assert np.isnan(done).sum() == 1
    noisy = z + np.random.default_rng(1).normal(0, 1, z.shape)
    assert 0.05 < (smoothed(noisy, 2.0) - done)[inner].std() < 0.25  # 1/(2 sqrt(pi) std) = 0.14


def test_dams_and_cuts_of_layers_in_the_order_given(tmp_path):
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    dem, out = tmp_path / "dem.tif", str(tmp_path / "out.tif")
    z = np.full((40, 40), 100.0, "f4")
    z[0, 0] = -32768
    make_raster(dem, z, nodata=-32768)
    crest = shapely.LineString([(W + 50, N - 100), (W + 150, N - 100)])
    make_layer(
        tmp_path / "dam.gpkg", [crest], height=[6.0], crest_width=[10.0], allow_coarse=[True]
    )
    ditch = shapely.LineString([(W, N - 77.5), (W + 200, N - 77.5)])
    plot = shapely.box(W + 20, N - 40, W + 40, N - 20)
    make_layer(
        tmp_path / "cut.gpkg", [ditch, plot],
        depth=[2.0, None], width=[5.0, None], level=[None, 97.5],
    )  # fmt: skip
    edits = ["--dam", str(tmp_path / "dam.gpkg"), "--cut", str(tmp_path / "cut.gpkg")]
    assert main(["dem", str(dem), "-o", out, *edits]) == 0
    found, grid = read_dem(out)
    assert np.isnan(found[0, 0]) and found.dtype == np.float32 and grid.crs.to_epsg() == 32632
    assert np.nanmax(found) == 106.0 and (found[20, 10:30] == 106.0).all()
    assert (found[15, 1:39] == 98.0).all() and (found[4:8, 4:8] == 97.5).all()
    assert np.count_nonzero(found != 100) == 40 + 16 + 1 + np.count_nonzero(found > 100)
    with rasterio.open(out) as file:
        assert file.nodata == -32768


@pytest.mark.parametrize(
    ("keys", "metres"),
    [({"depth": [300.0]}, 300), ({"level": [3.0]}, 97), ({"depth": [3.0]}, None)],
)
def test_a_cut_in_another_unit_is_told(tmp_path, capsys, keys, metres):
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    make_raster(tmp_path / "dem.tif", np.full((40, 40), 100.0, "f4"))
    make_layer(tmp_path / "cut.gpkg", [shapely.box(W + 20, N - 40, W + 40, N - 20)], **keys)
    edits = ["-o", str(tmp_path / "out.tif"), "--cut", str(tmp_path / "cut.gpkg")]
    assert main(["dem", str(tmp_path / "dem.tif"), *edits]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if "lowers the terrain" in line]
    assert len(told) == (metres is not None)
    assert metres is None or f"by up to {metres} m: is depth in cm" in told[0]


# ---- refusals

POINTS = "x,y,z\n0,0,1\n10,5,2\n3,9,4\n"


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("x,y\n1,2\n", [], "points.csv: line 1: must have exactly one column z (columns: x, y)"),
        ("x,y,z\n1,2,up\n", [], "line 2: z = up: must be a number"),
        ("x,y,z\n1,2,nan\n", [], "line 2: z = nan: must be a number"),
        ("x,y,z\n1,2,3\n", [], "all points lie on a line along an axis: give --cell and --within"),
        (POINTS, ["--cell", "nan"], "--cell nan: must be > 0"),
        (
            POINTS,
            ["--cell", "1e-9"],
            "--cell 1e-09: points are 5.48 m apart: must be at least 0.0548",
        ),
        (POINTS, ["--within", "0.001"], "all cells are nodata"),
        (POINTS, ["--neighbours", "0"], "--neighbours 0: must be > 0"),
        (POINTS, ["--crs", "EPSG:4326"], "cells are in degrees"),
        (POINTS, ["--crs", "moon"], "--crs moon: is not a known CRS"),
        (POINTS, ["--smooth", "-1"], "--smooth -1: must be > 0 [m]"),
        (POINTS, ["--dam", "none.gpkg"], "none.gpkg"),
        (POINTS, ["--cut", "none.gpkg"], "none.gpkg"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(text, options, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "points.csv").write_text(text)
    assert main(["dem", "points.csv", "-o", "dem.tif", *options]) == 2
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1
    assert [one.name for one in tmp_path.iterdir()] == ["points.csv"]


def test_points_cannot_be_cut(tmp_path, capsys):
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    make_raster(tmp_path / "dem.tif", hill())
    make_layer(tmp_path / "a.gpkg", [shapely.Point(W + 9, N - 9)], depth=[1.0], width=[9.0])
    cut = ["--cut", str(tmp_path / "a.gpkg")]
    assert main(["dem", str(tmp_path / "dem.tif"), "-o", str(tmp_path / "o.tif"), *cut]) == 2
    assert "is a point: must be a line or polygon" in capsys.readouterr().err


def test_nothing_is_written_over_that_is_not_ours(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    make_raster("dem.tif", hill())
    make_raster("other.tif", hill())
    for out, said in (
        ("dem.tif", "is an input"),
        ("other.tif", "already exists; not overwritten"),
        ("dem.nc", "must end in .tif"),
    ):
        assert main(["dem", "dem.tif", "-o", out, "--smooth", "5"]) == 2
        assert said in capsys.readouterr().err
    assert main(["dem", "dem.tif", "-o", "new.tif"]) == 2
    assert main(["dem", "dem.tif", "-o", "new.tif", "--smooth", "5", "--cell", "2"]) == 2
    for again in ([], ["--overwrite"]):
        assert main(["dem", "dem.tif", "-o", "new.tif", "--smooth", "5", *again]) == 0
