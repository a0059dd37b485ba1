# SPDX-License-Identifier: BSD-3-Clause
"""Objects from several layers: each has the same results as alone, sums include all objects, and
names distinguish the layers."""

from pathlib import Path

import numpy as np
import pytest

import rockfall
import scenes
from made import make_frame, make_layer, refused
from rockfall.analysis.objects.at_risk import AtRisk
from rockfall.cli import main
from rockfall.files.hazard_files import object_table
from rockfall.studies.hazard import read_study
from rockfall.tables import hazard as tables
from rockfall.tables.hazard import assumptions

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

Z = scenes.rough()
GRID = scenes.grid(Z)
HOUSE = shapely.box(140, 280, 155, 292)
SHED = shapely.box(100, 320, 125, 335)
ROAD = shapely.LineString([(0, 250), (300, 253)])
POINT = shapely.Point(122.5, 342.5)
TRAFFIC = {"aadt": [800.0], "speed": [50.0], "persons_per_vehicle": [1.6], "width": [6.0]}
ENDS = ("", "_low", "_high")


def make_case(folder):
    release = {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0}
    case = scenes.make_case(folder, *scenes.sets(2.0), release=release, case={"boulders": 100})
    return case.replace(scenario=[{"name": "one", "frequency": 0.5}])


@pytest.fixture
def layers(tmp_path):
    """Paths of layers: buildings with persons, a road with traffic, and a point without either."""
    about = {"crs": "EPSG:32632"}
    homes = {"name": ["1", "2"], "persons": [4.0, 2.0], "vulnerability": [0.5, 0.5]}
    return [
        make_layer(tmp_path / "houses.gpkg", [HOUSE, SHED], **about, **homes),
        make_layer(tmp_path / "roads.gpkg", [ROAD], **about, name=["1"], **TRAFFIC),
        make_layer(tmp_path / "marks.gpkg", [POINT], **about, name=["mark"]),
    ]


def hazard(folder, objects, **how):
    return rockfall.hazard(make_case(folder), dem=Z, transform=GRID, objects=objects, **how)


def test_names_are_unique(tmp_path):
    """Objects without a name get their number; repeated names get the next free number."""
    names = ["house", "house", "house 1", " ", None, "5"]
    shapes = [shapely.box(x, 250, x + 10, 260) for x in range(20, 140, 20)]
    found = hazard(tmp_path, make_layer(tmp_path / "a.gpkg", shapes, crs=None, name=names))
    assert found.object.values.tolist() == ["house 2", "house 3", "house 1", "4", "5 1", "5 2"]


def test_each_object_has_the_numbers_that_it_has_alone(tmp_path, layers):
    together = hazard(tmp_path, layers)
    assert together.object_layer.values.tolist() == ["houses", "houses", "roads", "marks"]
    assert together.object.values.tolist() == ["houses: 1", "2", "roads: 1", "mark"]
    first = 0
    for path in layers:
        alone = hazard(tmp_path, path)
        size = alone.sizes["object"]
        mine = together.isel(object=slice(first, first + size))
        first += size
        of_objects = [name for name in alone.data_vars if "object" in alone[name].dims]
        for name in of_objects:
            if alone[name].dtype.kind in "OU":
                assert mine[name].values.tolist() == alone[name].values.tolist(), name
            else:
                assert np.array_equal(mine[name].values, alone[name].values, equal_nan=True), name
    assert (together.object_passages.values > 5).all()
    assert np.isfinite(together.object_risk.values).tolist() == [True, True, False, False]


def test_sums_are_of_all_layers(tmp_path, layers):
    """Expected deaths add up over layers and over objects; a point without persons has none."""
    together = hazard(tmp_path, layers)
    added = sum(float(hazard(tmp_path, path).total_collective_risk) for path in layers[:2])
    assert added > 0
    assert float(together.total_collective_risk) == pytest.approx(added, rel=1e-12)
    each = together.object_collective_risk
    assert np.isnan(each.values[3])
    assert float(together.total_collective_risk) == pytest.approx(np.nansum(each.values), rel=1e-12)


def test_assumptions_and_tables_name_the_layer(tmp_path, layers):
    found = hazard(tmp_path, layers)
    said = assumptions(found)
    assert "default presence = 1: houses: 1, 2" in said
    assert any(one.startswith("NOT included") and one.endswith(": roads: 1") for one in said)
    assert len(said) == len({*said})
    table = tables.object_table(found)
    assert table.head[1] == "layer"
    assert {row[1] for row in table.rows} == {"houses", "roads", "marks"}
    assert len({len(row) for row in table.rows} | {len(table.head)}) == 1
    table = tables.risk_table(found)
    assert table.head[1] == "layer" and {len(row) for row in table.rows} == {len(table.head)}
    assert object_table(found)["layer"].tolist() == ["houses", "houses", "roads", "marks"]
    assert tables.object_table(hazard(tmp_path, layers[0])).head[1] != "layer"


def test_layers_of_one_file_and_files_of_one_name(tmp_path, layers):
    site = tmp_path / "site.gpkg"
    make_layer(site, [HOUSE], "EPSG:32632", layer="houses", name=["a"])
    make_layer(site, [ROAD], "EPSG:32632", layer="roads", name=["b"])
    found = hazard(tmp_path, site, objects_layer=["roads", "houses"])
    assert found.object_layer.values.tolist() == ["roads", "houses"]
    assert found.object.values.tolist() == ["b", "a"]
    files = hazard(tmp_path, [site, layers[0]], objects_layer=["houses", "houses"])
    assert files.object_layer.values.tolist() == ["houses 1", "houses 2", "houses 2"]
    with refused("--objects-layer: 2 names for 3 files: must be names of layers in one file, or "
                 "one for each file"):  # fmt: skip
        hazard(tmp_path, [site, *layers[:2]], objects_layer=["roads", "houses"])
    with refused(f"{site}, layer roads: is given twice as a layer of objects"):
        hazard(tmp_path, [site, site], objects_layer=["roads", "roads"])
    with refused(f"{site}: has 2 layers (houses, roads): choose one with --objects-layer"):
        hazard(tmp_path, [layers[0], site])


def test_frames_are_layers_too(tmp_path, layers):
    homes = {"name": ["1", "2"], "persons": [4.0, 2.0], "vulnerability": [0.5, 0.5]}
    frames = [make_frame([HOUSE, SHED], **homes), make_frame([ROAD], name=["1"], **TRAFFIC)]
    found, of_files = hazard(tmp_path, frames), hazard(tmp_path, layers[:2])
    assert found.object_layer.values.tolist() == ["objects[0]", "objects[0]", "objects[1]"]
    assert (found.object_passages.values == of_files.object_passages.values).all()
    frames[1]["width"] = -1.0
    with refused("objects[1] = (GeoDataFrame): feature 1: width = -1.0: must be 0 to 100"):
        hazard(tmp_path, frames)
    with refused("a GeoDataFrame: is given twice as a layer of objects"):
        hazard(tmp_path, [frames[0], frames[0]])


def test_the_command_takes_several(place, capsys):
    from slope_case import CASE

    Path("case.nml").write_text(CASE + "&scenario name = 'one', frequency = 0.5 /\n")
    make_layer("a.gpkg", [shapely.box(600040, 4999900, 600070, 4999920)], name=["house"])
    make_layer("b.gpkg", [shapely.LineString([(600000, 4999905), (600120, 4999930)])])
    words = ["hazard", "case.nml", "--objects", "a.gpkg", "--objects", "b.gpkg", "--write-cases"]
    assert main(words) == 0
    case = rockfall.read_case("case_scenario1.nml")
    assert [one["name"] for one in case.line] == ["object 1 part 1", "object 2 part 2", "L"]


@pytest.mark.family(2)
@pytest.mark.parametrize("given, listed", [
    ({"valeur": [5.0]}, "valeur (value?)"),
    ({"Valeur": [5.0], "vulnerability": [0.5]}, "valeur (value?)"),
    ({"persns": [4.0], "vulnerability": [0.5]}, "persns (persons?)"),
    ({"widht": [3.0]}, "widht (width?)"),
    ({"kindd": ["building"], "value": [5.0]}, "kindd (kind?)"),
    ({"expositon": [0.5], "value": [5.0]}, "expositon"),
    ({"vulnerabilty": [0.5]}, "vulnerabilty (vulnerability?)"),
    ({"address": ["Dorf 1"]}, "address"),
    ({**TRAFFIC, "presense": [0.1]}, "presense (presence?)"),
    ({"value": [5.0], "objectid": [7]}, None),
])  # fmt: skip
def test_attributes_that_are_not_used_are_listed(tmp_path, given, listed):
    path = make_layer(tmp_path / "own.gpkg", [ROAD], crs="EPSG:32632", **given)
    remarks = read_study(make_case(tmp_path), AtRisk(path), dem=Z, transform=GRID).remarks
    mine = [line for line in remarks if "attributes not used" in line]
    assert mine == [f"{path}: attributes not used: {listed}"] * (listed is not None)


@pytest.mark.family(2)
@pytest.mark.parametrize("given, question", [
    ({"width": 90.0}, "width = 90, as in 1 of 1 features: is the value in cm?"),
    ({"aadt": 292_000.0}, "aadt = 292000, as in 1 of 1 features: vehicles per day: is the"),
    ({"speed": 22.0}, "speed = 22, as in 1 of 1 features: is the value in m/s?"),
    ({"vehicle_length": 540.0}, "vehicle_length = 540, as in 1 of 1 features: is the value in cm?"),
    ({"persons_per_vehicle": 1280.0}, "persons in a vehicle: is the value per day?"),
    ({"aadt": 0.2}, "aadt = 0.2, as in 1 of 1 features: vehicles per day: is the value per"),
    ({"trips": 700.0}, "trips = 700, as in 1 of 1 features: passages of a person per day: is the"),
    ({"speed": 120.0, "aadt": 40_000.0, "width": 30.0, "trips": 20.0}, None),
    ({"aadt": 0.0}, None),
])  # fmt: skip
def test_units_of_objects_are_questioned(tmp_path, given, question):
    columns = TRAFFIC | {name: [value] for name, value in given.items()}
    path = make_layer(tmp_path / "own.gpkg", [ROAD], crs="EPSG:32632", **columns)
    remarks = read_study(make_case(tmp_path), AtRisk(path), dem=Z, transform=GRID).remarks
    assert [question in line for line in remarks if line.endswith("?")] == [True] * bool(question)


CURVE = "name,energy,vulnerability,source\nown,0,0,A.\nown,{half},0.5,A.\nown,{all},1,A.\n"
IDLE = "attribute {} has no effect without {}: add it, or correct the name"


@pytest.mark.family(2)
@pytest.mark.parametrize("given, idle", [
    ({"curve": ["own"]}, [("curve", "value")]),
    ({"curve": ["misspelt"]}, [("curve", "value")]),
    ({"exposure": [0.5]}, [("exposure", "value / vulnerability")]),
    ({"value": [5.0], "curve": ["own"], "presence": [0.5]}, [("presence", "persons")]),
    ({"aadt": [9e3], "speed": [50.0], "persons_per_vehicle": [2.0], "presence": [0.1]},
     [("presence", "persons")]),
    ({"persons": [2.0], "speed": [50.0], "trips": [2.0]}, [("speed", "aadt"), ("trips", "aadt")]),
    ({"persons": [2.0], "persons_per_vehicle": [2.0]}, [("persons_per_vehicle", "aadt")]),
    ({"persons": [2.0], "vehicle_length": [5.0]}, [("vehicle_length", "aadt")]),
    ({"value": [5.0], "kind": ["building"], "lethality": [0.5]}, [("lethality", "persons / aadt")]),
    ({"value": [5.0], "kind": ["building"], "lethality_curve": ["own"]},
     [("lethality_curve", "persons / aadt")]),
    ({"value": [5.0], "exposure": [0.5], "kind": ["building"]}, []),
    ({"persons": [2.0], "presence": [0.5], "lethality": [0.1]}, []),
])  # fmt: skip
def test_attributes_without_effect_are_named(tmp_path, given, idle):
    path = make_layer(tmp_path / "own.gpkg", [HOUSE], crs="EPSG:32632", **given)
    table = tmp_path / "curves.csv"
    table.write_text(CURVE.format(half=100, all=1000))
    study = read_study(
        make_case(tmp_path), AtRisk(path, vulnerability=table), dem=Z, transform=GRID
    )
    mine = [line for line in study.remarks if "has no effect" in line]
    assert mine == [f"{path}: {IDLE.format(*names)}" for names in idle]
    assert bool(study.objects.exposed) == any(key in given for key in ("value", "persons", "aadt"))


@pytest.mark.parametrize("kind, half, all_, doubt", [
    ("curve", 100, 1000, None),
    ("curve", 1e5, 1e6, "is 0.1 at 20,000 kJ, twice the strongest nets: give its energies in kJ"),
    ("curve", 0.1, 1, "is 1 at 5 kJ, the energy of a small stone: give its energies in kJ"),
    ("lethality_curve", 1e5, 1e6, "is 0.1 at 20,000 kJ"),
    ("lethality_curve", 0.1, 1, None),  # stones are lethal
    ("", 100, 1000, "no object uses a curve of this table"),
])  # fmt: skip
def test_units_of_curves_are_questioned(tmp_path, kind, half, all_, doubt):
    given = {"value": [5.0], "persons": [2.0], "kind": ["building"]}
    given |= {kind: ["own"]} if kind else {}
    path = make_layer(tmp_path / "own.gpkg", [HOUSE], crs="EPSG:32632", **given)
    table = tmp_path / "curves.csv"
    table.write_text(CURVE.format(half=half, all=all_))
    given = AtRisk(path, vulnerability=table)
    study = read_study(make_case(tmp_path), given, dem=Z, transform=GRID)
    mine = [one for one in study.remarks if str(table) in one]
    assert [doubt in line for line in mine] == [True] * bool(doubt)


@pytest.mark.family(2)
@pytest.mark.parametrize("shape, given, sources", [
    (shapely.box(110, 370, 155, 382), {}, 1),
    (shapely.box(110, 370, 190, 392), {}, 2),
    (shapely.LineString([(0, 382), (300, 382)]), {"width": [4.1]}, 1),
    (shapely.LineString([(0, 382), (300, 382)]), {"width": [6.1]}, 2),
    (shapely.LineString([(0, 382), (300, 382)]), {"width": [3.9]}, 0),
    (shapely.Point(123, 380), {"width": [6.1]}, 1),
    (shapely.Point(123, 380), {}, 1),  # as wide as the objects of the maps
    (shapely.Point(126, 380), {}, 0),
    (HOUSE, {}, 0),
    (shapely.Polygon(shapely.box(110, 370, 190, 392).exterior, [shapely.box(115, 375, 185, 390)
                                                                .exterior]), {}, 0),
])  # fmt: skip
def test_sources_on_objects_are_counted(tmp_path, shape, given, sources):
    path = make_layer(tmp_path / "own.gpkg", [shape, SHED], crs="EPSG:32632", name=["a", "b"],
                      **{key: value * 2 for key, value in given.items()})  # fmt: skip
    remarks = read_study(make_case(tmp_path), AtRisk(path), dem=Z, transform=GRID).remarks
    mine = [line for line in remarks if "sources lie on" in line]
    text = f"{path}: sources lie on a (sources: {sources}, objects: 1), whose frequencies are"
    assert [line.startswith(text) for line in mine] == [True] * bool(sources)


@pytest.mark.parametrize("scenario, words", [
    ({"volume": "fixed", "volume_mean": 500.0}, "volume_mean = 500 m3: a boulder 10 m across"),
    ({"volume_mean": 500.0}, "volume_mean = 500 m3: a boulder 10 m across"),
    ({"density": 800.0}, "density = 800 kg/m3: rock density is"),
    ({"volume": "lognormal", "volume_mean": 1.0, "volume_std": 20.0}, "volume_std = 20 m3: 20 tim"),
    ({"volume": "pareto", "volume_min": 0.1, "volume_max": 9.0, "volume_exponent": 1.7},
     "volume_exponent = 1.7: exponents of"),
    ({"volume": "list", "volumes": [0.5, 500.0]}, "volumes = 500 m3: a boulder 10 m across"),
])  # fmt: skip
def test_a_boulder_of_a_scenario_is_doubted_once(tmp_path, scenario, words):
    case = make_case(tmp_path)
    case = case.replace(scenario=[{"name": "one", "frequency": 0.5}, {"name": "odd",
                                  "frequency": 0.1, **scenario}])  # fmt: skip
    study = read_study(case, dem=Z, transform=GRID)
    place = f"{case.name}: &scenario name = 'odd' {words}"
    assert [line for line in study.remarks if words.split(": ")[1] in line] == [
        line for line in study.remarks if line.startswith(place)
    ]
    assert len([line for line in study.remarks if line.startswith(place)]) == 1
    assert [f"{case.name}: {where}: {text}" for where, text in study.warnings] == study.remarks
