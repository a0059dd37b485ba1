# SPDX-License-Identifier: BSD-3-Clause
"""Malformed inputs are accepted or refused in one line by both programs; a refusal writes no file.

benchmarks/stability/hostile.py tests thousands. This file has one of each kind that once was not
refused, and thirty others."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest

import rockfall
from benchmarks.machine import ROOT
from benchmarks.stability import hostile, mutators
from made import refused
from rockfall.analysis.observed.observations import read_observed
from rockfall.files.export import export
from rockfall.io.tables import table_rows
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.simulate import run_chunks, start
from rockfall.studies.runs import merge


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder with valid inputs of every kind in `in`, a result, and the same result in three
    parts."""
    folder = tmp_path_factory.mktemp("made")
    hostile.make_rasters(folder / "in")
    hostile.make_cases(folder / "in")
    with pytest.MonkeyPatch.context() as context:
        context.chdir(folder)  # a case stores the name by which it is read
        case = rockfall.read_case("in/asc.nml")
        rockfall.write_result(rockfall.run(case), "whole.nc")
        for k in (1, 2, 3):
            rockfall.write_result(rockfall.run(case, shard=(k, 3)), f"{k}.nc")
    return folder


@pytest.fixture
def files(made, tmp_path, monkeypatch):
    """Work in a folder with inputs that may be altered, and return their folder `in`."""
    shutil.copytree(made / "in", tmp_path / "in")
    monkeypatch.chdir(tmp_path)
    return Path("in")


@pytest.mark.all
def test_thirty_spoiled_inputs():
    """The benchmark needs a process of its own: it forks, and forks of a process that has run
    OpenMP would wait."""
    command = [sys.executable, "-m", hostile.__name__, "--inputs", "30", "--seed", "11"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "| all            |     30 |" in done.stdout


def test_the_check_finds_what_it_is_to_find(tmp_path):
    """`verdict` reports commands that crash, hang, print too much, write elsewhere or leave a
    file."""
    (tmp_path / "out").mkdir()
    before = hostile.snapshot(tmp_path)

    def verdict(status, said):
        return hostile.verdict(hostile.Ran(status, said, 0.0), tmp_path, before, batch=False)

    assert verdict(0, "") == "done" and verdict(0, "rockfall: warning: a\n") == "done"
    for said in ("rockfall: no\n", "rockfall: a\nrockfall: b\n"):
        assert verdict(2, said) == "refused"
    assert verdict(None, "").startswith("HANG") and verdict(-11, "").startswith("STATUS -11")
    assert verdict(1, "rockfall: internal error\n").startswith("STATUS 1")
    for said in ("", "rockfall: a\nand b\n", "Traceback\n", "ERROR 1: GDAL\nrockfall: a\n"):
        assert verdict(2, said).startswith("LINES"), said
    (tmp_path / "out/.half.nc").touch()
    assert verdict(2, "rockfall: no\n").startswith("LEFT")
    assert verdict(0, "").startswith("HALF")
    (tmp_path / "escaped").touch()
    assert verdict(0, "").startswith("OUTSIDE")


def test_a_pipe_is_refused_and_not_waited_for(files, batch):
    """Opening a pipe without a writer would never return."""
    said = {"case.nml": "is not a regular file", "scene.nc": "cannot be read as netCDF-4"}
    prepare(rockfall.read_case("in/asc.nml"), "in/ready")
    for name, words in said.items():
        good = (files / "ready" / name).read_bytes()
        mutators.fifo(None, files / "ready" / name)
        done = batch("in/ready/case.nml", "-o", "no", cwd=".")
        assert (done.returncode, done.stderr) == (2, f"rockfall-batch: in/ready/{name}: {words}\n")
        (files / "ready" / name).unlink()
        (files / "ready" / name).write_bytes(good)
    for name in ("asc.nml", "dem.asc", "zones.csv", "cells.asc"):
        text = (files / name).read_bytes()
        mutators.fifo(None, files / name)
        with refused(f"in/{name}: is not a regular file"):
            read_scene(rockfall.read_case("in/asc.nml"))
        (files / name).unlink()
        (files / name).write_bytes(text)
    assert not Path("no").exists()


def test_devices_and_links_to_themselves_are_refused(tmp_path):
    for read in (rockfall.read_case, rockfall.read_result, lambda path: merge([path])):
        with refused("/dev/zero: is not a regular file"):
            read("/dev/zero")
    loop = tmp_path / "loop.csv"
    loop.symlink_to(loop)
    with pytest.raises(rockfall.RockfallError, match="too many levels of symbolic links"):
        read_observed(loop)


def test_texts_past_all_bounds_are_refused_before_they_are_read(tmp_path):
    path = tmp_path / "large.csv"
    path.touch()
    os.truncate(path, 10_000_000_000)
    for read in (rockfall.read_case, lambda path: list(table_rows(path))):
        with refused(f"{path}: is larger than 64 MB, so it is not a rockfall text file"):
            read(path)
    path.write_text("zone," + ",".join(map(str, range(1000))) + "\n")
    with refused(f"{path}: line 1: more than 1000 columns"):
        list(table_rows(path))


@pytest.fixture
def parts(made, files):
    return [Path(shutil.copy(made / f"{k}.nc", f"{k}.nc")) for k in (1, 2, 3)]


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("tally_cell", 10**9, "2.nc: is damaged: tally_cell"),
        ("tally_shared_cell", 10**9, "2.nc: is damaged: tally_shared_cell"),
        ("crossing_distance", np.inf, "2.nc: is damaged: crossing_distance: must be a number"),
        ("crossing_velocity_x", np.nan, "2.nc: is damaged: crossing_velocity_x: must be a number"),
        ("crossing_time", -1, "2.nc: is damaged: crossing_time = -1: must be >= 0"),
        ("crossing_line", -1, "2.nc: is damaged: crossing_line"),
        ("crossing_line", 99, "2.nc: is damaged: crossing_line"),
        ("crossing_boulder", 1, "2.nc: is damaged: crossing_boulder"),
        ("crossing_boulder", 10**9, "2.nc: is damaged: crossing_boulder"),
        ("volume", -1, "2.nc: is damaged: volume = -1: must be > 0"),
        ("source", 99, "2.nc: is damaged: source: must be that from which each boulder comes"),
        (
            "stop_x",
            1e30,
            "2.nc: is damaged: stop_x = 1e30: must be 600000 to 600120, on the terrain",
        ),
        (
            "start_y",
            -5.0,
            "2.nc: is damaged: start_y = -5: must be 5199850 to 5200000, on the terrain",
        ),
        ("travel_time", -1e-9, "2.nc: is damaged: travel_time = -1e-9: must be >= 0"),
    ],
)
def test_a_damaged_part_is_named(parts, name, value, said):
    with netCDF4.Dataset(parts[1], "a") as file:
        assert file[name].size > 0
        file[name][-1] = value
    with refused(said):
        merge(parts)


@pytest.mark.parametrize("name", ["boulder_first", "version"])
def test_a_part_without_what_it_says_of_itself_is_none(parts, name):
    with netCDF4.Dataset(parts[1], "a") as file:
        file.delncattr(name)
    with refused(f"2.nc: is damaged: {name}"):
        merge(parts)


@pytest.mark.parametrize(
    ("name", "value"), [("threads", "9" * 400), ("boulders_requested", -1), ("case", "\x01")]
)
def test_a_part_of_numbers_past_all_bounds_is_refused(parts, name, value):
    with netCDF4.Dataset(parts[1], "a") as file:
        file.setncattr(name, value)
    with pytest.raises(rockfall.RockfallError, match=r"^2\.nc: "):
        merge(parts)


def test_a_part_of_other_shapes_is_named(parts):
    with netCDF4.Dataset(parts[1], "a") as file:
        file.renameVariable("stop_y", "stop_q")
    with refused("2.nc: is damaged: stop_y"):
        merge(parts)
    with netCDF4.Dataset(parts[0], "a") as file:
        file.renameVariable("crossing_time", "crossing_q")
    with refused("1.nc: is damaged: crossing_time"):
        merge(parts)
    with netCDF4.Dataset(parts[2], "a") as file:
        file.setncattr("boulder_last", 39)
    with refused("3.nc: is damaged: volume"):
        merge([parts[2]])


@pytest.fixture
def whole(made, files):
    return Path(shutil.copy(made / "whole.nc", "whole.nc"))


@pytest.fixture
def half(files):
    """Run of 40 boulders stopped after 20: the scene, and the path of its checkpoint."""
    scene = read_scene(rockfall.read_case("in/asc.nml"))
    tally = start(scene, 1)
    run_chunks(tally, 20, lambda: tally.done >= 20, lambda _: None)
    checkpoint = Checkpoint("half.nc", 0.0)
    checkpoint.save(tally)
    assert checkpoint.found() == 20
    return scene, checkpoint.path


def test_one_turned_bit_of_a_value_in_a_checkpoint_is_found(half):
    scene, path = half
    good = path.read_bytes()
    with netCDF4.Dataset(path) as file:
        values = file["travel_time"][...].data.tobytes()
    spoiled = bytearray(good)
    spoiled[good.index(values) + 5] ^= 1
    path.write_bytes(spoiled)
    with pytest.raises(rockfall.RockfallError, match=f"^{path}: is damaged: travel_time"):
        Checkpoint("half.nc", 0.0).restore(start(scene, 1))


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("key", "value", "said"),
    [("boulder_last", 41, "boulders"), ("threads", "many", "threads"),
     ("wall_seconds", float("nan"), "wall_seconds"), ("map_window", [0, 0, 9**9, 1], "map_window"),
     ("input_checksums", "[" * 100_000, "input_checksums"),
     ("decoded_checksums", "[1]", "decoded_checksums"), ("boulders_requested", 39, "boulder")],
)  # fmt: skip
def test_what_a_checkpoint_cannot_say_is_refused(half, key, value, said):
    scene, path = half
    with netCDF4.Dataset(path, "r+") as file:
        file.setncattr(key, value)
    with pytest.raises(rockfall.RockfallError, match=f"^{path}: (is|belongs) .*{said}"):
        Checkpoint("half.nc", 0.0).restore(start(scene, 1))


def test_a_pipe_as_a_checkpoint_is_refused_and_not_waited_for(half):
    scene, path = half
    mutators.fifo(None, path)
    with pytest.raises(
        rockfall.RockfallError, match="^half.nc.checkpoint: exists but is not a readable"
    ):
        Checkpoint("half.nc", 0.0).restore(start(scene, 1))


def change_result(path, change):
    with netCDF4.Dataset(path, "a") as file:
        change(file)


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f.renameVariable("restitution_normal_bin_bounds", "q"),
         "incomplete rockfall result: variable restitution_normal_bin_bounds is missing"),
        (lambda f: f.renameDimension("x", "q"), "passages: must have dimensions y, x"),
        (lambda f: f["status"].setncattr("flag_meanings", "stopped"),
         "status: has no flag_meanings"),
        (lambda f: f.setncattr("seed", "2"), "seed = 2: is not a number"),
        (lambda f: f["passages"].delncattr("long_name"), "passages: has no type"),
        (lambda f: f["incidence_angle_bin_bounds"].__setitem__((3, 1), np.nan),
         "incidence_angle_bin_bounds: must be increasing bin edges"),
        (lambda f: f["x"].__setitem__(3, np.inf), "x: must be a number for every x"),
        (lambda f: f["crossing_velocity_x"].__setitem__(0, np.inf),
         "crossing_velocity_x: must be a number for every crossing"),
        (lambda f: f["crossing_time"].__setitem__(0, -1), "crossing_time = -1: must be >= 0"),
        (lambda f: f["row_size"].__setitem__(0, f["row_size"][0] - 1),
         "row_size: contains impossible values"),
        (lambda f: f["crossing_line"].__setitem__(0, 1),
         "crossing_line: contains impossible values"),
        (lambda f: f["crossing_boulder"].__setitem__(1, f["crossing_boulder"][0]),
         "crossing_boulder: contains impossible values"),
        (lambda f: f["crossing_boulder"].__setitem__(0, 0),
         "crossing_boulder: contains impossible values"),
        (lambda f: f.renameVariable("crossing_omega", "q"),
         "incomplete rockfall result: variable crossing_omega is missing"),
        (lambda f: f.renameVariable("crossing_time", "line_time"),
         "has the layout of rockfall 1: run the case again"),
    ],
)  # fmt: skip
def test_a_result_that_is_not_whole_is_refused(whole, change, said):
    change_result(whole, change)
    with pytest.raises(rockfall.RockfallError, match=f"^{whole}: {said}$"):
        rockfall.read_result(whole)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f.renameVariable("stop_y", "q"), "the result is incomplete: "),
        (
            lambda f: f.renameDimension("boulder", "q"),
            "whole.nc: .*: must have dimensions boulder$",
        ),
        (lambda f: f["y"].__setitem__(3, 0.0), "dem: coordinate y is not evenly spaced$"),
    ],
)
def test_an_export_writes_all_or_nothing(whole, change, said):
    change_result(whole, change)
    there = sorted(Path().iterdir())
    with pytest.raises(rockfall.RockfallError, match=said):
        export(whole, "new/folder")
    assert sorted(Path().iterdir()) == there
