# SPDX-License-Identifier: BSD-3-Clause
"""Return levels: fit, coverage of intervals, and refusals."""

import re

import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats

import rockfall
from crossed import STORED, crossed
from known_law import SAMPLE, made
from programs import refuses
from rockfall.analysis.generalised_pareto import fit_gpd
from rockfall.analysis.precision.intervals import Sources
from rockfall.analysis.precision.samples import Values
from rockfall.analysis.return_levels import Level, _profiled, _rising, tail
from rockfall.cli import main
from rockfall.quantities import QUANTITIES as SHOWN
from rockfall.result.crossings import at_lines, masses_of
from rockfall.result.variables import MASS
from rockfall.tables.lines import estimate, rising_estimates
from rockfall.text import lines as lines_text
from rockfall.text.summary import summary
from scenes import grid, make_case, rough, sets


@pytest.mark.parametrize("shape", [-0.4, -0.1, 0.0, 0.3])
@pytest.mark.parametrize("size", [60, 800])
def test_the_fit_is_the_optimum_that_scipy_finds(shape, size):
    excess = np.sort(stats.genpareto.rvs(shape, scale=7e4, size=size, random_state=size))
    fit = fit_gpd(excess, 0.0, 1.0)
    other, _, scale = stats.genpareto.fit(excess / 7e4, shape, floc=0, scale=1)
    assert (fit.shape, fit.scale) == pytest.approx((other, scale * 7e4), rel=0.01, abs=1e-3)
    cost, least = (
        stats.genpareto.nnlf((c, 0, s), excess) for c, s in (fit[2:4], (other, scale * 7e4))
    )
    assert cost <= least + 1e-6


@pytest.mark.all
def test_p_values_are_even_where_the_gpd_holds_and_small_where_not():
    def p_values(draw):
        return np.array([fit_gpd(np.sort(draw(seed)), 0.0, 1.0).p_value for seed in range(250)])

    for shape in (-0.2, 0.2):
        p = p_values(lambda seed, c=shape: stats.genpareto.rvs(c, size=150, random_state=seed))
        assert stats.kstest(p, "uniform").pvalue > 0.001
        assert 0.02 <= np.mean(p < 0.05) <= 0.09
    p = p_values(lambda seed: stats.gamma.rvs(4, size=150, random_state=seed))
    assert np.mean(p < 0.05) > 0.9


MANY, FAR = {"maxiter": 2000}, 1e9  # options of a search, and its cost beyond the support
TAILS = {
    "exponential": stats.expon(10, 3),
    "heavy": stats.genpareto(0.2, 5, 2),
    "bounded": stats.beta(2, 5, 0, 40),
}


SAMPLES = {  # samples whose fitted levels may be below those of the sample
    "uniform": lambda random, n: random.uniform(size=n),
    "steps": lambda random, n: random.integers(0, 40, n).astype(float),
    "two kinds": lambda random, n: (
        np.where(random.uniform(size=n) < 0.01, 5.0, 0.0) + random.uniform(size=n)
    ),
    "bounded": lambda random, n: 40 * random.beta(2, 5, n),
    "edge": lambda random, n: 10 * random.beta(1, 1.2, n),
    "heavy": lambda random, n: 5 + random.pareto(5, n),
    "exponential": lambda random, n: 10 + random.exponential(3, n),
    "rounded": lambda random, n: random.exponential(3, n).round(1),
    "lognormal": lambda random, n: random.lognormal(0, 0.5, n),
    "Weibull": lambda random, n: random.weibull(3, n),
}


@pytest.mark.parametrize("name", SAMPLES)
@pytest.mark.parametrize("size", [1200, 30_000])
def test_levels_and_their_limits_do_not_fall_with_rarity(name, size):
    values = SAMPLES[name](np.random.default_rng(5), size)
    made = tail(values, levels=(100_000, 10_000, 1000, 100, 30)).levels
    given = np.array([made[N][:3] for N in sorted(made) if not made[N].refused])
    assert len(given) and np.all(np.diff(given, axis=0) >= 0)
    assert np.all(given[:, 1] <= given[:, 0]) and np.all(given[:, 0] <= given[:, 2])


def test_a_level_of_the_tail_is_not_below_one_of_the_sample():
    levels = {1000: Level(30.0, 29.0, 31.0), 10_000: Level(29.5, 28.0, 30.5),
              100_000: Level(refused="too long"), 1_000_000: Level(40.0, 28.5, np.inf)}  # fmt: skip
    found = _rising(levels)
    assert found[10_000] == Level(30.0, 29.0, 31.0) and found[100_000].refused == "too long"
    assert found[1_000_000] == Level(40.0, 29.0, np.inf)


def test_levels_as_written_do_not_fall_with_rarity():
    """Rounded by its own wide interval, a level of 24.46 would print as 24, below the 24.4 of a
    shorter return period."""
    row = {"level_1000": 24.4, "level_1000_low": 24.3, "level_1000_high": 24.5,
           "level_10000": 24.46, "level_10000_low": 20.0, "level_10000_high": 31.0,
           "level_100000": 39.9, "level_100000_low": 24.0, "level_100000_high": 60.0}  # fmt: skip
    names = ["level_1000", "level_10000", "level_100000"]
    shown = [cell.number for cell in rising_estimates(row, names, "speed")]
    assert shown == ["24.40", "24.46", "40"]
    assert estimate(row, "level_10000", "speed").number == "24"


def test_intervals_hold_the_levels_of_known_distributions():
    """At least 90 % of about 45 intervals include the level, and the median width is below 0.7 of
    the level. Exact 95 % intervals would fail in one of 20 tests; these enclose the intervals of
    two thresholds and cover more."""
    held, width = [], []
    for law in TAILS.values():
        for seed in range(20):
            found = tail(law.rvs(3000, random_state=seed), levels=(10_000,))
            level = found.levels[10_000]
            if not level.refused:
                held.append(level.low <= law.isf(1e-4) <= level.high)
                width.append((level.high - level.low) / level.value)
                assert level.low <= level.value <= level.high
    assert len(held) >= 40 and np.mean(held) >= 0.9 and np.median(width) < 0.7


def test_the_interval_encloses_that_of_the_highest_threshold():
    values = np.sort(TAILS["exponential"].rvs(10_000, random_state=5))
    found = tail(values, levels=(20_000,))
    sample = Values(values, Sources.alone(values.size))
    highest, alone = (
        _profiled([20_000], sample, found.independent, fit)[20_000]
        for fit in (found.tried[-1], found.fit)
    )
    level = found.levels[20_000]
    assert found.fit != found.tried[-1] and level.value == alone.value
    assert (level.low, level.high) == (
        min(highest.low, alone.low), max(highest.high, alone.high)
    )  # fmt: skip


@pytest.mark.parametrize("law", TAILS)
def test_limits_are_those_of_the_profile_likelihood(law):
    """At a limit, the profile log-likelihood, maximised by a search, is 1.96**2 / 2 (1 + 12/n)
    below its maximum."""
    values, N = np.sort(TAILS[law].rvs(4000, random_state=3)), 20_000
    excess, threshold = values[-150:] - values[-151], values[-151]
    fit = fit_gpd(excess, threshold)
    level = _profiled([N], Values(values, Sources.alone(4000)), 4000, fit)[N]

    def cost(parameters, height):
        shape, scale = parameters[0], np.exp(parameters[1])
        grown = 1 + shape * (height - threshold) / scale
        fraction = grown ** (1 / shape) / N if grown > 0 else 0
        if not 0 < fraction < 1:
            return FAR
        beyond = 150 * np.log(fraction) + 3850 * np.log1p(-fraction)
        return min(FAR, stats.genpareto.nnlf((shape, 0, scale), excess) - beyond)

    best = [fit.shape, np.log(fit.scale)]
    start = [max(0.05, fit.shape), best[1]]
    for height in level.low, level.high:
        found = optimize.minimize(cost, start, height, "Nelder-Mead", tol=1e-9, options=MANY).fun
        loss = found - cost(best, level.value)
        assert loss == pytest.approx(1.96**2 / 2 * (1 + 12 / 150), rel=1e-3)


def test_a_bounded_tail_says_where_it_ends():
    law = stats.genpareto(-0.25, 5, 2)  # range from 5 to 13
    known = [tail(law.rvs(20_000, random_state=k), levels=()).end for k in range(40)]
    assert np.mean([high >= 13 for _, high in known]) >= 0.9
    assert np.mean([high < 20 for _, high in known]) >= 0.9
    assert all(end <= high for end, high in known)
    assert tail(TAILS["heavy"].rvs(20_000, random_state=1), levels=()).end == (np.inf, np.inf)


def test_the_threshold_lies_above_what_is_not_the_tail():
    """Most jumps are low; one in 50 is from a population of high jumps."""
    low, high = stats.expon.rvs(size=19_600, random_state=1), stats.expon(10, 3)
    values = np.append(low, high.rvs(400, random_state=2))
    found = tail(values)
    assert found.fit.threshold > 9 and found.fit.p_value > 0.05
    assert found.tried[0].threshold < 5 and found.tried[0].p_value < 1e-3
    assert found.fit in found.tried and found.fit.exceedances == np.sum(
        values > found.fit.threshold
    )
    level = found.levels[100_000]
    assert level.low <= high.isf(1e-5 / 0.02) <= level.high


def test_levels_have_the_units_of_the_values():
    values, levels = TAILS["exponential"].rvs(5000, random_state=3), (100, 1000, 10_000)
    one, other = tail(values, levels=levels), tail(1000 * values, levels=levels)
    assert tail(values, levels=levels) == one
    for N, level in one.levels.items():
        assert other.levels[N][:3] == pytest.approx([1000 * v for v in level[:3]], rel=1e-3)


def test_a_level_that_many_boulders_exceed_is_that_of_the_sample():
    """30 of 30,000 boulders exceed a level that is a quantile of the sample, even for a
    distribution without a mean. Rarer levels are refused."""
    values = np.abs(stats.cauchy.rvs(size=30_000, random_state=1))
    found = tail(values)
    value, low, high, refused = found.levels[1000]
    assert value == np.quantile(values, 0.999) and refused is None
    assert low < value < high and stats.binomtest(np.sum(values > low), 30_000, 1e-3).pvalue > 0.02
    assert found.refused.startswith("tail too heavy (shape ")
    assert found.levels[10_000].refused == found.refused and np.isnan(found.levels[10_000].value)


random = np.random.default_rng(4)
REFUSED = {
    "none": (np.array([]), "0 independent boulders in the upper 5 %, 50 needed"),
    "one": (np.ones(1), "0 independent .*"),
    "few": (random.normal(size=900), "45 independent boulders in the upper 5 %, 50 needed"),
    "equal": (np.full(5000, 3.0), "ties leave fewer than 50 boulders above a threshold"),
    "steps": (np.round(random.exponential(size=5000), 0), "no suitable threshold|ties leave .*"),
    "end": (random.uniform(size=5000), r"tail ends too sharply \(shape -.*\)|no threshold fits"),
    "heavy": (random.pareto(1, size=5000), r"tail too heavy \(shape .*\)"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_the_data_do_not_bear_is_refused(name):
    values, reason = REFUSED[name]
    found = tail(values, levels=(10_000,))
    assert re.fullmatch(reason, found.refused)
    assert found.levels[10_000].refused == found.refused
    assert np.isnan(found.levels[10_000][:3]).all()


def test_a_far_level_is_refused_alone():
    found = tail(TAILS["exponential"].rvs(5000, random_state=1), levels=(10_000, 60_000))
    assert found.refused is None and found.levels[10_000].refused is None
    assert found.levels[60_000].refused == "more than 10 times the number of boulders"


def test_a_level_that_may_be_anything_is_refused():
    values = stats.genpareto.rvs(0.45, size=1500, random_state=2)
    found = tail(values, levels=(1000, 14_000))
    assert found.refused is None and found.levels[14_000].refused == "may be 3 times as high"


def of_each(number):
    """Sampled sources with five boulders each."""
    return Sources.of(np.repeat(np.arange(number), 5), sampled=True)


def test_boulders_of_a_source_count_as_one_where_they_do_the_same():
    """Each value occurs five times: five times more boulders, but no more information."""
    values = TAILS["exponential"].rvs(3000, random_state=1)
    alone = tail(values, levels=(10_000,))
    many = tail(
        np.repeat(values, 5),
        of_each(3000),
        levels=(10_000,),
    )
    assert many.independent == pytest.approx(3000, rel=0.01)
    assert many.levels[10_000].refused is None
    width = [found.levels[10_000].high - found.levels[10_000].low for found in (alone, many)]
    assert width[1] == pytest.approx(width[0], rel=0.35)
    few = tail(np.repeat(values[:600], 5), of_each(600))
    assert few.refused == "30 independent boulders in the upper 5 %, 50 needed"


# ---- levels of a result


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Result with 8,000 boulders, many of which pass one line and none another."""
    lines = [
        {"name": name, "x": [0.0, 300.0], "y": [y, y]} for name, y in (("L", 280.0), ("M", 399.0))
    ]
    case = make_case(
        tmp_path_factory.mktemp("case"), *sets(), line=lines, case={"boulders": 8000},
        terrain={}, release={"x": 150.0, "y": 380.0},
    )  # fmt: skip
    return rockfall.run(case, dem=rough(), transform=grid(rough()))


def without_lines(result):
    return result.drop_dims(["line", "line_vertex", "crossing"])


def test_the_table_has_the_tail_of_each_quantity(result):
    table = rockfall.return_levels(result).set_index(["line", "quantity"])
    assert len(table) == 12
    energy = (
        at_lines(result)["line_energy_translational"] + at_lines(result)["line_energy_rotational"]
    ).values[0]
    energy = energy[np.isfinite(energy)]
    found, row = tail(energy), table.loc["L", "energy_total"]
    assert (row["n"], row["max"]) == (energy.size, energy.max())
    assert (row["threshold"], row["exceedances"]) == found.fit[:2]
    assert row["shape_low"] < row["shape"] < row["shape_high"]
    for N in (1000, 10_000):
        names = [f"level_{N}{end}" for end in ("", "_low", "_high")]
        assert tuple(row[names]) == pytest.approx(found.levels[N][:3], nan_ok=True)
    assert "1 in 100,000: more than 10 times the number of boulders" in row["refused"]
    none = table.loc["M", "speed"]
    assert none["n"] == 0 and np.isnan(none["max"]) and none["refused"].startswith("0 independent")
    assert rockfall.return_levels(without_lines(result)).empty
    with pytest.raises(rockfall.RockfallError, match=r"levels: 0\.5: must be integers > 1"):
        rockfall.return_levels(result, levels=(0.5,))


def of_all(values, source=None, attrs=None, names=("L",)):
    """Result in which every quantity at the lines has `values`, of shape (lines, boulders) or
    (boulders,)."""
    result = made(np.atleast_2d(values)[0], source, attrs).drop_dims(["line", "crossing"])
    return result.assign(crossed(result["boulder"], names, **dict.fromkeys(STORED, values)))


def test_sources_that_are_a_sample_are_clusters():
    """All 100 boulders of a sampled source behave alike: 60 sources have 3 independent boulders in
    the upper 5 %, too few for levels."""
    speed = np.repeat(TAILS["exponential"].rvs(60, random_state=1), 100)
    table = rockfall.return_levels(of_all(speed, np.repeat(np.arange(60), 100), SAMPLE))
    assert set(table["refused"]) == {"3 independent boulders in the upper 5 %, 50 needed"}


def test_a_table_says_what_was_refused_where_some_is_and_some_is_not():
    """pandas 3 converts None among texts to NaN, pandas 2 does not: every row has a text."""
    values = np.stack([TAILS["exponential"].rvs(3000, random_state=1), np.full(3000, 2.0)])
    result = of_all(values, names=["L", "M"])
    table = rockfall.return_levels(result, levels=(1000,))
    reason = "ties leave fewer than 50 boulders above a threshold"
    assert set(table["refused"]) == {"", reason}
    printed = "\n".join(lines_text._refused(table))
    assert printed.count("refused") == 1 and reason in printed


def test_numbers_of_any_size_stand_in_columns_of_their_own(capsys, tmp_path, result):
    many = result.assign(mass=("boulder", 1e4 * masses_of(result), MASS["mass"]))
    rockfall.write_result(many, tmp_path / "out.nc")
    assert main(["lines", str(tmp_path / "out.nc")]) == 0
    rows = [re.split(r" {2,}", line.strip()) for line in capsys.readouterr().out.splitlines()]
    for head, (first, last) in (("mean", ("speed [m/s]", "E_rot / E_tot [%]")),
                                ("max", ("speed [m/s]", "E_tot [kJ]"))):  # fmt: skip
        at = next(k for k, row in enumerate(rows) if row[0] == head)
        body = rows[at + 1 : at + 17]
        titles = {about.short for about in SHOWN.values()}
        first_of = {}
        for row in body:
            if row[0] in titles:
                first_of.setdefault(row[0], row)
        named = [*first_of.values()]
        assert named[0][0] == first and last in [row[0] for row in named]
        assert all(len(row) == 1 + len(rows[at]) for row in named)
        alike = re.compile(r"-|-?[0-9][0-9,.]*")
        numbers = [cell for row in named for cell in row[1:]]
        assert any("," in cell for cell in numbers) and all(map(alike.fullmatch, numbers))
        intervals = [row for row in body if "(" in row[0]]
        assert intervals and all(cell.count("(") == 1 for row in intervals for cell in row)


def test_the_command_prints_and_writes_both_tables(result, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rockfall.write_result(result, "out.nc")
    assert main(["lines", "out.nc", "-o", "table.csv"]) == 0
    out, err = capsys.readouterr()
    assert out.endswith("\ntable.csv\ntable_levels.csv\n")
    assert all(line.startswith("rockfall: warning: ") for line in err.splitlines())
    for name, table in (
        ("table", rockfall.line_statistics),
        ("table_levels", rockfall.return_levels),
    ):
        written = pd.read_csv(f"{name}.csv").fillna({"refused": "", "withheld": ""})
        pd.testing.assert_frame_equal(written, table(result), check_dtype=False, rtol=1e-12)
    row = rockfall.return_levels(result).set_index("quantity").loc["jump_height"].iloc[0]
    level = estimate(row, "level_1000", "jump_height")
    shown = rf"^  jump height \[m\] +{row['max']:#.3g} +{level.number} "
    half = row["level_1000_high"] - row["level_1000_low"]
    assert float(level.number) == pytest.approx(row["level_1000"], abs=half / 4)
    assert row["level_1000"] > 0 and re.search(shown, out, re.M)
    assert level.interval in out
    assert "1 in 100,000: more than 10 times the number of boulders" in out
    assert "\nM: 0 of 8,000 boulders, 0.00 % (0.00–0.05)\n" in out  # 1.96^2 / (8000 + 1.96^2)
    assert re.search(r"^  M +0 +0\.00\n +\(0\.00–0\.05\)$", summary(result), re.M)
    assert max(map(len, out.splitlines())) <= 120, sorted(out.splitlines(), key=len)[-3:]


HOSTILE = {
    "no lines": (["bare.nc"], "bare.nc: has no evaluation lines"),
    "onto the result": (
        ["out.nc", "-o", "out.nc"],
        "out.nc: output name must end in .csv",
    ),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_bad_input_is_one_line_and_nothing_is_written(name, result, tmp_path, monkeypatch, capsys):
    words, message = HOSTILE[name]
    monkeypatch.chdir(tmp_path)
    rockfall.write_result(result, "out.nc")
    rockfall.write_result(without_lines(result), "bare.nc")
    refuses(["lines", *words], message, capsys)
