# SPDX-License-Identifier: BSD-3-Clause
"""Monte Carlo and epistemic uncertainty: parts of the variance, draws, and the command."""

import re
import signal
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import rockfall
from made import every_third, leave_pictures_blank, make_raster, refused
from programs import find_program, refuses
from rockfall.analysis.precision.intervals import Sources
from rockfall.cli import main
from rockfall.errors import RockfallError
from rockfall.html_report import page as html_page
from rockfall.html_report.page import Picture
from rockfall.kernel_rules import Z
from rockfall.language import speaking
from rockfall.plots.figures import figures
from rockfall.result.crossings import line_values
from rockfall.result.maps.map_labels import map_label
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene, simulate
from rockfall.studies.ensemble.sobol_indices import (
    MIN_CROSSED,
    deviations,
    indices,
    limits,
    parts,
    runs_needed,
)
from rockfall.studies.ensemble.study import RESULTS
from rockfall.studies.ensemble.uncertain_inputs import Uncertain, drawn_scene, gaussian_field
from rockfall.tables.ensemble import (
    _column,
    cases_outside,
    ensemble_summary,
    orders_reversed,
)
from rockfall.tables.lines import in_unit
from rockfall.text.summary import remark_lines
from scenes import cut_below, grid, make_case, rough, sets, write_sets

TERRAIN, _ = cut_below(rough(), 260.0)
LINE = {"name": "L", "x": [0.0, 300.0], "y": [300.0, 300.0]}


def place_of(z):
    return grid(z, south=260.0)


def case_of(folder, boulders=100, **groups):
    groups = {"terrain": {}, "release": {"x": 150.0, "y": 380.0, "drop_height": 5.0}} | groups
    run = {"boulders": boulders, "threads": 1}
    return make_case(folder, *sets(), line=[LINE], case=run, **groups)


def vary(case, **more):
    return rockfall.run_ensemble(case, dem=TERRAIN, transform=place_of(TERRAIN), **more)


# ---- parts of the variance


def model(blocks, boulders, random):
    """Means and covariances of boulders for f = 100 + 3 x1 + 2 x2 + x3 x4 + 0 x5, whose parts of
    the variance are known. Boulders have standard deviation 12, correlated by 0.7 between runs of a
    block."""
    a, b = random.standard_normal((2, blocks, 5))
    x = np.stack([a, b, *(np.where(np.arange(5) == i, b, a) for i in range(5))], axis=1)
    f = 100 + 3 * x[..., 0] + 2 * x[..., 1] + x[..., 2] * x[..., 3]
    same = random.standard_normal((blocks, 1, boulders))
    own = random.standard_normal((blocks, 7, boulders))
    values = f[..., None] + 12 * (np.sqrt(0.7) * same + np.sqrt(0.3) * own)
    return from_boulders(values)


def from_boulders(values):
    """Means and covariances over boulders, from values with axes (blocks, runs, boulders)."""
    y, n = values.mean(axis=2), values.shape[2]
    known = {"n": MIN_CROSSED, "fraction": 1.0}
    apart = np.array([
        [deviations(v, "mean", {**known, "mean": v.mean()}, Sources.alone(n)) for v in block]
        for block in values
    ])  # fmt: skip
    return y[..., None], (apart @ apart.transpose(0, 2, 1))[..., None]


FIRST, TOTAL = [9, 4, 0, 0, 0], [9, 4, 1, 1, 0]  # first-order and total parts of a variance of 14


@pytest.mark.all
def test_parts_are_those_of_a_model_without_chance_whatever_the_chance():
    """Estimates are unbiased: their mean over 200 ensembles, with a Monte Carlo variance (144 / 10)
    as large as the epistemic variance (14), is within four standard errors of the truth."""
    random = np.random.default_rng(1)
    found = [parts(*model(16, 10, random)) for _ in range(200)]
    truths = {"monte_carlo": 14.4, "epistemic": 14, "first": FIRST, "total": TOTAL}
    for name, truth in truths.items():
        values = np.array([getattr(one, name) for one in found])[..., 0]
        error = values.std(axis=0) / np.sqrt(200)
        assert np.all(np.abs(values.mean(axis=0) - truth) < 4 * error), name
        assert np.all(error < 0.6), name


@pytest.mark.all
def test_shares_and_their_errors():
    random = np.random.default_rng(2)
    found = [indices(*model(64, 100, random)) for _ in range(24)]
    for name, truth in (("first", FIRST), ("total", TOTAL)):
        values = np.array([getattr(one, name) for one in found])[..., 0]
        errors = np.array([getattr(one, f"{name}_error") for one in found])[..., 0]
        assert values.mean(axis=0) == pytest.approx(np.array(truth) / 14, abs=0.03)
        ratio = np.sqrt((errors**2).mean(axis=0)) / values.std(axis=0)
        assert np.all((ratio > 0.65) & (ratio < 1.5)), name


def test_no_shares_of_an_ignorance_that_is_not_there():
    random = np.random.default_rng(3)
    values = np.repeat(random.standard_normal((16, 1, 50)), 4, axis=1)
    found = indices(*from_boulders(values))
    assert abs(found.parts.epistemic[0]) < 3 * found.epistemic_error[0]
    assert np.isnan(found.first).all() and np.isnan(found.total).all()
    assert np.all(found.parts.first == 0) and np.all(np.abs(found.parts.total) < 1e-15)


def test_chance_is_that_of_the_intervals_at_a_line(tmp_path):
    result = rockfall.run(case_of(tmp_path, 2000), dem=TERRAIN, transform=place_of(TERRAIN))
    table = rockfall.line_statistics(result).set_index("quantity")
    for quantity, number in RESULTS.values():
        row = table.loc[quantity]
        of = deviations(line_values(result, quantity, 0), number, row, Sources.alone(2000))
        width = row[f"{number}_high"] - row[f"{number}_low"]
        close = 0.5 if number == "q95" else 0.01  # density of fewer boulders
        assert 2 * Z * np.sqrt(of @ of) == pytest.approx(width, rel=close)


def numbers(values):
    """Line statistics of the values of boulders; NaN is for boulders that do not cross."""
    known = values[np.isfinite(values)]
    share, q95 = known.size / values.size, np.quantile(known, 0.95)
    return {"n": known.size, "fraction": share, "mean": known.mean(), "q95": q95}


@pytest.mark.all
def test_chance_of_two_runs_and_what_they_share_are_those_of_other_boulders(tmp_path):
    """Covariances estimated from one pair of runs agree with those over 160 pairs with other
    boulders. The runs of a pair have the same boulders, from two sources, on two terrains."""
    case = case_of(tmp_path, 160 * 150, release={"x": [150.0, 200.0], "y": [380.0, 350.0]})
    scenes = [
        read_scene(case, dem=z, transform=place_of(z))
        for z in (TERRAIN, cut_below(rough(seed=2), 260.0)[0])
    ]
    z, other = (scene.rasters.z for scene in scenes)
    scenes[1] = scenes[1].replace(z=0.05 * other + 0.95 * z)
    chosen = [RESULTS[name] for name in ("fraction", "speed.mean", "speed.q95")]
    assert {quantity for quantity, _ in chosen} == {"speed"}
    values, covariances = np.empty((160, 3, 2)), np.empty((160, 3, 2, 2))
    two = Sources.of(np.repeat([0, 1], 150))
    all_ = [line_values(run_scene(scene), "speed", 0) for scene in scenes]
    for k, block in enumerate(np.arange(2 * 160 * 150).reshape(2, 160, 150).swapaxes(0, 1)):
        runs = [speed[block.ravel()] for speed in all_]
        rows = [numbers(speed) for speed in runs]
        for i, (_, number) in enumerate(chosen):
            values[k, i] = [row[number] for row in rows]
            pairs = zip(runs, rows, strict=True)
            of = np.array([deviations(speed, number, row, two) for speed, row in pairs])
            covariances[k, i] = of @ of.T
    for i, (_, number) in enumerate(chosen):
        true, estimate = np.cov(values[:, i].T), covariances[:, i].mean(axis=0)
        close = (1.4 if number == "q95" else 1) * 4 * np.sqrt(2 / 159)  # standard errors of `true`
        assert np.diag(estimate) == pytest.approx(np.diag(true), rel=close)
        correlation = [c[0, 1] / np.sqrt(c[0, 0] * c[1, 1]) for c in (true, estimate)]
        assert correlation[1] == pytest.approx(correlation[0], abs=0.15), number
    assert correlation[0] > 0.2  # the correlation is significant


def test_what_sets_sources_apart_is_no_chance():
    row = {"n": 200, "fraction": 1.0, "mean": 1.5}
    two, uneven = np.repeat([0, 1], 100), np.repeat([0, 1, 2], [100, 33, 67])
    single = np.arange(200)  # neighbours are in the same stratum
    known = [(np.repeat([1.0, 2.0], 100), number) for number in (two, uneven, single)]
    for values, number in known:
        of = deviations(values, "mean", row, Sources.of(number))
        assert of @ of == pytest.approx(0.0, abs=1e-15)
    of = deviations(np.tile([1.0, 2.0], 100), "mean", row, Sources.of(single))
    assert of @ of == pytest.approx(0.0025)


def test_few_boulders_at_a_line_make_no_number():
    speed = np.r_[np.arange(MIN_CROSSED - 1.0), np.full(81, np.nan)]
    row = {"n": MIN_CROSSED - 1, "fraction": 0.19, "mean": 9.0}
    assert np.isnan(deviations(speed, "mean", row, Sources.alone(100))).all()
    assert np.isfinite(deviations(speed, "fraction", row, Sources.alone(100))).all()
    row = {"n": 99, "fraction": 1.0, "q95": 93.1}
    assert np.isnan(deviations(np.arange(99.0), "q95", row, Sources.alone(99))).all()
    row |= {"n": 100}
    assert np.isfinite(deviations(np.arange(100.0), "q95", row, Sources.alone(100))).all()


# ---- ensembles


def test_an_input_that_does_nothing_has_no_share_and_the_other_all(tmp_path):
    """Both alternatives for the impact set are the same file: runs that differ only in the set are
    bit-identical, and the set has no part of the variance."""
    case = case_of(
        tmp_path, 400, ensemble={"runs": 8, "source_shift": 15.0, "sets": ["sets.nml"] * 2}
    )
    found = vary(case)
    assert found["input"].values.tolist() == ["source", "sets"]
    assert float(abs(found["total"].sel(input="sets")).max()) < 1e-12
    assert float(abs(found["first_order"].sel(input="sets")).max()) < 1e-12
    at = found.isel(line=0).sel(input="source", result="fraction")
    for name in ("first_order", "total"):
        assert abs(at[name] - 1) < 3 * at[f"{name}_error"] + 1e-9
    assert at["epistemic_std"] > 1.5 * at["monte_carlo_std"]
    same = found["value"].sel(variant=["A", "A with sets of B"])
    assert np.array_equal(same[:, 0], same[:, 1])


@pytest.mark.all
def test_where_nothing_matters_there_is_chance_only(tmp_path):
    case = case_of(tmp_path, 400, ensemble={"runs": 8, "sets": ["sets.nml"] * 2})
    found = vary(case)
    at = found.isel(line=0)
    assert np.all(abs(at["epistemic_variance"]) < 4 * at["epistemic_variance_error"])
    result = rockfall.run(case, dem=TERRAIN, transform=place_of(TERRAIN))
    table = rockfall.line_statistics(result).set_index("quantity")
    for name, (quantity, number) in RESULTS.items():
        row = table.loc[quantity]
        width = row[f"{number}_high"] - row[f"{number}_low"]
        assert at["case_value"].sel(result=name) == row[number]
        assert 2 * Z * at["monte_carlo_std"].sel(result=name) == pytest.approx(width, rel=0.35)


ALL = {
    "radius_factor": 1.3,
    "volume_factor": 1.1,
    "volume_std_factor": 1.5,
    "drop_height_factor": 1.2,
    "dem_error": 0.2,
    "dem_correlation": 10.0,
    "source_shift": 5.0,
    "sets": ["sets.nml", "laboratory-spheres"],
}


@pytest.mark.all
def test_every_run_can_be_made_again_from_what_is_kept(tmp_path):
    told = {key: value for key, value in ALL.items() if key[:3] != "dem"}
    volume = {"volume": "normal", "volume_mean": 0.8, "volume_std": 0.1}
    found = vary(case_of(tmp_path, 120, boulder=volume, ensemble={"runs": 8, **told}))
    for k, side in ((0, "A"), (3, "B")):
        drawn = found.isel(run=k).sel(side=side)
        factor = float(drawn["drawn_volume"])
        std = 0.1 * factor * float(drawn["drawn_volume_std"])
        release = {
            "x": [150 + float(drawn["drawn_source_east"])],
            "y": [380 + float(drawn["drawn_source_north"])],
            "drop_height": 5.0 * float(drawn["drawn_drop_height"]),
        }
        case = case_of(
            tmp_path, 120, release=release,
            boulder=volume | {"volume_mean": 0.8 * factor, "volume_std": std},
            surface={"uniform_mean_radius": 0.25 * float(drawn["drawn_radius"][0])},
            impact={"sets": told["sets"][int(drawn["drawn_set"])]},
        )  # fmt: skip
        again = case.replace(case={"seed": int(drawn["seed"])})
        table = rockfall.line_statistics(
            rockfall.run(again, dem=TERRAIN, transform=place_of(TERRAIN))
        ).set_index("quantity")
        value = found["value"].isel(run=k, line=0).sel(variant=side)
        assert value.sel(result="fraction") == table.loc["speed", "fraction"]
        assert value.sel(result="speed.mean") == table.loc["speed", "mean"]


@pytest.mark.all
def test_the_draws_of_a_file_are_as_many_files(tmp_path):
    mean, covariance = sets()
    other = 0.97 * mean, 1.2 * covariance
    for name, draws in ("b.nml", [other]), ("both.nml", [other, (mean, covariance)]):
        texts = []
        for draw, one in reversed([*enumerate(draws, 1)]):  # in any order
            write_sets(tmp_path / name, *one, lambda _: f" draw = {draw}\n")  # noqa: B023
            texts.append((tmp_path / name).read_text())
        (tmp_path / name).write_text("".join(texts))
    told = [
        vary(case_of(tmp_path, 60, ensemble={"runs": 8, "sets": names}))
        for names in (["b.nml", "sets.nml"], ["both.nml"])
    ]
    assert told[0]["value"].equals(told[1]["value"])
    assert told[0]["drawn_set"].equals(told[1]["drawn_set"])


DRAWS = {  # draws of each of five groups
    (1, 1, 2, 1, 1): "&impact_set is missing for ratio 3 of draw 1: must have ratios 1 to 5",
    (2, 2, 2, 2, 2): (
        "&impact_set is missing for ratio 1 2 3 4 5 of draw 1: must have ratios 1 to 5"
    ),
    (1, 1001, 1, 1, 1): "line 7: &impact_set draw = 1001: must be 1 to 1000",
}


@pytest.mark.parametrize("numbers", DRAWS)
def test_bad_draws_are_refused(tmp_path, numbers):
    write_sets(tmp_path / "bad.nml", *sets(), lambda ratio: f" draw = {numbers[ratio - 1]}\n")
    case = case_of(tmp_path, 60, ensemble={"runs": 8, "sets": ["sets.nml", "bad.nml"]})
    with pytest.raises(RockfallError, match=f"bad.nml: {DRAWS[numbers]}"):
        vary(case)


def test_a_run_takes_one_draw(tmp_path):
    text = (write_sets(tmp_path / "sets.nml", *sets())).read_text()
    case = case_of(tmp_path, 60)
    (tmp_path / "sets.nml").write_text(text + text.replace("ratio", "draw = 2, ratio"))
    with pytest.raises(
        RockfallError, match=("contains 2 draws of the impact sets: use it in &ensemble")
    ):
        rockfall.run(case, dem=TERRAIN, transform=place_of(TERRAIN))


def test_a_draw_depends_on_seed_input_and_number_alone(tmp_path):
    volume = {"volume": "normal", "volume_mean": 0.8, "volume_std": 0.1}
    few = vary(case_of(tmp_path, 30, boulder=volume, ensemble={"runs": 8, **ALL}))
    more = vary(case_of(tmp_path, 30, boulder=volume, ensemble={"runs": 9, **ALL}))
    names = ["value", "seed", *(name for name in few if name.startswith("drawn_"))]
    xr.testing.assert_equal(few[names], more[names].isel(run=slice(8)))
    alone = case_of(tmp_path, 30, ensemble={"runs": 8, "source_shift": 5.0})
    assert np.array_equal(shifts(alone), few["drawn_source_east"])
    other = alone.replace(case={"seed": 5})
    assert not np.isin(shifts(other), few["drawn_source_east"]).any()
    every = np.concatenate([few[name].values.ravel() for name in names[2:-2]])
    assert np.unique(every).size > 0.8 * every.size  # A, B and inputs use separate random numbers


def shifts(case):
    """Eastward shift of the sources in each run, for both sides."""
    inputs = Uncertain(read_scene(case, dem=TERRAIN, transform=place_of(TERRAIN)))
    draws = [[inputs.draw("source", k, side).kept for side in (0, 1)] for k in range(8)]
    return [[one["source_east"] for one in run] for run in draws]


@pytest.mark.all
def test_maps_are_of_the_runs_a_and_b(tmp_path, small):
    case = case_of(tmp_path, ensemble={"runs": 8, "source_shift": 10.0})
    found = vary(case.replace(output={"maps": ["reach_probability"]}))
    reached = []
    for k in range(8):
        for side in (0, 1):
            drawn = found.isel(run=k, side=side)
            release = {
                "x": [150 + float(drawn["drawn_source_east"])],
                "y": [380 + float(drawn["drawn_source_north"])],
            }
            output = {"maps": ["passages"], "map_extent": "terrain"}
            one = case.replace(case={"seed": int(drawn["seed"])}, release=release, output=output)
            passed = rockfall.run(one, dem=TERRAIN, transform=place_of(TERRAIN))["passages"]
            reached.append(passed.values / 100)
    close = {"rtol": 1e-5, "atol": 1e-7}
    assert np.allclose(found["reach_probability_mean"], np.mean(reached, axis=0), **close)
    assert np.allclose(found["reach_probability_std"], np.std(reached, axis=0, ddof=1), **close)
    shares = np.mean(np.array(reached) > 0.0101, axis=0)
    assert np.allclose(found["reached_runs"], shares, **close)
    assert "reach_probability_mean" not in small  # not requested
    only = vary(case.replace(line=[], output={"maps": ["passages"]}))
    xr.testing.assert_equal(only["reached_runs"], found["reached_runs"])
    _, *remarks = ensemble_summary(only).splitlines()
    assert remarks[1:] == [*remark_lines(only)]


def test_a_line_that_some_runs_do_not_reach_has_a_share_and_nothing_else(tmp_path):
    case = case_of(tmp_path, 30, ensemble={"runs": 8, "source_shift": 1.0})
    at = vary(case).isel(line=0).sel(result="speed.q95")  # no interval above it for 30 boulders
    assert at["too_few"] == 24
    unknown = ("mean", "monte_carlo_std", "epistemic_std", "total")
    assert all(np.isnan(at[name]).all() for name in unknown)


def test_an_index_that_is_not_known_is_undecided_and_others_stay_within_all_and_nothing():
    assert np.isnan(limits(3.58, 1.17)).all() and np.isnan(limits(np.nan, np.nan)).all()
    assert limits(-0.1, 0.1) == pytest.approx((0.0, 0.0, 0.196), abs=1e-3)
    assert limits(1.05, 0.1) == pytest.approx((1.0, 0.804, 1.0), abs=1e-3)
    assert limits(0.4, 0.05) == pytest.approx((0.4, 0.302, 0.498), abs=1e-3)
    assert runs_needed(np.array([0.1, 0.5]), 16) == 246  # 16 (1.96 0.5 / 0.25)^2


def test_an_ensemble_is_a_result(place, capsys, monkeypatch):
    """The file contains the run of the unchanged case, bit for bit; `lines`, `export` and `report`
    read it."""
    monkeypatch.setattr(html_page, "figures", lambda *_: [])  # figures take long
    leave_pictures_blank(monkeypatch)
    text = Path("case.nml").read_text() + "&output maps = 'passages', 'energy_max' /\n"
    Path("case.nml").write_text(text)
    assert main(["ensemble", "case.nml", "-o", "all.nc", "--quiet"]) == 0
    found, run = rockfall.read_result("all.nc"), rockfall.run(rockfall.read_case("case.nml"))
    assert all(run[name].equals(found[name]) for name in run if "y" not in run[name].dims)
    low, high = (found[f"energy_max_{name}"].values for name in ("q05", "q95"))
    assert (low <= high).all() and high.max() > 0
    assert np.array_equal(found["reach_probability_q95"] > 0, high > 0)
    for words in (["lines", "all.nc"], ["export", "all.nc", "out"], ["report", "all.nc"]):
        assert main(words) == 0
    assert "L: uncertainty that more boulders reduce" in capsys.readouterr().out
    names = " ".join(path.name for path in Path("out").glob("*.tif"))
    assert "reached_runs" in names and "energy_max_q95" in names
    page = Path("all.html").read_text("utf-8").replace("\u00a0", " ")
    first = page[page.index('id="answer"') : page.index('id="validity"')]
    assert "uncertain inputs, 90 % of the draws" in first and "Sobol" in first
    assert "rockfall ensemble case.nml" in page


@pytest.fixture(scope="module")
def small(gallery):
    ensemble = {"runs": 8, "radius_factor": 1.2, "source_shift": 20.0}
    return gallery.value(
        "ensemble", lambda folder: vary(case_of(folder, boulders=200, ensemble=ensemble))
    )


def first_page(found, monkeypatch, language="en"):
    """Report of an ensemble without figures, and its part up to the inputs."""
    shown = [replace(one, draw=lambda: None) for one in figures(found) if one.name == "epistemic"]
    monkeypatch.setattr(html_page, "figures", lambda *_: shown)
    monkeypatch.setattr(
        html_page, "picture",
        lambda figure, title, caption, *_: Picture(title, caption, "data:,", 9, 9),
    )  # fmt: skip
    monkeypatch.setattr(html_page, "history_figure", lambda *_: None)
    with speaking(language):
        page = html_page.report(html_page.ReportInputs(found)).replace("\u00a0", " ")
    return page, page[page.index('id="answer"') : page.index('id="inputs"')]


def test_the_page_of_an_ensemble_has_one_number_of_draws(small, monkeypatch):
    page, first = first_page(small, monkeypatch)
    assert "drawn 8 times" in first and "90 % of 8 draws of the uncertain" in page
    assert ensemble_summary(small).startswith("rockfall: 8 draws of 4 runs")
    assert "16" not in re.findall(r"(\d+) (?:draws|times)", page)


def test_the_headline_of_an_ensemble_is_its_range(small, monkeypatch):
    """Page 1 gives the range of 90 % of the draws, and no sentence that contradicts it."""
    _, first = first_page(small, monkeypatch)
    at = small.isel(line=0).sel(result="fraction")
    low, high, case = (
        in_unit(at[name].item(), "fraction") for name in ("q05", "q95", "case_value")
    )
    assert f"L: {low}–{high} % of boulders pass in 90 % of the draws" in first
    assert f"{low} to {high} ({case})" in first
    assert "The ranges include the uncertain inputs" in first
    for denied in ("are not included.", "Sampling error", "Brackets: 95 %"):
        assert denied not in first


def test_an_index_above_its_total_is_remarked(small, monkeypatch):
    """The remark distinguishes an excess within the errors of both indices from a larger one."""
    changed = small.copy(deep=True)
    for name, value in (("first_order", 0.1), ("total", 0.2), ("total_error", 0.02)):
        changed[name][...] = value
    changed["first_order_error"][...] = 0.02
    assert list(orders_reversed(changed)) == []
    about = "L: first-order index exceeds the total index"
    changed["first_order"].loc[{"input": "radius", "result": "speed.mean"}] = 0.37
    changed["first_order"].loc[{"input": "source", "result": "speed.mean"}] = 0.22
    assert list(orders_reversed(changed)) == [
        f"{about}, but within their errors: source (22 and 20 %)",
        f"{about} by more than their errors, which is impossible: use neither for "
        "radius (37 and 20 %)",
    ]
    _, first = first_page(changed, monkeypatch)
    assert all(f"{one}." in first for one in orders_reversed(changed))
    assert all(f"  {one}" in ensemble_summary(changed) for one in orders_reversed(changed))


def test_a_case_outside_the_range_of_its_draws_is_remarked(small, monkeypatch):
    changed = small.copy(deep=True)
    changed["case_value"][...] = 0.5 * (changed["q05"] + changed["q95"]).values
    assert not [*cases_outside(changed)]
    changed["case_value"].loc[{"result": "fraction"}] = 1.01 * changed["q95"].sel(result="fraction")
    changed["case_value"].loc[{"result": "speed.q95"}] = 0.9 * changed["q05"].sel(
        result="speed.q95"
    )
    (said,) = cases_outside(changed)
    named = "L: the unchanged case lies outside the range in {}; {}. Use the less favourable"
    titles = (_column(name).title for name in ("fraction", "speed.q95"))
    assert said.startswith(named.format(*titles))
    _, first = first_page(changed, monkeypatch)
    assert said in first and f"  {said}" in ensemble_summary(changed)


@pytest.mark.parametrize("language", every_third(["de", "fr", "it"]))
def test_no_title_of_an_ensemble_stays_english(small, monkeypatch, language):
    changed = small.copy(deep=True)
    changed["first_order"][...], changed["total"][...] = 0.4, 0.2
    changed["first_order_error"][...] = changed["total_error"][...] = 0.05
    _, first = first_page(changed, monkeypatch, language)
    shown = re.sub(r"<[^>]*>", " ", first)
    assert not {"the", "of", "boulders", "with", "over"} & set(re.findall(r"\w+", shown))
    for name in ("reach_probability_q05", "reach_probability_mean", "reached_runs"):
        english = map_label(name, "")
        with speaking(language):
            assert map_label(name, "") not in (english, "")


# ---- draws


@pytest.mark.all
def test_fields_have_the_variance_and_correlation_they_are_asked_for():
    random = np.random.default_rng(1)
    fields = np.array([gaussian_field((24, 30), 4.0, random) for _ in range(1500)])
    assert abs(fields.mean()) < 0.03
    assert fields.var() == pytest.approx(1, abs=0.03)
    for down, right in ((0, 1), (3, 0), (4, 3), (0, 8), (20, 25), (23, 0), (0, 29)):
        product = fields[:, down:, right:] * fields[:, : 24 - down, : 30 - right]
        assert product.mean() == pytest.approx(np.exp(-np.hypot(down, right) / 4), abs=0.03)
    for length in (0.01, 24.0):  # noise, and a length as long as the raster
        fields = np.array([gaussian_field((24, 30), length, random) for _ in range(1500)])
        assert (fields**2).mean() == pytest.approx(1, abs=0.1)
        correlation = (fields[:, 0, 0] * fields[:, 0, 6]).mean()
        assert correlation == pytest.approx(np.exp(-6 / length), abs=0.1)


def scene_of(folder, z=TERRAIN, **groups):
    return read_scene(case_of(folder, **groups), dem=z, transform=place_of(z))


def test_elevations_keep_their_type_and_what_is_not_known(tmp_path):
    z = TERRAIN.astype("f4")
    z[:3, :3] = np.nan
    told = {"dem_error": 0.5, "dem_correlation": 10.0, "runs": 40}
    inputs = Uncertain(scene_of(tmp_path, z, ensemble=told))
    drawn = [inputs.draw("dem", k, 1).arrays["z"] for k in range(40)]
    assert all(one.dtype == "f4" and np.array_equal(np.isnan(one), np.isnan(z)) for one in drawn)
    assert not np.array_equal(drawn[0], inputs.draw("dem", 0, 0).arrays["z"], equal_nan=True)
    assert np.nanstd(np.array(drawn) - z) == pytest.approx(0.5, rel=0.1)


def test_radii_vary_by_zone_and_rasters_as_a_whole(tmp_path):
    scene = scene_of(tmp_path, ensemble={"radius_factor": 2.0, "runs": 400})
    scene = scene.replace(sizes=np.array([[0.3], [np.inf], [0.1]]))
    inputs = Uncertain(scene)
    drawn = np.array([inputs.draw("radius", k, 1).arrays["sizes"] for k in range(400)])
    assert np.isinf(drawn[:, 1]).all()
    logs = np.log(drawn[:, [0, 2], 0] / [0.3, 0.1])
    assert np.abs(logs.mean(axis=0)).max() < 0.15
    assert logs.std(axis=0) == pytest.approx(np.log(2), rel=0.15)
    assert abs(np.corrcoef(logs.T)[0, 1]) < 0.2
    scene = scene.replace(values=np.full((1, *TERRAIN.shape), 0.2, "f4"))
    values = Uncertain(scene).draw("radius", 0, 0).arrays["values"]
    assert values.dtype == "f4" and np.ptp(values) == 0 and values[0, 0, 0] != np.float32(0.2)


def test_sources_stay_on_the_terrain_and_shifts_together(tmp_path):
    z = TERRAIN.copy()
    z[:, 34:] = np.nan  # known up to x = 167.5
    where = {"x": [150.0, 165.0], "y": [380.0, 380.0]}
    told = {"source_shift": 5.0, "runs": 100}
    inputs = Uncertain(scene_of(tmp_path, z, release=where, ensemble=told))
    draws = [inputs.draw("source", k, 0) for k in range(100)]
    x = np.array([one.arrays["x"] for one in draws])
    assert np.allclose(np.diff(x), 15) and x.max() < 167.5 < 150 + 15 + 5
    assert sum(one.kept["source_redrawn"] for one in draws) > 10
    for one in draws:  # the kernel accepts them
        drawn_scene(inputs.scene, [one], 1).survey()


# ---- invalid input


HOSTILE = {
    "radius_factor = 0.9": r"&ensemble radius_factor = 0.9: must be 1 to 10",
    "volume_std_factor = 2.0": r"&ensemble volume_std_factor = 2.0: .* only .* with a volume_std",
    "dem_error = -1.0": r"&ensemble dem_error = -1.0: must be 0 to 20 \[m\]",
    "dem_error = 1.0": r"&ensemble dem_correlation is missing: needed for dem_error",
    "dem_error = 1.0, dem_correlation = 1e4": r"&ensemble dem_correlation = 10000: .* 150 m.*",
    "source_shift = 1.0, runs = 7": r"&ensemble runs = 7: must be 8 to 65536",
    "runs = 8": r"&ensemble: nothing is uncertain: give .*",
}
CASE = """&case title = 'Slope', boulders = 60, seed = 7 /
&terrain dem = 'dem.tif' /
&surface uniform_mean_radius = 0.25 /
&impact sets = 'laboratory-spheres' /
&boulder volume = 'fixed', volume_mean = 0.8, density = 2800.0 /
&release x = 600060.0, y = 4999980.0, drop_height = 2.0 /
&line name = 'L', x = 600000.0, 600120.0, y = 4999960.0, 4999960.0 /
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Work in a folder with a case; return a function that writes its group &ensemble."""
    monkeypatch.chdir(tmp_path)
    z = (1100 - 0.9 * np.arange(30)[:, None] * 5.0 + np.zeros(24)).astype("f4")
    make_raster("dem.tif", z, nodata=-9999)

    def told(text):
        Path("case.nml").write_text(f"{CASE}&ensemble {text} /\n")

    told("runs = 8, source_shift = 2.0, radius_factor = 1.2")
    return told


@pytest.mark.parametrize("text", HOSTILE)
def test_bad_input_is_one_line_and_nothing_is_written(place, capfd, text):
    place(text)
    refuses(["ensemble", "case.nml"], f"case.nml: {HOSTILE[text]}", capfd)


def test_shifts_off_the_terrain_are_questioned_and_refused(place, capfd):
    place("source_shift = 1e9")
    assert main(["ensemble", "case.nml"]) == 2
    question, refusal = capfd.readouterr().err.splitlines()
    assert question.endswith("more than 100 m: is the value in cm?")
    assert refusal.startswith("rockfall: case.nml: &ensemble source_shift = 1e+09: none of 1000 ")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "out.txt"], r"out.txt: must end in .nc \(everything\) or .csv \(the table\)"),
        (["--runs", "1"], r"case.nml: &ensemble runs = 1: must be 8 to 65536"),
    ],
)
def test_bad_arguments_are_one_line(place, capfd, words, message):
    refuses(["ensemble", "case.nml", *words], message, capfd)


def test_nothing_to_look_at_is_refused(tmp_path):
    case = case_of(tmp_path, ensemble={"source_shift": 2.0}).replace(line=[])
    with refused("case: an ensemble requires a &line, or &output maps = 'reach_probability'"):
        vary(case)


def test_more_numbers_than_the_design_has_are_refused(tmp_path):
    scene = scene_of(tmp_path, ensemble={"radius_factor": 2.0})
    scene = scene.replace(sizes=np.full((10_595, 1), 0.3))
    with refused(
        "case: &ensemble: 10601 values are uncertain, most of them rows of the table of zones: "
        "must be at most 10600"
    ):
        Uncertain(scene)


def test_maps_alone_are_no_table(place, capsys):
    text = Path("case.nml").read_text()
    line = next(line for line in text.splitlines() if line.startswith("&line"))
    Path("case.nml").write_text(text.replace(line, "&output maps = 'reach_probability' /"))
    said = "table.csv: without a &line there is no table: write maps to a file .nc"
    refuses(["ensemble", "case.nml", "-o", "table.csv"], said, capsys)


def test_an_interrupted_ensemble_writes_nothing(place, capfd, monkeypatch):
    runs = iter(range(20))

    def pressed(*arguments, **more):
        if next(runs) == 7:
            raise KeyboardInterrupt
        return simulate(*arguments, **more)

    monkeypatch.setattr("rockfall.studies.study.simulate", pressed)
    assert main(["ensemble", "case.nml"]) == 130
    assert capfd.readouterr().err == "rockfall: interrupted: no incomplete file was written\n"
    assert sorted(path.name for path in Path().iterdir()) == ["case.nml", "dem.tif"]


@pytest.mark.all
def test_an_ensemble_that_is_stopped_keeps_what_was_done(place, capfd, monkeypatch):
    text = Path("case.nml").read_text()
    Path("case.nml").write_text(text + "&output maps = 'passages' /\n")
    names = Uncertain(read_scene(rockfall.read_case("case.nml"))).names
    runs = iter(range(1000))

    def pressed(*arguments, **more):  # in the second run of the tenth draw
        if next(runs) == 9 * (2 + len(names)) + 1:
            signal.raise_signal(signal.SIGINT)
        return simulate(*arguments, **more)

    monkeypatch.setattr("rockfall.studies.study.simulate", pressed)
    assert main(["ensemble", "case.nml", "--runs", "12", "-o", "some.nc", "--quiet"]) == 130
    said = (
        "rockfall: interrupted: some.nc contains the first 9 of 12 draws, like a run with "
        "--runs 9\n"
    )
    assert capfd.readouterr().err == said
    monkeypatch.setattr("rockfall.studies.study.simulate", simulate)
    assert main(["ensemble", "case.nml", "--runs", "9", "-o", "nine.nc", "--quiet"]) == 0
    some, nine = (rockfall.read_result(f"{name}.nc") for name in ("some", "nine"))
    assert some.equals(nine) and some.attrs["case"] == nine.attrs["case"]


# ---- the command


@pytest.mark.all
def test_the_command_writes_what_it_prints(place, capsys):
    assert main(["ensemble", "case.nml", "-o", "all.nc"]) == 0
    printed = capsys.readouterr().out
    assert main(["ensemble", "case.nml", "-o", "table.csv", "--quiet", "--threads", "1"]) == 0
    assert capsys.readouterr() == ("", "")
    found = rockfall.read_result("all.nc")
    with xr.open_dataset("all.nc") as written:
        assert written["input"].values.tolist() == ["source", "radius"]
        assert written.attrs["seed"] == 7 and "source_shift" in written.attrs["case"]
    table = rockfall.ensemble_table(found)
    assert Path("table.csv").read_text() == table.to_csv(index=False, lineterminator="\n")
    first = next(line for line in printed.splitlines() if line.startswith("    fraction passing"))
    value, *_, chance, epistemic = re.split(r"  +", first.strip())[1:]
    for shown, name in ((value, "case_value"), (chance, "monte_carlo_std"),
                        (epistemic, "epistemic_std")):  # fmt: skip
        assert float(shown) == pytest.approx(100 * table.loc[0, name], rel=0.01)
    assert printed.splitlines()[0] == "Slope: 8 draws of 4 runs, 60 boulders each"


def test_an_ensemble_says_the_limits_of_its_model_as_a_run_does(tmp_path, monkeypatch):
    """The summary lists the remarks of a run of the same case; the report has the remark on impact
    tables."""
    by_table = {"impact": {"form": "table", "table": "talus", "sets": None}}
    case = case_of(tmp_path, ensemble={"runs": 8, "source_shift": 2.0}, **by_table)
    found, run = (
        make(case, dem=TERRAIN, transform=place_of(TERRAIN))
        for make in (rockfall.run_ensemble, rockfall.run)
    )
    remarks = [*remark_lines(run)]
    assert any("followed impact tables" in line for line in remarks)
    *_, mark = (line for line in ensemble_summary(found).splitlines() if "unchanged case:" in line)
    assert ensemble_summary(found).partition(f"{mark}\n")[2].splitlines() == remarks
    page, _ = first_page(found, monkeypatch)
    assert "followed impact tables" in page


def test_inputs_stand_in_the_order_of_their_shares(small):
    changed = small.copy(deep=True)
    changed["total"].loc[{"input": "radius"}], changed["total"].loc[{"input": "source"}] = 0.1, 0.8
    text = ensemble_summary(changed).splitlines()
    first = [line.split()[0] for line in text if re.match(r"    (radius|source) ", line)]
    assert first and first == ["source", "radius"] * (len(first) // 2)


def test_a_run_takes_no_notice(place):
    text = Path("case.nml").read_text()
    Path("plain.nml").write_text(text[: text.index("&ensemble")])
    a, b = (rockfall.run(rockfall.read_case(name)) for name in ("case.nml", "plain.nml"))
    xr.testing.assert_equal(a, b)
    assert main(["prepare", "case.nml", "prepared"]) == 0
    done = subprocess.run([find_program(), "prepared/case.nml"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
