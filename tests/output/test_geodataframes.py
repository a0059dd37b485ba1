# SPDX-License-Identifier: BSD-3-Clause
"""GeoDataFrames of results equal the layers of exports, and can be used as inputs."""

import sys

import numpy as np
import pytest

import rockfall
import scenes
from made import make_frame, make_layer, refused

geopandas = pytest.importorskip("geopandas", reason="geopandas is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
pytest.importorskip("pyogrio", reason="the vector extra is not installed")

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

Z = scenes.rough(gradient=0.7, relief=0.5)
PLACE = {"dem": Z, "transform": scenes.grid(Z)}
LINE = {"name": "road", "x": [0.0, 300.0], "y": [200.0, 200.0]}
HOUSE = shapely.box(130.0, 150.0, 160.0, 170.0)
POINTS = [shapely.Point(x, 380.0) for x in (120.0, 150.0, 181.0)]
SOURCES = {
    "name": ["left", "middle", "right"],
    "volume_mean": [0.3, 2.0, np.nan],
    "density": [np.nan, 2500.0, 2700.0],
    "block_shape": ["platy", None, "elongated"],
    "frequency": [0.5, 3.0, 1.5],
}


@pytest.fixture
def case(tmp_path):
    groups = {
        "release": {"x": 120.0, "y": 380.0, "drop_height": 5.0},
        "case": {"boulders": None, "boulders_total": 60},
        "surface": {"uniform_mean_radius": 0.2, "ground": "talus"},
    }
    made = scenes.make_case(tmp_path, *scenes.sets(2.0), line=[LINE], **groups)
    return made.replace(boulder={"block_shape": "compact"}, output={"trajectories": 5})


def test_without_geopandas_the_package_is_advised(monkeypatch):
    """No extra installs geopandas."""
    monkeypatch.setitem(sys.modules, "geopandas", None)
    with refused("GeoDataFrames need geopandas: pip install geopandas"):
        rockfall.layers("out.nc")


def same(one, other):
    for name, values in one.data_vars.items():
        np.testing.assert_array_equal(values, other[name])


@pytest.mark.all
def test_layers_of_a_result_are_those_of_its_export(case, tmp_path):
    result = rockfall.run(case, sources=make_frame(POINTS, **SOURCES), **PLACE)
    path = tmp_path / "out.nc"
    rockfall.write_result(result, path)
    rockfall.export(path, tmp_path / "gis", formats=["gpkg"])
    found = rockfall.layers(path)
    assert {"sources", "stops", "lines", "crossings", "trajectories"} <= found.keys()
    for name, frame in found.items():
        written = geopandas.read_file(tmp_path / "gis/rockfall.gpkg", layer=name)
        own = frame.drop(columns="ground_strength", errors="ignore")
        assert {*own.columns} == {*written.columns}
        assert shapely.equals_exact(own.geometry.values, written.geometry.values).all()
        for column in own.columns.drop("geometry"):
            one, other = own[column], written[column]
            if one.dtype.kind == "M":  # a GeoPackage stores milliseconds
                assert ((one - other).abs() < np.timedelta64(1, "ms")).all()
            else:
                assert (one == other)[one.notna()].all()
    stops = result.rockfall.layers()["stops"]
    assert {*stops["block_shape"]} == {"platy", "compact", "elongated"}
    np.testing.assert_array_equal(stops["ground_strength"], rockfall.ground_strength(result))


def test_sources_that_are_handed_out_release_the_same_boulders(case, tmp_path):
    """`session.sources` returns shapes, frequencies and volumes of a layer, and can be used as
    input."""
    make_layer(tmp_path / "points.gpkg", POINTS, crs=None, **SOURCES)
    by_layer = case.replace(release={"x": None, "y": None, "points": str(tmp_path / "points.gpkg")})
    with rockfall.open(by_layer, **PLACE) as session:
        frame = session.sources
    assert frame["name"].tolist() == SOURCES["name"]
    assert frame["block_shape"].fillna("").tolist() == ["platy", "", "elongated"]
    assert frame["frequency"].tolist() == SOURCES["frequency"]
    np.testing.assert_array_equal(frame["volume_mean"], SOURCES["volume_mean"])
    one, other = rockfall.run(by_layer, **PLACE), rockfall.run(case, sources=frame, **PLACE)
    assert len(np.unique(one["source"])) == 3 and len(np.unique(one["volume"])) > 2
    same(one, other)
    with rockfall.open(case, **PLACE) as session:
        session.change(sources=frame[frame["name"] == "right"])
        (batch,) = session.run(batch_seconds=60.0)
        assert {*batch.dataset()["start_x"].values} == {181.0}


def test_a_case_without_attributes_hands_out_places(case):
    with rockfall.open(case, **PLACE) as session:
        frame = session.sources
    assert [*frame.columns] == ["geometry"] and frame.geometry[0] == shapely.Point(120.0, 380.0)
    same(rockfall.run(case, **PLACE), rockfall.run(case, sources=frame, **PLACE))


@pytest.mark.all
def test_layers_of_a_hazard_have_its_frequencies(case, tmp_path):
    with refused("road: a run has no annual frequencies: add &scenario groups to the case, "
                 "and use rockfall.hazard"):  # fmt: skip
        rockfall.exceedance(rockfall.run(case, **PLACE), "road")
    net = {"name": "net", "x": [50.0, 250.0], "y": [100.0, 100.0], "height": 3.0, "class": 3}
    of_scenario = case.replace(scenario=[{"name": "one", "frequency": 0.5}], barrier=[net])
    hazard = rockfall.hazard(of_scenario, objects=make_frame([HOUSE], name=["house"]), **PLACE)
    (tmp_path / "h").mkdir()
    rockfall.write_hazard(hazard, tmp_path / "h" / "out")
    for data in (hazard, tmp_path / "h" / "out" / "hazard.nc"):
        found = rockfall.layers(data)
        line, barrier = found["lines"].to_dict("records")
        assert barrier["geometry"].bounds == (50.0, 100.0, 250.0, 100.0)
        assert barrier["frequency"] == float(hazard["line_frequency"].sel(line="net"))
        assert line["line"] == "road" and line["geometry"].bounds == (0.0, 200.0, 300.0, 200.0)
        (house,) = found["objects"].to_dict("records")
        for row, place in ((line, "road"), (house, "house")):
            curve = hazard.rockfall.exceedance(place).iloc[0]
            for end, column in (("", "frequency"), ("_low", "low"), ("_high", "high")):
                assert row[f"frequency{end}"] == curve[column]
            assert 1 / row["frequency"] == hazard.rockfall.return_period(place).value
        assert house["geometry"].equals(HOUSE)
