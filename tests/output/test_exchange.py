# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories in time, KML and DXF: other readers find the simulated values in them."""

import sqlite3
import struct
import sys
from contextlib import closing
from datetime import datetime
from xml.etree import ElementTree

import numpy as np
import pyproj
import pytest

import rockfall
from made import make_layer, make_raster, refused, write_few_maps
from rockfall.cli import main
from rockfall.result.dataset import write_result
from rockfall.result.motion import motion_of, sampled
from scenes import make_case, rough, sets

pyogrio = pytest.importorskip("pyogrio", reason="the vector extra is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
ezdxf = pytest.importorskip("ezdxf", reason="the cad extra is not installed")

KML = "{http://www.opengis.net/kml/2.2}"
LINE = {"name": "Straße Süd <1>", "x": [600010.0, 600290.0], "y": [4999800.0, 4999810.0]}
G = 9.81


def run(place, crs="EPSG:32632", **changes):
    z = rough(nx=60, ny=80)
    make_raster(place / "dem.tif", z, crs=crs)
    release = {"x": [600150.0, 600160.0], "y": [4999990.0, 4999990.0], "drop_height": 5.0}
    given = {"output": {"trajectories": 6}, "line": [LINE], "case": {"boulders": 5, "seed": 3}}
    return make_case(
        place, *sets(), terrain={"dem": "dem.tif"}, release=release, **(given | changes)
    )


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return rockfall.run(run(tmp_path_factory.mktemp("site")))


@pytest.fixture(scope="module")
def exported(result, tmp_path_factory):
    """Folder with every format, whose polylines are within 1 cm of the arcs."""
    folder = tmp_path_factory.mktemp("out")
    rockfall.export(result, folder, formats=["gpkg", "kml", "dxf"], tolerance=0.01)
    return folder


def contacts(result):
    """Rows of x, y, z, time, velocity and kind of motion, at contacts and points between them, by
    boulder."""
    names = ("x", "y", "z", "time", "velocity_x", "velocity_y", "velocity_z", "leg")
    rows = np.column_stack([result[f"trajectory_{name}"].values for name in names])
    owner = result["trajectory_boulder"].values
    return {number: rows[owner == number] for number in np.unique(owner).tolist()}


def met(result):
    """Rows of `contacts` without the points between contacts."""
    known = contacts(result)
    between = {k: (one[1:-1, 7] > 1) & (one[:-2, 7] > 1) for k, one in known.items()}
    return {k: one[~np.r_[False, between[k], False]] for k, one in known.items()}


def place_at(rows, time):
    """Position of a boulder at a time since its release, by free fall in flight and along straight
    lines on the ground."""
    k = np.searchsorted(rows[:-1, 3], time, side="right") - 1
    t = time - rows[k, 3]
    if rows[k, 7] > 1:
        return rows[k, :3] + t / (rows[k + 1, 3] - rows[k, 3]) * (rows[k + 1] - rows[k])[:3]
    return rows[k, :3] + t * rows[k, 4:7] - (0, 0, G / 2 * t**2)


def rows_of(path, layer, columns):
    """Yield each line of a layer as (n, 4), decoded as in the standard, with the values of its
    columns; read by SQLite alone."""
    with closing(sqlite3.connect(path)) as database:
        rows = database.execute(f"SELECT geom, {', '.join(columns)} FROM {layer}").fetchall()
    for blob, *values in rows:
        envelope = (blob[3] >> 1) & 7
        start = 8 + (0, 32, 48, 48, 64)[envelope]
        kind, count = struct.unpack_from("<xII", blob, start)
        assert kind == 3002
        yield np.frombuffer(blob, "<f8", 4 * count, start + 9).reshape(-1, 4), values


def test_trajectories_are_parabolas_in_space_and_time(exported, result):
    """At every vertex and halfway between vertices, boulders are within 1 cm of free fall."""
    found = dict(
        (number, path)
        for path, (number,) in rows_of(exported / "rockfall.gpkg", "trajectories", ["boulder"])
    )
    known = contacts(result)
    assert found.keys() == known.keys()
    for number, path in found.items():
        rows = known[number]
        assert (np.diff(path[:, 3]) >= 0).all() and path[-1, 3] == rows[-1, 3]
        assert {tuple(row) for row in rows[:, :4]} <= {tuple(row) for row in path}
        wanted = [place_at(rows, time) for time in path[:-1, 3]]
        np.testing.assert_allclose(path[:-1, :3], wanted, rtol=0, atol=1e-6)
        between = (path[1:] + path[:-1]) / 2
        off = between[:, :3] - [place_at(rows, time) for time in between[:, 3]]
        assert 0.002 < np.linalg.norm(off, axis=1).max() <= 0.01 + 1e-6


def test_a_coarser_tolerance_needs_fewer_vertices_and_is_kept(result):
    sizes = []
    for tolerance in (0.001, 0.05, 1.0):
        motion = motion_of(result)
        paths = sampled(motion, tolerance).strings(motion.boulder)
        sizes.append(sum(map(len, paths)))
        for rows, path in zip(contacts(result).values(), paths, strict=True):
            between = (path[1:] + path[:-1]) / 2
            off = between[:, :3] - [place_at(rows, time) for time in between[:, 3]]
            assert np.linalg.norm(off, axis=1).max() <= tolerance + 1e-6
    assert sizes == sorted(sizes, reverse=True) and len(set(sizes)) == 3
    with refused("--tolerance 0: must be > 0 [m]"):
        sampled(motion_of(result), 0.0)


def seconds_of(stamp):
    return (datetime.fromisoformat(stamp.rstrip("Z")) - datetime(2000, 1, 1)).total_seconds()


def test_flights_have_begin_and_end_for_the_temporal_controller(exported, result):
    columns = ["boulder", "contact", '"begin"', '"end"', "begin_s", "duration_s"]
    columns += ["speed_m_s", "speed_end_m_s"]
    rows = list(rows_of(exported / "rockfall.gpkg", "flights", columns))
    known = met(result)
    assert len(rows) == sum((np.diff(one[:, 3]) > 0).sum() for one in known.values())
    for path, (boulder, contact, begin, end, begin_s, duration, speed, speed_end) in rows:
        own, following = known[boulder][contact - 1], known[boulder][contact]
        assert tuple(path[0]) == tuple(own[:4]) and tuple(path[-1]) == tuple(following[:4])
        assert (begin_s, duration) == (own[3], following[3] - own[3]) and duration > 0
        since = [seconds_of(stamp) for stamp in (begin, end)]
        assert since == pytest.approx([own[3], following[3]], abs=1.001e-3)
        assert since[0] < since[1]  # the format only has milliseconds
        assert speed == pytest.approx(np.linalg.norm(own[4:7]), abs=1e-12)
        fallen = own[4:7] - (0, 0, G * (own[7] == 1) * (following[3] - own[3]))
        assert speed_end == pytest.approx(np.linalg.norm(fallen), abs=1e-6)
    with closing(sqlite3.connect(exported / "rockfall.gpkg")) as database:
        query = "SELECT styleQML FROM layer_styles WHERE f_table_name = 'flights'"
        ((style,),) = database.execute(query).fetchall()
    temporal = ElementTree.fromstring(style).find("temporal")
    assert temporal.attrib["startField"] == "begin" and temporal.attrib["endField"] == "end"


def test_gdal_finds_every_layer_of_the_kml(exported, result):
    path = exported / "rockfall.kml"
    names = [name for name, _ in pyogrio.list_layers(path)]
    assert names == ["sources", "stops", "lines", "trajectories", "flights"]
    back = pyproj.Transformer.from_crs(4326, 32632, always_xy=True)

    def read(layer):
        about, _, wkb, values = pyogrio.raw.read(path, layer=layer)
        shapes = shapely.transform(
            shapely.from_wkb(wkb),
            lambda xyz: np.column_stack([*back.transform(*xyz.T[:2]), *xyz.T[2:]]),
            include_z=layer == "trajectories",
        )
        return shapes, dict(zip(about["fields"], values, strict=True))

    stops, _ = read("stops")
    wanted = np.column_stack([result["stop_x"].values, result["stop_y"].values])
    np.testing.assert_allclose(shapely.get_coordinates(stops), wanted, rtol=0, atol=1e-3)
    lines, fields = read("lines")
    assert fields["Name"].tolist() == [LINE["name"]]
    ends = np.column_stack([LINE["x"], LINE["y"]])
    np.testing.assert_allclose(shapely.get_coordinates(lines), ends, rtol=0, atol=1e-3)
    paths, _ = read("trajectories")
    for path, rows in zip(paths, contacts(result).values(), strict=True):
        ends = shapely.get_coordinates(path, include_z=True)[[0, -1]]
        np.testing.assert_allclose(ends, rows[[0, -1], :3], rtol=0, atol=1e-3)


def test_kml_says_what_its_heights_are(exported):
    root = ElementTree.parse(exported / "rockfall.kml").getroot()
    assert "vertical datum: not stated" in root.find(f"{KML}Document/{KML}description").text
    folders = {one.find(f"{KML}name").text: one for one in root.iter(f"{KML}Folder")}
    modes = {
        name: {one.text for one in folder.iter(f"{KML}altitudeMode")}
        for name, folder in folders.items()
    }
    assert modes["trajectories"] == {"absolute"}
    assert modes["stops"] == modes["lines"] == modes["sources"] == {"clampToGround"}
    styles = {one.attrib["id"] for one in root.iter(f"{KML}Style")}
    used = {one.text[1:] for one in root.iter(f"{KML}styleUrl")}
    assert used and used <= styles


def test_kml_has_the_time_of_each_flight_to_the_microsecond(exported, result):
    root = ElementTree.parse(exported / "rockfall.kml").getroot()
    known = met(result)
    flown = dict.fromkeys(known, 0.0)
    spans = root.findall(f".//{KML}Placemark[{KML}TimeSpan]")
    assert len(spans) == sum((np.diff(one[:, 3]) > 0).sum() for one in known.values())
    for place in spans:
        begin, end = (
            seconds_of(place.find(f"{KML}TimeSpan/{KML}{key}").text) for key in ("begin", "end")
        )
        data = {one.attrib["name"]: one[0].text for one in place.iter(f"{KML}Data")}
        boulder, contact = int(data["boulder"]), int(data["contact"])
        own, following = known[boulder][[contact - 1, contact], 3]
        assert (begin, end) == pytest.approx((own, following), abs=0.501e-6)
        assert float(data["duration_s"]) == following - own and "begin" not in data
        flown[boulder] += end - begin
    assert list(flown.values()) == pytest.approx([one[-1, 3] for one in known.values()], abs=1e-3)


def test_a_drawing_has_trajectories_in_space_and_names(exported, result):
    drawing = ezdxf.readfile(exported / "rockfall.dxf")
    assert not drawing.audit().errors and drawing.header["$INSUNITS"] == 6
    colours = {layer.dxf.name: layer.rgb or layer.color for layer in drawing.layers}
    assert colours["trajectories"] == (0, 114, 178) and colours["stops_stopped"] == (213, 94, 0)
    assert colours["lines"] == colours["sources"] == 7  # white on a dark ground
    space = drawing.modelspace()
    known = contacts(result)
    paths = space.query('POLYLINE[layer=="trajectories"]')
    for path, rows in zip(paths, known.values(), strict=True):
        places = [tuple(one.dxf.location) for one in path.vertices]
        assert {tuple(row) for row in rows[:, :3]} <= {*places}
        assert places[0] == tuple(rows[0, :3]) and places[-1] == tuple(rows[-1, :3])
    (line,) = space.query('LWPOLYLINE[layer=="lines"]')
    assert [tuple(one[:2]) for one in line] == list(zip(LINE["x"], LINE["y"], strict=True))
    (text,) = space.query('TEXT[layer=="lines"]')
    assert text.dxf.text == LINE["name"]
    stops = [one for one in space.query("POINT") if one.dxf.layer.startswith("stops_")]
    places = {tuple(one.dxf.location) for one in stops}
    axes = (result[f"stop_{axis}"].values.tolist() for axis in "xyz")
    assert places == {*zip(*axes, strict=True)}


def test_a_result_without_crs_is_drawn_as_dxf_only(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_result(rockfall.run(run(tmp_path, crs=None)), "out.nc")
    assert main(["export", "out.nc", "cad", "--formats", "dxf"]) == 0
    capsys.readouterr()
    assert main(["export", "out.nc", "gis", "--formats", "tif", "kml"]) == 2
    assert capsys.readouterr().err == (
        "rockfall: KML requires longitudes and latitudes, but the result has no CRS: give the DEM "
        "one (rockfall dem DEM -o DEM.tif --crs CODE) and run again\n"
    )
    assert not (tmp_path / "gis").exists()


def test_without_the_cad_extra_one_line_and_nothing_written(result, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with refused("DXF needs the cad extra: pip install 'rockfall[cad]'"):
        rockfall.export(result, tmp_path / "out", formats=["csv", "dxf"])
    assert not (tmp_path / "out").exists()


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--formats", "shp"], "--formats shp: must be one of tif, gpkg, csv, kml, dxf"),
        (
            ["--formats", "tif", "czml"],
            "--formats czml: is no longer written: use kml, which Cesium reads",
        ),
        (["--geoid=48"], "--geoid: was removed with CZML: use --formats kml"),
        (["--tolerance", "-1"], "--tolerance -1: must be > 0 [m]"),
    ],
)
def test_wrong_options_are_one_line(options, message, result, tmp_path, capsys):
    write_result(result, tmp_path / "out.nc")
    assert main(["export", str(tmp_path / "out.nc"), str(tmp_path / "gis"), *options]) == 2
    assert capsys.readouterr().err == f"rockfall: {message}\n"
    assert not (tmp_path / "gis").exists()


def test_zones_of_a_hazard_are_drawn(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    case = run(tmp_path).replace(scenario=[{"name": "blocks", "return_period": 10.0}])
    place = shapely.box(600150, 4999900, 600160, 4999910)
    objects = make_layer(tmp_path / "objects.gpkg", [place], name=["Haus Müller & <Söhne>"])
    write_few_maps(monkeypatch)
    rockfall.write_hazard(rockfall.hazard(case, objects=objects), "zones")
    assert main(["export", "zones/hazard.nc", "out"]) == 0
    capsys.readouterr()
    about, _, wkb, values = pyogrio.raw.read("zones/hazard.gpkg", layer="zones")
    zones = dict(zip(about["fields"], values, strict=True))
    shapes, hazard = shapely.from_wkb(wkb), zones["hazard"]
    drawing = ezdxf.readfile("out/hazard.dxf").modelspace()
    drawn = [one for one in drawing if one.dxf.layer.startswith("zones_")]
    assert {one.dxf.layer for one in drawn} == {f"zones_{name}" for name in hazard}
    assert all(one.closed for one in drawn)
    outlines = [shapely.Polygon([at[:2] for at in one]).area for one in drawn]
    rings = [ring for shape in shapes for ring in (shape.exterior, *shape.interiors)]
    assert sum(outlines) == pytest.approx(sum(shapely.Polygon(ring).area for ring in rings))
    about, _, wkb, values = pyogrio.raw.read("out/hazard.kml", layer="zones")
    assert dict(zip(about["fields"], values, strict=True))["Name"].tolist() == hazard.tolist()
    about, _, _, values = pyogrio.raw.read("out/hazard.kml", layer="objects")
    names = dict(zip(about["fields"], values, strict=True))["Name"].tolist()
    assert names == [one.dxf.text for one in drawing.query("TEXT")] == ["Haus Müller & <Söhne>"]
    assert main(["export", "zones/hazard.nc", "new", "--formats", "gpkg"]) == 2
    assert capsys.readouterr().err == "rockfall: --formats gpkg: must be one of kml, dxf\n"
