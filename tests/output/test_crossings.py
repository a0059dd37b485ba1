# SPDX-License-Identifier: BSD-3-Clause
"""First crossings of lines: table, dense arrays, selections of boulders, and file."""

import netCDF4
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import rockfall
from made import refused
from rockfall.result import crossings as module
from rockfall.result import stored_crossings
from rockfall.result.crossings import boulders_at, line_values
from scenes import grid, make_case, rough, sets

LINES = [{"name": "Straße Süd", "x": [0.0, 140.0, 295.0], "y": [280.0, 250.0, 283.0]},
         {"name": "road 2", "x": [10.0, 290.0], "y": [220.0, 220.0]},
         {"name": "road_2", "x": [2.0, 6.0], "y": [395.0, 395.0]}]  # fmt: skip
SINGLE = 2.0**-23


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    case = make_case(
        tmp_path_factory.mktemp("lines"), *sets(), line=LINES, case={"boulders": 300},
        release={"x": [150.0, 120.0], "y": [380.0, 390.0]},
    )  # fmt: skip
    z = rough()
    return rockfall.run(case, dem=z, transform=grid(z))


def test_the_table_is_sorted_and_follows_from_what_is_kept(result):
    table = rockfall.crossings(result)
    assert table["line"].unique().tolist() == ["Straße Süd", "road 2"]  # none reaches the last
    for name, rows in table.groupby("line", sort=False):
        assert rows["boulder"].is_monotonic_increasing and rows["boulder"].is_unique
        assert rows.reset_index(drop=True).equals(rockfall.crossings(result, name))
    assert len(table) == result.sizes["crossing"] > 500
    v = table[["velocity_x", "velocity_y", "velocity_z"]].to_numpy()
    speed = np.sqrt((v**2).sum(axis=1))
    volume = result["volume"].values[table["boulder"] - 1]
    mass, radius = 2800.0 * volume, np.cbrt(0.75 / np.pi * volume)
    np.testing.assert_allclose(table["speed"], speed, rtol=1e-12)
    np.testing.assert_allclose(table["energy_translational"], mass * speed**2 / 2, rtol=1e-12)
    spin = 0.2 * mass * (radius * table["omega"]) ** 2
    np.testing.assert_allclose(table["energy_rotational"], spin, rtol=1e-12)
    np.testing.assert_allclose(table["upper_edge"] - table["passing_height"], radius, rtol=1e-9)


def test_places_are_on_the_line_at_the_distance(result):
    x, y = (np.array(LINES[0][axis]) for axis in "xy")
    first = np.hypot(x[1] - x[0], y[1] - y[0])
    table = rockfall.crossings(result, 0)
    along = table["distance"].to_numpy()
    assert (along < first).sum() > 20 < (along > first).sum()
    legs = np.hypot(np.diff(x), np.diff(y))
    at = np.append(0.0, legs.cumsum())
    np.testing.assert_allclose(table["x"], np.interp(along, at, x), rtol=1e-12)
    np.testing.assert_allclose(table["y"], np.interp(along, at, y), rtol=1e-12)


def test_the_dense_view_has_the_same_and_nan_elsewhere(result):
    dense, table = rockfall.at_lines(result), rockfall.crossings(result)
    assert dense["line_speed"].dims == ("line", "boulder")
    assert int(dense["line_speed"].notnull().sum()) == len(table)
    row = table.iloc[-1]
    at = dense.sel(line=row["line"], boulder=row["boulder"])
    for name in ("x", "y", "time", "speed", "omega", "jump_height", "energy_rotational"):
        assert float(at[f"line_{name}"]) == row[name]
    assert dense["line_x"].sel(line="road_2").isnull().all()


def test_a_dense_view_that_is_too_large_is_refused(result, monkeypatch):
    monkeypatch.setattr(module, "MAX_DENSE", 1e5)
    with refused("at_lines: 3 lines x 600 boulders need 0.0 GB: read one line with "
                 "rockfall.crossings(result, line)"):  # fmt: skip
        rockfall.at_lines(result)


@pytest.mark.parametrize("line", ["rail", 3, -1])
def test_an_unknown_line_is_refused(result, line):
    with refused(f"line {line}: no such line (lines: Straße Süd, road 2, road_2)"):
        rockfall.crossings(result, line)


@pytest.mark.parametrize("chosen", [slice(100, 400), np.arange(0, 600, 7), np.arange(599, -1, -1)])
def test_of_selected_boulders_there_are_their_crossings(result, chosen, tmp_path):
    few = result.isel(boulder=chosen)
    for k in range(3):
        values = line_values(few, "speed", k)
        np.testing.assert_array_equal(values, line_values(result, "speed", k)[chosen])
        assert (few["boulder"].values[boulders_at(few, k)] >= 1).all()
    if isinstance(chosen, slice):
        rockfall.write_result(few, tmp_path / "few.nc")
        again = rockfall.read_result(tmp_path / "few.nc")
        assert again.sizes["crossing"] < result.sizes["crossing"]
        xr.testing.assert_equal(rockfall.at_lines(again), rockfall.at_lines(few))


def test_the_file_is_one_that_other_programs_read(result, tmp_path):
    """Line names are ASCII words, and no `coordinates` attribute lists their variable; chunks are
    small."""
    rockfall.write_result(result, tmp_path / "out.nc")
    with netCDF4.Dataset(tmp_path / "out.nc") as file:
        line, names, sizes = (file[name] for name in ("line", "line_name", "row_size"))
        assert line.flag_meanings == "Strae_Sud road_2 road_2_2" and line[:].tolist() == [0, 1, 2]
        assert names[:].tolist() == [one["name"] for one in LINES]
        assert sizes.sample_dimension == "crossing" and "featureType" not in file.ncattrs()
        assert sizes[:].sum() == file.dimensions["crossing"].size and sizes[2] == 0
        for variable in file.variables.values():
            assert "line_name" not in getattr(variable, "coordinates", "")
        assert file["crossing_time"].dtype == "f4" and file["crossing_line"].filters()["zlib"]
        assert max(file["crossing_omega"].chunking()) <= 32_768
    again = rockfall.read_result(tmp_path / "out.nc")
    assert again.equals(result) and {*again.attrs} <= {*result.attrs}


@pytest.mark.parametrize("size", [1.0, 1e9])
def test_analyses_that_share_lines_have_the_same_numbers(result, size, monkeypatch):
    """Statistics are the same whether the values at a line are shared, not shared, or too large to
    share. A selection of boulders does not share those of the full result."""
    monkeypatch.setattr(module, "MAX_SHARED", size)
    half = result.isel(boulder=slice(0, 150))
    alone = [rockfall.line_statistics(result), rockfall.return_levels(result, [10])]
    part = rockfall.line_statistics(half)
    with module.sharing(result):
        first = module.at_line(result, 0)
        assert module.at_line(result, 0) is first
        assert module.at_line(result, 1).boulders.size
        assert (module.at_line(result, 0) is first) == (size > 1)
        for _ in range(2):
            assert rockfall.line_statistics(result).equals(alone[0])
            assert rockfall.return_levels(result, [10]).equals(alone[1])
        assert rockfall.line_statistics(half).equals(part)
    assert module.at_line(result, 0) is not module.at_line(result, 0)


@pytest.fixture
def in_file(result, tmp_path, monkeypatch):
    """Result read from a file, whose crossings are not read into memory."""
    monkeypatch.setattr(stored_crossings, "MOST", 100)
    rockfall.write_result(result, tmp_path / "a.nc")
    return rockfall.read_result(tmp_path / "a.nc")


def test_crossings_that_stay_in_the_file_are_those_in_memory(result, in_file, tmp_path):
    assert not in_file["crossing_time"].variable._in_memory
    lines = result.sizes["line"]
    for k in range(lines):
        assert rockfall.crossings(in_file, k).equals(rockfall.crossings(result, k))
    assert rockfall.line_statistics(in_file).equals(rockfall.line_statistics(result))
    some = [1, 0]
    assert rockfall.line_statistics(in_file, lines=some).equals(
        pd.concat([rockfall.line_statistics(result, lines=[k]) for k in some], ignore_index=True)
    )
    assert rockfall.return_levels(in_file, [10], lines=["road 2"]).equals(
        rockfall.return_levels(result, [10], lines=[1])
    )
    assert not in_file["crossing_time"].variable._in_memory
    rockfall.write_result(in_file.copy(deep=True), tmp_path / "b.nc")
    xr.testing.assert_identical(rockfall.read_result(tmp_path / "b.nc").load(), in_file.load())
    assert in_file.drop_vars("crs").equals(result.drop_vars("crs"))
    chosen = rockfall.read_result(tmp_path / "a.nc").isel(crossing=slice(7, 300, 3))
    assert chosen["crossing_line"].equals(result["crossing_line"][7:300:3])


@pytest.mark.family(2)
@pytest.mark.parametrize(
    "name, at, value",
    [("row_size", 0, 1), ("crossing_line", -1, 0), ("crossing_boulder", 5, 2**20),
     ("crossing_boulder", 5, 0), ("crossing_omega", 3, np.nan), ("crossing_time", 4, -1.0)],
)  # fmt: skip
def test_a_damaged_crossing_in_the_file_is_refused_where_it_is_read(
    result, tmp_path, monkeypatch, name, at, value
):
    monkeypatch.setattr(stored_crossings, "MOST", 100)
    rockfall.write_result(result, tmp_path / "a.nc")
    with netCDF4.Dataset(tmp_path / "a.nc", "a") as file:
        file[name][at] = value
    with pytest.raises(rockfall.RockfallError, match=rf"a.nc: {name}(:| =)"):
        # Close here: netCDF is not thread-safe, and garbage collection may run in any thread.
        with rockfall.read_result(tmp_path / "a.nc") as damaged:
            rockfall.line_statistics(damaged, quantities=["speed"])
        with rockfall.read_result(tmp_path / "a.nc") as damaged:
            damaged.load()
