# SPDX-License-Identifier: BSD-3-Clause
"""Sampled sources: effective number of boulders at a place, and the same frequency and interval in
every product."""

import numpy as np
import pytest

import rockfall
import scenes
from made import make_layer
from rockfall.analysis.objects.at_risk import AtRisk
from rockfall.analysis.precision.clusters import Clusters
from rockfall.analysis.precision.intervals import Sources, fraction_interval
from rockfall.analysis.precision.weighted import Weighted
from rockfall.kernel_rules import count_limits, fraction_limits
from rockfall.limits import MIN_FOR_MEAN
from rockfall.studies.dossier import read_dossier, run_dossier

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

Z = scenes.rough(ny=40, gradient=0.7, relief=0.5)
PLACE = {"dem": Z, "transform": scenes.grid(Z)}
ENDS = "", "_low", "_high"


def sample(sources, each):
    return Sources.of(np.repeat(np.arange(sources), each), sampled=True)


def values(random, sources, each, between):
    """Normal values of boulders, with standard deviation 1 within a source and `between` between
    sources."""
    apart = np.repeat(between * random.normal(size=sources), each)
    return apart + random.normal(size=sources * each)


def at(source, numbers, most=10**9, above=-np.inf):
    boulders = np.flatnonzero(numbers > above)
    return Clusters(source, most).at(boulders, numbers[boulders])


@pytest.mark.parametrize("between", [0.0, 1.0])
def test_it_is_the_largest_design_effect_of_any_level(between):
    source, numbers = sample(40, 25), values(np.random.default_rng(1), 40, 25, between)
    levels = np.sort(numbers[numbers > -1])[: -MIN_FOR_MEAN + 1]
    effects = [numbers.size / source.effective_number(numbers >= level) for level in levels]
    assert at(source, numbers, above=-1) == pytest.approx(max(1, *effects), rel=1e-9)


def test_a_fraction_of_sampled_sources_by_hand():
    """16 of 60 boulders are chosen, from 7 of 12 sources: 6 degrees of freedom (t = 2.446912). With
    fewer than 10 chosen boulders, each source counts as one boulder."""
    source, z, t = sample(12, 5), 1.959964, 2.446912
    chosen = np.array([4, 3, 3, 2, 2, 1, 1, 0, 0, 0, 0, 0])
    holds = np.arange(60) % 5 < np.repeat(chosen, 5)
    p = 16 / 60
    variance = (np.sum((chosen - 5 * p) ** 2) * 12 / 11) / 60**2
    effective = z**2 * p * (1 - p) / (t**2 * variance)
    assert effective == pytest.approx(18.27, rel=1e-3)
    assert source.effective_number(holds) == pytest.approx(effective, rel=1e-6)
    first = np.arange(60) < 5
    assert fraction_interval(holds & first, source) == (4 / 60, *fraction_limits(4 / 60, 12))
    assert fraction_interval(first & ~first, source)[2] == pytest.approx(
        z**2 / (12 + z**2), rel=1e-6
    )


def test_boulders_that_are_alike_in_all_scenarios_count_once():
    """Scenarios share random numbers: three runs of the same 2,000 boulders count as 2,000, not
    6,000."""
    random = np.random.default_rng(4)
    holds = np.tile(random.random(2000) < 0.3, 3)
    pooled = Weighted(np.full(6000, 0.5), np.tile(np.arange(2000), 3))
    alike = pooled.fraction(holds)
    assert alike == pytest.approx((holds.mean(), *fraction_limits(holds.mean(), 2000)), rel=2e-3)
    apart = pooled.fraction(random.random(6000) < 0.3)
    assert apart[2] - apart[1] == pytest.approx((alike[2] - alike[1]) / 3**0.5, rel=0.05)
    one = pooled.quantile(np.tile(random.random(2000), 3), 0.95)
    assert one[2] - one[1] == pytest.approx(2 * 1.96 * (0.95 * 0.05 / 2000) ** 0.5, rel=0.3)


def test_its_bounds():
    random = np.random.default_rng(2)
    source = sample(1000, 20)
    alike = np.repeat(random.normal(size=1000), 20)
    assert at(source, alike, most=20) == 20
    assert 1 <= at(source, values(random, 1000, 20, 0.0)) < 1.6
    few = np.full(20000, -1.0)
    few[: MIN_FOR_MEAN - 1] = 1.0
    assert at(source, few, most=20, above=0) == 20
    assert at(sample(1, 500), random.normal(size=500), most=500) == 500
    assert at(Sources.of(np.repeat(np.arange(9), 9)), alike[:81], most=1) == 1


@pytest.mark.family(2)
@pytest.mark.parametrize("sources", [10, 100])
def test_limits_cover_the_fraction_of_all_sources(sources):
    """In at least 93 % of 200 trials the limits include the true fraction, also for rare boulders
    from 10 sources."""
    random, each, trials = np.random.default_rng(sources), 20, 200
    source = sample(sources, each)
    truth = values(np.random.default_rng(3), 200_000, 1, 1.0)
    for level in (0.5, 2.0):
        inside = 0
        for _ in range(trials):
            numbers = values(random, sources, each, 1.0)
            one = at(source, numbers, most=each)
            count = np.array([np.count_nonzero(numbers > level)], "i4")
            low, high = count_limits(count, numbers.size, one)
            inside += low[0] <= np.mean(truth > level) <= high[0]
        assert inside >= 0.93 * trials


def test_limits_of_places_are_those_of_each():
    counts = np.array([[3, 50], [1, 20]], "i4")
    low, high = count_limits(counts, 100, np.array([1.0, 4.0]))
    for place, effective in ((0, 100), (1, 25)):
        for k in range(2):
            expected = fraction_limits(counts[k, place] / 100, effective)
            assert (low[k, place], high[k, place]) == expected
    assert count_limits(np.zeros((3, 0), "i4"), 100, np.zeros(0))[0].shape == (3, 0)


@pytest.mark.all
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kind", [pytest.param("all", marks=pytest.mark.all), "sample"])
def test_a_frequency_has_one_interval(tmp_path, kind):
    """Hazard, dossier and yearly variants have equal limits at a line; hazard and dossier also at
    an object. With sampled sources, a cluster has fewer boulders than a source."""
    x = np.linspace(60.0, 240.0, 60)
    release = {"x": x.tolist(), "y": [180.0] * x.size, "drop_height": 2.0, "sources": kind}
    line = {"name": "road", "x": [0.0, 300.0], "y": [110.0, 110.0]}
    case = scenes.make_case(tmp_path, *scenes.sets(2.0), release=release, line=[line],
                            case={"boulders": 10})  # fmt: skip
    make_layer(tmp_path / "houses.gpkg", [shapely.box(130, 60, 160, 80)], crs=None, name=["a"])
    scenario = [{"name": "one", "frequency": 1.0},
                {"name": "two", "return_period": 10.0, "volume_mean": 2.0}]  # fmt: skip
    case = case.replace(scenario=scenario, hazard={"thresholds": [1.0, 20.0]})
    found = rockfall.hazard(case, objects=case.path("houses.gpkg"), **PLACE)
    net = {"name": "net", "x": [0.0, 300.0], "y": [20.0, 20.0], "height": 4.0, "class": 3}
    variants = [{"name": "bare", "without": ["barrier"]}, {"name": "net below"}]
    both = case.replace(barrier=[net], variant=variants)
    made = run_dossier(read_dossier(both, AtRisk(tmp_path / "houses.gpkg"), **PLACE))
    tables = [made.frequencies, rockfall.yearly_variants(both, **PLACE).table]
    for name, place in (("line", "road"), ("object", "a")):
        own = {end: float(found[f"{name}_frequency{end}"].sel({name: place})) for end in ENDS}
        assert own["_low"] < own[""] < own["_high"]
        for hazard in made.hazards.values():
            for end in ENDS:
                assert float(hazard[f"{name}_frequency{end}"].sel({name: place})) == own[end]
        curve = rockfall.exceedance(found, place)
        assert curve.iloc[0][["frequency", "low", "high"]].tolist() == [*own.values()]
        period = rockfall.return_period(found, place)
        assert period.low == pytest.approx(1 / own["_high"], rel=1e-12)
        for table in tables[: 2 if name == "line" else 1]:
            rows = table[(table["line"] == place) & (table["statistic"] == "all")]
            for end in ENDS:
                assert (rows[f"value{end}"] == own[end]).all(), end
    per_cluster = found["line_boulders_per_cluster"].values
    assert (per_cluster == 1).all() if kind == "all" else (per_cluster < 10).all()
