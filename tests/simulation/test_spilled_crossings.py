# SPDX-License-Identifier: BSD-3-Clause
"""Crossings moved to a file during a run are the same as in memory."""

import errno

import numpy as np
import pytest

import rockfall
from made import refused
from programs import Killed, killed_after
from rockfall.io.atomic import atomic_write
from rockfall.result.dataset import put_netcdf
from rockfall.scene.read import read_scene
from rockfall.simulation import spilled_crossings
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import simulate
from same import same
from scenes import grid, make_case, rough, sets

NET = {"name": "net", "x": [0.0, 295.0], "y": [200.0, 200.0], "height": 2.0, "capacity": 500.0}


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """Scene with barriers and breakage; crossings are read in small blocks."""
    monkeypatch.setattr(spilled_crossings, "BLOCK", 70)
    monkeypatch.setattr(spilled_crossings, "PIECE", 50)
    line = [{"name": f"{k}", "x": [0.0, 295.0], "y": [y, y]}
            for k, y in enumerate((360.0, 300.0, 120.0, 399.0))]  # fmt: skip
    where = {"x": [150.0], "y": [380.0]}
    case = make_case(tmp_path, *sets(), line=line, case={"boulders": 200}, release=where)
    case = case.replace(barrier=[NET], breakage={"at": "impact", "min_area_ratio": 0.3})
    z = rough()
    return read_scene(case, dem=z, transform=grid(z))


def test_every_bit_is_that_of_a_run_in_memory(scene, tmp_path):
    kept, spilled = (simulate(scene, chunk=30, spill=one) for one in (None, tmp_path))
    assert len(spilled["crossing_time"].shape) == 1 and not [*tmp_path.glob("*tmp*")]
    same(spilled.dataset(), kept.dataset())
    for contents, name in ((kept, "kept.nc"), (spilled, "spilled.nc")):
        with atomic_write(tmp_path / name) as part:
            put_netcdf(contents, part, name)
    same(rockfall.read_result(tmp_path / "spilled.nc"), rockfall.read_result(tmp_path / "kept.nc"))


@pytest.mark.all
def test_slices_are_those_of_the_whole(scene, tmp_path):
    contents = simulate(scene, chunk=30, spill=tmp_path)
    for name in ("crossing_boulder", "crossing_omega", "crossing_outcome", "crossing_volume"):
        whole = contents[name].values
        for first, last in ((0, 0), (0, 7), (3, 200), (whole.size - 5, whole.size), (0, None)):
            np.testing.assert_array_equal(contents[name][first:last], whole[first:last])


@pytest.mark.all
def test_a_killed_run_goes_on_with_what_was_spilled(scene, tmp_path, monkeypatch):
    whole = simulate(scene, chunk=50)
    with pytest.raises(Killed), monkeypatch.context() as patch:
        killed_after(patch, 2)
        simulate(scene, chunk=50, spill=tmp_path, checkpoint=Checkpoint(tmp_path / "a.nc", 0.0))
    again = Checkpoint(tmp_path / "a.nc", np.inf)
    assert again.found() >= 50
    same(simulate(scene, spill=tmp_path, checkpoint=again).dataset(), whole.dataset())


def test_a_full_disk_is_one_line(scene, tmp_path, monkeypatch):
    class Full:
        def seek(self, *where):
            return 0

        def write(self, values):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(spilled_crossings.tempfile, "TemporaryFile", lambda **how: Full())
    with refused(f"{tmp_path}: cannot store line crossings: No space left on device: free "
                 "disk space, or use fewer lines"):  # fmt: skip
        simulate(scene, chunk=30, spill=tmp_path)
