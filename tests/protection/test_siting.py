# SPDX-License-Identifier: BSD-3-Clause
"""Siting: each alignment has the values of a run with only that line, and a barrier there stops as
many boulders as the table gives."""

import csv
import gc
import math
import weakref
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import rockfall
from made import make_layer, refused
from rockfall.analysis.line_statistics import line_statistics
from rockfall.cli import main
from rockfall.kernel_rules import EAD_ENERGY
from rockfall.result.crossings import at_lines, line_names
from rockfall.simulation.simulate import run_scene
from rockfall.studies.barrier_advice import group_of
from rockfall.studies.siting import (
    BEST,
    COLUMNS,
    NO,
    NOT_DISTINGUISHED,
    UNDECIDED,
    YES,
    choose,
    under_doubt,
)
from rockfall.studies.variants import at_line as variant_line
from rockfall.tables.siting import siting_text
from scenes import FACTORS, cut_below, make_case, rough, sets

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

Z, GRID = cut_below(rough(), 120.0)
site = partial(rockfall.site, factors=FACTORS)
ROAD = {"name": "road", "x": [0.0, 300.0], "y": [180.0, 180.0]}
TERRAIN = {"dem": Z, "transform": GRID}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("siting")
    return make_case(
        folder, *sets(), terrain={}, line=[ROAD],
        case={"boulders": 300, "threads": 0},
        boulder={"volume": "normal", "volume_mean": 0.8, "volume_std": 0.2},
        release={"x": [100.0, 150.0, 200.0], "y": [380.0] * 3},
    )  # fmt: skip


@pytest.fixture(scope="module")
def found(case):
    return site(case, "road", every=40.0, to=220.0, max_height=8.0, **TERRAIN)


def at(found, name):
    return found.table.set_index("alignment").loc[name]


def test_alignments_are_the_line_shifted_to_the_sources(found):
    table = found.table
    assert list(table.columns) == COLUMNS
    assert table["distance"].tolist() == [0, 40, 80, 120, 160, 200]
    assert (np.diff(table["elevation"]) > 20).all() and (table["length"] == 300).all()
    assert [one.y for one in found.alignments] == [[180.0 + 40 * k] * 2 for k in range(6)]


def test_numbers_are_those_of_a_run_with_that_line_alone(case, found):
    alone = {"name": "other", "x": ROAD["x"], "y": [300.0, 300.0]}
    result = rockfall.run(case.replace(line=[alone]), **TERRAIN)
    rows = line_statistics(result).set_index("quantity")
    row = at(found, "road +120 m")
    for name, quantity in ("energy_q95", "energy_total"), ("height_q95", "passing_height"):
        for end in ("", "_low", "_high"):
            assert row[name + end] == rows.loc[quantity, f"q95{end}"]
    sheet = rockfall.design(result, factors=FACTORS).demand.iloc[0]
    for name in ("E_d", "E_d_high", "height_needed", "height_needed_low", "ead_class"):
        assert row[name] == sheet[name]
    assert row["n"] == sheet["n"]


def test_a_barrier_there_leaves_what_is_said(case, found):
    """The remaining boulders of the table are at least those that reach the road behind the
    barrier: boulders that break through are slower."""
    row = at(found, "road +160 m")
    net = {"name": "net", "x": ROAD["x"], "y": [340.0] * 2, "height": row["height_needed"],
           "class": int(row["ead_class"])}  # fmt: skip
    result = rockfall.run(case.replace(barrier=[net]), **TERRAIN)
    come = np.isfinite(at_lines(result)["line_time"].values[0])
    broke = at_lines(result)["barrier_outcome"].values[1] == 2
    said = round(row["remaining"] * found.come)
    assert 0 < come.sum() <= said <= (come | broke).sum()


def test_what_passes_around_a_short_alignment_counts(case):
    """Boulders that reach the road without crossing a short line are its bypass."""
    short = [{"name": "short", "x": [140.0, 160.0], "y": [300.0, 300.0]}]
    result = rockfall.run(case.replace(line=[ROAD, *short]), **TERRAIN)
    comes, met = np.isfinite(at_lines(result)["line_time"].values)
    layer = make_layer(case.folder / "short.gpkg", [shapely.LineString([(140, 300), (160, 300)])],
                       crs=None, name=["short"])  # fmt: skip
    found = site(case, "road", candidates=layer, **TERRAIN)
    row = at(found, "short")
    assert row["bypass"] == (comes & ~met).sum() / comes.sum() > 0.5
    assert row["remaining"] >= row["bypass"]
    assert (row["fits"], row["fails"], row["choice"]) == (NO, "bypass", "")
    assert row["distance"] == pytest.approx(120.0) and row["length"] == 20.0


def test_a_layer_and_a_frame_are_the_same(case):
    import pandas as pd
    from rasterio.crs import CRS

    class Frame(pd.DataFrame):
        _metadata = ["crs"]

        @property
        def geometry(self):
            return pd.Series(list(self["geom"]), name="geom")

    shapes = [shapely.LineString([(0, y), (300, y - 10)]) for y in (300, 250)]
    names = ["upper", "lower"]
    layer = make_layer(case.folder / "drawn.gpkg", shapes, crs=None, name=names)
    frame = Frame({"geom": shapes, "name": names})
    frame.crs = CRS.from_epsg(32632)
    one, other = (site(case, "road", candidates=of, **TERRAIN) for of in (layer, frame))
    assert one.table["alignment"].tolist() == ["lower", "upper"]
    assert one.table.equals(other.table)


def row_of(cost, low=math.nan, high=math.nan, fits=YES, distance=0.0):
    return {"cost": cost, "cost_low": low, "cost_high": high, "fits": fits, "distance": distance}


def test_the_choice_is_the_cheapest_and_what_overlaps_is_not_told_apart():
    rows = [row_of(5, 4, 6), row_of(7, 5.5, 9), row_of(9, 7, 12), row_of(1, 1, 1, NO),
            row_of(8), row_of(3, 2, 4, UNDECIDED), row_of(math.nan)]  # fmt: skip
    choose(rows)
    marks = [BEST, NOT_DISTINGUISHED, "", "", NOT_DISTINGUISHED, NOT_DISTINGUISHED, ""]
    assert [row["choice"] for row in rows] == marks
    few = [row_of(5), row_of(50, 40, 60)]  # too few boulders for an upper limit of the best
    choose(few)
    assert [row["choice"] for row in few] == [BEST, NOT_DISTINGUISHED]
    undecided = [row_of(5, 4, 6, UNDECIDED), row_of(1, 1, 1, NO)]
    choose(undecided)
    assert [row["choice"] for row in undecided] == [BEST, ""]


def test_limits_decide_over_the_interval(found, case):
    for row in found.table.to_dict("records"):
        if not row["n"]:
            continue
        high = row["height_needed_high"] <= 8.0
        low = row["height_needed_low"] > 8.0
        assert row["fits"] == (YES if high else NO if low else UNDECIDED), row["alignment"]
    row = at(found, "road +160 m")
    between = (row["height_needed_low"] + row["height_needed"]) / 2
    again = site(case, "road", every=160.0, to=160.0, max_height=between, **TERRAIN)
    row = at(again, "road +160 m")
    assert (row["fits"], row["fails"], row["choice"]) == (UNDECIDED, "height", BEST)
    assert "not certain to be within the limits (height)" in siting_text(again)


def test_cost_is_that_of_the_cheapest_that_suffices(case, found, tmp_path):
    row = at(found, "road +160 m")
    k, high = int(row["ead_class"]), row["height_needed"]
    assert row["cost"] == EAD_ENERGY[k] / 1000 * high * 300.0
    prices = tmp_path / "prices.csv"
    prices.write_text(f"class,height,cost\n{k},{high - 0.1},10\n{k},{high + 9},90\n"
                      f"{k + 1},{high + 9},80\n{k - 1},{high + 9},5\n")  # fmt: skip
    priced = site(case, "road", every=160.0, to=160.0, costs=prices, **TERRAIN)
    assert at(priced, "road +160 m")["cost"] == 80 * 300.0


def test_runs_in_turn_find_the_same(case, found):
    """The memory is enough for 900 boulders at 3 lines, 44 bytes each: the road and two alignments
    per run."""
    memory = 2 * 44 * 900 * 3
    turns = site(
        case, "road", every=40.0, to=220.0, max_height=8.0, memory=memory, **TERRAIN
    )  # fmt: skip
    assert turns.table.equals(found.table) and turns.come == found.come
    best = found.table["alignment"][found.table["choice"] == BEST].tolist()
    assert line_names(turns.result) == list(dict.fromkeys(["road", *best]))
    about = "900 boulders at 6 alignments need 0.00024 GB, more than half of the memory"
    assert turns.notes[0].startswith(f"{about}: 3 runs") and turns.notes[1:] == found.notes
    for given in ({"memory": 2 * 44 * 900}, {"memory": 1.0}):
        with refused("site: 900 boulders at 2 lines need 7.9e-05 GB, more than half of the "
                     "memory: give fewer boulders"):  # fmt: skip
            site(case, "road", every=40.0, to=220.0, **given, **TERRAIN)


@pytest.mark.all
def test_lines_are_let_go_between_runs(case, monkeypatch):
    """Only one result is in memory at a time, apart from the small result of the advised barrier,
    which has only the lines of the case."""
    alive = []

    def counted(scene, **how):
        gc.collect()
        is_advised = bool(scene.case.barrier)
        assert len([one for one in alive if one() is not None]) == is_advised
        result = run_scene(scene, **how)
        alive.append(weakref.ref(result))
        return result

    for where in "study", "siting":
        monkeypatch.setattr(f"rockfall.studies.{where}.run_scene", counted)
    site(case, "road", every=100.0, to=200.0, memory=2 * 44 * 900 * 2, **TERRAIN)
    assert len(alive) == 5  # three alignments, the best, and a barrier there


def test_the_table_says_what_is_printed(case):
    """With unconfirmed rebounds no alignment is certain to fit, in the table and in print; one is
    still the best."""
    ground = case.replace(surface={"uniform_mean_radius": 0.25, "ground": "soil_6"})
    about = {"every": 100.0, "to": 200.0, "max_height": 40.0}
    found = site(ground, "road", max_bypass=1.0, **about, **TERRAIN)
    assert (found.table["unconfirmed"] == "rebounds").all()
    assert YES not in {*found.table["fits"]} and UNDECIDED in {*found.table["fits"]}
    assert (found.table["choice"] == BEST).sum() == 1
    said = siting_text(found)
    for row in found.table.to_dict("records"):
        printed = [one for one in said.splitlines() if one.startswith(f"  {row['alignment']}  ")]
        assert f"{row['fits']}: {row['fails']}" in "\n".join(printed)
    best = found.table[found.table["choice"] == BEST].iloc[0]
    assert best["fails"] == "unconfirmed: rebounds"
    assert "not certain to be within the limits (unconfirmed: rebounds)" in said


def test_a_doubt_never_turns_a_refusal():
    row = {"fits": YES, "fails": ""}
    assert under_doubt(row, "") == {"unconfirmed": "", **row}
    forest = {"unconfirmed": "forest"}
    assert under_doubt(row, "forest") == forest | {
        "fits": UNDECIDED, "fails": "unconfirmed: forest"
    }  # fmt: skip
    open_one = {"fits": UNDECIDED, "fails": "height"}
    assert under_doubt(open_one, "forest")["fails"] == "height; unconfirmed: forest"
    refused_one = {"fits": NO, "fails": "class"}
    assert under_doubt(refused_one, "forest") == forest | refused_one


def passing(result, name="road"):
    """Fraction of boulders that pass a line and are not stopped by a barrier on it."""
    speeds = variant_line(result, name)["speed"]
    return np.mean(~np.isnan(speeds))


def test_the_advised_barrier_is_verified_by_a_run_with_it(case, found):
    advice = found.advice
    assert not advice.yearly and advice.acceptable is None and advice.is_enough is None
    row = at(found, advice.barrier.alignment.name)
    assert row["choice"] == BEST and advice.barrier.ead_class == row["ead_class_high"]
    assert row["height_needed_high"] <= advice.barrier.height < row["height_needed_high"] + 0.5
    bare = rockfall.run(case, **TERRAIN)
    held = rockfall.run(case.replace(barrier=[group_of(advice.barrier)]), **TERRAIN)
    assert advice.today[0] == passing(bare)
    assert advice.left[0] == passing(held) and advice.left[1] <= advice.left[0] <= advice.left[2]
    assert advice.has_effect and advice.change[0] == pytest.approx(passing(held) - passing(bare))
    if advice.ways:
        assert sum(advice.ways.values()) == pytest.approx(1)
    assert f"Advised: {row.name}, class" in siting_text(found)


def scenarios(case):
    return case.replace(
        case={"boulders": 200},
        scenario=[
            {"name": "often", "return_period": 0.5, "volume": "fixed", "volume_mean": 0.3},
            {"name": "rare", "return_period": 20.0, "volume": "fixed", "volume_mean": 2.5},
        ],
    )


def test_frequencies_are_sums_over_scenarios_and_a_barrier_grows_until_they_are_acceptable(case):
    case = scenarios(case)
    how = {"every": 40.0, "to": 40.0, **TERRAIN}
    usual = site(case, "road", **how).advice
    yearly, today, left = (2.0, 0.05), [], []
    for scenario in case.scenario:
        volume = {"volume": "fixed", "volume_mean": scenario["volume_mean"], "volume_std": None}
        own = case.replace(boulder=volume, scenario=[])
        barrier = own.replace(barrier=[group_of(usual.barrier)])
        today.append(passing(rockfall.run(own, **TERRAIN)))
        left.append(passing(rockfall.run(barrier, **TERRAIN)))
    assert usual.yearly
    assert usual.today[0] == pytest.approx(np.dot(yearly, today))
    assert usual.left[0] == pytest.approx(np.dot(yearly, left)) and usual.left[0] > 0

    wanted = 0.6 * usual.left[2]
    enough = site(case, "road", acceptable=wanted, **how).advice
    assert enough.is_enough and enough.left[2] <= wanted
    height, ead_class = enough.barrier[1:]
    assert height > usual.barrier.height or ead_class > usual.barrier.ead_class
    never = site(case, "road", acceptable=1e-9, **how)
    assert never.advice.is_enough is False and never.advice.left[2] > 1e-9
    assert f"not met by any of {never.advice.tried} alignments within" in siting_text(never)


def test_loads_and_frequencies_are_of_the_same_boulders(case):
    """Loads and frequencies weight boulders by the frequency of their scenario: rare large boulders
    have little weight."""
    case, how = scenarios(case), {"every": 40.0, "to": 40.0, **TERRAIN}
    found = site(case, "road", **how)
    row = at(found, "road")
    energies, weights, comes = [], [], 0.0
    for scenario, yearly in zip(case.scenario, (2.0, 0.05), strict=True):
        volume = {"volume": "fixed", "volume_mean": scenario["volume_mean"], "volume_std": None}
        result = rockfall.run(case.replace(boulder=volume, scenario=[]), **TERRAIN)
        energy = variant_line(result, "road")["energy_total"]
        energies.append(energy[~np.isnan(energy)])
        weights.append(np.full(energies[-1].size, yearly / energy.size))
        comes += weights[-1].sum()
    energy, weight = np.concatenate(energies), np.concatenate(weights)
    assert found.advice.today[0] == pytest.approx(comes)
    assert 2.05 * row["fraction"] == pytest.approx(comes)
    assert row["fraction_low"] < row["fraction"] < row["fraction_high"]
    above = weight[energy > row["energy_q95"]].sum() / comes
    assert above == pytest.approx(0.05, abs=weight.max() / comes)
    assert row["energy_q95"] < 0.5 * np.quantile(energies[1], 0.95)
    assert row["n"] == energy.size and found.boulders == 1200
    assert [*found.results] == ["often", "rare"]
    assert "of the scenarios, weighted by frequency: often, rare" in siting_text(found)
    assert "of the scenarios" not in siting_text(site(case.replace(scenario=[]), "road", **how))


def test_a_single_scenario_is_as_its_boulders(case):
    one = case.replace(
        scenario=[{"name": "all", "return_period": 5.0, "volume": "fixed", "volume_mean": 0.5}]
    )
    alone = case.replace(boulder={"volume": "fixed", "volume_mean": 0.5, "volume_std": None})
    how = {"every": 100.0, "to": 200.0, **TERRAIN}
    found, same = site(one, "road", **how), site(alone, "road", **how)
    assert found.table.equals(same.table)
    assert found.advice.today[0] == pytest.approx(0.2 * same.advice.today[0])


@pytest.mark.all
def test_scenarios_run_in_turn_find_the_same(case):
    case, how = scenarios(case), {"every": 100.0, "to": 200.0, **TERRAIN}
    found = site(case, "road", **how)
    turns = site(case, "road", memory=2 * 44 * 600 * 3 * 5, **how)
    assert turns.notes[0].startswith("1,200 boulders at 3 alignments need")
    assert turns.notes[0].endswith("4 runs, and only the best alignment is kept")
    assert turns.table.equals(found.table) and turns.come == found.come
    assert turns.advice == found.advice


def test_a_barrier_that_is_too_short_is_told(case):
    short = [shapely.LineString([(140.0, 300.0), (160.0, 300.0)])]
    geopandas = pytest.importorskip("geopandas")
    layer = geopandas.GeoDataFrame({"name": ["short"]}, geometry=short)
    advice = site(case, "road", candidates=layer, max_bypass=1.0, **TERRAIN).advice
    assert advice.ways["round"] > 0.9 and advice.left[0] > 0.5 * advice.today[0]
    aside = [shapely.LineString([(2.0, 470.0), (6.0, 470.0)])]
    layer = geopandas.GeoDataFrame({"name": ["aside"]}, geometry=aside)
    assert site(case, "road", candidates=layer, max_bypass=1.0, **TERRAIN).advice is None


def test_a_barrier_needs_its_space(case):
    found = site(case, "road", every=40.0, to=80.0, space=50.0, **TERRAIN)
    assert found.table["space"].tolist() == pytest.approx([0, 40, 80])
    assert found.table["fits"].tolist() == [NO, NO, YES]
    assert found.table["fails"].tolist()[:2] == ["space", "space"]
    assert found.advice.barrier.alignment.space >= 50


def test_directions(case):
    east = site(case, "road", every=10.0, to=10.0, direction=90.0, **TERRAIN)
    np.testing.assert_allclose(east.alignments[1].x, [10.0, 310.0])
    np.testing.assert_allclose(east.alignments[1].y, [180.0, 180.0])
    down = site(case, "road", every=50.0, to=50.0, direction=180.0, **TERRAIN)
    assert "no alignment is higher than road: give the uphill direction" in (down.notes)
    beyond = site(case, "road", every=150.0, to=450.0, **TERRAIN)
    assert beyond.table["distance"].tolist() == [0.0, 150.0]  # the terrain ends at 220 m
    assert beyond.notes[0] == "alignments beyond 150 m are outside the terrain: left out"
    assert not down.notes[0].endswith("left out")


def test_refusals(case):
    for given, message in (
        ({"line": "rail"}, "case: line = 'rail': no such line (lines: road)"),
        ({"every": 0.0}, "every = 0.0: must be > 0 m"),
        ({"every": 0.1}, "every = 0.1: gives 1,000 alignments up to 100 m: must be 1 to 199"),
        ({"every": 200.0}, "every = 200.0: gives 0 alignments up to 100 m: must be 1 to 199"),
        ({"direction": 361.0}, "direction = 361.0: must be 0 to 360 degrees"),
        ({"max_height": -1.0}, "max_height = -1.0: must be > 0 and <= 100 m"),
        ({"max_height": 400.0}, "max_height = 400.0: must be > 0 and <= 100 m"),
        ({"max_class": 8}, "max_class = 8: must be 0 to 7"),
        ({"max_bypass": 2.0}, "max_bypass = 2.0: must be 0 to 1"),
        ({"volume": 0.0}, "volume = 0.0: must be > 0 m3"),
        ({"space": -1.0}, "space = -1.0: must be >= 0 m"),
        ({"acceptable": 0.0}, "acceptable = 0.0: must be > 0 boulders per year"),
        (
            {"acceptable": 0.1},
            "case: acceptable = 0.1 per year: requires &scenario groups with frequencies",
        ),
    ):
        with refused(message):
            site(case, given.pop("line", "road"), **given, **TERRAIN)
    ring = [{"name": "ring", "x": [0.0, 9.0, 0.0, 0.0], "y": [180.0, 180.0, 190.0, 180.0]}]
    with refused("case: line 'ring' has sources on both sides: give the "
                 "direction [degree from north] of its shift"):  # fmt: skip
        site(case.replace(line=ring), "ring", **TERRAIN)


def test_command(place, capsys):
    words = ["site", "case.nml", "--line", "L", "--every", "10", "--to", "30", "--max-height", "9"]
    words += ["--factors", str(FACTORS)]
    assert main([*words, "--max-class", "7", "-o", "out"]) == 0
    said = capsys.readouterr().out
    assert "Best: L" in said and "height at most 9 m, class at most 7" in said
    with open("out/siting.csv") as file:
        rows = list(csv.DictReader(file))
    assert [row["alignment"] for row in rows] == ["L", "L +10 m", "L +20 m", "L +30 m"]
    assert rockfall.read_result("out/siting.nc").sizes["line"] == 4
    text = Path("case.nml").read_text() + Path("out/barrier.nml").read_text()
    (Path("with.nml")).write_text(text)
    assert rockfall.read_case("with.nml").barrier[0]["name"] == "advised barrier"
    pyogrio = pytest.importorskip("pyogrio")
    assert pyogrio.read_info("out/siting.gpkg")["features"] == 4
    assert main([*words, "-o", "out"]) == 2
    assert "already exists" in capsys.readouterr().err
    assert main(["site", "case.nml", "--line", "M", "--factors", str(FACTORS), "-o", "new"]) == 2
    assert "line = 'M': no such line (lines: L)" in capsys.readouterr().err
    assert not (place / "new").exists()
