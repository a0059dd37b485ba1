# SPDX-License-Identifier: BSD-3-Clause
"""Number of sources that reach a cell, and reach probability by source: exact in any run."""

import numpy as np
import pytest

import rockfall
from rockfall.scene.read import read_scene
from rockfall.simulation import simulate
from same import same
from scenes import grid, make_case, rough, sets

Z = rough()
MAPS = ["passages", "sources", "reach_probability_by_source"]
LINE = [{"name": "L", "x": [0.0, 300.0], "y": [280.0, 280.0]}]


def scattered(sources):
    """Terrain and a raster of adjacent source cells, whose boulders reach common cells."""
    cells = np.zeros(Z.shape, int)
    rows, columns = 4 + np.arange(sources) // 30, 15 + np.arange(sources) % 30
    cells[rows, columns] = 1
    return {"dem": Z, "transform": grid(Z), "cells": cells}


def case_of(folder, n, maps=MAPS, **release):
    release = {"cells": "cells", "drop_height": 5.0, **release}
    about = {"case": {"boulders": n}, "release": release, "output": {"maps": maps}}
    return make_case(folder, *sets(2.0), line=LINE, terrain={}, **about)


def by_brute_force(case, arrays):
    """Number of sources that reach each cell, and of their boulders, from one run for each
    source."""
    scene = read_scene(case.replace(output={"maps": ["passages"]}), **arrays)
    sources, released = np.zeros((2, *Z.shape), int)
    for source in range(scene.x.size):
        numbers = scene.numbers_of(source)
        tally = simulate.start(scene, 1)
        done = 0
        while done < len(numbers):  # a slow machine does only a part in the time of a call
            done += simulate._run_range(tally, numbers.start + done, len(numbers) - done)
        box = tally.box
        fed = tally.array("tally_counts")[0] > 0
        sources[box.rows, box.columns] += fed
        released[box.rows, box.columns] += len(numbers) * fed
    return sources, released


def check(result, sources, released):
    place = grid(Z)
    rows, columns = np.isin(place.y, result.y), np.isin(place.x, result.x)
    sources, released = (whole[np.ix_(rows, columns)] for whole in (sources, released))
    assert np.array_equal(result["sources"], sources) and result["sources"].dtype == np.int32
    share = np.where(sources > 0, result["passages"] / np.maximum(1, released), np.nan)
    found = result["reach_probability_by_source"].values
    assert np.array_equal(found, share.astype("f4"), equal_nan=True)


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("n", "of"), [(1, 400), pytest.param(7, 50, marks=pytest.mark.all), (2000, 2)]
)
def test_sources_of_each_cell_are_those_of_brute_force(tmp_path, n, of):
    case, arrays = case_of(tmp_path, n), scattered(of)
    sources, released = by_brute_force(case, arrays)
    assert sources.max() > min(of, 40) / 3
    whole = rockfall.run(case, **arrays)
    check(whole, sources, released)
    for how in ({"threads": 2}, {"threads": 7, "chunk": 37}, {"threads": 3, "chunk": 1000}):
        same(rockfall.run(case, **arrays, **how), whole)


@pytest.mark.family(2)
@pytest.mark.parametrize(("n", "of"), [(1, 100), (700, 3)])
def test_parts_joined_in_any_order_are_the_run(tmp_path, n, of, parts=11):
    case, arrays = case_of(tmp_path, n), scattered(of)
    flown = [
        rockfall.run(case, **arrays, shard=(k, parts), threads=k % 3, chunk=[None, 29][k % 2])
        for k in range(1, parts + 1)
    ]
    same(rockfall.merge(flown[::-1]), rockfall.run(case, **arrays))


@pytest.mark.family(2)
@pytest.mark.parametrize("only", [["sources"], ["reach_probability_by_source"]])
def test_one_of_the_maps_alone(tmp_path, only):
    case, arrays = case_of(tmp_path, 50, only), scattered(6)
    whole = rockfall.run(case, **arrays)
    all_maps = rockfall.run(case_of(tmp_path, 50), **arrays)
    assert np.array_equal(whole[only[0]], all_maps[only[0]], equal_nan=True)
    parts = [rockfall.run(case, **arrays, shard=(k, 11)) for k in range(1, 12)]
    same(rockfall.merge(parts), whole)


def test_sources_of_unequal_release(tmp_path):
    case, arrays = case_of(tmp_path, 20, by_area=True), scattered(30)
    sources, released = by_brute_force(case, arrays)
    assert len(np.unique(released[sources == 1])) > 1
    whole = rockfall.run(case, **arrays)
    check(whole, sources, released)
    parts = [rockfall.run(case, **arrays, shard=(k, 13), threads=2) for k in range(1, 14)]
    same(rockfall.merge(parts), whole)


def test_a_part_tells_of_its_own_boulders(tmp_path):
    """The second half of a run counts its own boulders, 100 of the second source and 200 of the
    third."""
    case, arrays = case_of(tmp_path, 200), scattered(3)
    part = rockfall.run(case, **arrays, shard=(2, 2))
    assert part.attrs["boulder_first"] == 301
    sources, released = np.zeros((2, *Z.shape), int)
    scene = read_scene(case.replace(output={"maps": ["passages"]}), **arrays)
    for first, last in ((301, 400), (401, 600)):
        tally = simulate.start(scene, 1)
        tally.done += simulate._run_range(tally, first, last - first + 1)
        sources += tally.array("tally_counts")[0] > 0
        released += (last - first + 1) * (tally.array("tally_counts")[0] > 0)
    found = np.zeros((2, sources.size), int)
    found[:, part["tally_cell"].values] = part["tally_counts"].values[1:]  # after the passages
    assert np.array_equal(found, np.stack([sources.ravel(), released.ravel()]))


def test_an_interrupted_run_tells_of_the_boulders_done(tmp_path, monkeypatch):
    case, arrays = case_of(tmp_path, 200), scattered(3)
    monkeypatch.setattr(simulate, "interrupts", lambda: _after(2))
    with pytest.raises(simulate.Interrupted) as stop:
        rockfall.run(case, **arrays, chunk=130)
    result = stop.value.result
    assert result.sizes["boulder"] == 260
    monkeypatch.undo()
    fed = []
    for first, n in ((1, 200), (201, 60)):
        tally = simulate.start(read_scene(case, **arrays), 1)
        tally.done += simulate._run_range(tally, first, n)
        fed.append(tally.array("tally_counts")[0] > 0)
    check(result, fed[0] + fed[1].astype(int), 200 * fed[0] + 60 * fed[1])


class _after:
    """Context that interrupts a run after a number of chunks."""

    def __init__(self, chunks):
        self.left = chunks

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def __call__(self):
        self.left -= 1
        return self.left < 0


def test_who_does_not_ask_does_not_pay(tmp_path):
    case = case_of(tmp_path, 5, ["passages"])
    tally = simulate.start(read_scene(case, **scattered(3)), 1)
    assert "last_source" not in {array.name for array in tally.run.arrays()}
    assert len(tally.array("tally_counts")) == 1
    part = rockfall.run(case, **scattered(3), shard=(1, 2))
    assert not any(name.startswith("tally_fed") for name in part.variables)
