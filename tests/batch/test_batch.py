# SPDX-License-Identifier: BSD-3-Clause
"""rockfall-batch: the same case gives the same bits as Python, and bad input one line."""

import csv
import hashlib
import json
import os
import resource
import subprocess
from pathlib import Path

import f90nml
import numpy as np
import pytest
import xarray as xr

import rockfall
import scenes
from batch_case import (
    CELLS,
    GRID,
    MAPS,
    SURFACES,
    TABLE,
    WHERE,
    case_text,
    elevations,
    sources,
    write_case,
    zones,
)
from made import write_ascii
from programs import find_program
from rockfall.errors import RockfallError
from rockfall.io.grid import Grid
from rockfall.result import variables
from same import same_bits

ROOT = Path(__file__).parents[2]


def read_table(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def reals(rows, name):
    return np.array([float(row[name]) for row in rows])


def check_folder(folder, result):
    """Every number in the folder is that of the result, bit for bit."""
    boulders = read_table(folder / "boulders.csv")
    assert [int(row["boulder"]) for row in boulders] == result["boulder"].values.tolist()
    words = {number: name for name, number in variables.STATUS.items()}
    for name in variables.BOULDER:
        if name == "status":
            assert [row[name] for row in boulders] == [words[k] for k in result[name].values]
        elif name == "impacts":
            assert [int(row[name]) for row in boulders] == result[name].values.tolist()
        else:
            assert same_bits(reals(boulders, name), result[name].values), name
    for k, file in enumerate(("line_EL_1_ö.csv", "line_el_1_ö_2.csv")):
        crossed = ~np.isnan(result["line_time"].values[k])
        rows = read_table(folder / file)
        assert 0 < len(rows) == crossed.sum()
        assert [int(row["boulder"]) for row in rows] == result["boulder"].values[crossed].tolist()
        for name in variables.LINE:
            assert same_bits(reals(rows, name), result[f"line_{name}"].values[k][crossed]), name
    check_maps(folder, result)
    rows = read_table(folder / "histograms.csv")
    for name in variables.HISTOGRAM:
        some = [row for row in rows if row["quantity"] == name]
        edges = np.stack([reals(some, "from"), reals(some, "to")], axis=1)
        assert same_bits(edges, result[f"{name}_bin_bounds"].values)
        counts = [int(row["rebounds"]) for row in some]
        assert counts == result[f"{name}_histogram"].values.tolist() and sum(counts) > 0
    rows = read_table(folder / "trajectories.csv")
    assert [int(row["boulder"]) for row in rows] == result["trajectory_boulder"].values.tolist()
    for name in set(variables.VERTEX) - {"boulder"}:
        assert same_bits(reals(rows, name), result[f"trajectory_{name}"].values), name
    with open(folder / "run.csv", encoding="utf-8") as file:
        run = {row[0]: row[1] for row in csv.reader(file)}
    assert run["title"] == result.attrs["title"] and int(run["seed"]) == result.attrs["seed"]
    assert int(run["boulders"]) == result.sizes["boulder"]
    for name in variables.COUNT:
        assert int(run[name]) == int(result[name]), name


def check_maps(folder, result):
    for name in MAPS:
        with open(folder / f"{name}.asc", encoding="ascii") as file:
            header = dict(next(file).split() for _ in range(6))
            values = np.loadtxt(file)
        assert (int(header["ncols"]), int(header["nrows"])) == (GRID.nx, GRID.ny)
        assert float(header["xllcorner"]) == GRID.west and float(header["cellsize"]) == GRID.cell
        assert float(header["yllcorner"]) + GRID.ny * GRID.cell == GRID.north
        expected = result[name].values
        if expected.dtype.kind == "f":
            values[values == -9999] = np.nan
        assert expected.any()
        assert np.array_equal(values, expected.astype("f8"), equal_nan=True), name
        assert np.array_equal(values.astype(expected.dtype), expected, equal_nan=True), name


@pytest.mark.parametrize("surface", SURFACES)
def test_both_doors_give_the_same_bits(surface, made, batch, tmp_path):
    points = f"{WHERE}, velocity = 1.5, -3.0, 0.25"
    release = points if surface.startswith("uniform") else CELLS
    case = write_case(made, surface=surface, release=release)
    done = batch(case, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "EL 1/ö" in done.stdout and "boulders" in done.stdout
    result = rockfall.run(rockfall.read_case(case))
    assert len(np.unique(result["status"])) > 1
    check_folder(tmp_path / "case_results", result)


def test_both_doors_count_what_a_set_was_not_fitted_on(made, batch, tmp_path):
    case = write_case(made)
    in_first_set("", speed_range=[3.0, 9.0], angle_range=[10.0, 40.0])(made)
    done = batch(case, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    result = rockfall.run(rockfall.read_case(case))
    check_folder(tmp_path / "case_results", result)
    speeds, angles = (int(result[f"rebounds_out_of_{name}"]) for name in ("speed", "angle"))
    assert min(speeds, angles) > 0
    assert f"; {speeds} at speeds, {angles} at angles outside" in done.stdout


@pytest.mark.parametrize("surface", ["zones_a", "radius"])
def test_both_doors_write_the_same_netcdf(surface, made, batch, netcdf, tmp_path):
    case = write_case(made, surface=surface)
    done = batch(case, "output=out.nc", "quiet=true", cwd=tmp_path)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", "")
    rockfall.write_result(rockfall.run(rockfall.read_case(case)), tmp_path / "python.nc")
    with (
        xr.open_dataset(tmp_path / "out.nc", mask_and_scale=False) as ours,
        xr.open_dataset(tmp_path / "python.nc", mask_and_scale=False) as theirs,
    ):
        xr.testing.assert_equal(ours, theirs)
        assert set(ours.variables) == set(theirs.variables)
        for name in theirs.variables:
            check_variable(name, ours[name], theirs[name])
        check_attributes(ours.attrs, theirs.attrs, case)
    assert sorted(os.listdir(tmp_path)) == ["case", "out.nc", "python.nc"]


def check_variable(name, ours, theirs):
    """The same bits, type and attributes (a GeoTransform may be spelled differently)."""
    if name != "line":
        assert same_bits(ours.values, theirs.values), name
    about, expected = dict(ours.attrs), dict(theirs.attrs)
    if name == "crs":
        numbers = [list(map(float, a.pop("GeoTransform").split())) for a in (about, expected)]
        assert numbers[0] == numbers[1]
    assert set(about) == set(expected), name
    for key in expected:
        assert np.array_equal(about[key], expected[key], equal_nan=key == "_FillValue"), (name, key)


def check_attributes(ours, theirs, case):
    apart = {"case", "threads", "wall_seconds", "cpu_seconds", "decoded_checksums"}
    assert set(ours) == set(theirs) - {"decoded_checksums"}  # the program sums files
    if rockfall.__version__ == "unknown":  # a source tree that is not installed
        apart |= {"version", "source"}
    for key in set(theirs) - apart:
        assert ours[key] == theirs[key], key
    assert ours["case"] == case.read_text()


@pytest.mark.parametrize("dtype", ["f4", "f8", "i2"])
def test_elevations_in_netcdf_give_the_same_bits(dtype, made, batch, netcdf, tmp_path):
    z = elevations()
    z = np.where(np.isnan(z), -9999, z).astype(dtype)
    about = {"axis": "Y", "units": "m"}, {"axis": "X", "units": "m"}
    coords = {"y": ("y", GRID.y, about[0]), "x": ("x", GRID.x, about[1])}
    dem = xr.DataArray(z[::-1], {**coords, "y": ("y", GRID.y[::-1], about[0])}, ("y", "x"), "z")
    dem.to_netcdf(made / "dem.nc", encoding={"z": {"_FillValue": np.array(-9999, dtype)[()]}})
    case = write_case(made, dem="dem.nc")
    assert batch(case, "output=out.nc", cwd=tmp_path).returncode == 0
    result = rockfall.run(rockfall.read_case(case))
    with xr.open_dataset(tmp_path / "out.nc") as ours:
        xr.testing.assert_equal(ours, result)


def test_values_of_the_command_line(made, batch, tmp_path):
    case = write_case(made)
    done = batch(case, "boulders=3", "seed=77", "threads=2", "output=sub/", cwd=tmp_path)
    assert done.returncode == 0 and "2 threads" in done.stdout
    changed = rockfall.read_case(case).replace(case={"boulders": 3, "seed": 77})
    check_folder(tmp_path / "sub", rockfall.run(changed))
    assert not list(tmp_path.glob(".*"))
    again = made / "again.nml"  # the case as it was run is kept with the result
    again.write_text((tmp_path / "sub" / "case.nml").read_text())
    assert rockfall.read_case(again).case == {**changed.case, "threads": 2}
    assert rockfall.read_case(again).line == changed.line


def test_threads_change_no_bit(made, batch, tmp_path):
    case = write_case(made)
    for threads in (1, 2, 4):
        done = batch(case, f"threads={threads}", f"output=r{threads}", cwd=tmp_path)
        assert done.returncode == 0
    names = {path.name for path in (tmp_path / "r1").iterdir()} - {"run.csv", "case.nml"}
    assert len(names) == 3 + len(MAPS) + 2
    for name in names:
        first = (tmp_path / "r1" / name).read_bytes()
        assert all((tmp_path / f"r{n}" / name).read_bytes() == first for n in (2, 4)), name


def test_results_replace_those_of_an_earlier_run_and_nothing_else(made, batch, tmp_path):
    case = write_case(made)
    assert batch(case, cwd=tmp_path).returncode == 0
    results = tmp_path / "case_results"
    (results / "notes.txt").write_text("mine")
    case.write_text(case_text().replace("EL 1/ö", "other").replace("rebounds = .true.,", ""))
    assert batch(case, "seed=3", cwd=tmp_path).returncode == 0
    names = {path.name for path in results.iterdir()}
    assert {"notes.txt", "line_other.csv", "run.csv"} <= names
    assert not {"line_EL_1_ö.csv", "histograms.csv"} & names
    assert "seed,3" in (results / "run.csv").read_text().split("\n")
    assert sorted(os.listdir(tmp_path)) == ["case", "case_results"]


@pytest.mark.parametrize("size", [128, 183, 184, 191, 192, 2**20, 2**20 + 1, 2**21 - 1])
def test_checksums_are_those_of_the_files(size, made, batch, tmp_path):
    (made / "zones.csv").write_text(TABLE + "\n" * (size - len(TABLE)))
    case = write_case(made)
    assert batch(case, "boulders=1", cwd=tmp_path).returncode == 0
    with open(tmp_path / "case_results" / "run.csv", encoding="utf-8") as file:
        run = {row[0]: row[1] for row in csv.reader(file)}
    for key, name in {"dem": "dem.asc", "table": "zones.csv", "cells": "cells.asc"}.items():
        assert run[f"sha256_{key}"] == hashlib.sha256((made / name).read_bytes()).hexdigest()


def test_a_line_outside_the_terrain_is_a_warning(made, batch, tmp_path):
    more = "&line name = 'far', x = 0.0, 1.0, y = 0.0, 0.0 /"
    case = write_case(made, more=more)
    done = batch(case, "quiet=true", cwd=tmp_path)
    assert done.returncode == 0 and done.stdout == ""
    assert done.stderr.count("\n") == 1 and "warning" in done.stderr and "far" in done.stderr
    assert (tmp_path / "case_results" / "line_far.csv").read_text().count("\n") == 1


def test_sets_are_those_of_the_case_alone(made, batch, tmp_path, monkeypatch):
    """No folder of the user's stands before those that are shipped, in either program."""
    folder = tmp_path / "sets"
    folder.mkdir()
    shipped = ROOT / "python/rockfall/data/impact_sets/rocky-slope.nml"
    (folder / shipped.name).write_text(shipped.read_text().replace("mean = ", "mean = 0.9*", 1))
    monkeypatch.setenv("ROCKFALL_SETS", str(folder))
    case = write_case(made)
    assert batch(case, cwd=tmp_path).returncode == 0
    with open(tmp_path / "case_results" / "run.csv", encoding="utf-8") as file:
        run = {row[0]: row[1] for row in csv.reader(file)}
    result = rockfall.run(rockfall.read_case(case))
    assert run["sha256_sets"] == json.loads(result.attrs["input_checksums"])["sets"]
    assert run["sha256_sets"] == hashlib.sha256(shipped.read_bytes()).hexdigest()


def replace(old, new):
    """A change of the case's text."""

    def change(folder):
        text = case_text()
        assert old in text
        (folder / "case.nml").write_text(text.replace(old, new))

    return change


def write(name, text, old="", new=""):
    """A file of other contents, and a change of the case's text."""

    def change(folder):
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        assert old in case_text()
        (folder / "case.nml").write_text(case_text().replace(old, new))

    return change


def raster(name, array, grid=GRID):
    def change(folder):
        write_ascii(folder / name, array, grid)

    return change


def sets(old, new, count=1):
    """Impact sets with a change, as a file beside the case."""
    text = scenes.sets_text(*scenes.sets())
    assert old in text
    changed = text.replace(old, new, count)
    return write("sets.nml", changed, "'rocky-slope'", "'sets.nml'")


def in_first_set(more, **keys):
    """Further keys in the first of the sets, and more in &impact."""

    def change(folder):
        sets("covariance", "covariance")(folder)
        groups = f90nml.read(folder / "sets.nml")
        groups["impact_set"][0] |= keys
        groups.write(folder / "sets.nml", force=True)
        path = folder / "case.nml"
        path.write_text(path.read_text().replace("'sets.nml'", f"'sets.nml' {more}"))

    return change


LAB = ", turning = 'lab'"


def _shifted(**about):
    return Grid(**{**{k: getattr(GRID, k) for k in ("west", "north", "cell", "nx", "ny")}, **about})


def _unknown_ids():
    ids = zones()
    ids[0, :4], ids[1, :2], ids[-1, 0] = 99, 50, 1234  # the last one where there is no terrain
    return ids


POINT = "cells = 'cells.asc'", "x = {}, y = {}"
HOLE = GRID.x[40], GRID.y[31]

# What is wrong -> a change, words of the message, whether Python says the very same.
HOSTILE = {
    "group": (replace("&release", "&releese"), ["&releese", "unknown group", "&release"], True),
    "key": (replace("drop_height", "drop_hight"), ["&release drop_hight", "unknown key"], True),
    "type": (replace("boulders = 40", "boulders = 4.5"), ["&case boulders = 4.5"], True),
    "nan": (replace("height = 3.0", "height = NaN"), ["&release drop_height = NaN"], True),
    "inf": (replace("stop_speed = 0.4", "stop_speed = Inf"), ["&impact stop_speed = Inf"], True),
    "twice": (replace("seed =", "seed = 1, seed ="), ["&case seed", "twice"], True),
    "no boulders": (replace("boulders = 40", "boulders = 0"), ["boulders = 0", ">= 1"], True),
    "no passages": (
        replace("&output ", "&output least_passages = 0, "),
        ["&output least_passages = 0", ">= 1"], True,
    ),
    "factor on nothing": (
        replace("drop_height = 3.0", "velocity = 3*1.0 /\n&ensemble drop_height_factor = 1.5"),
        ["&ensemble drop_height_factor = 1.5", "without a drop_height"], True,
    ),
    "memory": (replace("boulders = 40", "boulders = 200000000"), ["not fit in memory"], False),
    "more than cells count": (
        replace("boulders = 40", "boulders = 1000000000000000"),
        ["&case boulders = 1000000000000000 from each of", "at most 2147483647 together"], True,
    ),
    "sum of energies": (
        replace("volume_mean = 0.8, volume_std = 0.15", "volume_mean = 1e12, volume_std = 0.0"),
        ["case.nml: &output maps: energy_mean: the sum of 320 boulders can come to", "9e18"], True,
    ),
    "no dem": (replace("dem.asc", "none.asc"), ["&terrain dem = 'none.asc': no such file"], True),
    "empty dem": (write("dem.asc", ""), ["dem.asc: is empty"], True),
    "truncated dem": (
        lambda folder: os.truncate(folder / "dem.asc", 9000), ["dem.asc", "truncated"], False
    ),
    "words in dem": (write("dem.asc", "hello\n"), ["dem.asc: no ESRI ASCII grid"], False),
    "geotiff": (write("dem.asc", b"II*\0\1\2\3"), ["dem.asc", "rockfall prepare"], False),
    "degrees": (write("dem.prj", 'GEOGCS["x"]'), ["dem.asc: cells are in degrees"], False),
    "feet": (write("dem.prj", 'PROJCS["x",UNIT["Foot",0.3048]]'), ["cells are in feet"], False),
    "not square": (
        write("dem.asc", "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ndx 2.5\ndy 3\n1 2 3 4\n"),
        ["dem.asc: cells are not square (2.5 x 3 m)", "rio warp"], False,
    ),
    "one cell": (
        write("dem.asc", "ncols 1\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n12.5\n"),
        ["dem.asc: 1 x 1 cells, at least 2 x 2"], True,
    ),
    "nodata": (raster("dem.asc", np.full(GRID.shape, np.nan)), ["all cells are nodata"], True),
    "polygons": (replace("zones.asc", "zones.gpkg"), ["zones.gpkg", "rockfall prepare"], False),
    "source polygons": (
        replace("cells = 'cells.asc'", "polygons = 'a.shp'"), ["a.shp", "rockfall prepare"], False
    ),
    "other cells": (
        raster("zones.asc", zones(), _shifted(cell=2.0)),
        ["zones.asc: zones (60 x 50 cells of 2,", "not on the cells of", "rio warp"], False,
    ),
    "other size": (
        raster("zones.asc", zones()[:, 1:], _shifted(nx=59)), ["59 x 50 cells", "rio warp"], False
    ),
    "shifted": (
        raster("cells.asc", sources(), _shifted(west=GRID.west + 0.01)),
        ["cells.asc: source cells", "rio warp"], False,
    ),
    "apart": (
        raster("zones.asc", zones(), _shifted(west=0.0)), ["zones", "lie apart from"], False
    ),
    "no row": (
        raster("zones.asc", _unknown_ids()),
        ["zones.asc: zone 50 (2 cells), zone 99 (4 cells) have no row in"], True,
    ),
    "no zone": (
        replace(", default_zone = 7", ""),
        ["100 cells of the terrain have no zone", "default_zone"], True,
    ),
    "default": (replace("default_zone = 7", "default_zone = 8"), ["default_zone = 8"], True),
    "no table": (
        replace("zones.csv", "none.csv"), ["&surface table = 'none.csv': no such file"], True
    ),
    "radius": (
        write("zones.csv", TABLE.replace("0.35", "-0.35")),
        ["zones.csv: line 2: mean_radius = -0.35: must be > 0 (Inf absorbs)"], True,
    ),
    "column": (
        write("zones.csv", "zone,rg70\n1,1\n7,1\n-3,1\n"),
        ["zones.csv: zone 1: mean_radius needed for method B"], True,
    ),
    "not an id": (
        write("zones.asc", "ncols 2\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2.5\n"),
        ["zones.asc: row 1, column 2: 2.5: must be an integer"], False,
    ),
    "no sources": (
        raster("cells.asc", np.zeros(GRID.shape, "i4")), ["cells.asc: no source cells"], True
    ),
    "outside": (
        replace(POINT[0], POINT[1].format(1.0, 2.0)),
        ["case.nml: &release: source 1 (1.000, 2.000) lies outside the terrain"], True,
    ),
    "on nodata": (
        replace(POINT[0], POINT[1].format(*HOLE)), ["&release: source 1", "nodata"], True
    ),
    "no sets": (replace("rocky-slope", "soft"), ["&impact sets = 'soft'"], False),
    "ratio": (sets("ratio = 5", "ratio = 6"), ["sets.nml", "ratio = 6", "1 to 5"], True),
    "length": (sets("mean = ", "mean = 1.0, "), ["mean", "must be 9 values, not 10"], True),
    "indefinite": (
        lambda folder: sets("covariance", "covariance")(folder) or _indefinite(folder),
        ["sets.nml", "covariance", "eigenvalue"], True,
    ),
    "choice": (
        replace("sets = 'rocky", "ratio = 'mean', sets = 'rocky"),
        ["&impact ratio = 'mean': must be one of: nearest, between"], True,
    ),
    "noise": (in_first_set("", noise=[1.0] * 5), ["noise", "must be 6 values, not 5"], True),
    "loud noise": (
        in_first_set("", noise=[1.0, 2.0, 1.0, 0.0, 0.0, 1.0]),
        ["sets.nml: line", "&impact_set noise is indefinite: smallest eigenvalue  -1.0000E+00"],
        True,
    ),
    "one speed": (
        in_first_set("", speed_range=20.0), ["speed_range", "must be 2 values, not 1"], True
    ),
    "speeds": (
        in_first_set("", speed_range=[20.0, 19.0]),
        ["&impact_set speed_range = 20.0, 19.0: must not fall within 0 to 1000 [m/s]"], True,
    ),
    "speeds below zero": (
        in_first_set("", speed_range=[-1.0, 20.0]), ["speed_range", "must not fall within 0"], True
    ),
    "infinite speeds": (
        sets("ratio = 1", "ratio = 1, speed_range = 1, Inf"), ["speed_range (value 2) = Inf"], True
    ),
    "angles": (
        in_first_set("", angle_range=[5.0, 90.1]),
        ["&impact_set angle_range = 5.0, 90.1: must not fall within 0 to 90 [degree]"], True,
    ),
    "angles of text": (
        in_first_set("", angle_range=["a", "b"]), ["angle_range", "must be a real number"], True
    ),
    "no deviations": (
        in_first_set(LAB), ["lateral: is missing: needed for &impact turning = 'lab'"], True
    ),
    "deviations": (
        in_first_set(LAB, incidence=30.0, lateral=[1.0] * 25),
        ["lateral", "must be 13 values for each of 2 classes of incidence, not 25"], True,
    ),
    "far deviation": (
        in_first_set(LAB, incidence=30.0, lateral=[1.0] * 25 + [91.0]),
        ["lateral (value 26) = 91.0", "must be 0 to 90 [degree]"], True,
    ),
    "falling deviations": (
        in_first_set(LAB, incidence=30.0, lateral=[1.0] * 20 + [2.0] + [1.0] * 5),
        ["lateral", "must not fall within class 2"], True,
    ),
    "no class": (
        in_first_set(LAB, incidence=[30.0, 20.0], lateral=[1.0] * 39),
        ["incidence = 30.0, 20.0", "must rise within 0 to 90 [degree]"], True,
    ),
    "classes alone": (
        in_first_set("", incidence=30.0), ["incidence", "has no meaning without lateral"], True
    ),
    "turning": (
        replace("sets = 'rocky", "turning = 'back', sets = 'rocky"),
        ["&impact turning = 'back': must be one of: past_aspect, to_aspect, lab"], True,
    ),
    "zero size": (
        lambda folder: _zero_sizes(folder),
        ["rm.asc: 1 cells of the terrain without a value, 2 not > 0 (Inf absorbs)"], True,
    ),
}  # fmt: skip


def _indefinite(folder):
    """Sets whose first covariance has a negative variance."""
    path = folder / "sets.nml"
    groups = f90nml.read(path)
    groups["impact_set"][0]["covariance"][0] = -1.0
    groups.write(path, force=True)


def _zero_sizes(folder):
    sizes = np.full(GRID.shape, 0.4)
    sizes[3, 3], sizes[4, 4], sizes[5, 5] = np.nan, 0.0, -1.0
    write_ascii(folder / "rm.asc", sizes, GRID)
    write_case(folder, surface="radius")


@pytest.mark.parametrize("what", HOSTILE)
def test_bad_input_is_one_line(what, made, batch, tmp_path):
    change, words, same = HOSTILE[what]
    case = write_case(made)
    change(made)
    before = sorted(tmp_path.rglob("*"))
    done = batch(case, cwd=tmp_path)
    assert done.returncode == 2
    check_line(done, words)
    if same:
        with pytest.raises(RockfallError) as caught:
            rockfall.run(rockfall.read_case(case))
        assert done.stderr == f"rockfall-batch: {caught.value}\n"
    assert sorted(tmp_path.rglob("*")) == before


def check_line(done, words):
    assert done.stdout == ""
    assert done.stderr.startswith("rockfall-batch: ") and done.stderr.count("\n") == 1
    assert done.stderr.endswith("\n")
    for word in words:
        assert word in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["a case file is needed"]),
        (["none.nml"], ["none.nml: no such file"]),
        (["case/case.nml", "case/case.nml"], ["there is a case file already"]),
        (["case/case.nml", "bolders=3"], ["bolders=3: unknown key; known: output, boulders"]),
        (["case/case.nml", "--fast"], ["--fast: unknown option"]),
        (["case/case.nml", "boulders=many"], ["boulders = many: must be an integer"]),
        (["case/case.nml", "boulders=0"], ["&case boulders = 0: must be 1 to 1e15"]),
        (["case/case.nml", "seed=-1"], ["&case seed = -1: must be >= 0"]),
        (["case/case.nml", "seed=1 / &case"], ["must be an integer"]),
        (["case/case.nml", "threads="], ["a value is missing"]),
        (["case/case.nml", "quiet=maybe"], ["quiet = maybe: must be true or false"]),
        (["case/case.nml", "output=none/x"], ["none/x: there is no folder none/"]),
        (["case/case.nml", "output=case"], ["case: is a folder that is no result"]),
        (["case/case.nml", "output=case/dem.asc"], ["case/dem.asc: is a file, not a folder"]),
        (["case/case.nml", "output=/proc/x"], ["/proc/x: cannot be written"]),
    ],
)
def test_bad_arguments_are_one_line(arguments, words, made, batch, tmp_path):
    write_case(made)
    before = sorted(tmp_path.rglob("*"))
    done = batch(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    check_line(done, words)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("output", ["out.nc", "none/out.nc", "/proc/out.nc", "case.nc"])
def test_netcdf_that_cannot_be_written_is_one_line(output, made, batch, netcdf, tmp_path):
    case = write_case(made)
    (tmp_path / "case.nc").mkdir()
    before = sorted(tmp_path.rglob("*"))
    limit = 10_000 if output == "out.nc" else None
    done = batch(case, f"output={output}", cwd=tmp_path, limit=limit)
    assert done.returncode == 2
    check_line(done, [output])
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("limit", [10, 3000, 20_000])
def test_a_full_disk_is_one_line(limit, made, batch, tmp_path):
    case = write_case(made)
    done = batch(case, cwd=tmp_path, limit=limit)
    assert done.returncode == 2
    check_line(done, ["case_results", ": cannot be written"])
    assert sorted(os.listdir(tmp_path)) == ["case"]


def test_quantile_maps_take_memory_where_boulders_pass(netcdf, tmp_path):
    """Counts for all of a million cells are 824 MB; the program has 500. And netCDF has many blocks
    of rows."""
    grid = Grid(0.0, 1000.0, 1.0, 1000, 1000)
    write_ascii(tmp_path / "dem.asc", np.zeros(grid.shape) - np.arange(1000)[:, None], grid)
    (tmp_path / "case.nml").write_text("""&case boulders = 8, threads = 1 /
&terrain dem = 'dem.asc' /
&surface uniform_mean_radius = 0.1 /
&boulder volume_mean = 0.1 /
&release x = 500.0, y = 990.0, drop_height = 5.0 /
&output maps = 'passages', 'energy_q50', 'speed_q50', 'jump_height_q50', least_passages = 6 /
""")
    limit = 500 * 10**6
    for output in ("out", "out.nc"):
        done = subprocess.run(
            [find_program(), "case.nml", f"output={output}"], cwd=tmp_path, capture_output=True,
            text=True, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
    written = rockfall.result.read_result(tmp_path / "out.nc")
    result = rockfall.run(rockfall.read_case(tmp_path / "case.nml"))
    passages = result["passages"].values
    assert np.array_equal(~np.isnan(result["speed_q50"]), passages >= 6) and passages.max() == 8
    for name in ("energy_q50", "speed_q50", "jump_height_q50"):
        values = np.loadtxt(tmp_path / "out" / f"{name}.asc", dtype="f4", skiprows=6)
        assert same_bits(np.where(values == -9999, np.nan, values), result[name]), name
        assert same_bits(written[name], result[name]), name


def test_help_and_version(batch, tmp_path):
    done = batch("--help", cwd=tmp_path)
    assert done.returncode == 0 and "CASE [key=value ...]" in done.stdout
    done = batch("--version", cwd=tmp_path)
    assert done.returncode == 0 and done.stdout.startswith("rockfall-batch ")


@pytest.mark.parametrize("of", [2, 7])
def test_parts_of_both_doors_join_to_the_run(of, made, batch, netcdf, tmp_path, monkeypatch):
    version = batch("--version", cwd=".").stdout.split()[1].rstrip(",")
    monkeypatch.setattr(rockfall, "__version__", version)  # of a tree that is not installed, too
    case = write_case(made)
    parts = []
    for k in range(1, of + 1):
        parts.append(tmp_path / f"{k}.nc")
        if k % 2:
            assert batch(case, f"shard={k}/{of}", f"output={k}.nc", cwd=tmp_path).returncode == 0
        else:
            rockfall.write_result(rockfall.run(rockfall.read_case(case), shard=(k, of)), parts[-1])
    joined, whole = rockfall.merge(parts), rockfall.run(rockfall.read_case(case))
    xr.testing.assert_equal(joined, whole)
    for name in whole.variables:
        assert name == "line" or same_bits(joined[name].values, whole[name].values), name
    assert joined.attrs["boulder_last"] == joined.attrs["boulders_asked"]


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "a/b", "1/0", "-1/3", "1/3/5", "1/99999999"])
def test_wrong_shards_are_refused(text, made, batch, netcdf, tmp_path):
    done = batch(write_case(made), f"shard={text}", "output=a.nc", cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.startswith(f"rockfall-batch: shard = {text}: ")
    assert done.stderr.count("\n") == 1 and not (tmp_path / "a.nc").exists()


def test_a_part_is_a_file_whose_name_no_glob_takes_for_a_result(made, batch, netcdf, tmp_path):
    case = write_case(made)
    for k in (1, 2):
        assert batch(case, f"shard={k}/2", cwd=tmp_path).returncode == 0
    assert batch(case, "shard=1/2", "output=other", cwd=tmp_path).returncode == 0
    assert sorted(os.listdir(tmp_path)) == ["case", "case.part1of2", "case.part2of2", "other"]
    joined = rockfall.merge([tmp_path / f"case.part{k}of2" for k in (2, 1)])
    assert joined.sizes["boulder"] == joined.attrs["boulders_asked"]


def spoil(path):
    """A file that is nobody's result, and what is in it."""
    xr.Dataset({"z": ("x", [1.0])}, attrs={"source": "a survey"}).to_netcdf(path)
    return path


OVERWRITING = {  # what lies in the way of which output, and the word that tells it
    "the DEM, by another name": (lambda f: os.link("case/dem.asc", f), "out.nc", "is an input"),
    "the table, by a link": (lambda f: os.symlink("case/zones.csv", f), "out.nc", "is an input"),
    "the case": (lambda f: os.link("case/case.nml", f), "out.nc", "is an input"),
    "another netCDF file": (spoil, "out.nc", "is there, and not a result of a run"),
    "no netCDF file": (lambda f: Path(f).write_text("mine"), "out.nc", "is there, and not a"),
    "the case, in a folder": (
        lambda f: os.replace(f, "case/case.nml") or os.link("case/case.nml", f),
        "case_results/case.nml", "is an input",
    ),
    "another map, in a folder": (
        lambda f: os.replace("case/rm.asc", f), "case_results/sources.asc", "is there, and not of",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OVERWRITING)
def test_a_run_never_writes_over_what_it_reads_or_what_is_not_ours(
    name, made, batch, netcdf, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    lay, output, said = OVERWRITING[name]
    case = write_case(made)
    folder = output.partition("/")[0]
    if folder != output:
        case.write_text(case_text().replace("'sources', ", ""))
        assert batch(case, f"output={folder}", cwd=tmp_path).returncode == 0
    lay(output)
    case.write_text(case_text())  # has one more map
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    done = batch(case, f"output={folder}", cwd=tmp_path)
    assert done.returncode == 2
    check_line(done, [f"{output}: {said}"])
    after = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert after == before
