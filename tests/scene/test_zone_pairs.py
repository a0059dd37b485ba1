# SPDX-License-Identifier: BSD-3-Clause
"""Zones and complete cases with a strength and relief of their own: runs equal those with the same
values in a ground table."""

import csv
import re

import numpy as np
import pytest

import rockfall
from made import make_layer
from programs import find_program, make_full_case, run_program, same_results
from rockfall.errors import RockfallError
from rockfall.evidence import only
from rockfall.grounds import GroundTable, shipped_grounds
from rockfall.html_report.inputs import zone_table
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.simulation.parts.merge import join
from rockfall.studies.model_scenes import by_tables, variants

HEAD = "zone,mean_radius,ground,ground_strength,ground_relief\n"
PAIRS = {"talus": {"strength": 3e5, "relief": 12.5}, "meadow": {"relief": 15.0}}
ROWS = "4,0.3,talus,3e5,12.5\n-2,0.3,meadow,,15\n"
NAMES = ["talus (300000 Pa, 12.5 degrees)", "meadow (15 degrees)"]
SHIPPED = GroundTable(shipped_grounds())


@pytest.fixture
def case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    case = make_full_case(tmp_path, case={"boulders": 10})
    return case.replace(line=case.line[:1], surface={"table": "pairs.csv"})


def write_pairs(case, rows=ROWS, head=HEAD):
    (case.folder / "pairs.csv").write_text(head + rows)
    return case


def by_table(case, pairs=PAIRS):
    """Case whose ground table has the strengths and reliefs of `pairs`."""
    columns = [*next(iter(SHIPPED.rows.values())).cells]
    with open(case.folder / "grounds.csv", "w", newline="") as file:
        table = csv.DictWriter(file, columns)
        table.writeheader()
        for name, pair in pairs.items():
            cells = SHIPPED.rows[name].cells
            table.writerow({**cells, **{key: f"{value:.17g}" for key, value in pair.items()}})
    (case.folder / "named.csv").write_text("zone,mean_radius,ground\n4,0.3,talus\n-2,0.3,meadow\n")
    return case.replace(surface={"table": "named.csv", "ground_table": "grounds.csv"})


def same_runs(one, other):
    for name in set(other.variables) - {"ground"}:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_a_zone_is_the_ground_of_a_table_with_its_numbers(case):
    """Runs with values in zones and in a ground table are bit-identical; talus keeps the spread of
    its strength and its rest angle."""
    one, other = rockfall.run(write_pairs(case)), rockfall.run(by_table(case))
    assert one["ground"].values.tolist() == NAMES
    same_runs(one, other)
    assert (one["rebounds_by_ground"] > 0).all()
    assert rockfall.ground_strength(one).std() > 0
    plain = write_pairs(case, "4,0.3,talus,,\n-2,0.3,meadow,,\n")
    assert not np.array_equal(rockfall.run(plain)["stop_x"], one["stop_x"])


def test_polygons_and_frames_give_it_too(case):
    geopandas = pytest.importorskip("geopandas", reason="the test extra is not installed")
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    grid = read_scene(write_pairs(case)).grid
    edge = grid.west + 25 * grid.cell
    shapes = [
        shapely.box(grid.west, grid.south, edge, grid.north),
        shapely.box(edge, grid.south, grid.east, grid.north),
    ]
    columns = {
        "mean_radius": [0.3, 0.3], "ground": ["talus", "meadow"],
        "ground_strength": [3e5, np.nan], "ground_relief": [12.5, 15.0],
    }  # fmt: skip
    table = rockfall.run(case)
    make_layer("ground.gpkg", shapes, **columns)
    polygons = case.replace(surface={"zones": "ground.gpkg", "table": None})
    layer = rockfall.run(polygons)
    frame = geopandas.GeoDataFrame(columns, geometry=shapes, crs="EPSG:32632")
    for other in layer, rockfall.run(case, zones=frame):
        assert other["ground"].values.tolist() == NAMES
        same_runs(other, table)
    (found,) = zone_table(layer)
    assert ("300000", "12.5") in [tuple(row)[-2:] for row in found.rows]


def test_a_zone_without_a_ground_changes_that_of_the_case(case):
    rows = "4,0.3,,3e5,12.5\n-2,0.3,meadow,,15\n"
    one = rockfall.run(write_pairs(case, rows).replace(surface={"ground": "talus"}))
    assert one["ground"].values.tolist() == NAMES
    same_runs(one, rockfall.run(by_table(case)))
    without = write_pairs(case, "4,,2e5\n-2,,3e5\n", "zone,mean_radius,ground_strength\n")
    scene = read_scene(without.replace(surface={"ground": "meadow"}))
    assert [rule.name for rule in scene.grounds] == ["meadow (200000 Pa)", "meadow (300000 Pa)"]
    assert [rule.plane.ground.strength for rule in scene.grounds] == [2e5, 3e5]


@pytest.mark.all
@pytest.mark.skipif(not find_program(), reason="no rockfall-batch")
def test_the_standalone_program_gives_the_same_bits(case):
    prepare(write_pairs(case), "ready")
    done = run_program("ready/case.nml", "--quiet", "-o", "a.part1of1", cwd=case.folder)
    assert done.returncode == 0, done.stderr
    same_results(join(["a.part1of1"]).dataset(), rockfall.run(case))


BAD = {
    "talus,500,": "ground_strength = 500: must be 1000 to 1e+09",
    "talus,,46": "ground_relief = 46: must be 0 to 45",
    "talus,,-1": "ground_relief = -1: must be 0 to 45",
    "talus,soft,": "ground_strength = soft: must be a number",
    "talus,inf,": "ground_strength = inf: must be a number",
    "road,2e5,": "ground_strength = 200000: is not valid for ground 'road': only for rock, "
    "compact, talus, meadow, vegetated-soil, soft-soil",
    ",2e5,": "ground_strength = 200000: is not valid for ground 'sets.nml': only for ",
    "rocky-slope,,12": "ground_relief = 12: is not valid for ground 'rocky-slope': only for ",
    "mud,2e5,": "ground = 'mud': is not a ground of grounds.csv",
}


@pytest.mark.parametrize("row", BAD)
def test_what_a_zone_cannot_give_is_refused(case, row):
    with pytest.raises(RockfallError) as caught:
        read_scene(write_pairs(case, f"4,0.3,{row}\n-2,0.3,,,\n"))
    message = str(caught.value)
    assert message.startswith(f"{case.folder / 'pairs.csv'}: line 2: {BAD[row]}")


def test_numbers_beyond_the_tables_are_remarked(case):
    """A remark reports values outside the impact tables, where the nearest table is used; shipped
    grounds are inside."""
    scene = read_scene(write_pairs(case, "4,0.3,talus,,25\n-2,0.3,meadow,3000,5\n"))
    said = [remark for remark in scene.remarks if "impact tables" in remark]
    assert [remark.partition(": ground ")[2] for remark in said] == [
        "'talus (25 degrees)': relief 25 is outside the impact tables (7 to 22 degrees), "
        "so the nearest is used",
        "'meadow (3000 Pa, 5 degrees)': relief 5 is outside the impact tables (7 to 22 degrees), "
        "so the nearest is used",
        "'meadow (3000 Pa, 5 degrees)': strength 3,000 Pa is below all impact tables, "
        "so the softest is used",
    ]
    for name in SHIPPED.yielding:
        rows = f"4,0.3,{name},,\n-2,0.3,,,\n"
        assert "thrown" not in "".join(read_scene(write_pairs(case, rows)).remarks), name


def test_models_keep_the_ground_of_a_zone_with_numbers_of_its_own(case):
    """Models vary the ground of the case outside of the zone only."""
    own = "talus (300000 Pa)"
    for ground, kept in (("", {own}), ("talus", {own})):
        zoned = write_pairs(case, f"4,0.3,{ground},3e5,\n-2,0.3,,,\n")
        scenes = dict(variants(zoned.replace(surface={"ground": "talus"}), ["road"], []))
        names = {rule.name for rule in scenes["road"].grounds}
        assert names == {"road", *kept}


# ---- values of a complete case


OWN = {"ground_strength": 3e5, "ground_relief": 12.5}
NO_ZONES = {"zones": None, "table": None}


@pytest.mark.family(2)
@pytest.mark.parametrize("groups", [
    {"surface": {"ground": "talus"}}, {"impact": {"form": "table", "table": "talus", "sets": None}},
], ids=["ground", "table"])  # fmt: skip
def test_a_case_has_the_numbers_of_a_row_everywhere(case, groups):
    usual = case.replace(**groups)
    one = rockfall.run(usual.replace(surface=NO_ZONES | OWN))
    rows = by_table(case, {"talus": PAIRS["talus"]})
    named = rows.replace(surface=NO_ZONES | {"ground": "talus"})
    assert one["ground"].values.tolist() == NAMES[:1]
    same_runs(one, rockfall.run(named))
    relief = usual.replace(surface=NO_ZONES | {"ground_relief": 12.5})
    assert rockfall.run(relief)["ground"].values.tolist() == ["talus (12.5 degrees)"]


def test_zones_that_name_no_ground_have_them(case):
    """A zone without a named ground has that of the case, with the case's strength and relief or
    its own. A named ground has neither."""
    write_pairs(case, "4,0.3,,,14\n-2,0.3,talus,,\n")
    scene = read_scene(case.replace(surface={"ground": "talus"} | OWN))
    assert [rule.name for rule in scene.grounds] == ["talus (300000 Pa, 14 degrees)", "talus"]
    assert [rule.plane.ground.strength for rule in scene.grounds] == [3e5, 0.15e6]
    write_pairs(case, "4,0.3,,,\n-2,0.3,meadow,,\n")
    scene = read_scene(case.replace(surface={"ground": "talus"} | OWN))
    assert [rule.name for rule in scene.grounds] == [NAMES[0], "meadow"]


@pytest.mark.all
@pytest.mark.skipif(not find_program(), reason="no rockfall-batch")
def test_the_standalone_program_has_them_too(case):
    whole = case.replace(surface=NO_ZONES | {"ground": "talus"} | OWN)
    prepare(whole, "ready")
    done = run_program("ready/case.nml", "--quiet", "-o", "a.part1of1", cwd=case.folder)
    assert done.returncode == 0, done.stderr
    same_results(join(["a.part1of1"]).dataset(), rockfall.run(whole))


@pytest.mark.parametrize("surface, said", [
    ({"uniform_mean_radius": 0.2, "ground_strength": 3e5},
     "&surface ground_strength = 300000.0: is only valid with ground, or &impact table"),
    ({"ground": "talus", "ground_relief": 46.0},
     "&surface ground_relief = 46.0: must be 0 to 45 [degree]"),
    ({"ground": "talus", "ground_strength": 999.0},
     "&surface ground_strength = 999.0: must be 1000 to 1e9 [Pa]"),
])  # fmt: skip
def test_what_a_case_cannot_mean_is_refused(case, surface, said):
    with pytest.raises(RockfallError) as caught:
        case.replace(surface=NO_ZONES | surface)
    assert str(caught.value) == f"{case.name}: {said}"


@pytest.mark.parametrize("ground", ["road", "rocky-slope"])
def test_a_ground_without_strength_is_refused(case, ground):
    surface = NO_ZONES | {"ground": ground, "uniform_mean_radius": 0.3} | OWN
    with pytest.raises(RockfallError) as caught:
        read_scene(case.replace(surface=surface))
    assert str(caught.value) == (
        f"{case.name}: &surface ground_strength = 300000: is not valid for ground '{ground}': only "
        "for rock, compact, talus, meadow, vegetated-soil, soft-soil"
    )


def test_models_vary_it_whole(case):
    """Other models replace the ground of the case and do not use its strength and relief."""
    whole = case.replace(surface=NO_ZONES | {"ground": "talus", "uniform_mean_radius": 0.3} | OWN)
    scenes = dict(variants(whole, ["road"], []))
    grounds = {name: [rule.name for rule in scene.grounds] for name, scene in scenes.items()}
    assert grounds[NAMES[0]] == NAMES[:1]
    assert grounds["impact sets, method B"] == [] and grounds["road"] == ["road"]
    tables = dict(by_tables(whole, scenes[NAMES[0]], ["talus"], []))
    assert [rule.name for rule in tables["table talus"].grounds] == ["talus"]


@pytest.mark.parametrize("boulder", [{"ground_strength_sigma": 0.4}, {"mean_radius_sigma": 0.4}])
def test_models_leave_out_keys_that_they_do_not_use(case, boulder):
    ground = {} if "mean_radius_sigma" in boulder else {"ground": "talus"}
    whole = case.replace(surface=NO_ZONES | {"uniform_mean_radius": 0.3} | ground, boulder=boulder)
    scenes = dict(variants(whole, ["road"], []))
    assert "impact sets, method B" in scenes
    tables = dict(by_tables(whole, read_scene(whole), ["meadow", "rocky-slope"], []))
    keys = {name: scene.case.boulder.get("mean_radius_sigma") for name, scene in tables.items()}
    own = boulder.get("mean_radius_sigma", 0.0)
    assert keys == {"table meadow": 0.0, "table rocky-slope": own}


def test_draws_of_a_shipped_ground_do_not_stand_in_for_it(case):
    """Drawn tables of talus are refused for a ground with its own strength and relief."""
    whole = case.replace(surface=NO_ZONES | {"ground": "talus"} | OWN)
    with pytest.raises(RockfallError, match="talus-ensemble'"):
        rockfall.ensemble(whole.replace(ensemble={"runs": 8, "sets": ["talus-ensemble"]}))


# ---- values without calibration


def between_parts(blocks):
    return only("between-parts", blocks, "passing_too_low", "shipped")


def smoother(scene):
    """Relief [degree] of the additional run that a remark advises, by name of the ground."""
    found = (re.search(r"ground '(.*)': near .* relief of (\S+) degrees", r) for r in scene.remarks)
    return {one[1]: float(one[2]) for one in found if one}


def test_own_grounds_are_said_to_stop_boulders_too_early(case):
    """The advised relief is up to 2 degrees smaller, if there are tables. Shipped grounds are
    calibrated and have no such remark."""
    scene = read_scene(write_pairs(case, "4,0.3,talus,,12.5\n-2,0.3,rock,1e7,11.5\n"))
    assert smoother(scene) == {"talus (12.5 degrees)": 10.5, "rock (10000000 Pa, 11.5 degrees)": 10}
    parts = re.findall(r"ground '(talus|rock) .* up to (\d+) %", "\n".join(scene.remarks))
    assert dict(parts) == {
        name: f"{100 * between_parts(f'compact blocks, {model}').error:.0f}"
        for name, model in {"talus": "ploughed", "rock": "hard"}.items()
    }
    scene = read_scene(write_pairs(case, "4,0.3,talus,,7\n-2,0.3,talus,,13.5\n"))
    assert smoother(scene) == {}
    assert smoother(read_scene(write_pairs(case, "4,0.3,meadow,,\n-2,0.3,soft-soil,,\n"))) == {}
