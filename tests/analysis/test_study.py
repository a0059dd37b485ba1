# SPDX-License-Identifier: BSD-3-Clause
"""Engine of studies: a short study has the same boulders in all scenes, in order, with checkpoints,
each warning once, and one result in memory at a time."""

import gc
import signal
import weakref

import numpy as np
import pytest

import rockfall
from rockfall.analysis.precision.intervals import Sources
from rockfall.analysis.precision.paired import (
    changed_sides,
    difference,
    difference_of_fractions,
    difference_of_means,
    mean_difference,
    mean_of,
)
from rockfall.analysis.validity.warnings import joint_warnings
from rockfall.scene.read import read_scene
from rockfall.simulation import simulate
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.studies.dossier import Run
from rockfall.studies.study import Study, run_labels, with_numbers
from same import same
from scenes import case_in, grid, place, rough

Z = rough()
ARRAYS = {"dem": Z, "transform": grid(Z)}
DENSITIES = [2400.0, 2700.0, 3000.0]
SMALL = {"boulders": 60, "seed": 11}


@pytest.fixture
def case(tmp_path):
    return case_in(tmp_path, **place()).replace(case=SMALL)


def densities(case, values=DENSITIES):
    """Yield the name and the scene for each rock density [kg/m3]."""
    for density in values:
        yield f"{density:g}", read_scene(case.replace(boulder={"density": density}), **ARRAYS)


def own(case, density):
    return rockfall.run(case.replace(boulder={"density": density}), **ARRAYS)


def test_a_study_is_its_scenes_and_its_numbers(case):
    """Each run equals that of its case alone, in the order of the scenes."""
    found = dict(Study().run(densities(case), lambda _, result: result["plan_distance"].values))
    assert list(found) == ["2400", "2700", "3000"]
    for density, distances in zip(DENSITIES, found.values(), strict=True):
        np.testing.assert_array_equal(distances, own(case, density)["plan_distance"].values)


def test_scenes_that_are_compared_have_the_same_boulders(case):
    """Compared scenes get equal seeds; other scenes keep their seeds."""
    varied = case.replace(boulder={"volume": "normal", "volume_std": 0.2})
    scene = read_scene(varied, **ARRAYS)

    def volumes(compared):
        seeds = ((seed, with_numbers(scene, seed=seed)) for seed in (11, 12))
        runs = Study().run(seeds, lambda _, result: result["volume"].values, compared=compared)
        return [values for _, values in runs]

    one, same_one = volumes(compared=True)
    assert np.unique(one).size == one.size and (one == same_one).all()
    first, other = volumes(compared=False)
    assert (first == one).all() and (other != one).all()


def test_a_result_takes_the_place_of_its_run(case, monkeypatch):
    done = own(case, 2400.0)
    monkeypatch.setattr("rockfall.studies.study.run_scene", lambda *_, **__: pytest.fail("is run"))
    ((name, distances),) = Study().run(
        [("2400", done)], lambda _, result: result["plan_distance"].values
    )
    assert name == "2400" and (distances == done["plan_distance"].values).all()


def test_a_study_goes_on_where_it_was_stopped(case, tmp_path, monkeypatch):
    whole = dict(Study().run(densities(case), lambda _, result: result))
    saved = {name: Checkpoint(tmp_path / f"out.{name}", 3600.0, keep=True) for name in whole}
    chunks, run_range = [], simulate._run_range

    def stopping(tally, first, size):
        chunks.append((tally.scene.case.boulder["density"], first, size))
        if chunks[-1][:2] == (2700.0, 21):
            signal.raise_signal(signal.SIGINT)
        return run_range(tally, first, size)

    monkeypatch.setattr(simulate, "_run_range", stopping)
    names = []
    with pytest.raises(rockfall.Interrupted):
        for name, _ in Study(checkpoints=saved, chunk=20).run(densities(case), len_of):
            names.append(name)
    assert names == ["2400"] and chunks[-1] == (2700.0, 21, 20)
    del chunks[:]
    again = dict(Study(checkpoints=saved, chunk=20).run(densities(case), lambda _, result: result))
    assert [(density, first) for density, first, _ in chunks] == [
        (2700.0, 41), (3000.0, 1), (3000.0, 21), (3000.0, 41)
    ]  # fmt: skip
    for name, result in whole.items():
        same(again[name], result)


@pytest.mark.all
def test_each_warning_on_the_models_is_there_once(case):
    hard = case.replace(surface={"ground": "rock_ledge"})
    study = Study()
    scenes = [("sets", read_scene(case, **ARRAYS)), ("ledge", read_scene(hard, **ARRAYS))]
    results = dict(study.run(scenes, lambda _, result: result))
    assert study.warnings and study.warnings == tuple(joint_warnings(results))
    assert len(set(study.warnings)) == len(study.warnings)
    assert any("rock_ledge" in text for text in study.warnings)
    twice = Study()
    for seed in (1, 2):  # same scenes with other boulders; the first run decides the warnings
        list(twice.run(((name, with_numbers(one, seed=seed)) for name, one in scenes), len_of))
    first = Study()
    list(first.run(((name, with_numbers(one, seed=1)) for name, one in scenes), len_of))
    assert twice.warnings == first.warnings
    silent = Study()
    list(silent.run(scenes, len_of, compared=False))
    assert silent.warnings == ()


def len_of(_, result):
    return result.sizes["boulder"]


def test_one_scene_and_one_result_are_in_memory(case):
    alive = []

    def gone():
        gc.collect()
        return not [one for one in alive if one() is not None]

    def scenes():
        for name, scene in densities(case):
            assert gone()
            alive.append(weakref.ref(scene))
            yield name, scene
            del scene

    def numbers(_, result):
        assert not [one for one in alive[:-1] if one() is not None]
        alive.append(weakref.ref(result))
        return result.sizes["boulder"]

    assert [n for _, n in Study().run(scenes(), numbers)] == [60] * 3
    assert len(alive) == 6 and gone()


@pytest.mark.parametrize(("unit", "steps"), [("boulders", [60, 120, 180]), ("runs", [1, 2, 3])])
def test_progress_is_that_of_all_runs(case, monkeypatch, capfd, unit, steps):
    monkeypatch.setenv("ROCKFALL_PROGRESS", "lines")
    with Study(steps[-1], unit, progress=True) as study:
        assert len(list(study.run(densities(case), len_of))) == 3
    expected = [f"rockfall: {step} of {steps[-1]} {unit}" for step in steps]
    assert capfd.readouterr().err.splitlines() == expected


# ---- paired differences


@pytest.fixture
def pair():
    """Values of 400 boulders in two runs, some of them NaN, and their four sources."""
    random = np.random.default_rng(3)
    common, noise = random.gamma(4.0, 2.0, 400), random.normal(0, 0.3, (2, 400))
    values = common + noise
    values[1] += 0.5
    return np.where(values > 4.0, values, np.nan), Sources.of(np.repeat(np.arange(4), 100))


def test_differences_exclude_chance_common_to_both(pair):
    """The interval of a mean is less than half as wide as for two samples."""
    (before, here), source = pair
    value, low, high = difference_of_means(here, before, source)
    assert value == pytest.approx(np.nanmean(here) - np.nanmean(before), rel=1e-12)
    assert low < value < high
    apart = 1.96 * np.hypot(*(np.nanstd(one) / np.sqrt(400) for one in (here, before)))
    assert high - low < apart  # half of the width for two samples
    assert difference(mean_of(here), mean_of(before), source) == pytest.approx((value, low, high))
    ours, theirs = (~np.isnan(one) for one in (here, before))
    for of_fractions in changed_sides, difference_of_fractions:
        value, low, high = of_fractions(ours, theirs, source)
        assert value == pytest.approx(ours.mean() - theirs.mean())
        assert low <= value <= high and high - low < 2 * 1.96 * np.sqrt(0.5 / 400)


def test_equal_runs_differ_by_nothing(pair):
    (before, _), source = pair
    assert difference_of_means(before, before, source) == (0, 0, 0)
    assert mean_difference(np.zeros(400), source) == (0, 0, 0)
    value, low, high = changed_sides(~np.isnan(before), ~np.isnan(before), source)
    assert value == 0 and low == -high < 0  # some boulders might change sides


def test_boulders_that_change_sides_in_one_direction_bound_the_interval():
    source = Sources.alone(100)
    before = np.arange(100) < 50
    value, low, high = changed_sides(np.arange(100) < 53, before, source)
    assert value == 0.03 and 0 < low < value < high
    assert changed_sides(before, np.arange(100) < 53, source) == (-value, -high, -low)


def test_too_few_have_no_interval():
    source, few = Sources.alone(20), np.full(20, np.nan)
    nothing = difference_of_means(few, few, source)
    assert np.isnan(nothing).all()
    few[0] = 3.0
    other = np.where(np.arange(20) == 1, 5.0, np.nan)
    value, low, high = difference_of_means(other, few, source)
    assert value == 2.0 and np.isnan([low, high]).all()


def test_progress_shows_which_run_of_how_many(case, capsys, monkeypatch):
    monkeypatch.setenv("ROCKFALL_PROGRESS", "lines")
    second = Run("", "2400", is_second=True)
    labels = run_labels(["2400", "2700", second])
    assert labels[second] == "run 3 of 3 (second model/2400)"
    study = Study(progress=True, labels=labels)
    assert len([*study.run(densities(case), lambda *_: None)]) == 3
    lines = dict.fromkeys(line.partition(", ")[2] for line in capsys.readouterr().err.splitlines())
    assert [*lines] == ["run 1 of 3 (2400)", "run 2 of 3 (2700)", ""]
