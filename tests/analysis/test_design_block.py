# SPDX-License-Identifier: BSD-3-Clause
"""Design block of a return period: hand calculations, intervals, insufficient surveys."""

import math

import numpy as np
import pytest
from scipy import optimize, stats

import rockfall
from rockfall.analysis.design_block import _Likelihood
from rockfall.cli import main
from rockfall.errors import RockfallError
from rockfall.kernel_rules import Z
from rockfall.scene.releases.frequencies import stated_frequency
from rockfall.tables.design_block import design_block_text, scenario_text
from scenes import make_case, sets

STEPS = np.exp([*np.arange(1, 20) / 10, 4.0])  # [m3]; the logarithms sum to 23
EVENTS = [1.2, 1.5, 2.0, 3.0, 6.0]


def drawn(n, seed=3, shape=0.8):
    """Volumes above 0.5 m3 from a generalised Pareto distribution."""
    return 0.5 + stats.genpareto.rvs(shape, scale=0.6, size=n, random_state=seed)


def survey_file(folder, n=120, dated=12, text=None):
    if text is None:
        years = [str(1985 + 3 * k) for k in range(dated)] + [""] * (n - dated)
        rows = zip(drawn(n), years, strict=True)
        text = "volume,year\n" + "".join(f"{volume:.6g},{year}\n" for volume, year in rows)
    path = folder / "survey.csv"
    path.write_text(text)
    return path


def test_frequency_and_power_law_by_hand():
    """5 blocks above the threshold in 50 years: 0.1 per year. The exponent is b = 20/23, and the
    power law gives a 100-year block of 10**(23/20) m3."""
    found = rockfall.design_block(STEPS, 100, events=EVENTS, years=50, threshold=1.0)
    assert found.rate[:3] == pytest.approx((0.1, 1.6235 / 50, 11.6683 / 50), rel=1e-4)  # Garwood
    assert found.power_law.exponent == pytest.approx(20 / 23)
    assert found.power_law.activity == pytest.approx(0.1)
    row = found.levels.set_index("return_period").loc[100]
    assert row["power_law"] == pytest.approx(14.12538, rel=1e-5)
    low, high = (20 / 23 * stats.chi2.ppf(p, 40) / 40 for p in (0.025, 0.975))
    assert found.power_law[1:3] == pytest.approx((low, high))


def test_the_block_is_the_quantile_of_the_fitted_distribution():
    """V = V_t + sigma/xi ((lambda T)**xi - 1), with the most likely xi and sigma from SciPy."""
    volumes = drawn(200)
    found = rockfall.design_block(volumes, 300, events=drawn(20, 4), years=40, threshold=0.5)
    shape, _, scale = stats.genpareto.fit(volumes - 0.5, 0.8, floc=0)
    assert (found.fit.shape, found.fit.scale) == pytest.approx((shape, scale), rel=1e-3)
    assert found.volume == pytest.approx(0.5 + scale / shape * (150**shape - 1), rel=5e-3)
    assert 1 / (0.5 * stats.genpareto.sf(found.volume - 0.5, *found.fit[2:3], scale=found.fit.scale)
                ) == pytest.approx(300)  # fmt: skip


def test_a_known_power_law_is_found_again():
    """Volumes are quantiles of the power law V**-1.2 above 0.5 m3: the T-year block is 0.5 (lambda
    T)**(1/1.2)."""
    volumes = 0.5 * (1 - (np.arange(4000) + 0.5) / 4000) ** (-1 / 1.2)
    found = rockfall.design_block(volumes, 100, events=drawn(20, 4), years=40, threshold=0.5)
    assert found.volume == pytest.approx(0.5 * 50 ** (1 / 1.2), rel=0.01)
    assert found.power_law.exponent == pytest.approx(1.2, rel=0.01)
    assert found.power_law.p_value > 0.5


def test_the_interval_is_that_of_the_likelihood():
    """At both limits, twice the loss of log-likelihood, from a search over scale and shape, is Z**2
    (1 + 12/n). The frequency follows from the limit and the return period."""
    volumes, T = drawn(40), 100.0
    found = rockfall.design_block(volumes, T, events=drawn(9, 4), years=40, threshold=0.5)
    excess = volumes - 0.5

    def cost(scale, shape, yearly):
        gpd = stats.genpareto.nnlf((shape, 0, scale), excess)
        return gpd + 40 * yearly - 9 * math.log(yearly)

    def constrained(limit):
        def of(place):
            scale, shape = math.exp(place[0]), place[1]
            beyond = stats.genpareto.sf(limit - 0.5, shape, scale=scale)
            return cost(scale, shape, 1 / (T * beyond)) if beyond > 0 else 1e9

        start = [math.log(found.fit.scale), found.fit.shape]
        return optimize.minimize(of, start, method="Nelder-Mead", options={"xatol": 1e-6}).fun

    least = cost(found.fit.scale, found.fit.shape, 9 / 40)
    for limit in found.volume_low, found.volume_high:
        loss = 2 * (constrained(limit) - least)
        assert loss == pytest.approx(Z**2 * (1 + 12 / 40), rel=0.01)
    likelihood = _Likelihood(found.survey, found.fit, found.rate)
    assert likelihood.loss(found.volume - 0.5, T) == pytest.approx(0, abs=1e-3)


@pytest.mark.all
def test_intervals_hold_the_block_of_a_known_distribution():
    """At least 17 of 20 intervals include the true block, and the median ratio of their limits is
    below 12; benchmarks.accuracy.design_block has thousands of surveys."""
    random, held, width = np.random.default_rng(1), 0, []
    true = 0.5 + 0.6 / 0.8 * (37.5**0.8 - 1)
    for _ in range(20):
        dated = max(3, random.poisson(15))
        volumes, events = (drawn(n, random) for n in (80, dated))
        found = rockfall.design_block(volumes, 100, events=events, years=40, threshold=0.5)
        held += found.volume_low <= true <= found.volume_high
        width.append(found.volume_high / found.volume_low)
    assert held >= 17
    assert np.median(width) < 12


def test_the_threshold_rises_above_an_incomplete_part():
    """Blocks below 0.5 m3 are missing in the survey, increasingly with decreasing size."""
    small = 0.5 * np.random.default_rng(1).uniform(size=200) ** 0.3
    volumes = np.concatenate([small, drawn(150)])
    found = rockfall.design_block(volumes, 100, events=[0.11, *drawn(15, 4)], years=40)
    assert 0.3 < found.fit.threshold < 1.5


def test_more_years_or_more_blocks_narrow_the_interval():
    few = rockfall.design_block(drawn(40), 100, events=drawn(5, 4), years=20, threshold=0.5)
    many = rockfall.design_block(drawn(400), 100, events=drawn(50, 4), years=200, threshold=0.5)
    assert many.volume_high / many.volume_low < 0.6 * few.volume_high / few.volume_low


def test_clusters_widen_the_interval_and_are_warned_of(tmp_path):
    even = survey_file(tmp_path, dated=12)
    found = rockfall.design_block(even, years=40, threshold=0.5)
    assert found.rate.dispersion == 1
    text = even.read_text()
    for k in range(12):
        text = text.replace(f",{1985 + 3 * k}\n", f",{1990 if k < 6 else 2010}\n")
    even.write_text(text)
    clustered = rockfall.design_block(even, years=40, threshold=0.5)
    assert clustered.rate.dispersion == pytest.approx((72 / 0.3 - 12) / 39)
    assert clustered.volume == found.volume
    assert clustered.volume_high > found.volume_high
    assert any("clusters" in text for text in clustered.warnings)


def test_doubts_are_warned_of():
    volumes = np.concatenate([drawn(100), np.full(60, 1.0)])
    found = rockfall.design_block(volumes, 1000, events=50 + drawn(9, 4), years=40, threshold=0.5)
    told = "; ".join(found.warnings)
    for doubt in (
        "does not fit above",
        "volumes of dated and undated blocks differ",
        "no date",
    ):
        assert doubt in told
    block = rockfall.design_block(drawn(60), 2500, events=drawn(9, 4), years=40, threshold=0.5)
    assert "extrapolated" in "; ".join(block.warnings)
    assert block.levels["extrapolated"].tolist() == [False] * 4 + [True]
    assert block.volume > drawn(60).max()


def test_boxes_are_their_volume(tmp_path):
    sides = drawn(40) ** (1 / 3)
    rows = "".join(f"{2 * one!r},{one / 2!r},{one!r},x\n" for one in sides.tolist())
    path = survey_file(tmp_path, text=f"a,b,c,note\n{rows}")
    given = {"events": drawn(9, 4), "years": 40, "threshold": 0.5}
    assert rockfall.design_block(path, **given).volume == pytest.approx(
        rockfall.design_block(drawn(40), **given).volume
    )


def test_the_scenario_is_one_of_a_case(tmp_path):
    found = rockfall.design_block(drawn(100), events=drawn(12, 4), years=40, threshold=0.5)
    case = make_case(tmp_path, *sets(), terrain={}, release={"x": [1.0], "y": [1.0]})
    (scenario,) = case.replace(scenario=[found.scenario]).scenario
    law = found.power_law
    expected = 12 / 40 - 1 / law.period(found.scenario["volume_max"])
    assert stated_frequency(scenario, {}) == pytest.approx(expected, rel=1e-3)
    path = tmp_path / "pasted.nml"
    path.write_text(case.text() + scenario_text(found))
    assert rockfall.read_case(path).scenario[0]["activity"] == found.scenario["activity"]
    other = rockfall.design_block(
        drawn(100), events=drawn(12, 4), years=40, threshold=0.5, volume_max=300.0
    )
    assert other.scenario["volume_max"] == 300


GOOD = "volume\n" + "".join(f"{one:.4g}\n" for one in drawn(30))


@pytest.mark.parametrize(
    ("text", "given", "told"),
    [
        ("", {}, "is empty"),
        ("volume,year\n", {}, "no rows"),
        ("size,year\n1,2000\n", {}, "columns volume or a, b, c are missing"),
        ("volume,a,b,c\n1,1,1,1\n", {}, "cannot be combined"),
        ("volume,volume\n1,1\n", {}, "occurs twice"),
        ("volume,year,date\n1,2000,2000-01-01\n", {}, "year and date cannot be combined"),
        ("volume,year\n-1,2000\n", {}, "line 2: volume = -1: must be a number >= 1e-06"),
        ("volume,year\n0,2000\n", {}, "volume = 0"),
        ("volume,year\nnan,2000\n", {}, "volume = nan"),
        ("volume,year\n1e300,2000\n", {}, "volume = 1e300"),
        ("volume,year\n,2000\n", {}, "volume = : must be a number"),
        ("a,b,c\n1,1,0\n", {}, "c = 0"),
        ("volume,year\n1,about 1990\n", {}, "must be a year such as 1987"),
        ("volume,year\n1,1990-02-30\n", {}, "must be a year such as 1987"),
        ("volume,year\n1\n", {}, "has 1 columns, but the header has 2"),
        (GOOD, {}, "dated blocks are missing"),
        ("volume,year\n1,1990\n1,2000\n", {"years": 9.0}, "must be >= 10"),
        (None, {"years": None}, "years is missing: give"),
        (None, {"years": -1.0}, "years = -1"),
        (None, {"years": math.nan}, "years = nan"),
        (None, {"events": [1.0]}, "cannot be combined with events"),
        (None, {"return_period": 0.0}, "return_period = 0"),
        (None, {"return_period": 1.0}, "below the threshold"),
        (None, {"return_period": 1e6}, "support return periods"),
        (None, {"threshold": math.inf}, "threshold = inf"),
        (None, {"threshold": 4.0}, "larger than 4 m3, 20 needed"),
        (None, {"volume_max": 0.1}, "m3, the largest surveyed block"),
        (None, {"volume_max": 5.0, "return_period": 300.0}, "m3, the largest surveyed block"),
        (GOOD, {"events": drawn(9, 4), "volume_max": 7.0, "return_period": 300.0, "threshold": 0.6},
            "m3, the block of 300 years"),
        (None, {"years": 1987.0}, "is a calendar year: give the length of the observation"),
        ("volume,year\n1,2187\n", {}, "year = 2187: is in the future"),
        ("volume,date\n1,2187-01-01\n", {}, "date = 2187-01-01: is in the future"),
        ("a,b,c\n120,80,60\n", {}, "a = 120: must be a number >= 0.001 and <= 50"),
        ("a,b,c\n50,48,47\n", {}, "a x b x c must be <= 100000 m3, with axes in metres"),
        ("a,b,c\n1200,800,600\n", {}, "a = 1200"),
        ("volume,year\n800000,2000\n", {}, "volume = 800000"),
        (GOOD, {"events": [8e5]}, "volume = 800000: must be >= 1e-06 and <= 100000 m3"),
        (GOOD, {"events": [1.0, 2.0]}, "2 dated blocks, 3 needed"),
        (GOOD, {"events": [0.1, 1.0, 2.0], "threshold": 0.5}, "2 dated blocks are larger than 0.5"),
        (GOOD, {"events": [[1.0]]}, "must be a table"),
        (GOOD, {"events": [1.0, -2.0]}, "volume = -2"),
        ("volume\n" + "1\n" * 50, {"events": [1.0] * 5}, "no threshold gives an acceptable"),
        ("volume\n" + "1\n" * 50, {"events": [1.0] * 5, "threshold": 0.5}, "end too sharply"),
    ],
)  # fmt: skip
def test_what_no_survey_bears_is_refused_in_one_line(tmp_path, text, given, told):
    path = survey_file(tmp_path, text=text)
    with pytest.raises(RockfallError) as refusal:
        rockfall.design_block(path, **{"years": 40.0} | given)
    assert told in str(refusal.value)
    assert "\n" not in str(refusal.value)


DATES = [1985.0 + 3 * k for k in range(12)]


@pytest.mark.parametrize(
    ("factor", "years", "dates", "told"),
    [
        (1000.0, 40.0, DATES, "are volumes in dm3 or kg"),
        (2700.0, 40.0, DATES, "are volumes in dm3 or kg"),
        (
            1.0,
            480.0,
            DATES,
            "all dated blocks fell within 33 of 480 years: is the observation",
        ),
        (1.0, 40 * 365.25, DATES, None),  # refused: above the maximum
        (1.0, 480.0, None, "an observation period of 480 years: is the value in months?"),
        (1.0, 40.0, DATES, ""),
        (1.0, 60.0, DATES, ""),
        (10.0, 40.0, DATES, ""),
    ],
)
def test_units_of_a_survey_are_questioned(tmp_path, factor, years, dates, told):
    """An unlikely unit of volume or time gives one question of at most 25 words; more than 10,000
    years are rejected."""
    volumes = [f"{factor * one:.6g}" for one in drawn(120)]
    rows = [f"{one},{dates[k] if dates else 1990:.0f}" for k, one in enumerate(volumes[:12])]
    rows = rows if dates else [row.partition(",")[0] + "," for row in rows]
    path = survey_file(
        tmp_path, text="volume,year\n" + "\n".join([*rows, *(f"{one}," for one in volumes[12:])])
    )
    given = {} if dates else {"events": [factor * one for one in drawn(12, 4)]}
    if told is None:
        with pytest.raises(RockfallError, match="years = 14610: must be > 0 and <= 10000"):
            rockfall.design_block(path, years=years, **given)
        return
    warned = rockfall.design_block(path, years=years, **given).warnings
    questions = [line for line in warned if line.endswith("?")]
    assert len(questions) == (told != "") and all(told in line for line in questions)
    assert all(len(line.split()) <= 25 for line in questions)


def test_whole_numbers_are_questioned():
    volumes = np.ceil(10 * drawn(60) ** 0.5)
    found = rockfall.design_block(volumes, 30, events=volumes[:9], years=40, threshold=9.5)
    assert "all volumes are whole numbers of m3: are they in dm3 or kg?" in found.warnings


def test_the_command_prints_and_writes(tmp_path, capsys):
    path, sheet = survey_file(tmp_path), tmp_path / "sheet"
    command = ["design", "--return-period", "100", "--blocks", str(path), "--years", "40"]
    assert main([*command, "-o", str(sheet)]) == 0
    shown = capsys.readouterr().out
    found = rockfall.design_block(path, years=40)
    assert design_block_text(found) in shown
    assert scenario_text(found) in (sheet / "design_block.nml").read_text()
    assert "return_period,volume,volume_low" in (sheet / "design_block.csv").read_text()
    assert main([*command, "-o", str(sheet)]) == 2
    assert "already exists" in capsys.readouterr().err
    assert main([*command, "-o", str(sheet), "--overwrite"]) == 0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--return-period", "100"], "requires --blocks"),
        (["--return-period", "100", "--blocks", "none.csv"], "none.csv: no such file"),
        (["out.nc", "--return-period", "100", "--blocks", "s.csv"], "not results"),
        (["--return-period", "100", "--blocks", "s.csv", "--standard", "ONR"], "--standard cannot"),
        (["out.nc", "--years", "40"], "--years requires --return-period"),
        (["out.nc", "--volume-max", "4"], "--volume-max requires --return-period"),
        ([], "OUT.nc is required, or --return-period"),
    ],
)
def test_options_of_the_other_mode_are_refused(words, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["design", *words]) == 2
    assert told in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
