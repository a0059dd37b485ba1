# SPDX-License-Identifier: BSD-3-Clause
"""Predictions of `rockfall check` compared with results."""

from dataclasses import replace

import numpy as np
import pytest
from rasterio import crs

from rockfall.grounds import band, shipped_rows
from rockfall.scene.read import read_scene
from rockfall.simulation import pilot
from rockfall.simulation.simulate import run_scene
from rockfall.text import preview
from rockfall.text.summary import summary
from scenes import grid, make_case, rough, sets

Z = rough(nx=150, ny=200)
MAPS = ["passages", "energy_q95"]


def scene_of(folder, sources, each, maps=MAPS, **about):
    cells = np.zeros(Z.shape, int)
    random = np.random.default_rng(3)
    cells.flat[random.choice(60 * Z.shape[1], sources, replace=False) + 10 * Z.shape[1]] = 1
    about = {"case": {"boulders": each}, "output": {"maps": maps}} | about
    release = {"cells": "cells", "drop_height": 5.0}
    case = make_case(folder, *sets(2.0), terrain={}, release=release, **about)
    return read_scene(case, dem=Z, transform=grid(Z), cells=cells)


@pytest.mark.family(3)
@pytest.mark.parametrize(("sources", "each", "few"), [(100, 30, 300), (500, 5, 250), (3, 800, 200)])
def test_the_cells_that_all_boulders_reach(tmp_path, monkeypatch, sources, each, few):
    scene = scene_of(tmp_path, sources, each, maps=["passages"])
    monkeypatch.setattr(pilot, "PILOT_BOULDERS", few)
    monkeypatch.setattr(pilot, "PILOT_REBOUNDS", 10**9)
    run = pilot.pilot_run(scene)
    assert run.tally.done == few
    reached = int((run_scene(scene)["passages"] > 0).sum())
    early = np.count_nonzero(run.tally.array("tally_counts")[0])
    assert early < 0.85 * reached  # there is something to predict
    assert run.cells == pytest.approx(reached, rel=0.25)


def test_memory_is_that_of_the_arrays(tmp_path):
    scene = scene_of(tmp_path, 50, 10)
    run = replace(pilot.pilot_run(scene), cells=1000.0)
    need = pilot.memory(scene, run)
    assert need["rasters"] == 8 * Z.size
    box = np.prod(run.tally.box.shape)
    assert 4 * box * 2 <= need["maps"] <= 4 * Z.size * 2  # passages, column indices: 4 bytes
    assert need["made"] - pilot.PACKAGES <= 4 * Z.size  # the quantile map
    assert need["classes"] == 1000 * 440  # bytes of the energy bin counts per cell
    assert 0 <= need["results"] - (500 * (12 * 8 + 9) + 50 * 16) < 100  # sums


@pytest.mark.parametrize("lines", [1, 9])
def test_crossings_are_written_piece_by_piece(tmp_path, lines, monkeypatch):
    many = [{"name": f"{k}", "x": [0.0, 300.0], "y": [9.0 * k] * 2} for k in range(1, lines + 1)]
    scene = scene_of(tmp_path, 8, 10, maps=None, line=many)
    run = pilot.pilot_run(scene)
    crossings = run.tally.crossed()  # of all boulders
    assert pilot.memory(scene, run)["made"] == pilot.PACKAGES + 2 * 8 * crossings > pilot.PACKAGES
    monkeypatch.setattr(pilot, "BLOCK", crossings / 4)
    monkeypatch.setattr(pilot, "PIECE", crossings / 2)
    assert pilot.memory(scene, run)["made"] == pilot.PACKAGES + (1 + 1 / 4) * 8 * crossings / 2


def test_rows_too_many_for_a_file_are_said_before_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(pilot, "PILOT_BOULDERS", 100)
    monkeypatch.setattr(preview, "LARGE_RESULT", preview.LARGE_RESULT / 4000)  # writing takes time
    many = [{"name": f"{k}", "x": [0.0, 300.0], "y": [9.0 * k, 9.0 * k]} for k in range(1, 41)]
    words = "MB: &output kept = 'none' keeps sums and counts"
    for lines, is_said in ((many, True), (many[:1], False)):
        scene = scene_of(tmp_path, 8, 200, line=lines)
        assert (words in preview._memory(scene, pilot.pilot_run(scene))) == is_said
        assert ("18, 19, 20, ... (40)" in preview.preview(scene)) == is_said


def test_a_terrain_without_a_crs_is_said_with_what_follows_and_the_cure(tmp_path):
    note = "the DEM has no CRS: layers are read in its coordinates, results have none: set it with "
    note += "rockfall dem DEM --crs EPSG:2056 -o NEW"
    scene = scene_of(tmp_path, 8, 10)
    assert preview.preview(scene).splitlines()[-1] == f"  note         {note}"
    result = run_scene(scene)
    assert f"  note: {note}" in summary(result).splitlines()
    known = scene.replace(grid=replace(scene.grid, crs=crs.CRS.from_epsg(2056)))
    for text in preview.preview(known), summary(run_scene(known)):
        assert "no CRS" not in text


def test_what_is_not_asked_for_takes_nothing(tmp_path):
    scene = scene_of(tmp_path, 50, 10, maps=None)
    need = pilot.memory(scene, pilot.pilot_run(scene))
    assert need["maps"] == need["classes"] == 0
    assert need["made"] == pilot.PACKAGES


def test_check_prints_the_same_whenever_it_is_called(tmp_path, monkeypatch):
    """Two calls give the same lines, except the run time, although the pilot run took another
    time."""
    scene = scene_of(tmp_path, 50, 10)

    def lines():
        return [one for one in preview.preview(scene).splitlines() if not one.startswith("  time ")]

    before = lines()
    follow = pilot._follow
    monkeypatch.setattr(pilot, "_follow", lambda *given: replace(follow(*given), seconds=7.0))
    assert lines() == before and any("pilot run" in one for one in before)


def test_scenarios_are_summed_in_a_line(tmp_path):
    """A boulder in 4 years from each of 50 sources, and one in 10 years from all together, are 12.6
    boulders per year."""
    scene = scene_of(tmp_path, 50, 10)
    assert "scenarios" not in preview.preview(scene)
    law = {"volume": "uniform", "volume_min": 2.0, "volume_max": 5.0}
    scenarios = [
        {"name": "often", "frequency": 0.25, "frequency_per": "source"},
        {"name": "large", "return_period": 10.0, **law},
    ]
    text = preview.preview(replace(scene, case=scene.case.replace(scenario=scenarios)))
    (line,) = [line for line in text.splitlines() if line.startswith("  scenarios ")]
    assert line.split(None, 1)[1].startswith("2, 12.6 boulders per year, volume 0.8 to 5 m3;")
    assert "of CPU, a dossier up to twice that for each variant" in line


def test_each_ground_has_a_softer_and_a_firmer_neighbour():
    """Neighbours are the next grounds in strength; talus, with strength proportional to size, has
    none."""
    order = ["soft-soil", "vegetated-soil", "meadow", "compact", "rock"]
    for k, name in enumerate(order):
        assert band(name) == (*order[max(0, k - 1) : k], *order[k + 1 : k + 2])
    assert {*shipped_rows().yielding} - {*order} == {"talus"} and band("talus") == ()


@pytest.mark.parametrize(("surface", "others"), [
    ({"ground": "meadow"}, ["vegetated-soil", "compact"]),
    ({"ground": "rock"}, ["compact"]),
    ({"ground": "meadow", "ground_strength": 8e5}, []),  # measured strength
    ({"ground": "talus"}, []),
])  # fmt: skip
def test_the_runs_by_both_neighbours_are_offered(tmp_path, surface, others):
    scene = scene_of(tmp_path, 3, 10, surface=surface)
    lines = [line for line in preview.preview(scene).splitlines() if "ground band" in line]
    offered = [word for line in lines for word in line.split("--table ")[1:]]
    assert [word.strip() for word in offered] == others
    assert all(len(line) <= 120 and f"models {scene.case.name} --table" in line for line in lines)


def test_memory_of_samples_grows_with_what_lines_see(tmp_path, monkeypatch):
    """Without kept boulders, the memory of samples grows with the number of lines and less than in
    proportion to the boulders, because bins fill up."""
    monkeypatch.setattr(pilot, "PILOT_BOULDERS", 400)
    many = [{"name": f"{k}", "x": [0.0, 300.0], "y": [9.0 * k] * 2} for k in range(1, 31)]
    found = []
    for lines, each in ((many[-3:], 200), (many, 200), (many, 20_000)):
        scene = scene_of(tmp_path, 8, each, line=lines)
        scene = replace(scene, case=scene.case.replace(output={"kept": "none"}))
        run = pilot.pilot_run(scene)
        assert run.blocks > 0 and run.tally.crossed() <= run.tally.done * len(lines)
        found.append(pilot.memory(scene, run)["samples"])
    assert found[0] < found[1] / 4 and found[1] < found[2] < 100 * found[1]
