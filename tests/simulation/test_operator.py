# SPDX-License-Identifier: BSD-3-Clause
"""Default rebound model of a case, and what the name of a ground means."""

from pathlib import Path

import numpy as np
import pytest

import rockfall
from made import refused
from programs import refuses
from rockfall.case import given_groups
from rockfall.errors import RockfallError
from rockfall.grounds import draws_of, ensemble_grounds
from rockfall.grounds.impact_tables import plane_files
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible
from rockfall.studies.ensemble.uncertain_inputs import Uncertain
from same import same, same_numbers
from scenes import case_in, grid, place, rough, sets, write_sets

SIZE = {"uniform_mean_radius": 0.25}


def case_of(impact, surface=SIZE):
    return rockfall.Case(
        case={"boulders": 20}, terrain={"dem": "dem.tif"}, surface=surface, impact=impact,
        boulder={"volume_mean": 0.8}, **place(),
    )  # fmt: skip


def run(case):
    z = rough()
    return rockfall.run(case, dem=z, transform=grid(z))


@pytest.mark.parametrize(
    "impact, form",
    [
        ({}, "matrix"),
        ({"sets": "mine.nml"}, "matrix"),
        ({"table": "meadow"}, "table"),
        ({"form": "table"}, "table"),
        ({"form": "table", "sets": "mine.nml", "table": "meadow"}, "table"),
        ({"form": "matrix", "sets": "mine.nml", "table": "meadow"}, "matrix"),
    ],
)
def test_what_a_case_names_it_follows(impact, form):
    case = case_of(impact)
    assert case.impact["form"] == form
    assert case_of(given_groups(case).get("impact", {})) == case


def test_both_without_a_form_are_refused(tmp_path, monkeypatch, capsys):
    says = "&impact sets, table: give only one, or choose with form = 'matrix' or 'table'"
    with refused(f"case: {says}"):
        case_of({"sets": "mine.nml", "table": "meadow"})
    monkeypatch.chdir(tmp_path)
    text = case_of({}).text().replace("form = 'matrix'", "")
    (tmp_path / "case.nml").write_text(text)
    refuses(["check", "case.nml"], f"case.nml: {says}".replace("(", r"\("), capsys)


def test_a_change_brings_its_form():
    table, matrix = case_of({"table": "meadow"}), case_of({"sets": "mine.nml"})
    both = {"sets": "mine.nml", "table": "meadow"}
    assert table.replace(impact={"sets": "mine.nml"}) == case_of({"form": "matrix"} | both)
    for change in ({"table": "meadow"}, {"form": None, "table": "meadow"}):
        assert matrix.replace(impact=change) == case_of({"form": "table"} | both)
    assert table.replace(impact={"table": None}) == matrix.replace(impact={"sets": None})
    assert case_of({"form": "table"}).replace(impact={"form": None}) == case_of({})
    for case in table, matrix:
        with pytest.raises(RockfallError, match="give only one, or choose with form"):
            case.replace(impact={"sets": "laboratory-spheres", "table": "talus"})
    for case in table, matrix:
        assert case.replace(impact={"stop_speed": 1.0}).impact["form"] == case.impact["form"]


def test_a_named_table_is_the_table_by_form():
    same(run(case_of({"table": "meadow"})), run(case_of({"form": "table", "table": "meadow"})))


def test_a_ground_of_a_table_needs_no_form():
    by_name = run(case_of({}, SIZE | {"ground": "meadow"}))
    same_numbers(by_name, run(case_of({"table": "meadow"})))


def models(folder, surface=(), **impact):
    case = case_in(folder, impact=impact, surface=SIZE | dict(surface), **place())
    scene = read_scene(case, dem=rough(), transform=grid(rough()))
    return [ground.model for ground in scene.grounds]


def uncertain(folder, surface, *names, **impact):
    """Uncertain inputs of a scene for the given names in &ensemble sets."""
    case = case_in(
        folder, surface=SIZE | surface, impact=impact, ensemble={"sets": [*names], "runs": 8},
        **place(),
    )  # fmt: skip
    return Uncertain(read_scene(case, dem=rough(), transform=grid(rough())))


@pytest.mark.parametrize("form", ["matrix", "table"])
@pytest.mark.parametrize(
    ("name", "model"), [("rocky-slope", "ratio_table"), ("laboratory-spheres", "impact_sets")]
)
def test_a_ground_has_a_model_whatever_form_the_case_has(tmp_path, form, name, model):
    assert models(tmp_path, {"ground": name}, form=form) == [model]


def test_rows_of_ones_own_table_come_first(tmp_path):
    (tmp_path / "own.csv").write_text("name,model,r_n,r_t,source\nmeadow,constant,0.3,0.8,mine\n")
    meadow = {"ground": "meadow"}
    assert models(tmp_path, meadow) == ["impact_table"]
    own = meadow | {"ground_table": "own.csv"}
    assert models(tmp_path, own) == ["constant"]
    with refused(
        "case: &ensemble sets = 'meadow-ensemble': has no effect: it replaces the impact "
        "table meadow, which no ground of the case uses: remove it"
    ):
        uncertain(tmp_path, own, "meadow-ensemble")


def test_a_row_and_the_table_of_all_else_may_not_share_a_name(tmp_path):
    """A row of a ground table is refused if it has the name of the case's table, because zones with
    this name would use the table."""
    (tmp_path / "own.csv").write_text("name,model,r_n,r_t,source\nmeadow,constant,0.3,0.8,mine\n")
    (tmp_path / "zones.csv").write_text("zone,mean_radius,ground\n1,0.2,meadow\n2,0.2,\n")
    zones = {"zones": "given", "table": "zones.csv", "ground_table": "own.csv"}
    case = case_in(
        tmp_path, impact={"form": "table", "table": "meadow"}, surface=zones, **place()
    )  # fmt: skip
    ids = np.ones((80, 60), np.int32)
    with refused(
        f"case: &impact: 'meadow' is also a row of {tmp_path / 'own.csv'}: rename the row"
    ):
        read_scene(case, dem=rough(), transform=grid(rough()), zones=ids)
    (tmp_path / "zones.csv").write_text("zone,mean_radius,ground\n1,0.2,road\n2,0.2,\n")
    with (tmp_path / "own.csv").open("a") as file:
        file.write("road,constant,0.4,0.9,mine\n")
    scene = read_scene(case, dem=rough(), transform=grid(rough()), zones=ids)
    assert [ground.model for ground in scene.grounds] == ["impact_table", "constant"]


def test_a_file_of_a_table_is_a_ground(tmp_path):
    (row, *_) = plane_files("ploughed", "compact").values()
    (tmp_path / "own.nc").write_bytes(row.read_bytes())
    assert models(tmp_path, {"ground": "own.nc"}) == ["impact_table"]


def test_sets_and_the_ground_of_a_zone_are_uncertain_together(tmp_path):
    """Each draw is the run with its impact sets and its table."""
    write_sets(tmp_path / "other.nml", *sets(1.5))
    ground = {"ground": "talus"}
    case = case_in(
        tmp_path, surface=SIZE | ground, output={"maps": None}, case={"boulders": 40},
        ensemble={"sets": ["sets.nml", "other.nml", "talus-ensemble"], "runs": 8}, **place(),
    )  # fmt: skip
    inputs = Uncertain(read_scene(case, dem=rough(), transform=grid(rough())))
    rules = [(rule.text, rule.table.ground) for rule in ensemble_grounds(case, "talus-ensemble")]
    assert len({*rules}) == len(draws_of("talus")) > 1
    drawn = [inputs._set(which).arrays for which in range(len(inputs.sets))]
    own = [
        (Path(one["sets"].name).name, (one["grounds"][0].text, one["grounds"][0].table.ground))
        for one in drawn
    ]
    assert own == [(name, rule) for name in ("sets.nml", "other.nml") for rule in rules]


def test_a_table_does_not_stand_in_for_impact_sets(tmp_path):
    """An impact table is refused as an alternative to impact sets."""
    says = "is an impact table, which can only replace an impact table, not laboratory-spheres"
    for others in ([], ["laboratory-spheres"]):
        with refused(f"case: &ensemble sets = 'talus': {says}"):
            uncertain(tmp_path, {}, *others, "talus", sets="laboratory-spheres")


def test_a_name_that_has_no_effect_is_warned_of(tmp_path):
    """Impact sets and tables have no effect, and a warning, next to a ground for the complete case.
    A form alone has no warning."""
    mine = str(write_sets(tmp_path / "mine.nml", *sets(1.5)))
    for key, name in ("table", "unknown"), ("sets", mine):
        scene = read_scene(
            case_of({key: name}, SIZE | {"ground": "meadow"}), dem=rough(), transform=grid(rough())
        )
        said = f"&impact {key} = '{name}': has no effect: rebounds follow meadow"
        assert any(said in text for text in implausible(scene))
    plain = case_of({"form": "table"}, {"ground": "meadow"})
    scene = read_scene(plain, dem=rough(), transform=grid(rough()))
    assert not any("no effect" in text for text in implausible(scene))
