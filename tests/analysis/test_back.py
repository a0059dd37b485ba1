# SPDX-License-Identifier: BSD-3-Clause
"""Back-analysis: known posteriors, data that no run explains, and the command."""

import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rockfall
from made import make_raster
from programs import refuses
from rockfall.analysis.observed.observations import read_observed
from rockfall.cli import main
from rockfall.result.crossings import at_lines
from rockfall.simulation.simulate import simulate
from rockfall.studies.back import study
from rockfall.studies.back.evidence import Counted, Printed, predictive_p
from rockfall.studies.back.posterior import posterior_table, warnings, weighted_quantile
from rockfall.studies.back.sampling import Sampler, effective
from rockfall.studies.back.smoothing import smoothed
from scenes import grid, make_case, rough, sets

stats = pytest.importorskip("scipy.stats")
TERRAIN = rough()
LINE = {"name": "L", "x": [0.0, 300.0], "y": [300.0, 300.0]}


# ---- likelihood


def counted(values, **known):
    return Counted("data", np.asarray(values, float), lambda result: result, **known)


def test_counts_have_the_dirichlet_multinomial_probability():
    """Differences of log-likelihoods between runs are SciPy's; a constant common to all runs is
    left out."""
    data = counted(np.arange(18.0) + 0.5)
    runs = np.array([[30.0, 40, 10, 20, 15, 5], [20, 20, 20, 20, 20, 20]])
    assert data.counts.size == 6 and np.array_equal(data.counts, [3] * 6)
    theirs = [stats.dirichlet_multinomial.logpmf([3] * 6, run + 0.5, 18) for run in runs]
    ours = data.log_likelihood(runs)
    assert ours[1] - ours[0] == pytest.approx(theirs[1] - theirs[0], rel=1e-9)


def test_boulders_on_an_edge_are_half_on_either_side_and_few_runs_explain_nothing():
    data = counted([3.0])
    assert data.edges.tolist() == [3.0] and data.counts.tolist() == [0.5, 0.5]
    assert data.counted(np.array([1.0, 3.0, np.nan])).tolist() == [1.5, 0.5]
    assert data.log_likelihood(np.array([[10.0, 9.0]]))[0] == -np.inf


def test_runs_that_differ_by_more_than_their_boulders_count_as_fewer():
    random = np.random.default_rng(1)
    data = counted(random.standard_normal(50))
    shifts = {"alike": 0.0, "unlike": 0.3}
    for name, shift in shifts.items():
        runs = [data.counted(random.standard_normal(400) + shift * random.standard_normal())
                for _ in range(200)]  # fmt: skip
        data.learn_noise(np.array(runs))
        assert data.worth > 0.7 if name == "alike" else data.worth < 0.1


@pytest.mark.parametrize("kind", ["sample", "printed"])
def test_data_of_the_law_are_explained_and_others_are_not(kind):
    random = np.random.default_rng(2)
    weight = np.full(50, 0.02)
    values = [random.standard_normal(500) for _ in weight]
    p = {}
    for shift in (0.0, 1.0):
        seen = random.standard_normal(40) + shift
        data = (
            counted(seen) if kind == "sample"
            else Printed("data", seen.mean(), seen.std(ddof=1), 40, lambda result: result)
        )  # fmt: skip
        runs = np.array([data.counted(one) for one in values])
        p[shift] = predictive_p(data, runs, weight, random)
    assert p[0.0] > 0.05 > 0.01 > p[1.0]


# ---- sampler


def test_a_normal_posterior_is_found():
    """A normal likelihood, correlated and away from the prior's centre, gives the exact mean and
    covariance of the posterior, within four standard errors."""
    precision = np.array([[9.0, 6.0, 0.0], [6.0, 9.0, 0.0], [0.0, 0.0, 0.0]])
    centre = np.array([1.5, -1.0, 0.0])
    random = np.random.default_rng(3)
    sampler = Sampler(random.standard_normal((256, 3)), np.zeros(3, int))
    new = sampler.points
    for _ in range(5):
        apart = new - centre
        sampler.learn(-np.einsum("ni,ij,nj->n", apart, precision, apart) / 2)
        new = sampler.propose(128, random)
    sampler.learn(-np.einsum("ni,ij,nj->n", new - centre, precision, new - centre) / 2)
    covariance = np.linalg.inv(precision + np.eye(3))
    weight = sampler.weights()
    assert effective(weight) > 200
    mean = weight @ sampler.points
    error = np.sqrt(np.diag(covariance) / effective(weight))
    assert np.all(abs(mean - covariance @ precision @ centre) < 4 * error)
    apart = sampler.points - mean
    found = (weight[:, None] * apart).T @ apart
    spread = np.sqrt(np.diag(covariance))
    close = 4 * np.sqrt(2 / effective(weight)) * np.outer(spread, spread)
    assert np.all(abs(found - covariance) < close)


def test_weighted_quantiles_of_equal_weights_are_those_of_the_sample():
    values = np.random.default_rng(4).permutation(101.0 + np.arange(101))
    found = weighted_quantile(values, np.full(101, 1 / 101), 0.25)
    assert found == pytest.approx(np.quantile(values, 0.25, method="weibull"))


def test_smoothing_takes_the_noise_of_runs_away_and_keeps_what_has_no_order_apart():
    """Log-likelihoods are quadratic in one input, lower by 3 for one of two unordered values, and
    have noise of variance 2. Smoothing removes most of the noise; minus infinity remains."""
    random = np.random.default_rng(5)
    points = random.standard_normal((300, 2))
    true = -2 * (points[:, 0] - 0.5) ** 2 - 3.0 * (points[:, 1] > 0)
    noisy = true + np.sqrt(2) * random.standard_normal(300)
    noisy[7] = -np.inf
    found = smoothed(points, np.array([0, 2]), noisy)
    assert found[7] == -np.inf
    near = (true > -5) & np.isfinite(noisy)
    assert np.std((found - true)[near]) < 0.4  # standard deviation without smoothing: 1.4


# ---- a case


@pytest.fixture(scope="module")
def found(gallery):
    """Back-analysis of rocks of 0.5 m, with a prior median of 0.25 m and a factor of 2; the volume
    is nearly known."""
    return gallery.value("back", sought)


def sought(folder):
    release = {"x": 150.0, "y": 380.0, "drop_height": 5.0}

    def case(boulders, seed, **groups):
        run = {"boulders": boulders, "threads": 1, "seed": seed}
        return make_case(
            folder, *sets(), line=[LINE], terrain={}, release=release, case=run, **groups
        )

    how = {"dem": TERRAIN, "transform": grid(TERRAIN)}
    truth = rockfall.run(case(40, 77, surface={"uniform_mean_radius": 0.5}), **how)
    stops = np.column_stack([truth["stop_x"], truth["stop_y"]])
    speed = at_lines(truth)["line_speed"].values[0]
    seen = replace(
        read_observed(), stops=stops, samples={("L", "speed"): speed[np.isfinite(speed)]},
        lines={"L": "made"},
    )  # fmt: skip
    uncertain = {"radius_factor": 2.0, "volume_factor": 1.02}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "ROUND", 64)
        return study.back_analysis(
            case(300, 5, ensemble=uncertain), seen, members=192, enough=30, **how
        )


@pytest.mark.all
def test_the_truth_is_in_the_posterior_and_the_data_are_explained(found):
    table = posterior_table(found).set_index("parameter")
    rocks, volume = table.loc["R_m [m]".split(" ")[0]], table.loc["volume, mean"]
    assert rocks["q05"] < 0.5 < rocks["q95"] and rocks["verdict"] == "informed"
    assert rocks["prior_median"] == 0.25 and rocks["ratio"] < 0.7
    assert 0.6 < volume["ratio"] < 1.4 and volume["verdict"] != "informed"
    assert not any("does not explain" in one for one in warnings(found))
    assert set(found.data["data"]) == {"stopping distance", "lateral offset", "speed at L"}
    assert found.weight.sum() == pytest.approx(1)


@pytest.mark.all
def test_too_few_members_leave_it_undecided_and_the_edge_is_said(found):
    few = replace(found, asked=190)
    assert any(one.startswith("undecided: ") for one in warnings(few))
    assert posterior_table(few)["verdict"].iloc[0] == "undecided"
    beyond = found.members["radius_1"] > 2.0**1.7
    weight = np.where(beyond, 1.0, 0.0) / beyond.sum()
    edge = replace(found, members=found.members.assign(weight=weight))
    assert any("which may be too narrow: R_m" in one for one in warnings(edge))


# ---- the command


CASE = """&case title = 'Slope', boulders = 60, seed = 7, threads = 1 /
&terrain dem = 'dem.tif' /
&surface uniform_mean_radius = 0.25 /
&impact sets = 'laboratory-spheres' /
&boulder volume = 'fixed', volume_mean = 0.8, density = 2800.0 /
&release x = 600060.0, y = 4999980.0, drop_height = 2.0 /
&line name = 'L', x = 600000.0, 600120.0, y = 4999960.0, 4999960.0 /
&ensemble runs = 8, radius_factor = 1.5, source_shift = 1.0 /
"""
SPEEDS = "line,quantity,unit,value\n" + "".join(f"L,speed,m/s,{v}\n" for v in range(4, 12))


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study, "ROUND", 16)
    z = (1100 - 0.9 * np.arange(30)[:, None] * 5.0 + np.zeros(24)).astype("f4")
    make_raster("dem.tif", z, nodata=-9999)
    Path("case.nml").write_text(CASE)
    Path("seen.csv").write_text(SPEEDS)


@pytest.mark.all
def test_the_posterior_is_what_an_ensemble_draws(place, capsys):
    Path("out").mkdir()
    Path("out/case.nml").write_text("of before")
    words = ["back", "case.nml", "seen.csv", "-o", "out", "--members", "32", "--effective", "2"]
    assert main([*words, "--overwrite"]) == 0
    printed = capsys.readouterr().out
    assert "R_m [m]" in printed and printed.endswith(f"{Path('out/case.nml')}\n")
    assert Path("out/posterior.png").stat().st_size > 10_000
    draws = np.genfromtxt("out/draws.csv", delimiter=",", names=True)
    found = rockfall.run_ensemble(rockfall.read_case("out/case.nml").replace(ensemble={"runs": 8}))
    assert found["input"].values.tolist() == ["draws"]
    which = found["drawn_draw"].values.astype(int)
    assert np.allclose(found["drawn_radius"].values[..., 0], draws["radius_1"][which])
    assert np.allclose(found["drawn_source_east"], draws["source_east"][which])


@pytest.mark.all
def test_a_back_analysis_that_is_stopped_keeps_its_whole_rounds(place, capfd, monkeypatch):
    words = ["back", "case.nml", "seen.csv", "--effective", "40", "--members", "48", "--quiet"]
    members = iter(range(100))

    def pressed(*arguments, **more):  # interrupted in the third round
        if next(members) == 2 * study.ROUND + 3:
            signal.raise_signal(signal.SIGINT)
        return simulate(*arguments, **more)

    monkeypatch.setattr("rockfall.studies.study.simulate", pressed)
    assert main([*words, "-o", "some"]) == 130
    said = "rockfall: interrupted: some contains the posterior of the first 32 members\n"
    assert capfd.readouterr().err == said
    monkeypatch.setattr("rockfall.studies.study.simulate", simulate)
    assert main([*words[:-2], "32", "--effective", "30", "-o", "whole", "--quiet"]) == 0
    some, whole = (Path(folder, "draws.csv").read_text() for folder in ("some", "whole"))
    assert some == whole


HOSTILE = {
    "radius_1,volume\n1,1\n": (
        "draws.csv: line 1: volume_std: is missing, but related columns are given"
    ),
    "radius_2\n1\n": "draws.csv: line 1: column radius_2: must be one of draw, radius_1, .*",
    "radius_1\n0\n": "draws.csv: line 2: radius_1 = 0: must be a number >= 0.01 and <= 100",
    "set\n0\n": "draws.csv: line 1: column set: the case has no &ensemble sets",
}


@pytest.mark.parametrize("text", HOSTILE)
def test_bad_draws_are_one_line(place, capfd, text):
    Path("draws.csv").write_text(text)
    Path("case.nml").write_text(CASE.replace("radius_factor = 1.5, source_shift = 1.0",
                                             "draws = 'draws.csv'"))  # fmt: skip
    refuses(["ensemble", "case.nml"], HOSTILE[text], capfd)


ARGUMENTS = {
    ("--members", "31"): "--members 31: must be at least 32",
    ("--members", "40", "--effective", "41"): "--effective 41: must be 2 to --members 40",
    ("-o", "taken"): r"taken.case\.nml: already exists; not overwritten .*",
}


@pytest.mark.parametrize("words", ARGUMENTS)
def test_bad_arguments_are_one_line(place, capfd, words):
    Path("taken").mkdir()
    Path("taken/case.nml").write_text(CASE)
    refuses(["back", "case.nml", "seen.csv", *words], ARGUMENTS[words], capfd)


DATA = {
    "x,y,impact\n600060,4999970,1\n": "the observations contain nothing that .*: .*",
    "distance,percent\n10,50\n": "the observations contain nothing that .* column n .* is missing.",
    "line,quantity,unit,value\nM,speed,m/s,3\n": "seen.csv: line 2: line M: is not in the case .*",
}


@pytest.mark.parametrize("text", DATA)
def test_data_that_say_nothing_are_one_line(place, capfd, text):
    Path("seen.csv").write_text(text)
    refuses(["back", "case.nml", "seen.csv"], DATA[text], capfd)


def test_draws_have_the_inputs_in_their_place(place, capfd):
    Path("draws.csv").write_text("radius_1\n1\n")
    Path("case.nml").write_text(CASE.replace("source_shift = 1.0", "draws = 'draws.csv'"))
    said = "case.nml: &ensemble radius_factor = 1.5: must be 1: draws gives it"
    refuses(["ensemble", "case.nml"], said, capfd)
