# SPDX-License-Identifier: BSD-3-Clause
"""Chunks receive only the sources of their own boulders, without an effect on results; results are
written without importing unused packages."""

import copy
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import rockfall
from made import every_third
from rockfall.errors import RockfallError
from rockfall.scene.read import read_scene
from rockfall.simulation import simulate
from rockfall.simulation.run_state import Run
from rockfall.simulation.simulate import run_scene
from same import same
from scenes import grid, make_case, rough, sets

EACH = 5
X = np.array([110.0, 130.0, 150.0, 170.0, 190.0, 210.0, 230.0])
CLOCKS = ("date_created", "wall_seconds", "cpu_seconds")


def case_in(folder, x=X, **case):
    release = {"x": x.tolist(), "y": [380.0] * x.size, "drop_height": 5.0}
    output = {"maps": ["passages", "energy_max"], "trajectories": 12}
    return make_case(
        folder,
        *sets(2.0),
        case={"boulders": EACH} | case,
        terrain={},
        release=release,
        output=output,
    )


def run(case, **how):
    return rockfall.run(case, dem=rough(), transform=grid(rough()), **how)


@pytest.mark.parametrize("chunk", [1, 7, pytest.param(EACH, marks=pytest.mark.all)])
def test_any_chunk_and_part_starts_at_its_own_sources(tmp_path, chunk):
    case = case_in(tmp_path)
    whole = run(case)
    assert np.array_equal(whole["start_x"], np.repeat(X, EACH))
    found = run(case, chunk=chunk)
    xr.testing.assert_equal(found, whole)
    parts = [run(case, chunk=chunk, shard=(k, 4)) for k in range(1, 5)]
    xr.testing.assert_equal(rockfall.merge(parts), whole)


@pytest.mark.parametrize("threads", every_third([2, 1]))
@pytest.mark.parametrize("maps", [["passages", "energy_max"], ["passages", "hits"]])
def test_a_call_whose_time_is_over_starts_no_more_boulders(tmp_path, monkeypatch, maps, threads):
    """A call whose time has passed runs only one batch per thread, in lanes or one by one, without
    an effect on results."""
    case = case_in(tmp_path, boulders=40).replace(output={"maps": maps})
    whole, sizes = run(case, chunk=10**6), []
    advance = Run.advance

    def count(*arguments, **how):
        done, *left = advance(*arguments, **how)
        sizes.append(done)
        return done, *left

    monkeypatch.setattr(simulate, "MAX_SECONDS", 0.0)
    monkeypatch.setattr(Run, "advance", count)
    found = run(case, chunk=10**6, threads=threads)
    assert sum(sizes) == 40 * X.size and 1 <= max(sizes) <= 16 * threads
    xr.testing.assert_equal(found, whole)


def test_the_last_source_is_refused_before_the_first_boulder_flies(tmp_path, monkeypatch):
    call = "rockfall.simulation.run_state.Run.advance"
    monkeypatch.setattr(call, lambda *_: pytest.fail("a boulder flew"))
    with pytest.raises(RockfallError, match=r"source 8 \(9999.000, 380.000\) lies outside"):
        run(case_in(tmp_path, np.append(X, 9999.0)), chunk=1)


def test_texts_and_coordinates_beside_dimensions_are_kept(tmp_path):
    result = run(case_in(tmp_path))
    kind = ("boulder", np.array(["round", "flat"])[result["boulder"].values % 2])
    result = result.assign_coords(kind=kind)
    rockfall.write_result(result, tmp_path / "out.nc")
    back = rockfall.read_result(tmp_path / "out.nc")
    assert "kind" in back.coords
    assert back["kind"].values.tolist() == result["kind"].values.tolist()
    del result.attrs["model_warnings"]  # not stored in files
    xr.testing.assert_identical(back.drop_vars("kind"), result.drop_vars("kind"))


def test_runs_of_one_scene_at_once_do_not_disturb_each_other(tmp_path):
    """Four parts of a run with maps and trajectories run at the same time, as on a Dask worker."""
    case = make_case(
        tmp_path, *sets(), release={"x": [150.0], "y": [350.0], "drop_height": 5.0},
        case={"boulders": 400, "threads": 1}, output={"maps": ["passages"], "trajectories": 60},
    )  # fmt: skip
    z = rough()
    scene = read_scene(case, dem=z, transform=grid(z))
    with ThreadPoolExecutor(4) as threads:
        parts = list(threads.map(lambda k: run_scene(scene, shard=(k, 4)), range(1, 5)))
    same(rockfall.merge(parts), run_scene(scene))


@pytest.mark.all
def test_a_process_whose_threads_have_run_scenes_ends(place):
    """OpenMP releases the data of a thread as it ends: the process ends without a fault."""
    code = """if True:
        import faulthandler, threading, rockfall
        faulthandler.enable()
        case = rockfall.read_case("case.nml")
        for _ in range(4):
            thread = threading.Thread(target=rockfall.run, args=(case,), kwargs={"threads": 2})
            thread.start()
            thread.join()
    """
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        cwd=place, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_copy_of_a_scene_is_its_own(tmp_path):
    case = make_case(tmp_path, *sets(), release={"x": [150.0], "y": [350.0]})
    z = rough()
    scene = read_scene(case, dem=z, transform=grid(z))
    for copied in copy.deepcopy(scene), pickle.loads(pickle.dumps(scene)):
        assert copied.kernel is not scene.kernel and copied.boulders == scene.boulders
    assert replace(scene, case=case.replace(case={"boulders": 7})).boulders == 7
    with pytest.raises(TypeError, match="belongs to its process"):
        pickle.dumps(scene.kernel)
