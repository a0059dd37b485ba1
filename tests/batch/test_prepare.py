# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall prepare`: the same bits from the case and from what is made of it, by both programs."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from affine import Affine

import rockfall
from made import make_layer, make_raster, refused
from rockfall.io.grid import Grid
from rockfall.io.raster import read_dem
from rockfall.result.variables import BOULDER
from rockfall.scene.prepare import prepare

NY, NX = 40, 50
CELL = 2.0 / 3.0  # no such number in binary, nor are the edges
WEST, NORTH = 412345.1, 5123456.7
PLACE = Affine(CELL, 0.0, WEST, 0.0, -CELL, NORTH)
ROOT = Path(__file__).parents[2]
VARIABLES = {"maps": ["passages", "deposits", "energy_max", "energy_mean", "speed_max_map"]}


def elevations(dtype):
    """Rough, steep, then flat; holes far from the sources, and one elevation of -9999."""
    rng = np.random.default_rng(8)
    z = 900 - 0.9 * np.minimum(np.arange(NY), 25)[:, None] * CELL + rng.normal(0, 0.05, (NY, NX))
    z[-3:, :4] = np.nan
    return z.astype(dtype)


def zone_ids():
    return np.where(np.arange(NX) < 25, 4, -2) + np.zeros((NY, 1), np.int32)


def polygons(path, field):
    """Two rectangles beside each other that leave the east of the terrain free."""
    shapely = pytest.importorskip("shapely")
    middle, east, south = WEST + 15 * CELL, WEST + 38.2 * CELL, NORTH - NY * CELL
    boxes = [shapely.box(WEST, south, middle, NORTH), shapely.box(middle, south, east, NORTH)]
    make_layer(path, boxes, **{field: [4, -2]})


def case_of(folder, **changes):
    """A case in a folder, with every output."""
    groups = {
        "case": {"title": "It's a slope, 'rough'", "boulders": 30, "seed": 2**62 + 1},
        "terrain": {"dem": "dem.tif"},
        "surface": {"uniform_mean_radius": 0.1 + 0.2},
        "impact": {"sets": "rocky-slope"},
        "boulder": {"volume": "lognormal", "volume_mean": 0.1, "volume_std": 1 / 3},
        "release": {
            "x": [WEST + 5.3, WEST + 20.7],
            "y": [NORTH - 3.1, NORTH - 2.3],
            "drop_height": 4,
        },
        "output": VARIABLES | {"rebounds": True, "trajectories": 4},
    }
    for group, values in changes.items():
        groups[group] = groups[group] | values if group == "case" else values
    line = {"name": "an 'inner' line", "x": [WEST, WEST + NX * CELL], "y": [NORTH - 9.1] * 2}
    (folder / "zones.csv").write_text(
        'zone;name;mean_radius;rg70;rg20;rg10\n4;"scree; old";0.1;0.3;0.2;0.7\n'
        "-2;rock;0.30000000000000004;0.1;0.2;0.3\n77;river;Inf;Inf;Inf;Inf\n"
    )
    return rockfall.Case(folder=folder, name="case.nml", line=[line], **groups)


ZONES = {"zones": "zones.tif", "table": "zones.csv"}
LAYER = {"zones": "zones.gpkg", "table": "zones.csv", "zone_field": "kind", "default_zone": 77}
RADII = {name: f"{name}.tif" for name in ("rg70", "rg20", "rg10")}
CASES = {
    "points, one radius": ("float32", {}),
    "double precision": ("float64", {}),
    "zones": ("float32", {"surface": ZONES}),
    "zones, method A": ("float64", {"surface": ZONES | {"method": "A"}}),
    "zones and cells": (
        "float32",
        {"surface": ZONES, "release": {"cells": "cells.tif", "drop_height": 2}},
    ),
    "polygons": (
        "float64",
        {"surface": LAYER, "release": {"polygons": "sources.gpkg", "drop_height": 1.5}},
    ),
    "radius of each cell": ("float32", {"surface": {"mean_radius": "mean_radius.tif"}}),
    "sizes of each cell": ("float64", {"surface": RADII | {"method": "A"}}),
    "own sets": ("float32", {"impact": {"sets": "case.nml"}}),
}


def make_case(folder, dtype, changes):
    make_raster(folder / "dem.tif", elevations(dtype), transform=PLACE)
    make_raster(folder / "zones.tif", zone_ids().astype("i2"), transform=PLACE)
    cells = (np.random.default_rng(3).random((NY, NX)) < 0.02) & (np.arange(NY) < 9)[:, None]
    make_raster(folder / "cells.tif", np.where(cells, 1, 0).astype("u1"), transform=PLACE)
    radii = np.random.default_rng(4).uniform(0.05, 0.6, (NY, NX)).astype("f4")
    radii[30:33] = np.inf
    for k, name in enumerate(("mean_radius", "rg70", "rg20", "rg10")):
        make_raster(folder / f"{name}.tif", np.roll(radii, k, axis=1), transform=PLACE)
    if "polygons" in changes.get("release", {}):
        polygons(folder / "zones.gpkg", "kind")
        shapely = pytest.importorskip("shapely")
        box = shapely.box(WEST + 6.1, NORTH - 7, WEST + 8.3, NORTH - 5.5)
        make_layer(folder / "sources.gpkg", [box])
    sets = Path(rockfall.__file__).parent / "data" / "impact_sets" / "rocky-slope.nml"
    (folder / "case.nml").write_bytes(sets.read_bytes())  # a name that the prepared case needs
    return case_of(folder, **changes)


@pytest.fixture(params=CASES)
def prepared(request, tmp_path):
    """(result of a case, folder of the case prepared)"""
    case = make_case(tmp_path, *CASES[request.param])
    prepare(case, tmp_path / "prepared")
    return rockfall.run(case), tmp_path / "prepared"


def assert_same(a, b):
    """Every variable to the last bit; what a file name or a clock decides may differ."""
    xr.testing.assert_equal(a.drop_vars("crs"), b.drop_vars("crs"))
    assert a["crs"].attrs["GeoTransform"] == b["crs"].attrs["GeoTransform"]
    for key in ("title", "seed", "impact_set_checksum"):
        assert a.attrs[key] == b.attrs[key]


def test_same_bits_in_python(prepared):
    result, folder = prepared
    assert result.sizes["boulder"] >= 60 and result["impacts"].max() > 5
    again = rockfall.run(rockfall.read_case(folder / "case.nml"))
    assert_same(result, again)


def find_program():
    """The program of this build, or of this installation."""
    places = [ROOT / "build" / "fortran", Path(sys.executable).parent]
    beside = [place / "rockfall-batch" for place in places if (place / "rockfall-batch").is_file()]
    return str(beside[0]) if beside else shutil.which("rockfall-batch")


def test_same_bits_from_the_program(prepared):
    program = find_program()
    assert program, "rockfall-batch is not built"
    result, folder = prepared
    files = sorted(path.name for path in folder.iterdir())
    subprocess.run([program, "case.nml", "output=out"], cwd=folder, check=True, timeout=60)
    assert sorted(path.name for path in folder.iterdir()) == sorted([*files, "out"])
    rows = np.genfromtxt(
        folder / "out" / "boulders.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
    )
    numbers = [name for name in BOULDER if name != "status"]
    assert {*numbers, "status", "boulder"} <= {*rows.dtype.names}
    for name in numbers:
        assert np.array_equal(rows[name], result[name].values), name
    for name in VARIABLES["maps"]:
        written, _ = read_dem(folder / "out" / f"{name}.asc")
        written = written.astype(result[name].dtype)
        assert np.array_equal(written, result[name].values, equal_nan=written.dtype.kind == "f"), (
            name
        )


def test_only_what_the_case_needs_is_there(tmp_path):
    case = make_case(tmp_path, *CASES["polygons"])
    written = prepare(case, tmp_path / "new" / "prepared")
    names = [path.name for path in written]
    assert [name for name in names if not name.endswith(".prj")] == [
        "cells.asc", "dem.asc", "rocky-slope.nml", "zones.asc", "zones.csv", "case.nml",
    ]  # fmt: skip
    assert sorted(names) == sorted(os.listdir(tmp_path / "new" / "prepared"))
    assert os.listdir(tmp_path / "new") == ["prepared"]
    table = (tmp_path / "new" / "prepared" / "zones.csv").read_text().splitlines()
    assert table[0] == "zone,mean_radius,rg70,rg20,rg10"
    assert table[2] == "-2,0.30000000000000004,0.1,0.2,0.3"
    again = rockfall.read_case(tmp_path / "new" / "prepared" / "case.nml")
    assert again.surface == {
        "zones": "zones.asc", "table": "zones.csv", "zone_field": "zone", "method": "B",
        "rg_reading": "diameter",
    }  # fmt: skip
    assert again.case == case.case and again.line == case.line


def test_a_prepared_case_moves_and_is_prepared_again(tmp_path):
    case = make_case(tmp_path, *CASES["polygons"])
    result = rockfall.run(case)
    prepare(case, tmp_path / "a")
    (tmp_path / "a").rename(tmp_path / "b")
    (tmp_path / "b" / "notes.txt").write_text("mine")
    moved = rockfall.read_case(tmp_path / "b" / "case.nml")
    before = {path: path.read_bytes() for path in (tmp_path / "b").iterdir()}
    with refused(f"{tmp_path / 'b' / 'case.nml'}: is an input; it is not overwritten"):
        prepare(moved, tmp_path / "b")
    assert before == {path: path.read_bytes() for path in (tmp_path / "b").iterdir()}
    assert_same(result, rockfall.run(moved))
    prepare(case, tmp_path / "b")
    assert_same(result, rockfall.run(rockfall.read_case(tmp_path / "b" / "case.nml")))
    prepare(make_case(tmp_path, *CASES["points, one radius"]), tmp_path / "b")
    assert sorted(name for name in os.listdir(tmp_path / "b") if not name.endswith(".prj")) == [
        "case.nml", "dem.asc", "notes.txt", "rocky-slope.nml",
    ]  # fmt: skip


def test_other_folders_are_left_alone(tmp_path):
    case = make_case(tmp_path, *CASES["zones"])
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with refused(f"{tmp_path}: is not empty and holds no prepared case; take another"):
        prepare(case, tmp_path)
    assert before == {path: path.read_bytes() for path in tmp_path.iterdir()}
    (tmp_path / "empty").mkdir()
    prepare(case, tmp_path / "empty")
    assert (tmp_path / "empty" / "case.nml").exists()


def test_arrays_are_prepared_too(tmp_path):
    grid = Grid(WEST, NORTH, CELL, NX, NY)
    case = case_of(tmp_path, terrain={}, release={"cells": "cells"})
    cells = np.zeros((NY, NX), int)
    cells[3, 10:40:7] = 1
    arrays = {"dem": elevations("float32"), "transform": grid, "cells": cells}
    result = rockfall.run(case, **arrays)
    prepare(case, tmp_path / "prepared", **arrays)
    assert_same(result, rockfall.run(rockfall.read_case(tmp_path / "prepared" / "case.nml")))


def test_minus_9999_may_be_a_zone(tmp_path):
    case = make_case(tmp_path, *CASES["zones"])
    ids = np.where(zone_ids() == 4, -9999, -2)
    make_raster(tmp_path / "zones.tif", ids.astype("i2"), transform=PLACE)
    table = tmp_path / "zones.csv"
    table.write_text(table.read_text().replace("\n4;", "\n-9999;"))
    prepare(case, tmp_path / "prepared")
    assert_same(
        rockfall.run(case), rockfall.run(rockfall.read_case(tmp_path / "prepared" / "case.nml"))
    )
