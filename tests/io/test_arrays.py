# SPDX-License-Identifier: BSD-3-Clause
"""Rasters given as arrays have the same effect as in files, or are refused."""

import json

import numpy as np
import pytest
import xarray as xr
from affine import Affine

import rockfall
from rockfall.scene.read import read_scene

SIZE = 40
PLACE = Affine(2.0, 0.0, 5000.0, 0.0, -2.0, 9000.0)
ROWS, COLUMNS = np.mgrid[:SIZE, :SIZE]
Z = 1000.0 + 3.0 * COLUMNS - 1.1 * ROWS
ZONES = 1 + (COLUMNS > 25) + 2 * (ROWS > 30)
CELLS = ((ROWS == 5) & (COLUMNS > 20)).astype(int)


def labelled(array):
    x = 5001.0 + 2.0 * np.arange(SIZE)
    y = 8999.0 - 2.0 * np.arange(SIZE)
    return xr.DataArray(array, coords={"y": y, "x": x}, dims=("y", "x"))


@pytest.fixture
def case(tmp_path):
    (tmp_path / "zones.csv").write_text("zone,mean_radius\n1,0.2\n2,0.3\n3,Inf\n4,0.1\n")
    return rockfall.Case(
        case={"boulders": 3},
        surface={"zones": "zones.tif", "table": "zones.csv"},
        impact={"sets": "laboratory-spheres"},
        boulder={"volume_mean": 1.0},
        release={"cells": "cells.tif", "drop_height": 3.0},
        folder=tmp_path,
    )


def run(case, **changed):
    arrays = {"dem": Z, "transform": PLACE, "zones": ZONES, "cells": CELLS} | changed
    return rockfall.run(case, **arrays)


@pytest.mark.parametrize("order", [("y", "x"), ("x", "y")])
@pytest.mark.parametrize("north_first", [True, False])
def test_arrays_with_coordinates_may_lie_any_way(case, order, north_first):
    def turned(array):
        array = labelled(array).transpose(*order)
        return array if north_first else array.isel(y=slice(None, None, -1))

    plain = run(case)
    result = rockfall.run(case, dem=turned(Z), zones=turned(ZONES), cells=turned(CELLS))
    for name in ("start_x", "start_y", "stop_x", "stop_y", "status"):
        assert np.array_equal(result[name], plain[name])


def test_masked_cells_are_none(case):
    masked = np.ma.masked_where(COLUMNS > 30, CELLS)
    assert run(case, cells=masked).sizes["boulder"] == 3 * 10
    zones = np.ma.masked_where(COLUMNS == 0, ZONES)
    with pytest.raises(rockfall.RockfallError, match="40 cells of the terrain have no zone"):
        run(case, zones=zones)


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("zones", ZONES + 0.5, r"zones = \(array\): 1.5: must be a 32-bit integer"),
        ("zones", ZONES + 2**32, r"zones = \(array\): 4294967297: must be a 32-bit integer"),
        ("cells", CELLS.astype("U21"), r"cells = \(array\): must contain numbers, not <U21"),
        ("cells", CELLS[1:], r"cells = \(array\): has the shape \(39, 40\)"),
    ],
)
def test_what_no_raster_could_hold_is_refused(case, name, array, message):
    with pytest.raises(rockfall.RockfallError, match=message):
        run(case, **{name: array})


def test_the_result_says_what_it_was_made_from(case):
    one, other = run(case), run(case, dem=Z + 500.0)
    assert "dem = '(array)'" in one.attrs["case"] and "zones = '(array)'" in one.attrs["case"]
    sums = [json.loads(result.attrs["input_checksums"]) for result in (one, other)]
    assert set(sums[0]) == {"dem", "zones", "cells", "table", "sets"}
    assert {key for key in sums[0] if sums[0][key] != sums[1][key]} == {"dem"}


def test_a_case_that_was_changed_in_place_is_checked_again(case):
    case.boulder["density"] = -5.0
    with pytest.raises(rockfall.RockfallError, match="&boulder density = -5.0: must be > 0"):
        read_scene(case, dem=Z, transform=PLACE, zones=ZONES, cells=CELLS)
