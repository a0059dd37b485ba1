# SPDX-License-Identifier: BSD-3-Clause
"""Where it comes from: the sources of what comes to a place sum up to it, and each gives no more
than what starts there."""

import numpy as np
import pytest

import rockfall
import scenes
from made import make_layer, refused
from rockfall.plots.hazard.origin_map import parts_of_total

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

Z = scenes.rough()
PLACE = {"dem": Z, "transform": scenes.grid(Z)}
LINES = [
    {"name": "road", "x": [0.0, 300.0], "y": [200.0, 200.0]},
    {"name": "left", "x": [0.0, 75.0], "y": [330.0, 330.0]},
    {"name": "above", "x": [0.0, 300.0], "y": [398.0, 398.0]},
]
SCENARIOS = [
    {"name": "often", "frequency": 8.0},
    {"name": "large", "frequency": 0.5, "volume_mean": 6.0},
]


@pytest.fixture(scope="module")
def hazard(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    release = {"x": [52.0, 120.0, 121.0, 260.0], "y": [380.0] * 4, "drop_height": 5.0}
    groups = {"release": release, "case": {"boulders": 150}, "line": LINES}
    case = scenes.make_case(folder, *scenes.sets(2.0), **groups).replace(scenario=SCENARIOS)
    make_layer(folder / "houses.gpkg", [shapely.box(130.0, 150.0, 150.0, 170.0)], crs=None,
               name=["house"])  # fmt: skip
    return rockfall.hazard(case, objects=folder / "houses.gpkg", **PLACE)


def test_sources_sum_up_to_what_comes(hazard):
    assert hazard["source_frequency"].values.sum() == pytest.approx(8.5, rel=1e-12)
    for kind in ("line", "object"):
        rates = hazard[f"{kind}_source_frequency"].values
        assert np.allclose(rates.sum(axis=1), hazard[f"{kind}_frequency"].values, rtol=1e-12)
        assert (rates <= hazard["source_frequency"].values * (1 + 1e-12)).all()


def test_two_sources_of_one_cell_are_one_and_stand_in_its_middle(hazard):
    assert sorted(hazard["source_x"].values.tolist()) == [52.5, 122.5, 262.5]
    released = dict(zip(hazard["source_x"].values, hazard["source_frequency"].values, strict=True))
    assert released[122.5] == pytest.approx(2 * released[52.5], rel=1e-12)


def test_origins_are_sorted_shares_of_what_comes(hazard):
    found = rockfall.origins(hazard, "road")
    assert found["share"].sum() == pytest.approx(1.0) and (found["reach"] <= 1 + 1e-12).all()
    assert (found["frequency"].diff()[1:] <= 0).all()
    left = rockfall.origins(hazard, "left")
    assert left["x"][0] == 52.5 and left["share"][0] > 0.9  # the only source above it
    assert rockfall.origins(hazard, "above").empty
    with refused("roof: no line or object; there are road, left, above, house"):
        rockfall.origins(hazard, "roof")


def test_classes_hold_half_and_the_next_third_of_the_sum():
    rates = np.array([0.0, 4.0, 1.0, 3.0, 2.0])
    assert parts_of_total(rates).tolist() == [3, 0, 2, 0, 1]
    random = np.random.default_rng(1).exponential(1.0, 500)
    classes = parts_of_total(random)
    sums = [random[classes == k].sum() / random.sum() for k in range(3)]
    assert sums == pytest.approx([0.5, 0.3, 0.2], abs=0.02)


def test_a_geopackage_has_the_sources(hazard, tmp_path):
    pyogrio = pytest.importorskip("pyogrio", reason="the vector extra is not installed")
    rockfall.write_hazard(hazard, tmp_path / "out")
    names, _, _, columns = pyogrio.raw.read(tmp_path / "out/hazard.gpkg", layer="sources")
    table = dict(zip(names["fields"], columns, strict=True))
    assert np.allclose(table["to road"], hazard["line_source_frequency"].sel(line="road"))
    assert {"frequency", "to left", "to above", "to house"} <= {*table}
