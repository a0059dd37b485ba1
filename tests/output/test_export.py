# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall export`: every value of a result is in the layer or attribute that a GIS expects."""

import csv
import subprocess
import sys
import warnings
from xml.etree import ElementTree

import numpy as np
import pytest
import rasterio
import xarray as xr

import rockfall
from crossed import crossed
from made import make_raster
from rockfall.errors import RockfallError
from rockfall.files.export import export, write_geopackage
from rockfall.io.rasters.grid import Grid
from rockfall.result.dataset import open_result
from rockfall.result.maps.classes import classes_of
from scenes import make_case, rough, sets
from slope_case import CASE

pyogrio = pytest.importorskip("pyogrio", reason="the vector extra is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

GRID = Grid(600000.0, 5000000.0, 2.5, nx=7, ny=5)
FILL = -2147483647
STATUS = {
    "flag_values": np.array([1, 2, 3, 4], "i1"),
    "flag_meanings": "stopped absorbed left_domain impact_limit",
}


def lines_of(names):
    """Two evaluation lines; of five boulders, 2 and 4 cross the first, none the second."""
    time = np.full((2, 5), np.nan)
    time[0, [1, 3]] = 10.25, 12.5
    made = crossed(range(1, 6), names, time=time, distance=time - 5, speed=2 * time)
    return {
        **{
            name: (*of, {"units": "s"} if name == "crossing_time" else {})
            for name, of in made.items()
        },
        "line_vertex_line": ("line_vertex", np.array([0, 0, 1, 1, 1], "i4")),
        "line_vertex_x": ("line_vertex", [600000.0, 600010.0, 600000.0, 600005.0, 600010.0]),
        "line_vertex_y": ("line_vertex", [4999990.0, 4999990.0, 4999995.0, 4999996.0, 4999995.0]),
    }


def made():
    """Small result with everything that can be exported."""
    rolls = np.array([1.0, 1 / 1.5, 0.0, 0.0, 1 / 3.25, 0.0])  # [m/s]
    vertices = {
        "trajectory_boulder": ("trajectory_vertex", np.array([1, 1, 1, 2, 3, 3], "i4")),
        "trajectory_x": ("trajectory_vertex", 600000.0 + np.arange(6.0)),
        "trajectory_y": ("trajectory_vertex", 4999990.0 + np.arange(6.0)),
        "trajectory_z": ("trajectory_vertex", 100.0 - np.arange(6.0)),
        "trajectory_time": ("trajectory_vertex", [0.0, 1.0, 2.5, 0.0, 0.0, 3.25], {"units": "s"}),
        **{
            f"trajectory_velocity_{axis}": ("trajectory_vertex", way * rolls)
            for axis, way in {"x": 1, "y": 1, "z": -1}.items()
        },
        "trajectory_leg": ("trajectory_vertex", np.array([2.0, 2.0, 0.0, 0.0, 2.0, 0.0])),
    }
    stop_x = 600000.0 + np.arange(5.0) / 3.0
    stop_x[4] = np.nan
    boulders = {
        "volume": ("boulder", np.linspace(0.1, 0.9, 5).astype("f4"), {"units": "m3"}),
        "mass": ("boulder", np.full(5, 200.0), {"units": "kg"}),
        "start_x": ("boulder", [600001.0, 600001.0, 600002.0, 600002.0, 600002.0]),
        "start_y": ("boulder", np.full(5, 4999999.0)),
        "plan_distance": ("boulder", [10.0, 30.0, 20.0, 5.0, np.nan], {"units": "m"}),
        "stop_x": ("boulder", stop_x),
        "stop_y": ("boulder", np.full(5, 4999995.0)),
        "stop_z": ("boulder", np.arange(5.0)),
        "impacts": ("boulder", np.array([3, 4, 5, 6, FILL], "i4"), {"_FillValue": FILL}),
        "travel_time": ("boulder", np.arange(5.0), {"units": "s"}),
        "status": ("boulder", np.array([1, 2, 1, 3, 4], "i1"), STATUS),
    }
    attrs = {"units": "1", "long_name": "boulders that passed", "grid_mapping": "crs"}
    energy = np.linspace(0, 1e5, 35, dtype="f4").reshape(5, 7)
    energy[0, 0] = np.nan
    maps = {
        "passages": (("y", "x"), np.arange(35, dtype="i8").reshape(5, 7), attrs),
        "energy_max": (("y", "x"), energy, {"units": "J", "grid_mapping": "crs"}),
        "crs": ((), 0, {"crs_wkt": rasterio.crs.CRS.from_epsg(32632).to_wkt()}),
    }
    return xr.Dataset(
        {**maps, **boulders, **lines_of(["EL1", "EL 1/x"]), **vertices},
        coords={"x": GRID.x, "y": GRID.y, "boulder": np.arange(1, 6)},
        attrs={"seed": 7, "case": CASE, "case_file": "case.nml"},
    )


@pytest.fixture
def result():
    return made()


@pytest.mark.parametrize("system", ["EPSG:32632+6360", "EPSG:32632+5783"])
def test_maps_of_a_result_with_a_system_of_heights_have_none(result, system, tmp_path):
    """GDAL would convert counts and energies from feet. Older results may have a compound CRS."""
    result["crs"].attrs["crs_wkt"] = rasterio.crs.CRS.from_user_input(system).to_wkt()
    maps = [path for path in export(result, tmp_path / "out") if path.suffix == ".tif"]
    assert maps
    for path in maps:
        with rasterio.open(path) as file:
            assert file.crs == rasterio.crs.CRS.from_epsg(32632)
            assert "foot" not in str(file.units) and "metre" not in str(file.units)
    assert "32632" in str(layer(tmp_path / "out", "stops")[0])


def table(path):
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def layer(folder, name):
    about, _, wkb, values = pyogrio.raw.read(folder / "rockfall.gpkg", layer=name)
    columns = dict(zip(about["fields"], values, strict=True))
    return about["crs"], shapely.from_wkb(wkb), columns


@pytest.fixture(scope="module", params=["dataset", "decoded file"])
def exported(request, tmp_path_factory):
    """Folder of exports from a result in memory, or from a file opened with decoded times."""
    place, given = tmp_path_factory.mktemp("place"), made()
    if request.param != "dataset":
        given.to_netcdf(place / "out.nc")
        given = place / "out.nc"
    if request.param == "decoded file":
        given = xr.open_dataset(given, decode_timedelta=True)
    paths = export(given, place / "new" / "folder")
    assert sorted(paths) == sorted((place / "new" / "folder").iterdir())
    return place / "new" / "folder"


def test_all_files_are_there_and_no_others(exported):
    names = "boulders.csv energy_max_kJ.qml energy_max_kJ.tif line_EL1.csv line_EL_1_x.csv"
    names += " passages.qml passages.tif rockfall.gpkg"
    assert sorted(path.name for path in exported.iterdir()) == names.split()


def test_maps_keep_values_place_and_crs(exported, result):
    with rasterio.open(exported / "passages.tif") as file:
        values = result.passages.values
        assert (file.read(1) == np.where(values, values, -1)).all()  # none passed: nodata
        assert file.dtypes == ("int64",) and file.nodata == -1
        assert file.transform == GRID.transform
        assert file.crs.to_epsg() == 32632
        assert file.descriptions == ("boulders that passed",)
        assert file.tags()["long_name"] == "boulders that passed"
        assert file.tags()["seed"] == "7" and file.tags()["case"] == CASE  # provenance
        assert file.tags(ns="IMAGE_STRUCTURE")["LAYOUT"] == "COG"
    with rasterio.open(exported / "energy_max_kJ.tif") as file:
        in_kj = result.energy_max.values * np.float32(1e-3)
        np.testing.assert_array_equal(file.read(1), np.where(values, in_kj, np.nan))
        assert np.isnan(file.nodata)
        assert file.dtypes == ("float32",)
        assert file.units == ("kJ",)


@pytest.mark.parametrize("name", ["energy_max_kJ", "passages"])
def test_a_style_has_a_colour_for_every_value(exported, name):
    with rasterio.open(exported / f"{name}.tif") as file:
        values, unit = file.read(1, masked=True).compressed(), file.units[0]
    root = ElementTree.parse(exported / f"{name}.qml").getroot()
    items = list(root.iter("item"))
    ends = [float(item.get("value")) for item in items]
    assert ends == sorted(ends) and values.max() < ends[-1] == np.inf
    assert unit == "1" or {30.0, 300.0} < set(ends)
    assert len({item.get("color") for item in items}) == len(ends) > 3
    found = classes_of("boulders" if unit == "1" else unit)
    held = np.searchsorted(ends, values)  # QGIS includes the upper limit
    assert (held == found.numbers(values.astype(float))).all()
    assert [item.get("color") for item in items] == list(found.colours)


def test_maps_with_y_upwards_are_turned(result, tmp_path):
    export(result.isel(y=slice(None, None, -1)), tmp_path)
    with rasterio.open(tmp_path / "passages.tif") as file:
        assert file.transform == GRID.transform
        assert (file.read(1)[1:] == result.passages.values[1:]).all()


def test_boulders_come_back_to_a_tenth_of_a_millimetre(exported, result):
    rows = table(exported / "boulders.csv")
    assert [row["boulder"] for row in rows] == ["1", "2", "3", "4", "5"]
    stops = np.round(result.stop_x.values[:4], 4)
    assert [float(row["stop_x"]) for row in rows[:4]] == stops.tolist()
    assert rows[4]["stop_x"] == ""
    assert [row["impacts"] for row in rows] == ["3", "4", "5", "6", ""]
    assert [row["volume"] for row in rows] == ["0.1", "0.3", "0.5", "0.7", "0.9"]
    ended = "stopped absorbed stopped left_domain impact_limit".split()
    assert [row["status"] for row in rows] == ended


def test_line_tables_have_those_who_crossed(exported):
    rows = table(exported / "line_EL1.csv")
    assert [
        (row["boulder"], row["x"], row["y"], row["time"], row["distance"], row["speed"],
         row["energy_translational"]) for row in rows
    ] == [
        ("2", "600005.25", "4999990.0", "10.25", "5.25", "20.5", "42025.0"),
        ("4", "600007.5", "4999990.0", "12.5", "7.5", "25.0", "62500.0"),
    ]  # fmt: skip
    empty = (exported / "line_EL_1_x.csv").read_text()
    assert empty == f"{','.join(rows[0])}\n" and empty.startswith(
        "boulder,x,y,time,distance,speed,"
    )


def test_crossings_and_sources_are_points(exported):
    _, points, columns = layer(exported, "crossings")
    assert [point.coords[0] for point in points] == [(600005.25, 4999990), (600007.5, 4999990)]
    assert columns["line"].tolist() == ["EL1", "EL1"] and columns["boulder"].tolist() == [2, 4]
    assert columns["energy_translational_kJ"] == pytest.approx([42.025, 62.5], rel=1e-7)
    assert columns["speed_m_s"].tolist() == [20.5, 25.0]
    _, points, columns = layer(exported, "sources")
    assert [point.coords[0] for point in points] == [(600001, 4999999), (600002, 4999999)]
    assert columns["boulders"].tolist() == [2, 3]
    assert columns["plan_distance_max_m"].tolist() == [30.0, 20.0]


def test_stops_are_points_with_all_that_is_known(exported, result):
    crs, points, columns = layer(exported, "stops")
    assert crs == "EPSG:32632"
    assert [p.coords[0] for p in points[:4]] == [
        (x, 4999995.0, z)
        for x, z in zip(result.stop_x.values[:4], result.stop_z.values[:4], strict=True)
    ]
    assert points[4] is None
    assert columns["boulder"].tolist() == [1, 2, 3, 4, 5]
    assert columns["status"].tolist()[3] == "left_domain"
    assert columns["travel_time_s"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    units = {"travel_time": "_s", "volume": "_m3", "plan_distance": "_m", "mass": "_kg"}
    assert set(columns) == {"boulder"} | {
        name + units.get(name, "") for name in result.data_vars if result[name].dims == ("boulder",)
    }


def test_lines_and_trajectories_are_line_strings(exported):
    _, shapes, columns = layer(exported, "lines")
    assert columns["name"].tolist() == ["EL1", "EL 1/x"]
    assert [len(shape.coords) for shape in shapes] == [2, 3]
    assert shapes[1].coords[1] == (600005.0, 4999996.0)

    _, shapes, columns = layer(exported, "trajectories")
    assert columns["boulder"].tolist() == [1, 2, 3]
    assert columns["vertices"].tolist() == [2, 1, 2]  # contacts and ends
    assert columns["travel_time"].tolist() == [2.5, 0.0, 3.25]
    assert shapes[0].coords[2] == (600002.0, 4999992.0, 98.0)
    assert list(shapes[1].coords) == [(600003.0, 4999993.0, 97.0)] * 2  # it never moved


def test_many_boulders_are_written_in_parts(result, tmp_path, monkeypatch):
    export(result, tmp_path / "whole")
    monkeypatch.setattr("rockfall.files.export._ROWS", 2)
    export(result, tmp_path / "parts")
    for name in ("boulders.csv", "line_EL1.csv"):
        assert (tmp_path / "parts" / name).read_text() == (tmp_path / "whole" / name).read_text()
    _, whole, _ = layer(tmp_path / "whole", "stops")
    _, parts, columns = layer(tmp_path / "parts", "stops")
    assert parts.tolist() == whole.tolist()
    assert columns["boulder"].tolist() == [1, 2, 3, 4, 5]


def test_boulder_numbers_of_the_result_are_kept(result, tmp_path):
    crossing = result["crossing_boulder"] + 100
    export(
        result.assign_coords(boulder=np.arange(101, 106)).assign(crossing_boulder=crossing),
        tmp_path,
    )
    assert [row["boulder"] for row in table(tmp_path / "boulders.csv")][0] == "101"
    assert table(tmp_path / "line_EL1.csv")[1]["boulder"] == "104"


def test_lines_with_the_same_letters_get_files_of_their_own(result, tmp_path):
    export(result.assign(line_name=("line", ["../el1", "EL1"])), tmp_path / "out")
    names = sorted(path.name for path in (tmp_path / "out").glob("line_*"))
    assert names == ["line_EL1_2.csv", "line_el1.csv"]


@pytest.mark.parametrize("n", [0, 5])
def test_a_geopackage_has_the_values_of_every_type(tmp_path, n):
    points = shapely.points(np.arange(n, dtype=float), np.zeros(n))
    points[1:2] = None
    mixed = np.array(["ä", None, np.nan, 1.5, ""], dtype=object)[:n]
    begin = np.datetime64("2000-01-01", "us") + 1500 * np.arange(n)
    fields = {"mixed": mixed, "word": mixed.astype("U3"), "begin": begin, "flag": begin > begin[:1]}
    fields |= {kind: np.arange(n).astype(kind) for kind in ("i8", ">f8", "f4", "u1", "i4")}
    fields["f4"][1:2] = np.nan
    layers = {name: ("Point", [(points, fields)] * 2) for name in ("one", "other")}
    path = write_geopackage(tmp_path / "a.gpkg", layers, "EPSG:2056")
    about, _, shapes, columns = pyogrio.raw.read(path, layer="other")
    found = dict(zip(about["fields"], columns, strict=True))
    assert [*found] == [*fields]
    assert shapes.tolist() == 2 * shapely.to_wkb(points).tolist()
    assert found["mixed"].tolist() == 2 * ["ä", None, None, "1.5", ""][:n]
    assert found["word"].tolist() == 2 * fields["word"].tolist()
    assert (found["begin"] == np.tile(begin.astype("M8[ms]"), 2)).all()
    for name in ("flag", "i8", ">f8", "f4", "u1", "i4"):
        assert found[name].dtype == fields[name].dtype.newbyteorder("=") or name in ("u1", "flag")
        np.testing.assert_array_equal(found[name], np.tile(fields[name], 2))


def test_without_a_crs_maps_and_layers_have_none(result, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        export(result.drop_vars("crs"), tmp_path)
    with rasterio.open(tmp_path / "passages.tif") as file:
        assert file.crs is None


def test_a_run_without_maps_keeps_its_crs(tmp_path):
    z = rough(nx=20, ny=20)
    make_raster(tmp_path / "dem.tif", z)
    release = {"x": 600050.0, "y": 4999990.0}
    case = make_case(tmp_path, *sets(), terrain={"dem": "dem.tif"}, release=release)
    export(rockfall.run(case), tmp_path / "out")
    assert layer(tmp_path / "out", "stops")[0] == "EPSG:32632"


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "out.nc: no such file"), (b"no netCDF", "out.nc: is not a netCDF result: ")],
)
def test_what_is_no_result_is_one_line(content, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if content:
        (tmp_path / "out.nc").write_bytes(content)
    with pytest.raises(RockfallError) as caught:
        export("out.nc", "folder")
    assert str(caught.value).startswith(message)
    assert caught.value.code == 2
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "folder").exists()


def test_a_file_in_place_of_the_folder_is_one_line(result, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").touch()
    with pytest.raises(RockfallError, match="^folder: is a file: give a folder$"):
        export(result, "folder")


@pytest.mark.parametrize("package", ["nanoarrow", "pyogrio", "shapely"])
def test_without_the_vector_extra_one_line_and_nothing_written(
    package, result, tmp_path, monkeypatch
):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(RockfallError) as caught:
        export(result, tmp_path / "out")
    assert str(caught.value) == "GeoPackages need the vector extra: pip install 'rockfall[vector]'"
    assert not (tmp_path / "out").exists()


DISK_FULL = """
import resource, signal, sys, xarray as xr
from rockfall.errors import RockfallError
from rockfall.result.maps.classes import classes_of
from rockfall.files.export import export, write_geopackage
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
data = xr.load_dataset("out.nc", mask_and_scale=False, decode_times=False)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
for names in sys.argv[1:]:
    try:
        export(data[names.split()], "out")
    except RockfallError as error:
        print(error)
"""


@pytest.mark.all
def test_a_full_disk_leaves_nothing_under_the_final_name(result, tmp_path):
    pytest.importorskip("resource", reason="this system has no limits of a process")
    rng = np.random.default_rng(1)
    grid = Grid(0.0, 300.0, 1.0, nx=300, ny=300)
    many = result.drop_dims(["x", "y", "boulder"]).assign(
        passages=(("y", "x"), rng.integers(0, 2**40, grid.shape)),
        volume=("boulder", rng.uniform(size=3000)),
        stop_z=("boulder", rng.uniform(size=3000)),
    )
    many.assign_coords(x=grid.x, y=grid.y).to_netcdf(tmp_path / "out.nc")
    line = "line line_name row_size line_vertex_line line_vertex_x line_vertex_y"
    parts = ["passages", "volume stop_z", line]
    done = subprocess.run(
        [sys.executable, "-c", DISK_FULL, *parts], cwd=tmp_path, capture_output=True, text=True
    )
    lines = done.stdout.splitlines()
    assert lines[:2] == [
        "out/passages.tif: cannot be written: File too large",
        "out/boulders.csv: cannot be written: File too large",
    ], done.stderr
    assert len(lines) == 3 and lines[2].startswith("out/rockfall.gpkg: cannot be written: ")
    assert [path.name for path in tmp_path.iterdir()] == ["out.nc"]


@pytest.mark.parametrize(("files", "shown"), [(["b.nc", "a.nc"], "a.nc, b.nc"), ([], "OUT.nc")])
def test_a_folder_in_place_of_a_result_lists_its_files(tmp_path, files, shown):
    for name in files:
        (tmp_path / name).touch()
    with pytest.raises(RockfallError) as caught:
        open_result(tmp_path)
    assert str(caught.value) == f"{tmp_path}: is a folder: give one of its files, {shown}"
