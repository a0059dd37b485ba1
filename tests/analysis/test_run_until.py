# SPDX-License-Identifier: BSD-3-Clause
"""Runs until a precision is reached: stopping, coverage of intervals, equality with a run."""

import signal

import numpy as np
import pytest
from scipy.stats import norm

import rockfall
from known_law import SAMPLE, lognormal, made, stages, theory
from rockfall.analysis.line_statistics import line_numbers
from rockfall.analysis.precision.intervals import sources
from rockfall.cli import main
from rockfall.kernel_rules import Z
from rockfall.result.crossings import has_crossed
from rockfall.studies import run_until as until
from rockfall.studies.run_until import (
    CROSSED,
    FIRST,
    evaluate,
    next_stage,
    read_rules,
    verdicts_of,
)
from rockfall.text.summary import summary
from scenes import cut_below, make_case, rough, sets

LINE = [{"name": "L", "x": [0.0, 300.0], "y": [280.0, 280.0]}]
NEVER = {"name": "never", "x": [0.0, 10.0], "y": [395.0, 395.0]}


@pytest.mark.family(3)
@pytest.mark.parametrize(
    ("rule", "within"),
    [("fraction@L<3%", 1.0), ("speed.mean@L<1.5%", 1.0), ("speed.q50@L<2.5%", 0.5)],
)
def test_it_stops_within_20_percent_of_theory_and_its_intervals_hold(rule, within):
    """The mean number of boulders is within 20 % of theory. So are all single numbers, or half of
    them for a quantile, because its interval has a random width. `benchmarks.accuracy.intervals`
    has thousands of runs."""
    random = np.random.default_rng(1)
    rules = read_rules(rule, ["L"])
    statistic = rules[0].statistic
    truth, need = theory(statistic, rules[0].limit)
    stops, held = [], []
    for _ in range(10):
        result = stages(rules, random)
        row = line_numbers(result, 0, "speed", sources(result))
        assert (row[f"{statistic}_high"] - row[f"{statistic}_low"]) / 2 <= (
            rules[0].limit * row[statistic] * (1 + 1e-12)
        )
        stops.append(result.sizes["boulder"] / need)
        held.append(row[f"{statistic}_low"] <= truth <= row[f"{statistic}_high"])
    assert abs(np.mean(stops) - 1) < 0.2
    assert np.mean(np.abs(np.array(stops) - 1) <= 0.2) >= within
    assert np.mean(held) >= 0.8  # 10 runs: 2.2 standard errors below 0.95


@pytest.mark.all
def test_heavy_tails_take_no_more_boulders_than_theory_asks():
    """Every stage has new boulders, as with several sources: on average, a run has 1.07 +- 0.15
    times the boulders of theory. The limits of the 95 % quantile are only a few values apart: runs
    stopped by their width were a fifth too long."""
    (rule,) = rules = read_rules("speed.q95@L<12%", ["L"])
    sigma, level = 1.2, 0.95
    density = norm.pdf(norm.ppf(level)) / sigma  # density of the logarithm at the quantile
    need = (Z / rule.limit) ** 2 * level * (1 - level) / density**2
    random, stops = np.random.default_rng(5), []
    for _ in range(40):
        n, larger = 0, 500
        while larger > n:
            n = larger
            result = made(np.exp(random.normal(0, sigma, n)))
            larger = next_stage(evaluate(rules, result), n, 10**6)
        stops.append(n / need)
    assert np.mean(stops) == pytest.approx(1.07, abs=0.15)


@pytest.mark.family(3)
@pytest.mark.parametrize("rule", ["fraction@L<0.7%", "speed.mean@L<1%", "energy_total.std@L<2.5%"])
def test_a_scene_takes_the_boulders_that_its_precision_needs(tmp_path, rule):
    """The number of boulders is within 10 % of the number needed, according to the interval of a
    run five times as long."""
    case = slope_case(tmp_path)
    found = rockfall.run_until(case, rule, **terrain())
    (verdict,) = verdicts_of(found)
    long = 5 * found.sizes["boulder"]
    many = rockfall.run(case.replace(case={"boulders": long}), **terrain())
    (known,) = evaluate(read_rules(rule, ["L"]), many)
    need = long * (known.width / known.rule.limit) ** 2
    assert verdict.met and found.sizes["boulder"] == pytest.approx(need, rel=0.1)


@pytest.mark.family(2)
@pytest.mark.parametrize("of", [2, 5])
def test_runs_of_few_sources_do_not_end_by_luck(of):
    """Few sources may seem alike by chance: even so, no run has less than 0.8 times the boulders
    needed, and at least 85 % of 25 intervals include the mean."""
    random, held = np.random.default_rng(of), []
    rules = read_rules("speed.mean@L<3%", ["L"])
    for _ in range(25):
        n, larger = 0, FIRST // of
        while larger > n:
            n = larger
            result = made(lognormal(random, n * of), np.repeat(np.arange(of), n))
            larger = next_stage(evaluate(rules, result), n, 20_000 // of)
        row = line_numbers(result, 0, "speed", sources(result))
        held.append(row["mean_low"] <= theory("mean", 1)[0] <= row["mean_high"])
        assert result.sizes["boulder"] >= 0.8 * theory("mean", 0.03)[1]
    assert np.mean(held) >= 0.85  # 25 runs: 2.3 standard errors below 0.95


def test_no_interval_is_believed_before_enough_boulders_crossed():
    def rare(random, n):
        return np.where(random.random(n) < 0.1, 5.0 + random.random(n), np.nan)

    result = stages(read_rules("speed.mean@L<50%", ["L"]), np.random.default_rng(2), rare)
    crossed = has_crossed(result, 0).sum()
    assert CROSSED <= crossed <= 1.2 * CROSSED


def test_equal_values_are_met_at_once_and_nobody_never():
    rules = read_rules("speed.mean@L<1%, speed.std@L<1%, speed.q99@L<1%", ["L"])
    assert stages(rules, None, lambda _, n: np.full(n, 7.0)).sizes["boulder"] == FIRST
    nobody = stages(rules, None, lambda _, n: np.full(n, np.nan), cap=50_000)
    assert nobody.sizes["boulder"] == 50_000
    assert all("too few boulders cross" in str(one) for one in evaluate(rules, nobody))


def test_a_number_without_an_interval_is_never_met():
    """A sample of nine places gives no interval, however many boulders it has: the run ends at once
    with a report. A sample of ten places can meet the rule."""
    rules = read_rules("speed.mean@L<90%", ["L"])
    values = 10 + np.random.default_rng(1).random(1800)
    for places in (9, 10):
        (verdict,) = evaluate(rules, made(values, np.arange(1800) % places, SAMPLE))
        assert verdict.met == (places == 10) and np.isnan(verdict.width) == (places == 9)
    assert next_stage([verdict._replace(met=False, need=np.inf)], 200, 10**6) == 200
    (verdict,) = evaluate(rules, made(values, np.arange(1800) % 9, SAMPLE))
    assert "more boulders do not help" in str(verdict)


def test_a_sample_of_sources_that_differ_stops_a_run_that_more_boulders_do_not_help():
    """Sources have speeds of 10 +- 3 m/s, their boulders +- 1 m/s. If the 20 sources are a sample,
    the best precision is 13 %, and a rule of 2 % ends the run. If they are all sources, 2 % is soon
    reached."""
    random = np.random.default_rng(3)
    place = random.normal(10, 3, 20)

    def result(n):
        source = np.repeat(np.arange(20), n)
        return made(place[source] + random.normal(0, 1, source.size), source, SAMPLE)

    rules = read_rules("speed.mean@L<2%", ["L"])
    assert next_stage(evaluate(rules, result(50)), 50, 10**6) > 50  # not yet evident
    (verdict,) = evaluate(rules, result(2000))
    assert verdict.need == np.inf and "do not help" in str(verdict)
    assert next_stage([verdict], 2000, 10**6) == 2000
    (verdict,) = evaluate(rules, result(50).drop_attrs())
    assert verdict.met
    (verdict,) = evaluate(read_rules("speed.mean@L<20%", ["L"]), result(50))
    assert verdict.met


def slope_case(folder, x=(150.0,), line=LINE, **output):
    release = {"x": list(x), "y": [320.0] * len(x)}
    return make_case(folder, *sets(), line=line, terrain={}, release=release, output=output)


def terrain():
    return dict(zip(("dem", "transform"), cut_below(rough(), 260.0), strict=True))


@pytest.mark.parametrize("x", [(150.0,), (130.0, 140.0, 150.0)])
def test_the_result_is_that_of_run_with_as_many_boulders(tmp_path, x):
    maps = ["passages", "energy_max", "energy_mean", "energy_q95", "reach_probability"]
    case = slope_case(tmp_path, x, maps=maps, rebounds=True, trajectories=3)
    rule = "speed.mean@L<0.9%" if len(x) == 1 else "speed.q50@L<2%"
    found = rockfall.run_until(case, rule, **terrain(), cap=5000)
    n = found.attrs["boulders_requested"] // len(x)
    assert n not in (case.case["boulders"], 5000, -(-FIRST // len(x)))  # several stages
    plain = rockfall.run(case.replace(case={"boulders": n}), **terrain())
    assert found.equals(plain)
    own = {"until", "until_met", "date_created", "wall_seconds", "cpu_seconds"}
    for name in found.attrs.keys() - own:
        assert found.attrs[name] == plain.attrs[name], name
    assert found.attrs["until"] == rule and found.attrs["until_met"] == 1
    assert found.attrs["complete"] == 1
    assert found.attrs.keys() - plain.attrs.keys() == {"until", "until_met"}


def test_a_cap_ends_a_run_and_says_what_is_not_met(tmp_path):
    case = slope_case(tmp_path, line=[*LINE, NEVER])
    rules = "speed.mean@L<0.5%, fraction@never<10%, fraction@L<20%"
    found = rockfall.run_until(case, rules, **terrain(), cap=1500)
    assert found.sizes["boulder"] == 1500 and found.attrs["until_met"] == 0
    mean, never, share = verdicts_of(found)
    exact = 1500 * (mean.width / 0.005) ** 2
    assert not mean.met and mean.need == pytest.approx(exact, rel=1e-12)
    assert not never.met and np.isnan(never.need)
    assert share.met
    text = summary(found)
    assert "until speed.mean@L<0.5%: not met" in text and "until fraction@L<20%: met" in text


def test_rules_are_read_with_any_spaces_and_names():
    one, two, three = read_rules(
        " speed.q95 @ a, b <c < 2.5 % ,share@ L<.3%,energy_total.std@L<10%", ["L", "a, b <c"]
    )
    assert (one.line, one.quantity, one.statistic, one.limit) == (1, "speed", "q95", 0.025)
    assert (two.line, two.statistic, two.limit) == (0, "fraction", 0.003)
    assert (three.quantity, three.statistic, three.limit) == ("energy_total", "std", 0.1)


@pytest.mark.parametrize(
    ("rules", "says"),
    [
        ("", "QUANTITY.STATISTIC@LINE<PERCENT%"), ("speed.mean@L<2", "PERCENT%"),
        ("speed.mean@L<2%,", "PERCENT%"), ("speed.mean@L<2%; fraction@L<2%", "unknown line"),
        ("speed.max@L<2%", "statistic 'max' has no interval: must be one of mean, std, q50"),
        ("speed@L<2%", "has no interval"),
        ("spede.mean@L<2%", "unknown quantity 'spede': must be one of speed"),
        ("fraction.mean@L<2%", "or fraction without a statistic"),
        ("speed.mean@M<2%", "unknown line 'M' (lines:"),
        ("speed.mean@L<0%", "above 0 and below 100"), ("speed.mean@L<-2%", "above 0"),
        ("speed.mean@L<100%", "below 100"), ("speed.mean@L<nan%", "a number"),
        ("speed.mean@L<1_0%", "a number"), ("speed.mean@L<%", "a number"),
        ("fraction@L<3%, speed.mean@L<x%", "speed.mean@L<x%"),
    ],
)  # fmt: skip
def test_a_wrong_rule_is_refused_with_what_is_allowed(rules, says):
    with pytest.raises(rockfall.RockfallError) as refused:
        read_rules(rules, ["L"])
    assert says in str(refused.value) and str(refused.value).startswith("until '")


def test_a_case_without_lines_and_a_bad_cap_are_refused(tmp_path):
    with pytest.raises(rockfall.RockfallError, match="unknown line 'L' \\(lines: none\\)"):
        rockfall.run_until(slope_case(tmp_path, line=[]), "fraction@L<2%", **terrain())
    with pytest.raises(rockfall.RockfallError, match="cap = 0: must be at least 1"):
        rockfall.run_until(slope_case(tmp_path), "fraction@L<2%", cap=0, **terrain())


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Work in a folder with a case file on a rough slope."""
    from rockfall.io.rasters.geotiff import write_geotiff

    monkeypatch.chdir(tmp_path)
    write_geotiff("dem.tif", *cut_below(rough(dtype="f4"), 260.0))
    case = slope_case(tmp_path).replace(terrain={"dem": "dem.tif"})
    (tmp_path / "case.nml").write_text(case.text())
    return tmp_path


def test_the_command_writes_warns_and_refuses(place, capsys):
    assert main(["run", "case.nml", "-o", "a.nc", "--until", "fraction@L<5%"]) == 0
    said = capsys.readouterr()
    assert "until fraction@L<5%: met" in said.out and not said.err
    assert rockfall.read_result("a.nc").attrs["until_met"] == 1
    arguments = ["run", "case.nml", "-o", "b.nc", "--quiet", "--cap", "50"]
    assert main([*arguments, "--until", "fraction@L<0.5%"]) == 0
    said = capsys.readouterr()
    assert not said.out and said.err.count("\n") == 1
    assert "warning: --until fraction@L<0.5%: not met" in said.err and "needs about" in said.err
    assert rockfall.read_result("b.nc").sizes["boulder"] == 50
    for wrong in (
        ["--until", "fraction@M<5%"], ["--cap", "5"], ["--until", "fraction@L<5%", "--cap", "0"],
        ["--until", "fraction@L<5%", "--boulders", "9"],
    ):  # fmt: skip
        assert main(["run", "case.nml", "-o", "c.nc", *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert not (place / "c.nc").exists()


def test_ctrl_c_keeps_what_is_done(tmp_path, monkeypatch):
    def interrupted_stage(tally, chunk, interrupted, advance):
        signal.raise_signal(signal.SIGINT)
        run_chunks(tally, 300, lambda: tally.done >= 300, advance)

    run_chunks = until.run_chunks
    monkeypatch.setattr(until, "run_chunks", interrupted_stage)
    with pytest.raises(rockfall.Interrupted) as stop:
        rockfall.run_until(slope_case(tmp_path), "fraction@L<1%", **terrain())
    assert stop.value.result.sizes["boulder"] == 300
    assert stop.value.result.attrs["until_met"] == stop.value.result.attrs["complete"] == 0
