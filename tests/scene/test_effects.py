# SPDX-License-Identifier: BSD-3-Clause
"""Keys, groups and variants without an effect are refused, by both programs if the case alone shows
it. Attributes that are not used are listed."""

import geopandas
import pytest
import shapely
import shapely.affinity

import programs
import rockfall
import scenes
from made import PLACE, refused
from programs import make_full_case, refused_in_one_line, run_program
from rockfall.analysis.hazard.scenarios import base_case
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible

BASE = {
    "case": {"boulders": 2},
    "surface": {"uniform_mean_radius": 0.3},
    "boulder": {"volume_mean": 1.0},
    "release": {"x": [PLACE.c + 150.0], "y": [PLACE.f - 50.0], "drop_height": 2.0},
}
STEMS = {
    "uniform_stems": 300.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 3.0,
    "uniform_conifers": 80.0,
}  # fmt: skip
SCENARIO = {"scenario": [{"name": "all", "frequency": 0.1}]}
BY_TABLE = {"impact": {"form": "table"}}
FOREST = "trees, polygons or stems"
#: group and key with a value, rest of the case, requirement in the message, valid change
EFFECTS = [
    ("forest", "density_factor", 0.5, {}, FOREST, {"forest": STEMS}),
    ("forest", "clear_of_sources", 10.0, {}, FOREST, {"forest": STEMS}),
    ("forest", "seed", 2, {}, FOREST, {"forest": STEMS}),
    ("forest", "lateral_from", 0.5, {}, FOREST, {"forest": STEMS}),
    ("forest", "scratch_from", 0.9, {}, FOREST, {"forest": STEMS}),
    ("forest", "turn_frontal", [1.0, 2.0, 3.0], {}, FOREST, {"forest": STEMS}),
    ("forest", "turn_lateral", [1.0, 2.0, 3.0], {}, FOREST, {"forest": STEMS}),
    ("forest", "turn_scratch", [1.0, 2.0, 3.0], {}, FOREST, {"forest": STEMS}),
    ("forest", "spread", "even", {"forest": {"trees": "t.csv"}}, "polygons or stems",
        None),
    ("forest", "dbh_field", "d", {"forest": STEMS}, "trees", None),
    ("forest", "species_field", "d", {"forest": STEMS}, "trees", None),
    ("breakage", "min_area_ratio", 0.5, {}, "at = ", {"breakage": {"at": "impact"}}),
    ("breakage", "min_volume", 0.5, {}, "at = ", {"breakage": {"at": "impact"}}),
    ("breakage", "max_fragments", 7, {}, "at = ", {"breakage": {"at": "impact"}}),
    ("breakage", "cone", 30.0, {}, "at = ", {"breakage": {"at": "impact"}}),
    ("impact", "ratio", "nearest", BY_TABLE, "form = 'matrix'", {"impact": {"form": "matrix"}}),
    ("impact", "turning", "to_aspect", BY_TABLE, "form = 'matrix'", {"impact": {"form": "matrix"}}),
    ("boulder", "block_shape", ["platy"], {}, "an impact table", BY_TABLE),
    ("boulder", "block_shape_share", [1.0], {}, "an impact table", BY_TABLE),
    ("boulder", "block_axes", [3.0, 2.0, 1.0], {"boulder": {
        "volume": "list", "volumes": [2.0], "volume_mean": None}}, "an impact table", BY_TABLE),
    ("boulder", "ground_strength_sigma", 0.5, {}, "an impact table", BY_TABLE),
    ("boulder", "mean_radius_sigma", 0.5, BY_TABLE | {"surface": {"uniform_mean_radius": None}},
        "rock sizes", {"surface": {"uniform_mean_radius": 0.2}}),
    ("surface", "ground_strength", 2e5, {}, "ground, or &impact table", BY_TABLE),
    ("surface", "ground_relief", 12.0, {}, "ground, or &impact table", BY_TABLE),
    ("surface", "zone_field", "z", {}, "zones", None),
    ("surface", "rg_reading", "radius", {}, "method = 'A'", {"surface": {
        "method": "A", "uniform_mean_radius": None, "uniform_rg": [0.1, 0.2, 0.3]}}),
    ("surface", "ground_table", "own.csv", {}, "ground, ground_map or zones", None),
    ("output", "map_extent", "terrain", {}, "maps", {"output": {"maps": ["passages"]}}),
    ("output", "min_passages", 5, {}, "maps", {"output": {"maps": ["passages"]}}),
    ("hazard", "return_periods", [1.0, 10.0, 50.0], {}, "&scenario", SCENARIO),
    ("hazard", "matrix", ["low"] * 9, {}, "&scenario", SCENARIO),
    ("hazard", "frequency_factor", [0.5, 2.0], {}, "&scenario", SCENARIO),
    ("hazard", "minimum_area", 50.0, {}, "&scenario", SCENARIO),
    ("hazard", "minimum_width", 5.0, {}, "&scenario", SCENARIO),
    ("hazard", "object_width", 5.0, {}, "&scenario", {"output": {"maps": ["hits"]}}),
    ("hazard", "thresholds", [5.0], {}, "&scenario", {"output": {"maps": ["energy_exceeded"]}}),
    ("ensemble", "dem_correlation", 30.0, {}, "a dem_error", {"ensemble": {"dem_error": 1.0}}),
    ("ensemble", "radius_factor", 2.0, BY_TABLE | {"surface": {"uniform_mean_radius": None}},
        "rock sizes", {"surface": {"uniform_mean_radius": 0.2}}),
]  # fmt: skip


def case_of(*changes):
    groups = {name: dict(keys) for name, keys in BASE.items()}
    for change in changes:
        for name, keys in change.items():
            groups[name] = groups.get(name, {}) | keys if isinstance(keys, dict) else keys
    return rockfall.Case(**groups)


@pytest.mark.parametrize(
    "group, key, value, others, needs, valid", EFFECTS, ids=lambda value: str(value)[:20]
)
def test_a_key_without_effect_is_refused(group, key, value, others, needs, valid):
    given = {group: {key: value}}
    with pytest.raises(rockfall.RockfallError, match=f"^case: &{group} {key}") as caught:
        case_of(others, given)
    text = str(caught.value)
    assert f"is only valid with {needs}" in text and len(text.split()) <= 25 and ";" not in text
    if valid is not None:
        case = case_of(others, {group: {key: value}}, valid)
        assert getattr(case, group)[key] == value


def test_maps_and_scenarios_that_go_take_their_keys_along():
    """Without maps or scenarios, keys that only they use return to their defaults, so that studies
    can leave maps out; keys that are still used remain."""
    hazard = {"thresholds": [5.0, 50.0], "object_width": 7.0}
    maps = {"output": {"maps": ["hits", "energy_exceeded"], "min_passages": 3}, "hazard": hazard}
    case = case_of(maps)
    bare = case.replace(output={"maps": None})
    assert "maps" not in bare.output and bare.output["min_passages"] == 1
    default = case_of()
    for key, value in hazard.items():
        assert bare.hazard[key] == default.hazard[key]
        assert case.replace(output={"maps": ["passages"]}).hazard[key] == default.hazard[key]
        assert case.replace(output={"trajectories": 1}).hazard[key] == value
    one = case.replace(output={"maps": ["hits"]})
    assert (one.hazard["object_width"], one.hazard["thresholds"]) == (7.0, [30.0, 300.0])
    often = case_of(maps, SCENARIO, {"hazard": {"minimum_area": 9.0}})
    assert often.replace(output={"maps": None}).hazard["thresholds"] == [5.0, 50.0]
    rare = often.replace(scenario=[])
    assert (rare.hazard["thresholds"], rare.hazard["minimum_area"]) == ([5.0, 50.0], 0.0)
    assert often.replace(scenario=[], output={"maps": None}).hazard["thresholds"] == [30.0, 300.0]
    rule = "is only valid with &scenario, or maps ..._exceeded"
    with refused(f"case: &hazard thresholds = 5.0, 50.0: {rule}"):
        bare.replace(hazard={"thresholds": [5.0, 50.0]}, scenario=[])


def test_a_default_that_is_written_out_is_no_mistake():
    """Defaults that a program has written out are accepted, in any spelling."""
    forest = {"seed": 1, "turn_frontal": [22.5, 45, 8.5], "density_factor": 1}
    case = case_of({"forest": forest, "breakage": {"cone": 5e1}, "hazard": {"object_width": 10}})
    assert not case.has_forest and case.breakage["at"] == "none"


@pytest.mark.skipif(programs.find_program() is None, reason="without the standalone program")
@pytest.mark.parametrize("usual, given, needs", [
    ("cone = 50.0", "cone = 30.0", "&breakage cone = 30.0: is only valid with at = 'release', "
        "'impact' or 'both'"),
    ("density_factor = 1.0", "density_factor = 0.5", "&forest density_factor = 0.5: is only valid "
        "with trees, polygons or stems"),
    ("minimum_area = 0.0", "minimum_area = 9.0", "&hazard minimum_area = 9.0: is only valid with "
        "&scenario"),
])  # fmt: skip
def test_the_standalone_program_refuses_the_same(tmp_path, usual, given, needs):
    make_full_case(tmp_path)
    text = (tmp_path / "case.nml").read_text(encoding="utf-8")
    assert text.count(usual) == 1
    (tmp_path / "own.nml").write_text(text.replace(usual, given), encoding="utf-8")
    refused_in_one_line(run_program("own.nml", cwd=tmp_path), f"own.nml: {needs}")


def read(case, **layers):
    return implausible(read_scene(case, scenes.rough(), PLACE, **layers))


@pytest.mark.parametrize("changes, words", [
    ({"boulder": {"block_shape": "platy"}, "surface": {"ground": "soil_4"}},
        "&boulder block_shape = 'platy': is only valid with an impact table"),
    ({"impact": {"ratio": "nearest"}, "surface": {"ground": "soil_4"}},
        "&impact ratio = 'nearest': is only valid with impact sets"),
    ({"impact": {"turning": "to_aspect"}, "surface": {"ground": "talus"}},
        "&impact turning = 'to_aspect': is only valid with impact sets or classical models"),
    ({"breakage": {"at": "impact", "min_volume": 1.0}},
        "&breakage min_volume = 1: must be below the largest volume of the boulders [m3]"),
    ({"breakage": {"at": "impact", "min_volume": 1.0},
      "boulder": {"volume": "list", "volumes": [0.5, 0.9], "volume_mean": None}},
        "&breakage min_volume = 1: must be below the largest volume of the boulders [m3]"),
])  # fmt: skip
def test_a_key_that_files_leave_without_effect_is_refused(changes, words):
    with pytest.raises(rockfall.RockfallError) as caught:
        read(case_of(changes))
    assert str(caught.value).startswith(f"case: {words}")
    assert len(str(caught.value).split()) <= 25


def test_a_distribution_without_a_limit_may_break_at_any_minimum():
    distribution = {"volume": "lognormal", "volume_std": 0.1}
    breakage = {"at": "impact", "min_volume": 1.0}
    assert not read(case_of({"breakage": breakage, "boulder": distribution}))


def test_small_blocks_of_a_scenario_do_not_break_and_are_no_mistake():
    small = [{"name": "small", "frequency": 1.0, "volume_mean": 0.001}, {"name": "b",
             "frequency": 0.1}]  # fmt: skip
    breakage = {"at": "impact", "min_volume": 0.01}
    base_case(case_of({"breakage": breakage, "scenario": small}))


STANDS = {"stems": [400.0], "dbh_mean": [30.0], "dbh_std": [5.0], "conifers": [80.0]}


def frame(shape, **columns):
    west, north = PLACE.c, PLACE.f
    shapes = {
        "point": shapely.Point(west + 150, north - 50),
        "line": shapely.LineString([(west + 100, north - 200), (west + 200, north - 200)]),
        "everywhere": shapely.box(west - 1, north - 401, west + 301, north + 1),
        "strip": shapely.box(west + 10, north - 300, west + 60, north - 30),
        "polygon": shapely.box(west + 100, north - 300, west + 200, north - 30),
    }
    return geopandas.GeoDataFrame(columns, geometry=[shapes[shape]], crs=None)


ATTRIBUTES = [
    ("sources", frame("point", volumne=[2.0]), "volumne (volume?)"),
    ("sources", frame("point", drop_hight=[2.0]), "drop_hight (drop_height?)"),
    ("sources", frame("point", frequenz=[2.0]), "frequenz (frequency?)"),
    ("sources", frame("point", Hoehe=[2.0], fid=[3]), "Hoehe"),
    ("sources", frame("polygon", densité=[2500.0]), "densité (density?)"),
    ("lines", frame("line", name=["a"], object_widht=[3.0]), "object_widht (object_width?)"),
    (
        "barriers",
        frame("line", height=[3.0], capacity=[500.0], deckay_class=[2]),
        "deckay_class (decay_class?)",
    ),
    (
        "dams",
        frame("line", height=[20.0], allow_coarse=[True], crestwidth=[3.0]),
        "crestwidth (crest_width?)",
    ),
    ("stands", frame("polygon", **STANDS, alter=[80]), "alter"),
    ("clearings", frame("polygon", density_facto=[0.5]), "density_facto (density_factor?)"),
    ("zones", frame("everywhere", mean_radius=[0.3], grund=["meadow"]), "grund (ground?)"),
]


@pytest.mark.family(2)
@pytest.mark.parametrize("key, layer, names", ATTRIBUTES, ids=lambda value: str(value)[:14])
def test_attributes_that_are_not_used_are_listed(key, layer, names):
    case = case_of({"forest": STEMS} if key == "clearings" else {})
    warned = read(case, **{key: layer})
    assert any(line.endswith(f": attributes not used: {names}") for line in warned), warned
    plain = layer.drop(columns=[n.split()[0] for n in names.split(", ")])
    if key != "clearings" and len(plain.columns) > 1:
        rest = read(case, **{key: plain})
        assert not any("attributes not used" in line for line in rest)


MARKED = [
    ("sources", "point", "volume", [1.0, 2.0, 255.0]),
    ("sources", "point", "drop_height", [1.0, 2.0, 99.9]),
    ("sources", "point", "frequency", [0.01, 0.02, 127.0]),
    ("sources", "polygon", "density", [2600.0, 2700.0, 9999.0]),
    ("stands", "strip", "stems", [300.0, 200.0, 999.0]),
    ("stands", "strip", "dbh_mean", [30.0, 20.0, 255.0]),
    ("stands", "strip", "dbh_std", [3.0, 2.0, 99.9]),
    ("barriers", "line", "capacity", [500.0, 1000.0, 9999.0]),
    ("barriers", "line", "height", [3.0, 4.0, 99.9]),
    ("lines", "line", "object_width", [3.0, 4.0, 99.9]),
    ("zones", "everywhere", "mean_radius", [0.2, 0.3, 127.0]),
]
ONES = {
    "stands": {"stems": 300.0, "dbh_mean": 30.0, "dbh_std": 3.0, "conifers": 80.0},
    "barriers": {"height": 3.0, "capacity": 500.0},
}


@pytest.mark.family(2)
@pytest.mark.parametrize("key, shape, name, values", MARKED, ids=lambda value: str(value))
def test_numbers_for_missing_ones_are_questioned(key, shape, name, values):
    """A value far above all others is questioned in every column that has a range."""
    step = 60.0 if shape == "strip" else 7.0
    one = frame(shape, a=[0]).geometry.iloc[0]
    shapes = [shapely.affinity.translate(one, step * k, 0) for k in range(len(values))]
    for last, is_mark in [(values[-1], True), (values[-1] * 0.37, False)]:
        columns = {n: [v] * len(values) for n, v in ONES.get(key, {}).items()}
        columns |= {name: [*values[:-1], last]}
        warned = read(case_of({}), **{key: geopandas.GeoDataFrame(columns, geometry=shapes)})
        marks = [line for line in warned if "does it mark missing values?" in line]
        assert len(marks) == is_mark, warned
        if is_mark:
            assert f": {name} = {values[-1]:g} in 1 rows, far above all others" in marks[0]


def test_one_frequency_far_above_the_others_is_questioned():
    points = [shapely.Point(PLACE.c + 150 + 9 * k, PLACE.f - 50) for k in range(3)]
    for frequencies, ratio in [([2e-4, 0.3, 2e-4], "1,500"), ([1e-3, 0.3, 2e-4], "")]:
        layer = geopandas.GeoDataFrame({"frequency": frequencies}, geometry=points)
        warned = read(case_of({"case": {"boulders": None, "boulders_total": 9}}), sources=layer)
        questions = [line for line in warned if "next lower" in line]
        assert len(questions) == bool(ratio)
        assert all(f"feature 2: frequency {ratio} times the next" in line for line in questions)
