# SPDX-License-Identifier: BSD-3-Clause
"""Steep cells as sources, and boulders in proportion to the true surface area of their cells."""

import re

import numpy as np
import pytest

import rockfall
from made import make_layer, make_raster, refused
from programs import refuses
from rockfall.cli import main
from rockfall.scene.read import read_scene
from rockfall.studies.convergence import converge
from rockfall.studies.ensemble.study import run_ensemble
from rockfall.studies.run_until import run_until
from same import same
from scenes import grid, make_case, rough, sets

LINE = [{"name": "L", "x": [0.0, 300.0], "y": [280.0, 280.0]}]


def released(scene):
    return np.array([len(scene.numbers_of(k)) for k in range(scene.x.size)])


def steep(folder, line=LINE, **groups):
    groups["release"] = {"steep_cells": True} | groups.get("release", {})
    return make_case(folder, *sets(2.0), line=line, **{"terrain": {}, **groups})


def plane(tangent, nx=9, ny=7, cell=2.5, towards=(0.6, 0.8), dtype="f8"):
    """Elevations of a plane that falls in a direction by a slope of given tangent."""
    y, x = np.mgrid[ny - 1 : -1 : -1, 0:nx] * cell
    return (1000.0 - tangent * (towards[0] * x + towards[1] * y)).astype(dtype)


def cells_of(scene):
    g, found = scene.grid, np.zeros(scene.grid.shape, bool)
    row, column = (g.north - scene.y) / g.cell, (scene.x - g.west) / g.cell
    found[row.astype(int), column.astype(int)] = True
    assert found.sum() == scene.x.size
    return found


@pytest.mark.parametrize("degrees", [10.0, 44.0, 80.0])
def test_a_plane_is_steep_above_the_threshold_and_not_below(tmp_path, degrees):
    z = plane(np.tan(np.radians(degrees)))
    inner = np.zeros(z.shape, bool)
    inner[1:-1, 1:-1] = True  # cells without a 3x3 window
    below = steep(tmp_path, release={"slope_threshold": degrees - 1e-9})
    assert np.array_equal(cells_of(read_scene(below, dem=z, transform=grid(z, 2.5))), inner)
    above = steep(tmp_path, release={"slope_threshold": degrees + 1e-9})
    with refused(f"case: &release steep_cells: no cell is as steep as {degrees:.1f} degrees"):
        read_scene(above, dem=z, transform=grid(z, 2.5))


def test_45_degrees_are_at_the_threshold_of_45(tmp_path):
    z = plane(1.0, cell=2.0, towards=(1, 0))
    case = steep(tmp_path, release={"slope_threshold": 45.0})
    assert read_scene(case, dem=z, transform=grid(z, 2.0)).x.size == 7 * 5


@pytest.mark.parametrize("cell", [0.5, 5.0, 25.0])
def test_the_usual_threshold_is_that_of_the_cell_size(tmp_path, cell):
    usual = 55 * cell**-0.075
    for apart, many in ((1e-9, 35), (-1e-9, 0)):
        z = plane(np.tan(np.radians(usual + apart)), cell=cell)
        if many:
            assert read_scene(steep(tmp_path), dem=z, transform=grid(z, cell)).x.size == many
        else:
            with pytest.raises(rockfall.RockfallError, match=f"as steep as {usual:.1f} degrees"):
                read_scene(steep(tmp_path), dem=z, transform=grid(z, cell))


def test_nodata_in_the_window_and_flats_are_no_sources(tmp_path):
    z = plane(2.0, nx=30, ny=30)
    z[20:, :] = z[20, :]
    z[8, 11] = np.nan
    expected = np.zeros(z.shape, bool)
    expected[1:20, 1:-1] = True
    expected[7:10, 10:13] = False
    found = cells_of(read_scene(steep(tmp_path), dem=z, transform=grid(z, 2.5)))
    assert np.array_equal(found[:19], expected[:19]) and not found[21:].any()
    single = read_scene(steep(tmp_path), dem=z.astype("f4"), transform=grid(z, 2.5))
    assert np.array_equal(cells_of(single)[:19], expected[:19])


def test_the_slope_is_that_of_horn(tmp_path):
    z = rough()
    case = steep(tmp_path, release={"slope_threshold": 40.0})
    found = cells_of(read_scene(case, dem=z, transform=grid(z)))
    window = np.lib.stride_tricks.sliding_window_view(z, (3, 3))
    weights = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]]) / (8 * 5.0)
    east, north = ((window * w).sum(axis=(2, 3)) for w in (weights, -weights.T))
    expected = np.degrees(np.arctan(np.hypot(east, north))) >= 40.0
    assert np.array_equal(found[1:-1, 1:-1], expected) and 0.1 < expected.mean() < 0.9


def test_only_steep_cells_within_cells_or_polygons(tmp_path):
    z = rough()
    make_raster(tmp_path / "dem.tif", z, transform=grid(z).transform, crs="EPSG:32632")
    about, least = {"terrain": {"dem": "dem.tif"}}, {"slope_threshold": 42.0}
    everywhere = cells_of(read_scene(steep(tmp_path, release=least, **about)))
    some = np.zeros(z.shape, "u1")
    some[3:20, 5:40] = 1
    make_raster(tmp_path / "some.tif", some, transform=grid(z).transform, crs="EPSG:32632")
    within = read_scene(steep(tmp_path, release=least | {"cells": "some.tif"}, **about))
    assert np.array_equal(cells_of(within), everywhere & (some > 0)) and within.x.size > 10
    shapely = pytest.importorskip("shapely")
    box = shapely.box(5 * 5.0, 400 - 20 * 5.0, 40 * 5.0, 400 - 3 * 5.0)
    make_layer(tmp_path / "some.gpkg", [box])
    inside = read_scene(steep(tmp_path, release=least | {"polygons": "some.gpkg"}, **about))
    assert np.array_equal(inside.x, within.x) and np.array_equal(inside.y, within.y)


REFUSED = {
    "steep_cells = .true., x = 1.0, y = 2.0": "&release steep_cells = .true.: is not valid for "
    "points",
    "by_area = .true., x = 1.0, y = 2.0": "&release by_area = .true.: is not valid for points",
    "cells = 'a', slope_threshold = 40.0": "&release slope_threshold = 40.0: is only valid "
    "with steep_cells = .true.",
    "steep_cells = .true., slope_threshold = 90": "&release slope_threshold = 90: must be 1 to 89 "
    "[degree]",
    "steep_cells = .false.": "&release: give one of: points (x, y, or a layer); cells; polygons; "
    "or steep_cells, alone or with cells or polygons",
}


@pytest.mark.parametrize("release", REFUSED)
def test_what_cannot_be_is_refused_in_one_line(
    few_boulders, tmp_path, monkeypatch, capsys, release
):  # fmt: skip
    monkeypatch.chdir(tmp_path)
    case = rockfall.read_case("case.nml")
    text = case.replace(release={"x": None, "y": None, "steep_cells": True}).text()
    given = text.replace("steep_cells = .true.", release).replace("    by_area = .false.\n", "")
    (tmp_path / "case.nml").write_text(given)
    refuses(["run", "case.nml"], f"case.nml: {re.escape(REFUSED[release])}", capsys)


def numbers_of(result):
    """Number of boulders from each start, in the order of the result."""
    start = result["start_x"].values + 1j * result["start_y"].values
    edges = np.flatnonzero(np.r_[True, start[1:] != start[:-1], True])
    return np.diff(edges)


@pytest.mark.parametrize("n", [1, 7])
@pytest.mark.parametrize("tangent", [0.0, 0.75, 2.0])
def test_a_plane_releases_by_its_true_area(tmp_path, n, tangent):
    """Each cell releases boulders by the area of the plane, also at the edge, where no 3x3 window
    is complete."""
    z = plane(tangent, nx=20, ny=15)
    release = {"steep_cells": None, "cells": "cells", "by_area": True}
    case = steep(tmp_path, case={"boulders": n}, release=release)
    cells = np.ones(z.shape, int)
    scene = read_scene(case, dem=z, transform=grid(z, 2.5), cells=cells)
    ratio, each = np.sqrt(1 + tangent**2), released(scene)
    assert abs(scene.boulders - n * z.size * ratio) < 1
    assert np.isin(each, [np.floor(n * ratio - 1e-9), np.ceil(n * ratio - 1e-9), n]).all()
    assert each.min() >= n and (tangent > 0 or (each == n).all())
    result = rockfall.run(case, dem=z, transform=grid(z, 2.5), cells=cells)
    assert np.array_equal(numbers_of(result), each)


def weighted(folder, **groups):
    """Case on steep cells that release by their area, with 200 trajectories."""
    output = {"maps": ["passages", "sources", "reach_probability_by_source"], "trajectories": 200}
    release = {"by_area": True, "slope_threshold": 44.0, "cells": "cells", "drop_height": 2.0}
    groups = {"case": {"boulders": 3}, "output": output, **groups}
    return steep(folder, release=release, **groups)


def top():
    cells = np.zeros(rough().shape, int)
    cells[2:12, 5:55] = 1
    return cells


def test_boulders_by_area_are_the_same_however_they_are_flown(tmp_path):
    z, case = rough(), weighted(tmp_path)
    arrays = {"dem": z, "transform": grid(z), "cells": top()}
    whole = rockfall.run(case, **arrays)
    scene = read_scene(case, **arrays)
    each = released(scene)
    assert np.array_equal(numbers_of(whole), each) and len(np.unique(each)) > 1
    same(rockfall.run(case, **arrays, threads=2, chunk=17), whole)
    parts = [rockfall.run(case, **arrays, shard=(k, 9), threads=2) for k in range(1, 10)]
    same(rockfall.merge(parts), whole)
    first = np.flatnonzero(np.diff(whole["trajectory_boulder"].values, prepend=0))
    number = whole["trajectory_boulder"].values[first]
    assert np.array_equal(whole["trajectory_x"].values[first], whole["start_x"].values[number - 1])
    begins = np.cumsum(each) - each
    wanted = np.cumsum(each) * 200 // each.sum()  # sources up to each
    expected = [
        np.arange(start, start + n)
        for start, n in zip(begins, np.diff(wanted, prepend=0), strict=True)
    ]
    assert np.array_equal(number - 1, np.concatenate(expected)) and number.size == 200
    flat = rockfall.run(case.replace(release={"by_area": False}), **arrays)
    assert flat.sizes["boulder"] == 3 * each.size < whole.sizes["boulder"]
    assert np.array_equal(flat["volume"].values[:3], whole["volume"].values[:3])


def test_check_says_how_many_and_from_which_slope_on(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    z = rough()
    make_raster(tmp_path / "dem.tif", z, transform=grid(z).transform)
    case = steep(tmp_path, terrain={"dem": "dem.tif"}, release={"by_area": True})
    (tmp_path / "case.nml").write_text(case.text())
    assert main(["check", "case.nml"]) == 0
    scene = read_scene(case)
    assert (
        f"{scene.boulders:,}, 50 from a flat cell, more by area; sources: {scene.x.size:,} (cells "
        f"of {55 * 5**-0.075:.1f} degrees or more)"
    ) in capsys.readouterr().out


def test_what_needs_the_same_from_each_source_is_refused(tmp_path):
    z, case = rough(), weighted(tmp_path)
    arrays = {"dem": z, "transform": grid(z), "cells": top()}
    make_raster(tmp_path / "dem.tif", z, transform=grid(z).transform)
    make_raster(tmp_path / "cells.tif", top().astype("u1"), transform=grid(z).transform)
    files = case.replace(terrain={"dem": "dem.tif"}, release={"cells": "cells.tif"})
    refusal = (
        "case: &release by_area = .true.: {} requires equal numbers of boulders from each source"
    )
    with refused(refusal.format("--until")):
        run_until(case, "share@L<5%", **arrays)
    with refused(refusal.format("an ensemble")):
        run_ensemble(case, **arrays)
    with refused(refusal.format("a study of convergence")):
        converge(files)
