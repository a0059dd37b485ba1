# SPDX-License-Identifier: BSD-3-Clause
"""Scenes read by blocks of rows have the contents of the rasters, whichever row comes first."""

import numpy as np
import pytest
from affine import Affine

import rockfall
from made import make_raster
from rockfall.io.rasters.grid import row_blocks
from rockfall.scene.read import read_scene

NY, NX = 1300, 1000  # more than a block
NORTH_UP = Affine(2.0, 0.0, 5000.0, 0.0, -2.0, 9000.0)
SOUTH_UP = Affine(2.0, 0.0, 5000.0, 0.0, 2.0, 9000.0 - 2.0 * NY)


@pytest.fixture
def rasters():
    rng = np.random.default_rng(1)
    z = rng.uniform(0, 100, (NY, NX)).astype("f4")
    ids = rng.choice([3, -7, 900], (NY, NX)).astype("i4")
    radii = rng.uniform(0.1, 0.5, (NY, NX)).astype("f4")
    return {"dem": z, "zones": ids, "cells": (rng.random((NY, NX)) < 1e-4), "mean_radius": radii}


def case_in(folder, rasters, south_up, **surface):
    for name, array in rasters.items():
        array = array.astype("u1") if array.dtype == bool else array
        stored, place = (array[::-1], SOUTH_UP) if south_up else (array, NORTH_UP)
        make_raster(folder / f"{name}.tif", stored, transform=place, tiled=True, blockysize=128)
    (folder / "zones.csv").write_text("zone,mean_radius\n900,0.1\n3,0.2\n55,0.3\n-7,0.4\n")
    return rockfall.Case(
        case={"boulders": 1},
        terrain={"dem": "dem.tif"},
        surface=surface,
        impact={"sets": "laboratory-spheres"},
        boulder={"volume_mean": 1.0},
        release={"cells": "cells.tif"},
        folder=folder,
    )


@pytest.mark.parametrize("south_up", [False, True])
def test_zones_and_sources_of_several_blocks(rasters, south_up, tmp_path):
    assert len(list(row_blocks((NY, NX)))) > 1
    case = case_in(tmp_path, rasters, south_up, zones="zones.tif", table="zones.csv")
    scene = read_scene(case)
    assert np.array_equal(scene.rasters.z, rasters["dem"])
    assert np.array_equal(np.array([900, 3, 55, -7])[scene.rasters.zone - 1], rasters["zones"])
    assert scene.rasters.used_zones().tolist() == [0, 1, 3]
    row, column = np.nonzero(rasters["cells"])  # from the north, then from the west
    assert np.array_equal(scene.x, 5000.0 + (column + 0.5) * 2.0)
    assert np.array_equal(scene.y, 9000.0 - (row + 0.5) * 2.0)


@pytest.mark.parametrize("south_up", [False, True])
def test_values_of_several_blocks(rasters, south_up, tmp_path):
    case = case_in(tmp_path, rasters, south_up, mean_radius="mean_radius.tif")
    assert np.array_equal(read_scene(case).rasters.values[0], rasters["mean_radius"])
    given = read_scene(case, cells=rasters["cells"], mean_radius=rasters["dem"] + 1)
    assert np.array_equal(given.rasters.values[0], rasters["dem"] + 1)


def test_a_scene_gives_its_memory_back(rasters, tmp_path):
    scene = read_scene(case_in(tmp_path, rasters, False, zones="zones.tif", table="zones.csv"))
    boulders = scene.boulders
    scene.forget_rasters()
    assert scene.rasters.z.size == 0 and scene.rasters.zone is None and scene.rasters.values is None
    assert scene.boulders == boulders


def test_a_path_is_no_case():
    with pytest.raises(
        rockfall.RockfallError,
        match=r"^case = 'case.nml': must be a Case, as read by rockfall.read_",
    ):
        rockfall.run("case.nml")
