# SPDX-License-Identifier: BSD-3-Clause
"""Origins: the contributions of sources to a place sum to its total, and none exceeds what the
source releases."""

import numpy as np
import pytest

import rockfall
import scenes
from made import make_layer, refused
from rockfall.analysis.precision.weighted import quantile_interval
from rockfall.language import LANGUAGES, speaking
from rockfall.plots.cartography.sheet import Room
from rockfall.plots.hazard.origin_map import (
    origin_map,
    origin_place,
    parts_and_words,
    parts_of_total,
)
from rockfall.quantities import number
from rockfall.studies.hazard import read_study

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
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    release = {"x": [52.0, 120.0, 121.0, 260.0], "y": [380.0] * 4, "drop_height": 5.0}
    groups = {"release": release, "case": {"boulders": 150}, "line": LINES}
    case = scenes.make_case(folder, *scenes.sets(2.0), **groups).replace(scenario=SCENARIOS)
    make_layer(folder / "houses.gpkg", [shapely.box(130.0, 150.0, 150.0, 170.0)], crs=None,
               name=["house"])  # fmt: skip
    make_layer(folder / "point.gpkg", [shapely.Point(140.0, 160.0)], crs=None, name=["pole"])
    return case


@pytest.fixture(scope="module")
def hazard(case):
    return rockfall.hazard(case, objects=case.path("houses.gpkg"), **PLACE)


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
    assert left["x"][0] == 52.5 and left["share"][0] > 0.9  # the only source above the place
    assert rockfall.origins(hazard, "above").empty
    with refused("roof: no line or object; there are road, left, above, house"):
        rockfall.origins(hazard, "roof")


def test_energies_are_those_of_the_boulders_that_start_in_the_cell_and_come(hazard, case):
    values, weights = [], []
    for scenario in read_study(case, **PLACE).scenarios:
        result = rockfall.run(scenario.case, **PLACE)
        at = rockfall.crossings(result, "road")
        x = result["start_x"].values[at["boulder"].to_numpy() - 1]
        here = (x >= 120.0) & (x < 125.0)
        energy = at["energy_translational"] + at["energy_rotational"]
        values.append(energy.to_numpy()[here])
        weights.append(np.full(here.sum(), scenario.frequency / result.sizes["boulder"]))
    energy, weight = np.concatenate(values), np.concatenate(weights)
    assert min(map(len, values)) > 20
    found = rockfall.origins(hazard, "road").set_index("x").loc[122.5]
    assert found["frequency"] == pytest.approx(weight.sum(), rel=1e-12)
    assert found["energy_mean"] == pytest.approx(np.average(energy, weights=weight), rel=1e-12)
    limits = quantile_interval(energy, weight, 0.95)
    names = ["energy_q95", "energy_q95_low", "energy_q95_high"]
    assert found[names].tolist() == pytest.approx(list(limits), nan_ok=True)
    assert np.average(energy <= found["energy_q95"], weights=weight) == pytest.approx(
        0.95, abs=0.02
    )


def test_a_cell_of_which_none_comes_has_no_energy(hazard):
    left = hazard.sel(line="left")
    none = left["line_source_frequency"].values == 0
    assert none.any() and not none.all()
    for name in ("mean", "q95", "q95_low", "q95_high"):
        assert np.isnan(left[f"line_source_energy_{name}"].values[none]).all()
    assert (left["line_source_energy_mean"].values[~none] > 0).all()


def test_classes_hold_half_and_the_next_third_of_the_sum():
    rates = np.array([4.0, 1.0, 3.0, 2.0])
    assert parts_of_total(rates).tolist() == [0, 2, 0, 1]
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
    for name in "energy_mean", "energy_q95", "energy_q95_low", "energy_q95_high":
        values = 1e-3 * hazard[f"object_source_{name}"].sel(object="house").values
        assert np.allclose(table[f"to house {name}"], values, equal_nan=True)


def test_a_table_lists_the_origins_of_each_place(hazard, tmp_path):
    pd = pytest.importorskip("pandas")
    rockfall.write_hazard(hazard, tmp_path / "out")
    table = pd.read_csv(tmp_path / "out/origins.csv")
    own = table[table["name"] == "house"].reset_index(drop=True)
    found = rockfall.origins(hazard, "house")
    assert {*own["place"]} == {"object"} and {*table["name"]} == {"road", "left", "house"}
    for name in found:
        factor = 1e-3 if name.startswith("energy") else 1.0
        assert np.allclose(own[name], factor * found[name], equal_nan=True), name


def test_a_point_without_a_width_has_no_known_sources(case):
    found = rockfall.hazard(case, objects=case.path("point.gpkg"), **PLACE)
    assert np.isnan(found["object_source_frequency"].values).all()
    with refused("pole: is a point without a width, whose sources are unknown: give it a width"):
        rockfall.origins(found, "pole")


def test_the_key_of_the_map_has_the_energies_of_its_classes(hazard):
    found = rockfall.origins(hazard, "road")
    parts, words = parts_and_words(found)
    for k in range(3):
        own = found[parts == k]
        if own.empty:
            assert "kJ" not in words[k]
            continue
        mean = (own["frequency"] * own["energy_mean"]).sum() / own["frequency"].sum()
        most = own["energy_q95"].max()
        assert words[k].endswith(
            f"mean {number(mean / 1e3)} kJ, 95 % up to {number(most / 1e3)} kJ"
        )


@pytest.mark.parametrize("wide", [6.69, 4.0])
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_key_of_the_map_lies_on_the_sheet(hazard, language, wide):
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    with speaking(language):
        figure = origin_map(hazard, None, origin_place(hazard), Room(wide, 6.0))
    figure.canvas.draw()
    (key,) = figure.legends
    box, page = key.get_window_extent(), figure.bbox
    assert box.x0 >= page.x0 and box.x1 <= page.x1 and box.y0 >= page.y0
    bottom = figure.axes[0].get_window_extent().y0
    assert all(text.get_window_extent().y1 < bottom for text in key.get_texts())
