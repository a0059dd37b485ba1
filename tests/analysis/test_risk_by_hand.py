# SPDX-License-Identifier: BSD-3-Clause
"""Risk of objects: annual damage and deaths equal a hand calculation over the boulders of a run;
limits enclose them; sums account for shared boulders; nothing is silently omitted."""

import warnings

import numpy as np
import pytest

import rockfall
import scenes
from made import make_layer, refused
from rockfall.analysis.objects.risk import layered, mean_of, risk_classes
from rockfall.analysis.objects.vulnerability import BUILDING, read_curves, stepped
from rockfall.analysis.precision.clusters import Clusters
from rockfall.analysis.precision.intervals import Sources
from rockfall.kernel_rules import fraction_limits
from rockfall.result.crossings import at_lines

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

Z = scenes.rough()
GRID = scenes.grid(Z)
YEARLY, BOULDERS = 0.5, 200
HOUSE = shapely.box(140, 280, 155, 292)
ROAD = shapely.LineString([(0, 250), (300, 253)])
ENDS = ("", "_low", "_high")


def make_case(folder, **groups):
    release = {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0}
    groups = {"release": release, "case": {"boulders": 100}} | groups
    case = scenes.make_case(folder, *scenes.sets(2.0), **groups)
    return case.replace(scenario=[{"name": "one", "frequency": YEARLY}])


@pytest.fixture
def found(tmp_path):
    def make(*objects, curves=None, **columns):
        columns = {"name": [f"o{k}" for k in range(len(objects))]} | columns
        path = make_layer(tmp_path / "objects.gpkg", list(objects), "EPSG:32632", **columns)
        given = {} if curves is None else {"vulnerability": curves}
        return rockfall.hazard(make_case(tmp_path), objects=path, dem=Z, transform=GRID, **given)

    return make


@pytest.fixture
def boulders(tmp_path):
    """Energies [J] at house and road (NaN: no hit), and diameters [m], in the same run."""
    lines = [
        {"name": name, "x": list(x), "y": list(y), "object_width": 0.0}
        for name, (x, y) in (("h", HOUSE.exterior.xy), ("r", ROAD.xy))
    ]
    result = rockfall.run(
        make_case(tmp_path).replace(line=lines, scenario=[]), dem=Z, transform=GRID
    )
    energy = (
        at_lines(result)["line_energy_translational"].values
        + at_lines(result)["line_energy_rotational"].values
    )
    return energy, 2 * np.cbrt(3 * result.volume.values / (4 * np.pi))


def three(found, name, k=0):
    return [float(np.ravel(found[f"{name}{end}"].values)[k]) for end in ENDS]


# ---- by hand


def test_persons_in_a_house(found, boulders):
    """Part of the 0.5 boulders per year hit the house; 4 persons are present half the time, and one
    in ten dies."""
    home = {"persons": [4.0], "presence": [0.5], "lethality": [0.1]}
    risk = found(HOUSE, **home)
    hits = np.isfinite(boulders[0][0]).sum()
    assert hits > 5
    by_hand = YEARLY * hits / BOULDERS * 0.5 * 0.1
    value, low, high = three(risk, "object_individual_risk")
    assert value == pytest.approx(by_hand, rel=1e-12)
    limits = fraction_limits(hits / BOULDERS, BOULDERS)
    assert [low, high] == pytest.approx([YEARLY * 0.05 * one for one in limits], rel=1e-12)
    assert three(risk, "object_collective_risk") == pytest.approx(
        [4 * one for one in (value, low, high)], rel=1e-12
    )
    assert three(risk, "total_collective_risk") == three(risk, "object_collective_risk")
    assert np.isnan(three(risk, "object_damage")).all()
    assert three(risk, "total_damage") == [0, 0, 0]


def test_vehicles_on_a_road(found, boulders):
    """Vehicles are 600 m apart; a boulder of diameter d [m] hits those within d + 4 m."""
    traffic = {"aadt": [2400.0], "speed": [60.0], "vehicle_length": [4.0]}
    traffic |= {"persons_per_vehicle": [1.5], "trips": [4.0], "lethality": [0.8]}
    risk = found(ROAD, **traffic)
    energy, diameter = boulders
    met = np.isfinite(energy[1])
    metres = (diameter[met] + 4.0).sum() / BOULDERS
    assert met.sum() > 50
    deaths = YEARLY * metres / 600.0 * 1.5 * 0.8
    value, low, high = three(risk, "object_collective_risk")
    assert value == pytest.approx(deaths, rel=1e-12)
    assert low < value < high < 1.5 * value
    commuter = YEARLY * metres * 4 / (24 * 60_000) * 0.8
    assert three(risk, "object_individual_risk")[0] == pytest.approx(commuter, rel=1e-12)


def test_damage_is_that_of_the_energy_of_each_boulder(found, boulders):
    energy = boulders[0][0]
    energy = energy[np.isfinite(energy)]
    sigmoid = 1 - 1.358 / (1 + np.exp((energy - 129_000) / 120_300))
    by_hand = YEARLY * 8e5 * np.maximum(sigmoid, 0).sum() / BOULDERS
    for columns in ({"kind": ["building"]}, {"curve": ["agliardi2009"]}):
        risk = found(HOUSE, value=[8e5], **columns)
        value, low, high = three(risk, "object_damage")
        assert value == pytest.approx(by_hand, rel=1e-9)
        assert low < value < high
        assert "Agliardi" in risk.attrs["risk_assumptions"]
        assert "object_risk" not in risk  # it depends only on the attributes of vulnerability


def test_a_table_of_curves(found, boulders, tmp_path):
    path = tmp_path / "curves.csv"
    path.write_text("name,energy,vulnerability,source\nhut,10,0.2,survey\nhut,50,0.6,survey\n")
    risk = found(HOUSE, curves=path, value=[10.0], curve=["hut"], exposure=[0.5])
    energy = boulders[0][0]
    energy = energy[np.isfinite(energy)] / 1000
    lost = np.where(energy > 50, 1.0, np.interp(energy, [10, 50], [0.2, 0.6]))
    value = YEARLY * 5.0 * lost.sum() / BOULDERS
    assert three(risk, "object_damage")[0] == pytest.approx(value, rel=1e-12)
    assert (
        "hut (survey (1 above 50 kJ, where the table ends)): o0" in risk.attrs["risk_assumptions"]
    )


def test_attributes_by_intensity_give_the_same_as_the_risk_of_classes(found):
    columns = {f"vulnerability_{k + 1}": [one] for k, one in enumerate((0.1, 0.4, 0.9))}
    risk = found(ROAD, persons=[1.0], value=[200.0], exposure=[0.5], **columns)
    assert three(risk, "object_damage") == pytest.approx(three(risk, "object_risk"), rel=1e-12)


def test_points_without_a_width_have_the_upper_end_of_each_intensity(found):
    """Damage is that at the upper ends of classes of intensity; its lower limit is at most the
    damage at their lower ends. Deaths are exact, because lethality is given by class."""
    columns = {"persons": [1.0], "value": [1.0], "curve": ["agliardi2009"]}
    columns |= {f"lethality_{k + 1}": [one] for k, one in enumerate((0.1, 0.4, 0.9))}
    risk = found(shapely.Point(147.0, 286.0), **columns)
    hits = risk.object_passages.values[0, 0]
    medium, strong = risk.object_energy_exceeded.values[0, :, 0]
    assert hits > 0
    ends = BUILDING.fraction(np.array([30e3, 300e3, np.inf]))
    numbers = np.array([hits - medium, medium - strong, strong])
    damage, low, high = three(risk, "object_damage")
    assert damage == pytest.approx(YEARLY * (ends * numbers).sum() / BOULDERS)
    assert low <= YEARLY * (np.append(0, ends[:2]) * numbers).sum() / BOULDERS < damage < high
    deaths = YEARLY * (np.array([0.1, 0.4, 0.9]) * numbers).sum() / BOULDERS
    assert three(risk, "object_collective_risk")[0] == pytest.approx(deaths)
    assert "upper limit of its intensity" in risk.attrs["risk_assumptions"]


# ---- limits and sums


def test_sums_know_that_boulders_are_shared(found):
    """A house given twice is hit by the same boulders: its limits are those of one house times 2.
    Two houses hit by other boulders have limits within the sums."""
    persons = {"lethality": [0.1, 0.1], "persons": [2.0, 2.0]}
    twice = found(HOUSE, HOUSE, **persons)
    added = [2 * one for one in three(twice, "object_collective_risk")]
    assert three(twice, "total_collective_risk") == pytest.approx(added, rel=1e-12)
    apart = shapely.box(100, 262, 110, 268)
    both = found(HOUSE, apart, **persons)
    value, low, high = three(both, "total_collective_risk")
    sums = [float(both[f"object_collective_risk{end}"].sum()) for end in ENDS]
    assert value == pytest.approx(sums[0], rel=1e-12)
    assert sums[1] < low < value < high < sums[2]


def test_a_total_of_points_adds_their_limits(found):
    points = [shapely.Point(147.0, 286.0), shapely.Point(147.0, 270.0)]
    risk = found(*points, persons=[1.0, 3.0])
    assert (risk.object_passages.values > 0).all()
    for end in ENDS:
        total = risk[f"total_collective_risk{end}"].values
        assert total == pytest.approx(risk[f"object_collective_risk{end}"].values.sum())


def clusters(sources, each=1):
    """Sources with `each` boulders; if more than one, the sources are a sample, and each counts as
    one boulder."""
    number = np.repeat(np.arange(sources), each)
    return Clusters(Sources.of(number, sampled=each > 1), each)


@pytest.mark.parametrize("boulders", [50, 400])
def test_limits_hold_the_mean_as_often_as_they_say(boulders):
    """Losses are mostly zero and rarely large. Limits include the mean in at least 95 % of 1,000
    trials, and the upper limit is below it in at most 2.5 %."""
    random = np.random.default_rng(5)
    held, above = 0, 0
    for _ in range(1000):
        hit = random.random(boulders) < 0.08
        values = np.where(hit, random.random(boulders) ** 3, 0.0)
        _, low, high = mean_of(values, 1.0, clusters(boulders))
        held += low <= 0.08 / 4 <= high
        above += high < 0.08 / 4
    assert held >= 950 and above <= 25


def test_what_none_did_may_still_be_done():
    _, low, high = mean_of(np.zeros(1000), 7.0, clusters(1000))
    assert low == 0 and high == pytest.approx(7 * fraction_limits(0.0, 1000)[1])
    alone = layered(np.array([7.0]), np.array([0]), 1000, 1)
    assert alone == (0, 0, high)


def test_boulders_of_a_place_count_as_one():
    values = np.repeat([0.0, 1.0], 50)
    narrow, wide = mean_of(values, 1.0, clusters(100)), mean_of(values, 1.0, clusters(2, 50))
    assert wide.low < narrow.low < 0.5 < narrow.high < wide.high


def test_classes_end_at_powers_of_ten(found):
    risks = np.array([np.nan, 0.0, 9e-7, 1e-6, 9.9e-6, 1e-5, 1e-4, 1.0])
    assert risk_classes(risks).tolist() == [0, 0, 1, 2, 2, 3, 4, 4]
    risk = found(HOUSE, persons=[1.0], presence=[1e-3])
    for end, of in (("", ""), ("_lower", "_low"), ("_upper", "_high")):
        expected = risk_classes(risk[f"object_individual_risk{of}"].values)
        assert (risk[f"object_risk_class{end}"].values == expected).all()


# ---- remarks and refusals


def test_every_default_is_said(found):
    persons, aadt, missing = [2.0, np.nan], [np.nan, 500.0], [np.nan, 50.0]
    traffic = {"aadt": aadt, "speed": missing, "persons_per_vehicle": missing}
    road = shapely.box(0, 240, 300, 250)
    risk = found(
        HOUSE, road, persons=persons, value=[10.0, 10.0], kind=["building", "road"], **traffic
    )
    said = risk.attrs["risk_assumptions"]
    for line in (
        "default presence = 1: o0",
        "default lethality = 1: o0, o1",
        "default vehicle_length = 5: o1",
        "default trips = 2: o1",
        "vulnerability missing, so no damage is counted: o1",
        "NOT included (errs low): vehicles that run into a block",
    ):
        assert line in said
    assert risk.object_kind.values.tolist() == ["building", "road"]


def test_layers_without_exposure_are_as_before(found):
    risk = found(HOUSE, vulnerability=[0.5], value=[3.0], kind=["building block"])
    assert not {name for name in risk.data_vars if "collective" in name or "damage" in name}
    assert "risk_assumptions" not in risk.attrs


def test_capitals_make_no_other_kind(found):
    small, large = (found(HOUSE, value=[8e5], kind=[kind]) for kind in ("building", " Building"))
    assert small.object_damage.item() == large.object_damage.item() > 0


@pytest.mark.parametrize(
    ("objects", "columns", "line"),
    [
        ([HOUSE], {"value": [8e5], "kind": ["Haus"]}, "value has no effect: give vulnerability, a"),
        ([HOUSE], {"value": [8e5], "vulnerability": [0.5]}, None),
        ([HOUSE, HOUSE], {"value": [8e5, 8e5], "vulnerability": [0.5, 0.5]},
         "o1 duplicates o0 (1 in all), so each is hit and their risks add up"),
        ([HOUSE, HOUSE], {"persons": [2.0, 3.0]}, None),  # flats
    ],
)  # fmt: skip
def test_values_without_effect_and_objects_that_count_twice_are_told(found, objects, columns, line):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        found(*objects, **columns)
    told = [str(warning.message) for warning in caught if "objects.gpkg" in str(warning.message)]
    assert len(told) == (line is not None)
    assert line is None or line in told[0]


TRAFFIC = {"aadt": [100.0], "speed": [50.0], "persons_per_vehicle": [1.5]}


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"persons": [-1.0]}, "feature 1: persons = -1.0: must be >= 0"),
        ({"persons": [np.inf]}, "feature 1: persons = inf: must be >= 0"),
        ({"persons": ["four"]}, "attribute persons: must be a number, >= 0"),
        ({"persons": [1.0], "presence": [1.1]}, "feature 1: presence = 1.1: must be 0 to 1"),
        ({"persons": [1.0], "lethality": [2.0]}, "feature 1: lethality = 2.0: must be 0 to 1"),
        ({"persons": [1.0], "lethality_1": [0.2]},
         "attributes lethality_1: must be lethality, or lethality_1 to lethality_3: one for each "
         "intensity"),
        ({"persons": [1.0], "lethality_1": [0.2], "lethality_2": [0.1], "lethality_3": [1.0]},
         "feature 1: lethality_2: must not be below lethality_1"),
        ({"persons": [1.0], "lethality_1": [0.2], "lethality_2": [np.nan], "lethality_3": [1.0]},
         "feature 1: lethality_2 = nan: must be 0 to 1"),
        ({"persons": [1.0], "lethality_curve": ["x"]},
         "feature 1: lethality_curve = x: must be one of: agliardi2009, or a curve of the "
         "--vulnerability table"),
        ({"value": [1.0], "curve": ["x"]},
         "feature 1: curve = x: must be one of: agliardi2009, or a curve of the --vulnerability "
         "table"),
        ({"aadt": [100.0]}, "feature 1: aadt = 100: needs the attribute speed"),
        ({"aadt": [100.0], "speed": [50.0]},
         "feature 1: aadt = 100: needs the attribute persons_per_vehicle"),
        (TRAFFIC | {"speed": [0.0]}, "feature 1: speed = 0.0: must be 1 to 500"),
        (TRAFFIC | {"vehicle_length": [-4.0]},
         "feature 1: vehicle_length = -4.0: must be 0 to 1000"),
        (TRAFFIC | {"persons": [2.0]}, "feature 1: aadt = 100: cannot be combined with persons"),
    ],
)  # fmt: skip
def test_exposure_that_cannot_be_is_refused(found, tmp_path, columns, message):
    with refused(f"{tmp_path / 'objects.gpkg'}: {message}"):
        found(ROAD, **columns)


def test_traffic_needs_a_width(found, tmp_path):
    with refused(
        f"{tmp_path / 'objects.gpkg'}: feature 1: aadt = 100: needs a line, a polygon, or a point "
        "with a width"
    ):
        found(shapely.Point(150.0, 300.0), **TRAFFIC)


HEAD = "name,energy,vulnerability,source\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,energy,vulnerability\na,1,1\n",
         "line 1: column source is missing (columns: name, energy, vulnerability)"),
        (HEAD, "no rows below the header"),
        (HEAD + "a,1,0.2,\n", "line 2: source = : must not be empty"),
        (HEAD + "a,-1,0.2,b\n",
         "line 2: energy = -1: must be a number >= 0 and <= 1e+09"),
        (HEAD + "a,1,1.2,b\n", "line 2: vulnerability = 1.2: must be a number >= 0 and <= 1"),
        (HEAD + "a,1,nan,b\n", "line 2: vulnerability = nan: must be a number >= 0 and <= 1"),
        (HEAD + "a,1,0.2,b\na,1,0.3,b\n",
         "line 3: energy = 1: must be above that of the previous row of a"),
        (HEAD + "a,1,0.2,b\na,2,0.1,b\n",
         "line 3: vulnerability = 0.1: must not be below that of the previous row of a"),
        (HEAD + "agliardi2009,1,0.2,b\n",
         "line 2: name = agliardi2009: is a curve of the package: choose another name"),
    ],
)  # fmt: skip
def test_curves_that_cannot_be_are_refused(tmp_path, text, message):
    path = tmp_path / "curves.csv"
    path.write_text(text)
    with refused(f"{path}: {message}"):
        read_curves(path)


def test_curves_need_objects(tmp_path):
    with refused(f"{tmp_path}/c.csv: vulnerability curves require objects"):
        rockfall.hazard(
            make_case(tmp_path), vulnerability=f"{tmp_path}/c.csv", dem=Z, transform=GRID
        )


def test_a_curve_by_intensity_changes_above_its_thresholds():
    curve = stepped(np.array([30e3, 300e3]), np.array([0.1, 0.4, 0.9]))
    energies = np.array([0.0, 30e3, 30e3 + 1, 300e3, 1e9])
    assert curve.fraction(energies).tolist() == [0.1, 0.1, 0.4, 0.4, 0.9]
    assert BUILDING.fraction(np.array([0.0, 5e3, 1e12])).tolist() == [0.0, 0.0, 1.0]
