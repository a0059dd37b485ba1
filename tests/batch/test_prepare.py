# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall prepare`: results from its files are bit-identical to those of the case in Python."""

import os
from pathlib import Path

import numpy as np
import pytest
from affine import Affine

import rockfall
from made import make_layer, make_raster, refused
from programs import everything, same_results
from rockfall.io.output_files import overwriting
from rockfall.scene.prepare import prepare

NY, NX = 40, 50
CELL = 2.0 / 3.0  # not exact in binary, nor are the edges
WEST, NORTH = 412345.1, 5123456.7
PLACE = Affine(CELL, 0.0, WEST, 0.0, -CELL, NORTH)
VARIABLES = {"maps": ["passages", "deposits", "energy_max", "energy_mean", "speed_max_map"]}


def elevations(dtype):
    """Rough slope that becomes flat; elevations are missing in a corner far from the sources."""
    rng = np.random.default_rng(8)
    z = 900 - 0.9 * np.minimum(np.arange(NY), 25)[:, None] * CELL + rng.normal(0, 0.05, (NY, NX))
    z[-3:, :4] = np.nan
    return z.astype(dtype)


def zone_ids():
    return np.where(np.arange(NX) < 25, 4, -2) + np.zeros((NY, 1), np.int32)


def polygons(path, field):
    """Write two adjacent rectangles with zones 4 and -2, which leave the east of the terrain
    uncovered."""
    shapely = pytest.importorskip("shapely")
    middle, east, south = WEST + 15 * CELL, WEST + 38.2 * CELL, NORTH - NY * CELL
    boxes = [shapely.box(WEST, south, middle, NORTH), shapely.box(middle, south, east, NORTH)]
    make_layer(path, boxes, **{field: [4, -2]})


def case_of(folder, **changes):
    groups = {
        "case": {"title": "It's a slope, 'rough'", "boulders": 30, "seed": 2**62 + 1},
        "terrain": {"dem": "dem.tif"},
        "surface": {"uniform_mean_radius": 0.1 + 0.2},
        "impact": {"sets": "laboratory-spheres"},
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
    "double precision": ("float64", {}),
    "zones": ("float32", {"surface": ZONES}),
    "zones and cells": ("float32",
        {"surface": ZONES, "release": {"cells": "cells.tif", "drop_height": 2}}),
    "polygons": ("float64",
        {"surface": LAYER, "release": {"polygons": "sources.gpkg", "drop_height": 1.5}}),
    "sizes of each cell": ("float64", {"surface": RADII | {"method": "A"}}),
    "own sets": ("float32", {"impact": {"sets": "case.nml"}}),
}  # fmt: skip


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
    sets = Path(rockfall.__file__).parent / "data" / "impact_sets" / "laboratory-spheres.nml"
    (folder / "case.nml").write_bytes(sets.read_bytes())  # a name that the prepared case needs
    return case_of(folder, **changes)


@pytest.mark.parametrize("name", CASES)
def test_both_programs_give_the_same_bits(name, batch, tmp_path):
    case = make_case(tmp_path, *CASES[name])
    assert prepare(case, tmp_path / "ready") == [
        tmp_path / "ready/scene.nc", tmp_path / "ready/case.nml"
    ]  # fmt: skip
    done = batch("case.nml", "-o", "part", "--quiet", cwd=tmp_path / "ready")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    result = rockfall.run(case)
    assert result.sizes["boulder"] >= 60 and result["impacts"].max() > 5
    same_results(rockfall.merge([tmp_path / "ready/part"]), result)


def test_a_prepared_case_moves_and_is_prepared_again(tmp_path):
    case = make_case(tmp_path, *CASES["zones"])
    prepare(case, tmp_path / "a")
    first = (tmp_path / "a/case.nml").read_text()
    assert first.startswith("! Prepared by rockfall from ")
    assert rockfall.read_case(tmp_path / "a/case.nml").text() == case.text()
    (tmp_path / "a").rename(tmp_path / "b")
    (tmp_path / "b/notes.txt").write_text("mine")
    prepare(case.replace(case={"title": "again"}), tmp_path / "b")
    assert sorted(os.listdir(tmp_path / "b")) == ["case.nml", "notes.txt", "scene.nc"]
    assert "again" in (tmp_path / "b/case.nml").read_text()


def test_other_files_are_left_alone(tmp_path):
    case = make_case(tmp_path, *CASES["zones"])
    before = everything(tmp_path)
    said = f"{tmp_path / 'case.nml'}: already exists; not overwritten (--overwrite replaces it)"
    with overwriting(False), refused(said):
        prepare(case, tmp_path)
    assert everything(tmp_path) == before
    (tmp_path / "used").mkdir()
    (tmp_path / "used/notes.txt").write_text("mine")
    prepare(case, tmp_path / "used")
    assert sorted(os.listdir(tmp_path / "used")) == ["case.nml", "notes.txt", "scene.nc"]
