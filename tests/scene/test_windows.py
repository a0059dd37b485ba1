# SPDX-License-Identifier: BSD-3-Clause
"""Terrain that does not fit in memory is read in windows, with bit-identical results."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from affine import Affine

import rockfall
from made import make_raster, write_ascii
from rockfall.cli import main
from rockfall.errors import RockfallError
from rockfall.io.rasters.grid import Grid
from rockfall.scene.read import read_scene
from rockfall.simulation import memory
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import run_scene
from rockfall.studies.run_until import run_scene_until, run_until
from same import same
from scenes import make_case, rough, sets

NY, NX, CELL = 220, 90, 5.0
PLACE = Affine(CELL, 0, 1000, 0, -CELL, 9000)
LINE = [{"name": "L", "x": [1000, 1450], "y": [8400.0, 8400.0]}]
MAPS = ["passages", "energy_mean", "jump_height_max_map", "speed_q90"]
SIZES = {"rg70": 0.5, "rg20": 0.2, "rg10": 0.9}


def elevations(dtype="f4"):
    z = rough(nx=NX, ny=NY, dtype=dtype)
    z[120:124, 40:45] = np.nan
    return z


def make_zones(folder, name="zones.tif"):
    ids = np.ones((NY, NX), "i2")
    ids[60:90] = 7
    ids[::9, ::7] = 300
    make_raster(
        folder / name, ids, transform=PLACE, crs=None, tiled=True, blockxsize=16, blockysize=16
    )
    (folder / "zones.csv").write_text("zone,mean_radius\n1,0.25\n7,0.4\n300,0.1\n")
    return {"zones": name, "table": "zones.csv"}


def make_sizes(folder):
    y, x = np.mgrid[:NY, :NX]
    for name, size in SIZES.items():
        values = (size * (1 + (x + 2 * y) % 5)).astype("f4")
        make_raster(folder / f"{name}.tif", values, transform=PLACE, crs=None)
    return {name: f"{name}.tif" for name in SIZES} | {"method": "A"}


def make_dem(folder, kind):
    z = elevations("f8" if kind == "ascii" else "f4")
    if kind == "tiff":
        about = {"tiled": True, "blockxsize": 32, "blockysize": 32}
        make_raster(folder / "dem.tif", z, transform=PLACE, crs=None, **about)
        return "dem.tif"
    if kind == "ascii":
        write_ascii(folder / "dem.asc", z, Grid(1000, 9000, CELL, NX, NY))
        return "dem.asc"
    grid = Grid(1000, 9000, CELL, NX, NY)
    about = {"axis": "Y", "units": "m"}
    dem = xr.DataArray(
        z[::-1], dims=("y", "x"), coords={"y": ("y", grid.y[::-1], about), "x": grid.x}, name="z"
    )
    dem.x.attrs.update(axis="X", units="m")
    dem.to_netcdf(folder / "dem.nc")
    return "dem.nc:z"


def case_in(folder, kind="tiff", surface=None, **groups):
    cells = np.zeros((NY, NX), "u1")
    cells[5:100:12, 8:80:11] = 1
    make_raster(folder / "cells.tif", cells, transform=PLACE, crs=None)
    output = {"maps": MAPS, "rebounds": True, "trajectories": 25}
    groups = {"case": {"boulders": 2}, "output": output} | groups
    groups.setdefault("release", {"cells": "cells.tif", "drop_height": 5.0})
    return make_case(
        folder, *sets(2.0), line=LINE, terrain={"dem": make_dem(folder, kind)},
        surface=surface or {}, **groups,
    )  # fmt: skip


def refused(pattern):
    return pytest.raises(RockfallError, match=pattern)


@pytest.mark.family(3)
@pytest.mark.parametrize(  # [bytes]; the DEM has 79,200
    ("surface", "size"), [(None, 10_000), (make_zones, 25_000), (make_sizes, 60_000)]
)
def test_windows_give_the_bits_of_the_whole(tmp_path, surface, size):
    case = case_in(tmp_path, surface=surface and surface(tmp_path))
    scene = read_scene(case, memory=size)
    assert scene.windows and scene.rasters.z.size == 0
    same(run_scene(scene, threads=2), rockfall.run(case))


@pytest.mark.all
@pytest.mark.parametrize("kind", ["ascii", "netcdf from the south"])
def test_windows_of_other_files(tmp_path, kind):
    case = case_in(tmp_path, kind, make_zones(tmp_path))
    scene = read_scene(case, memory=50_000)
    assert scene.windows
    same(run_scene(scene), rockfall.run(case))


@pytest.mark.all
def test_windows_of_boulders_that_break(tmp_path):
    """A boulder is counted only if all its fragments stay in the window; others are run again."""
    breakage = {"at": "both", "release_fall": 8.0, "max_fragments": 20}
    case = case_in(tmp_path, case={"boulders": 2}, breakage=breakage)
    scene = read_scene(case, memory=3_000)
    whole = rockfall.run(case)
    assert scene.windows and int(whole["breakages"].min()) > 0
    same(run_scene(scene), whole)


def test_windows_follow_the_sources_and_learn_how_far_boulders_go(tmp_path):
    case = case_in(tmp_path, case={"boulders": 9})
    scene = read_scene(case, memory=30_000)
    windows, seen = scene.windows, []
    rim = windows.margins[0]
    assert set(windows.margins) == {rim} and rim > 4
    rows = ((scene.grid.north - scene.y) / scene.grid.cell).astype(int)
    columns = ((scene.x - scene.grid.west) / scene.grid.cell).astype(int)
    for number in range(1, 9 * len(rows) + 1, 9):
        window, n = scene.around(number, 9)
        row, column = rows[number // 9], columns[number // 9]
        (top, left), (ny, nx) = window.rasters.at, window.rasters.z.shape
        assert n == 9 and ny * nx <= windows.cells
        assert top <= max(0, row - rim) and row + rim < top + ny
        assert left <= max(0, column - rim) and min(NX, column + rim) <= left + nx
        seen.append(window.rasters.at)
    assert 2 < len(set(seen)) < len(seen) / 2  # one window for many sources
    before = windows.margins.copy()
    run_scene(scene)
    assert windows.margins[2] > before[2]  # southwards, in the direction of boulders
    assert windows.margins[0] == before[0]


@pytest.mark.parametrize(
    ("cells", "slope"), [pytest.param(None, 48.0, marks=pytest.mark.all), ("cells.tif", 44.0)]
)
def test_steep_cells_and_their_surface(tmp_path, cells, slope):
    release = {"steep_cells": True, "slope_threshold": slope, "by_area": True, "drop_height": 5.0}
    case = case_in(
        tmp_path, case={"boulders": 1}, release=release | ({"cells": cells} if cells else {})
    )
    case = case.replace(impact={"impact_limit": 20})
    scene = read_scene(case, memory=30_000)
    assert scene.windows and 0 < scene.x.size < 6000
    same(run_scene(scene), rockfall.run(case))


@pytest.mark.all
def test_other_numbers_of_boulders_from_the_same_tiles(tmp_path):
    case = case_in(tmp_path)
    scene = read_scene(case, memory=20_000)
    run_scene(scene)
    more = replace(scene, case=case.replace(case={"boulders": 9}))
    same(run_scene(more), rockfall.run(more.case))
    rules = "share@L<30%"
    until = run_scene_until(read_scene(case, memory=20_000), rules, 15)
    same(until, run_until(case, rules, 15))


@pytest.mark.all
def test_parts_and_checkpoints(tmp_path):
    case = case_in(tmp_path)
    whole = rockfall.run(case)
    parts = [rockfall.run(case, memory=20_000, shard=(k, 2)) for k in (1, 2)]
    same(rockfall.merge(parts), whole)
    first = Checkpoint(tmp_path / "c", 0.0)
    run_scene(read_scene(case, memory=20_000), checkpoint=first, chunk=100)
    again = Checkpoint(tmp_path / "c", 0.0)
    same(run_scene(read_scene(case), checkpoint=again), whole)


@pytest.mark.all
def test_the_command(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("rockfall.simulation.pilot.PILOT_REBOUNDS", 2000)  # because of its times
    case = case_in(tmp_path, surface=make_zones(tmp_path))
    (tmp_path / "case.nml").write_text(case.text())
    assert main(["check", str(tmp_path / "case.nml"), "--memory", "30kB"]) == 0
    assert "90 x 220 cells of 5 m, in windows of about 2,500 cells" in capsys.readouterr().out
    run = ["run", str(tmp_path / "case.nml"), "--quiet", "-o"]
    assert main([*run, str(tmp_path / "a.nc")]) == 0
    assert main([*run, str(tmp_path / "b.nc"), "--memory", "30kB"]) == 0
    a, b = (rockfall.read_result(tmp_path / name) for name in ("a.nc", "b.nc"))
    assert a.attrs.pop("case_file") == b.attrs.pop("case_file")
    same(a, b)


# ---- what is wrong is found before the run, wherever it lies


def test_a_cell_without_a_zone(tmp_path):
    surface = make_zones(tmp_path)
    (tmp_path / "zones.csv").write_text("zone,mean_radius\n1,0.25\n7,0.4\n")
    with refused(r".*zones.tif: zone 300 \(\d+ cells\) has no row in .*"):
        read_scene(case_in(tmp_path, surface=surface), memory=20_000)


@pytest.mark.parametrize("x, y, what", [(1212.0, 8390.0, "nodata"), (900.0, 8390.0, "outside")])
def test_a_source_where_no_boulder_can_start(tmp_path, x, y, what):
    case = case_in(tmp_path, release={"x": [1100.0, x], "y": [8500.0, y], "drop_height": 5.0})
    with refused(rf"case: &release: source 2 \({x}.*{what}.*"):
        read_scene(case, memory=20_000)


def test_polygons_need_the_terrain_whole(tmp_path):
    (tmp_path / "z.geojson").write_text("{}")
    case = case_in(tmp_path, release={"polygons": "z.geojson", "drop_height": 5.0})
    with refused(r"case: &release polygons = 'z.geojson': polygons need the whole terrain .*"):
        read_scene(case, memory=20_000)


def test_maps_by_source_need_the_terrain_whole(tmp_path):
    case = case_in(tmp_path, output={"maps": ["sources"]})
    with refused(r"case: &output maps = 'sources': needs the whole terrain in memory.*"):
        read_scene(case, memory=20_000)


# ---- how much there is


@pytest.mark.parametrize("text, size", [("500MB", 5e8), ("4 g", 4e9), ("1.5TB", 1.5e12), ("7", 7)])
def test_sizes(text, size):
    assert memory.read_memory(text) == size


@pytest.mark.parametrize("text", ["", "GB", "-4GB", "4 apples", "0MB", "nan", "1e9"])
def test_what_is_no_size(text):
    with refused(f"--memory {text}: must be a size such as 500MB or 4GB"):
        memory.read_memory(text)


def test_the_least_limit_counts(tmp_path, monkeypatch):
    (tmp_path / "memory.max").write_text("max\n")
    (tmp_path / "job").write_text("123456789\n")
    monkeypatch.setattr(memory, "limit_files", lambda _: [tmp_path / "memory.max"])
    assert memory.machine_memory() > 1e9
    monkeypatch.setattr(memory, "limit_files", lambda _: [tmp_path / "none", tmp_path / "job"])
    assert memory.machine_memory() == 123456789


def test_control_groups_old_and_new():
    found = memory.limit_files("12:cpu,cpuacct:/a\n7:memory:/slurm/job_8\n0::/user.slice/b\n")
    assert [file.as_posix() for file in found] == [
        "/sys/fs/cgroup/user.slice/b/memory.max",
        "/sys/fs/cgroup/user.slice/memory.max",
        "/sys/fs/cgroup/memory.max",
        "/sys/fs/cgroup/memory/slurm/job_8/memory.limit_in_bytes",
        "/sys/fs/cgroup/memory/slurm/memory.limit_in_bytes",
        "/sys/fs/cgroup/memory/memory.limit_in_bytes",
    ]
    assert memory.limit_files("") == []
