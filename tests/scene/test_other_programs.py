# SPDX-License-Identifier: BSD-3-Clause
"""Projects of PlatRock and AvaFrame as cases: runs use the values in their files and the defaults
of those programs, and every input is listed."""

import csv
import math

import numpy as np
import pytest

import rockfall
from made import make_layer, refused
from projects import BOX, GRID, ROCKS, SOILS, avaframe, box, collection, elevations, platrock
from rockfall.cli import main
from rockfall.importers.imported import CHANGED, LEFT, TAKEN
from rockfall.scene.read import read_scene
from rockfall.scene.releases.source_attributes import values_of

pyogrio = pytest.importorskip("pyogrio", reason="the vector extra is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

SOIL = SOILS[0]
WHERE = box(*BOX["west"])
ONE = "must have exactly one"


@pytest.fixture
def simulation(tmp_path):
    lists = rockfall.import_platrock(platrock(tmp_path / "simulation"), tmp_path / "out")
    return rockfall.read_case(tmp_path / "out/case.nml"), lists


def grounds(folder):
    with open(folder / "grounds.csv", encoding="utf-8", newline="") as file:
        return {row.pop("name"): row for row in csv.DictReader(file)}


def test_rocks_of_platrock(simulation):
    case, _ = simulation
    result = rockfall.run(case)
    assert result.sizes["boulder"] == 400
    feature = result.source_feature.values - 1
    assert np.bincount(feature).sum() == 400 and abs(np.bincount(feature)[0] - 300) <= 1
    volume = result.volume.values
    west, east = volume[feature == 0], volume[feature == 1]
    assert 0.5 <= west.min() < 0.52 and 1.98 < west.max() <= 2.0
    assert abs(west.mean() - 1.25) < 4 * 1.5 / math.sqrt(12 * 300)
    assert (east == 1.0).all()
    density = (result.mass / result.volume).values
    assert np.allclose(density, np.where(feature == 0, 2700, 2650), rtol=1e-12)
    given = values_of(case, read_scene(case).features)  # density, drop height, velocity
    assert given.tolist() == [[2700, 3, 0, 0, 0], [2650, 4, 0, 0, 0]]  # 2650, 4, 0: PlatRock's
    assert case.flight["gravity"] == 9.8 and case.impact["stop_speed"] == 0.2


def test_soils_of_platrock(simulation, tmp_path):
    case, lists = simulation
    rows = grounds(tmp_path / "out")
    radius = (3 * (0.75 * 1.25 + 0.25 * 1.0) / (4 * math.pi)) ** (1 / 3)  # from the mean volume
    expected = {
        "outside": ("constant", {"r_n": 0.15, "r_t": 0.05}, 0.1),
        "soil_1": ("constant", {"r_n": 0.4, "r_t": 0.8}, 0.3),
        "soil_2": ("bourrier_hungr", {"r_t": 0.7, "half_speed": 5, "friction_angle": 30}, 0.1),
    }
    assert rows.keys() == expected.keys()
    for name, (model, numbers, roughness) in expected.items():
        row = rows[name]
        assert row["model"] == model
        assert float(row["roughness_angle"]) == pytest.approx(
            math.degrees(math.atan(roughness / radius)), abs=0.005
        )
        keys = ("r_n", "r_t", "half_speed", "friction_angle")
        assert {key: float(row[key]) for key in keys if row[key]} == numbers
    rasters = read_scene(case).rasters
    rows = [round((GRID.north - y) / GRID.cell - 0.5) for y in (2052.5, 2127.5, 2202.5, 2297.5)]
    # where soils overlap, the first counts
    names = [rasters.grounds[k - 1].name for k in rasters.cell_ground[rows, 20]]
    assert names == ["soil_1", "soil_1", "soil_2", "outside"]
    defaults = [line for line in lists[CHANGED] if "default" in line]
    assert "soil.geojson: polygon 2: no roughness: 0.1, PlatRock's default" in defaults
    assert not any("R_n:" in line for line in defaults)  # not used by its model


def test_all_names_of_an_attribute_are_read(tmp_path):
    names = {"rocks_nb": 7, "rocks_z": 6, "rocks_density": 3000, "rocks_vz": -2}
    folder = platrock(tmp_path / "simulation", **{"rocks.geojson": collection((names, WHERE))})
    rockfall.import_platrock(folder, tmp_path / "out")
    case = rockfall.read_case(tmp_path / "out/case.nml")
    assert case.case["boulders_total"] == 7
    assert values_of(case, read_scene(case).features).tolist() == [[3000, 6, 0, 0, -2]]


def test_each_input_of_platrock_is_listed(simulation):
    _, lists = simulation
    assert [line.partition(":")[0] for line in lists[TAKEN]] == [
        "dem.asc", "rocks.geojson", "soil.geojson", "trees.xyd", "checkpoints.geojson"
    ]  # fmt: skip
    assert "2.5 m further west and south" in lists[CHANGED][0]
    assert lists[LEFT] == [
        "soil.geojson: mu_r has no effect in three dimensions",
        "setup.json: settings and scripts of PlatRock are not read",
    ]


def test_checkpoints_and_stems_of_platrock(simulation):
    case, _ = simulation
    scene = read_scene(case)
    assert scene.trees.x.size == 20
    result = rockfall.run(case)
    assert result.line_name.values.tolist() == ["checkpoint 0"]
    stopped_below = np.count_nonzero(result.stop_y.values < 2080)
    assert stopped_below and rockfall.line_statistics(result)["n"].iloc[0] >= stopped_below


def test_coordinates_are_taken_as_they_are(tmp_path):
    """Coordinates are not transformed, because PlatRock ignores the CRS of a GeoJSON."""
    text = collection((ROCKS[0], box(*BOX["west"])))
    named = text[:-1] + ', "crs": {"type": "name", "properties": {"name": "EPSG:4326"}}}'
    folder = platrock(tmp_path / "simulation", **{"rocks.geojson": named})
    rockfall.import_platrock(folder, tmp_path / "out", crs="EPSG:2154")
    meta, _, shapes, _ = pyogrio.raw.read(tmp_path / "out/sources.gpkg")
    assert meta["crs"] == "EPSG:2154"
    assert shapely.from_wkb(shapes[0]).bounds == BOX["west"]


def test_stands_of_platrock(tmp_path):
    stands = collection(({"density": 400, "dhp_mean": 25}, box(1000, 2110, 1250, 2200)))
    folder = platrock(tmp_path / "simulation", **{"trees.xyd": None, "forest.geojson": stands})
    lists = rockfall.import_platrock(folder, tmp_path / "out")
    assert "forest.geojson: polygon 1: no dbh_std: 10, PlatRock's default" in lists[CHANGED]
    stems = read_scene(rockfall.read_case(tmp_path / "out/case.nml")).trees
    expected = 400 * 2.25
    assert abs(stems.x.size - expected) < 4 * math.sqrt(expected)
    assert abs(stems.dbh.mean() - 25) < 4 * 10 / math.sqrt(expected)


def test_unknown_and_misspelt_attributes_are_listed(tmp_path):
    """Unknown names are listed: names are case-sensitive in PlatRock, which uses the default of a
    missing attribute."""
    soil = collection(({"r_n": 0.9, "R_t": 0.5, "bounce_mod": 0}, box(1000, 2000, 1250, 2300)))
    folder = platrock(tmp_path / "simulation", **{"soil.geojson": soil})
    lists = rockfall.import_platrock(folder, tmp_path / "out")
    assert "soil.geojson: r_n is not an attribute of PlatRock here" in lists[LEFT]
    assert grounds(tmp_path / "out")["soil_1"]["r_n"] == "0.15"


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("name", "text", "file", "message"),
    [
        ("rocks.geojson", "{", "/rocks.geojson", "is no GeoJSON"),
        ("rocks.geojson", None, "", "rocks are missing: give a GeoJSON of polygons with number, "
                                    "z, rocks_min_vol, rocks_max_vol"),
        ("rocks.geojson", collection(({"number": 5}, WHERE), ({"nb_rocks": 5}, WHERE)),
         "/rocks.geojson", "has number and nb_rocks, which are the same attribute: keep one of "
                           "them"),
        ("rocks.geojson", collection(({"number": 0}, WHERE)), "/rocks.geojson",
         "polygon 1: number = 0: must be a number >= 1"),
        ("rocks.geojson", collection(({"rocks_min_vol": 0}, WHERE)), "/rocks.geojson",
         "polygon 1: rocks_min_vol = 0: must be a number > 0"),
        ("rocks.geojson", collection(({"z": "high"}, WHERE)), "/rocks.geojson",
         "polygon 1: z = 'high': must be a number >= 0"),
        ("rocks.geojson", collection(({"rocks_min_vol": 3, "rocks_max_vol": 2}, WHERE)),
         "/rocks.geojson", "polygon 1: rocks_min_vol 3 is above 2, rocks_max_vol"),
        ("soil.geojson", collection((SOIL | {"bounce_mod": 7}, WHERE)), "/soil.geojson",
         "soil_1: bounce_model_number = 7: must be 0, 1 or 2"),
        ("soil.geojson", collection((SOIL | {"R_n": -0.1}, WHERE)), "/soil.geojson",
         "polygon 1: R_n = -0.1: must be a number >= 0"),
        ("soil.geojson", collection(({"number": 5, "R_n": 0.4}, WHERE)), "/soil.geojson",
         "has attributes of rocks and of another layer: rocks, soils and forest require separate "
         "files"),
        ("soils.geojson", collection((SOIL, WHERE)), "/soils.geojson",
         "soils are already given by soil.geojson"),
        ("other.tif", "", "", f"{ONE} DEM (.asc or .tif) (found: dem.asc, other.tif)"),
        ("dem.asc", None, "", f"{ONE} DEM (.asc or .tif) (found: none)"),
        ("more.xyd", "1010,2120,20", "",
         f"{ONE} forest (.xyd or .geojson) (found: more.xyd, trees.xyd)"),
        ("trees.xyd", "1010,2120,20\n1020,here,20\n", "/trees.xyd",
         "line 2: must be x, y and DBH [cm], with decimal points"),
    ],
)  # fmt: skip
def test_refused_projects_of_platrock(tmp_path, name, text, file, message):
    folder = platrock(tmp_path / "simulation", **{name: text})
    if name == "dem.asc":
        (folder / name).unlink()
    if message == "is no GeoJSON":
        assert main(["import-platrock", str(folder), "-o", str(tmp_path / "out")]) == 2
    else:
        with refused(f"{folder}{file}: {message}"):
            rockfall.import_platrock(folder, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["simulation"]


def test_layers_of_no_known_use_are_listed(tmp_path):
    parcels = collection(({"owner": "A"}, WHERE))
    points = collection(({"number": 5}, {"type": "Point", "coordinates": [1100, 2200]}))
    folder = platrock(tmp_path / "simulation", **{"parcels.geojson": parcels, "p.geojson": points})
    left = rockfall.import_platrock(folder, tmp_path / "out")[LEFT]
    why = "no polygons with attributes of rocks, soils or forest, and no lines"
    assert {f"parcels.geojson: {why}", f"p.geojson: {why}"} <= {*left}


def test_every_folder_of_avaframe_is_in_a_list(tmp_path):
    folder = avaframe(tmp_path / "avaHill")
    inputs = folder / "Inputs"
    for name in ("SECREL", "RELTH", "DAM", "POINTS", "MINE"):
        (inputs / name).mkdir()
        (inputs / name / "file.txt").write_text("")
    make_layer(inputs / "RES/wood.shp", [shapely.box(*BOX["west"])], name=["a"])
    lists = rockfall.import_avaframe(inputs, tmp_path / "out", ground="talus", no_forest=True)
    named = {line.partition(":")[0] for line in (*lists[TAKEN], *lists[LEFT])}
    assert {"SECREL", "RELTH", "DAM", "POINTS", "MINE", "CFGs", "RES/wood.shp", "RES/fsi.asc",
            "hill.asc", "REL/area.asc", "INFRA/infra.asc"} == named  # fmt: skip
    assert "MINE: unknown folder" in lists[LEFT]


@pytest.mark.parametrize("release", ["raster", "shapefiles"])
def test_an_avaframe_folder(tmp_path, release, capsys):
    folder = avaframe(tmp_path / "avaHill", release)
    words = ["import-avaframe", str(folder), "-o", str(tmp_path / "out"), "--ground", "talus"]
    assert main([*words, "--no-forest", "--crs", "EPSG:31287"]) == 0
    printed = capsys.readouterr().out
    assert "Inputs/RES/fsi.asc: no stems" in printed
    assert "Inputs/CFGs: settings of flow models" in printed
    assert "Inputs/ENT" not in printed and "Inputs/LINES" not in printed  # empty folders
    case = rockfall.read_case(tmp_path / "out/case.nml")
    cases = rockfall.variants(case)
    assert [*cases] == ([] if release == "raster" else ["east", "west"])
    sources = {name: read_scene(one) for name, one in (cases or {"": case}).items()}
    for name, scene in sources.items():
        west, south, east, north = BOX.get(name, (1050, 2255, 1100, 2275))
        assert scene.x.size == (east - west) * (north - south) / GRID.cell**2
        assert west < scene.x.min() < scene.x.max() < east
        assert south < scene.y.min() < scene.y.max() < north
    meta, _, shapes, values = pyogrio.raw.read(tmp_path / "out/objects.gpkg")
    assert meta["crs"] == "EPSG:31287"
    areas = {value: shapely.from_wkb(shape).area for shape, value in zip(shapes, values[1])}  # noqa: B905
    assert areas == {3.0: 4 * GRID.cell**2, 1.0: 2 * GRID.cell**2}


def test_objects_of_avaframe_are_hit(tmp_path):
    """`hazard --objects` reads the polygons, and boulders from above hit them."""
    folder = avaframe(tmp_path / "avaHill")
    rockfall.import_avaframe(folder, tmp_path / "out", ground="rock", no_forest=True)
    scenario = {"name": "once", "frequency": 1.0}
    case = rockfall.read_case(tmp_path / "out/case.nml").replace(
        case={"boulders_total": 400}, scenario=[scenario]
    )
    hazard = rockfall.hazard(case, objects=tmp_path / "out/objects.gpkg")
    assert hazard.sizes["object"] == 2
    assert (hazard.object_frequency > 0).any()


def test_rasters_of_forest_are_refused_by_name(tmp_path):
    folder = avaframe(tmp_path / "avaHill")
    with refused(
        f"{folder / 'Inputs/RES/fsi.asc'}: a forest structure index (FSI) has no stems: give "
        "--no-forest, then &forest with stems per hectare and diameters"
    ):
        rockfall.import_avaframe(folder, tmp_path / "out", ground="talus")
    assert not (tmp_path / "out").exists()


def test_refused_folders_of_avaframe(tmp_path):
    def imported(folder, message, **more):
        with refused(f"{folder}{message}"):
            rockfall.import_avaframe(folder, tmp_path / "out", no_forest=True, **more)

    imported(tmp_path, ": has no folder Inputs/REL", ground="talus")
    folder = avaframe(tmp_path / "avaHill")
    choices = "rock, rocky-slope, talus, compact, meadow, vegetated-soil, soft-soil"
    imported(folder, f"/Inputs/hill.asc: ground is missing: give --ground GROUND, of {choices}")
    with refused(
        f"--ground: no ground 'slate': must be {choices}, or another ground of docs/grounds.md"
    ):
        rockfall.import_avaframe(folder, tmp_path / "out", ground="slate", no_forest=True)
    make_layer(folder / "Inputs/REL/rel.shp", [shapely.box(*BOX["west"])], name=["a"])
    mixed = "/Inputs/REL: must have shapefiles or rasters (found: both)"
    imported(folder, mixed, ground="talus")
    for path in (folder / "Inputs/REL").iterdir():
        path.unlink()
    imported(folder, mixed.replace("both", "none"), ground="talus")
    (folder / "Inputs/second.asc").write_text("")
    imported(
        folder, "/Inputs: must have exactly one DEM (.asc or .tif) (found: hill.asc, second.asc)",
        ground="talus",
    )  # fmt: skip
    assert not (tmp_path / "out").exists()


def test_the_slope_is_as_in_the_file(simulation):
    assert np.array_equal(read_scene(simulation[0]).rasters.z, elevations())
