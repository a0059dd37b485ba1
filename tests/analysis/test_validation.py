# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall validate`: a model agrees with boulders that it generated and disagrees with others; no
verdict where chance may decide. Weights of boulders enter every statistic."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import rockfall
from programs import make_full_case, refuses
from rockfall.analysis.observed.observations import read_observed
from rockfall.analysis.observed.run_out import kolmogorov_smirnov
from rockfall.cli import main
from rockfall.result.crossings import at_lines
from rockfall.studies.model_scenes import AS_GIVEN
from rockfall.studies.models import run_models
from rockfall.studies.study import Study
from rockfall.studies.validation import (
    BEYOND,
    COLUMNS,
    RUN_OUT,
    UNDECIDED,
    WITHIN,
    comparable_numbers,
    validate,
)

OWN = "impact sets, method B"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return make_full_case(tmp_path_factory.mktemp("site"), case={"boulders": 150})


@pytest.fixture(scope="module")
def made(case, tmp_path_factory):
    """Observations from a run with another seed: their folder, the line, and the speeds [m/s]
    there."""
    result = rockfall.run(case.replace(case={"seed": 4711}))
    places = {f"{name}": result[f"stop_{name}"].values for name in "xy"}
    places |= {f"start_{name}": result[f"start_{name}"].values for name in "xy"}
    folder = tmp_path_factory.mktemp("observed")
    pd.DataFrame(places).to_csv(folder / "stops.csv", index=False)
    line = str(result["line_name"].values[0])
    speed = at_lines(result)["line_speed"].values[0]
    speed = speed[np.isfinite(speed)]
    rows = {"line": line, "quantity": "speed", "unit": "m/s", "value": speed}
    pd.DataFrame(rows).to_csv(folder / "speeds.csv", index=False)
    return folder, line, speed


@pytest.fixture(scope="module")
def small(case):
    few = case.replace(case={"boulders": 20})
    few.name = str(Path(case.name).with_name("few.nml"))
    Path(few.name).write_text(few.text(), encoding="utf-8")
    return few


def of(found, law, statistic, line=""):
    table = found.table.set_index(["law", "line", "statistic"])
    return table.loc[law, line, statistic]


@pytest.mark.all
def test_a_law_is_within_the_bounds_of_its_own_boulders(case, made):
    folder, line, speed = made
    seen = read_observed(folder / "stops.csv", folder / "speeds.csv")
    found = validate(case, seen, tables=["meadow"], seeds=3)
    assert list(found.table.columns) == COLUMNS
    assert len(set(found.seeds)) == 3 and case.case["seed"] not in found.seeds
    assert {OWN, "table meadow"} <= set(found.laws)
    for place in ("", line):
        assert of(found, OWN, "mean", place).verdict == WITHIN
        assert of(found, OWN, "std", place).verdict == WITHIN
        assert of(found, OWN, "p", place).simulated > 0.01
        assert (
            of(found, OWN, "wasserstein", place).simulated
            < of(found, "constant", "wasserstein", place).simulated
        )
    mean = of(found, OWN, "mean", line)
    assert mean.observed == pytest.approx(speed.mean())
    assert mean.observed_error == pytest.approx(speed.std() / np.sqrt(speed.size), rel=0.2)
    assert BEYOND in set(found.table.verdict)


@pytest.mark.all
def test_each_law_has_the_name_of_what_it_follows(case, made):
    """A rebound model has the name of its table or ground. A ground of the complete case has
    priority over a table."""
    folder, _, _ = made
    seen = read_observed(folder / "stops.csv")
    named = case.replace(impact={"table": "talus"}, case={"boulders": 5})
    ground = named.replace(surface={"ground": "soft-soil"})
    tables = ["talus", "soft-soil"]
    of_table, of_ground = (validate(one, seen, tables=tables, seeds=2) for one in (named, ground))
    assert of_table.laws[:2] == ("table talus", "impact sets, method B")
    assert of_ground.laws[:2] == ("soft-soil", "impact sets, method B")
    assert of_ground.laws[-1] == "table talus" and of_table.laws[-1] == "table soft-soil"
    for law in "table talus", "soft-soil":
        other = {"soft-soil": "table soft-soil"}.get(law, law)
        assert of(of_ground, law, "mean").simulated == of(of_table, other, "mean").simulated


def test_few_boulders_decide_little(small, made):
    folder, _, _ = made
    some = folder / "some.csv"
    pd.read_csv(folder / "stops.csv").iloc[:6].to_csv(some, index=False)
    found = validate(small, read_observed(some), tables=[], seeds=2)
    assert of(found, OWN, "std").verdict in (UNDECIDED, BEYOND)
    assert of(found, OWN, "mean").verdict == UNDECIDED


def test_printed_numbers_are_compared(small, made, tmp_path):
    _, line, speed = made
    text = f"line,quantity,unit,mean,std,n\n{line},speed,m/s,{speed.mean()},{speed.std()},100\n"
    (tmp_path / "printed.csv").write_text(text)
    found = validate(small, read_observed(tmp_path / "printed.csv"), tables=[], seeds=2)
    assert set(found.table.statistic) == {"mean", "std"}
    assert of(found, OWN, "mean", line).observed_error == pytest.approx(speed.std() / 10)


@pytest.mark.all
def test_the_command_writes_its_table(small, made, tmp_path, capsys):
    folder, _, _ = made
    command = ["validate", small.name, str(folder / "stops.csv"), "--table", "talus"]
    out = tmp_path / "validation.csv"
    out.write_text("of before")
    assert main([*command, "--seeds", "2", "--quiet", "-o", str(out), "--overwrite"]) == 0
    printed = capsys.readouterr().out
    assert "run-out in plan [m]" in printed and "table talus" in printed
    assert list(pd.read_csv(out).columns) == COLUMNS
    assert main([*command, "--quiet", "-o", str(folder / "stops.csv"), "--overwrite"]) == 2


def test_what_cannot_be_compared_is_refused(small, made, tmp_path, capsys, monkeypatch):
    folder, _, _ = made
    monkeypatch.chdir(tmp_path)
    (tmp_path / "apart.csv").write_text("line,quantity,unit,value\nnowhere,speed,m/s,3\n")
    (tmp_path / "marks.csv").write_text("impact,x,y,speed\n1,40,40,3\n")
    printed = f"line,method,quantity,unit,mean,std\n{made[1]},A,speed,m/s,9,1\n"
    (tmp_path / "printed.csv").write_text(printed)
    (tmp_path / "source.csv").write_text("x,y,source\n40,40,east\n60,60,moon\n")
    name, stops = small.name, folder / "stops.csv"
    few = ["--table", "talus", "--seeds", "2"]
    with monkeypatch.context() as patch:
        patch.setattr(Study, "run", lambda *_, **__: pytest.fail("refused after a run"))
        for path, why in (
            ("apart.csv", r"apart.csv.*: line nowhere: is not in the case \(lines: .*\)"),
            ("source.csv", "source.csv: line 2: source = east: not a source of the run, .*"),
            ("marks.csv", ".*: no observation to compare with.*"),
            ("printed.csv", ".*: no observation to compare with.*"),
        ):
            refuses(["validate", name, path, *few], why, capsys)
    refuses(["validate", name, stops, "--seeds", "1"], "--seeds 1: must be at least 2 .*", capsys)
    refuses(["validate", name, stops, "--table", "moon"], ".* no such impact table.*", capsys)


# ---- two-sample test with weights


def test_equal_weights_give_the_test_of_two_samples():
    random = np.random.default_rng(1)
    seen, made = random.normal(size=30), random.normal(0.4, 1.2, 70)
    scipys = stats.ks_2samp(seen, made)
    for weight in (1.0, 3.5):
        found = kolmogorov_smirnov(seen, made, np.full(70, weight))
        assert found == (scipys.statistic, scipys.pvalue)


def test_a_weight_counts_as_that_many_boulders():
    """The statistic is that of boulders repeated by weight, with ties within and between samples; p
    follows from the effective number of boulders."""
    random = np.random.default_rng(2)
    seen, made = random.integers(0, 12, 25) * 1.0, random.integers(0, 15, 40) * 1.0
    share = random.integers(1, 5, 40)
    statistic, p = kolmogorov_smirnov(seen, made, share * 1.0)
    assert statistic == pytest.approx(stats.ks_2samp(seen, np.repeat(made, share)).statistic)
    effective = share.sum() ** 2 / (share**2).sum()
    size = round(25 * effective / (25 + effective))
    assert p == pytest.approx(stats.kstwo.sf(statistic, size))
    assert p > stats.ks_2samp(seen, np.repeat(made, share), method="asymp").pvalue


def test_more_boulders_of_a_source_do_not_move_the_test():
    """A source has ten times as many boulders, each with a tenth of the weight."""
    random = np.random.default_rng(3)
    seen, near, far = random.normal(size=20), random.normal(-1, 1, 30), random.normal(1, 1, 30)
    even = kolmogorov_smirnov(seen, np.concatenate([near, far]), np.ones(60))
    many = np.concatenate([near, np.repeat(far, 10)])
    found = kolmogorov_smirnov(seen, many, np.repeat([1.0, 0.1], [30, 300]))
    assert found[0] == pytest.approx(even[0])
    unweighted = stats.ks_2samp(seen, many).statistic
    assert abs(unweighted - even[0]) > 0.1


@pytest.mark.all
def test_p_of_the_same_distribution_is_uniform():
    """If weights are independent of values, p is below 0.05, 0.2 and 0.5 nearly as often as in
    theory. The number of boulders, used in place of the effective number, would give p < 0.05 in
    more than 15 % of samples."""
    random = np.random.default_rng(4)
    runs, found, naive = 2000, [], 0
    critical = stats.kstwo.isf(0.05, 50)  # 60 * 300 / 360
    for _ in range(runs):
        seen, made = random.normal(size=60), random.normal(size=300)
        share = np.where(random.random(300) < 0.1, 20.0, 0.2)
        statistic, p = kolmogorov_smirnov(seen, made, share)
        found.append(p)
        naive += statistic > critical
    for level in (0.05, 0.2, 0.5):
        error = np.sqrt(level * (1 - level) / runs)
        assert abs(np.mean(np.array(found) < level) - level) < 5 * error + 0.1 * level
    assert naive / runs > 0.15


def test_several_results_count_as_one_site(case, made):
    """A result given twice has twice the boulders: equal statistics, and p at most as large."""
    folder, line, _ = made
    seen = read_observed(folder / "stops.csv", folder / "speeds.csv")
    result = rockfall.run(case)
    once, twice = (comparable_numbers([(result, seen)] * n) for n in (1, 2))
    for key, one in once.items():
        place, quantity, statistic = key
        if statistic not in ("p", "std", "lateral_std"):
            assert twice[key].simulated == pytest.approx(one.simulated), key
        assert twice[key].n == 2 * one.n
    for key in (("", RUN_OUT), (line, "speed")):
        assert twice[*key, "p"].simulated <= once[*key, "p"].simulated
        assert twice[*key, "std"].simulated == pytest.approx(once[*key, "std"].simulated, rel=0.01)
    assert twice["", RUN_OUT, "lateral_std"].simulated > 0


def test_a_part_weighs_as_often_as_it_was_observed(case, made, tmp_path):
    """The mean of two results with different run-outs weights them by their numbers of observed
    boulders, 40 and 10."""
    folder, _, _ = made
    stops = pd.read_csv(folder / "stops.csv")
    stops.iloc[:40].to_csv(tmp_path / "many.csv", index=False)
    stops.iloc[40:50].to_csv(tmp_path / "few.csv", index=False)
    many, few = (read_observed(tmp_path / f"{name}.csv") for name in ("many", "few"))
    result = rockfall.run(case)
    short = rockfall.run(case.replace(surface={"ground": "soil_1"}))
    key = "", RUN_OUT, "mean"
    parts = [comparable_numbers([pair])[key] for pair in ((result, many), (short, few))]
    both = comparable_numbers([(result, many), (short, few)])[key]
    assert both.simulated == pytest.approx((40 * parts[0].simulated + 10 * parts[1].simulated) / 50)
    assert both.observed == pytest.approx((40 * parts[0].observed + 10 * parts[1].observed) / 50)


# ---- named grounds


def with_zones(case, rows):
    """Case with 20 boulders and a zone table of the given rows."""
    path = case.path(case.surface["table"]).with_name("named.csv")
    path.write_text(f"zone,mean_radius,ground\n{rows}")
    return case.replace(surface={"table": path.name}, case={"boulders": 20})


NAMED = "4,{0},soil_0\n-2,{0},rock\n77,,meadow\n"


@pytest.mark.all
def test_tables_hold_where_every_ground_has_a_name(case, made):
    """Tables replace all rebounds, also on named grounds; a note gives the part of the terrain with
    named grounds."""
    seen = read_observed(made[0] / "stops.csv")
    named = with_zones(case, NAMED.format(0.2))
    found = validate(named, seen, tables=["talus", "rocky-slope"], seeds=2)
    assert found.laws[0] == AS_GIVEN and found.laws[-2:] == ("table talus", "table rocky-slope")
    means = {of(found, law, "mean").simulated for law in (AS_GIVEN, *found.laws[-2:])}
    assert len(means) == 3
    (note,) = (note for note in found.notes if note.startswith("all places have a named ground"))
    assert note.endswith(" on 58.3 % of the terrain")
    alone = with_zones(case, NAMED.format(0.2).replace("rock", "talus"))
    one, other = (
        validate(own, seen, tables=["talus"], seeds=2).table.query(f"law == '{law}'")
        for own, law in ((named, "table talus"), (alone, AS_GIVEN))
    )
    assert np.array_equal(one.simulated, other.simulated)


@pytest.mark.all
def test_a_note_says_where_every_law_has_the_same_ground(case, made):
    seen = read_observed(made[0] / "stops.csv")
    part = with_zones(case, "4,0.2,\n-2,0.2,meadow\n77,0.2,\n")
    found = validate(part, seen, tables=["talus"], seeds=2)
    (note,) = (note for note in found.notes if "named grounds" in note)
    assert note in run_models(part).notes
    alone = part.replace(impact={"form": "table", "table": "talus", "sets": None})
    law = validate(alone, seen, tables=[], seeds=2)
    assert law.laws[0] == "table talus"
    one, other = (each.table.query("law == 'table talus'").simulated for each in (found, law))
    assert np.array_equal(one, other)


@pytest.mark.all
def test_tables_take_the_place_of_sets_whatever_keys_these_have(case, made):
    seen = read_observed(made[0] / "stops.csv")
    zones = with_zones(case, "4,0.2,\n-2,0.2,\n77,0.2,\n")
    keyed = zones.replace(impact={"ratio": "nearest", "turning": "to_aspect"})
    one, other = (
        validate(each, seen, tables=["talus"], seeds=2).table.query("law == 'table talus'")
        for each in (keyed, zones)
    )
    assert len(one) and np.array_equal(one.simulated, other.simulated)


def test_laws_that_hold_nowhere_are_refused(case, made):
    seen = read_observed(made[0] / "stops.csv")
    absorbed = with_zones(case, "4,,soil_0\n-2,,soil_0\n77,,soil_0\n")
    with pytest.raises(rockfall.RockfallError) as caught:
        validate(absorbed, seen, tables=["talus"], seeds=2)
    assert str(caught.value).endswith("absorbs boulders, so all models agree")


@pytest.mark.all
@pytest.mark.parametrize("rows", ["named", "none"])
def test_a_table_that_needs_sizes_of_rocks_is_refused_without(case, made, rows):
    """A requested table is refused; among the shipped tables it is omitted, with a note."""
    seen = read_observed(made[0] / "stops.csv")
    bare = with_zones(case, NAMED.format(""))
    if rows == "none":
        surface = {"zones": None, "table": None}
        bare = bare.replace(surface=surface, impact={"form": "table", "table": "talus"})
    with pytest.raises(rockfall.RockfallError) as caught:
        validate(bare, seen, tables=["meadow", "rocky-slope"], seeds=2)
    assert str(caught.value) == (
        f"{bare.name}: --table rocky-slope: requires rock sizes in &surface"
    )
    found = validate(bare, seen, seeds=2)
    assert "table meadow" in found.laws and "table rocky-slope" not in found.laws
    assert "rock sizes are missing: tables rocky-slope omitted" in found.notes
