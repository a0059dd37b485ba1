# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall-batch`: the options of `rockfall run`, bit-identical results, one line for bad
input."""

import os
import shutil
import subprocess
import sys

import netCDF4
import numpy as np
import pytest

import rockfall
from made import make_raster
from programs import (
    everything,
    find_program,
    limited,
    make_full_case,
    refused_in_one_line,
    same_results,
)
from rockfall.cli import main
from rockfall.io.rasters.grid import Grid
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene

CASE = "ready/case.nml"


@pytest.mark.parametrize("of", [1, 3])
def test_parts_of_both_programs_join_to_the_run(of, batch, tmp_path):
    """The case has every output; parts begin within sources."""
    case = make_full_case(tmp_path)
    prepare(case, tmp_path / "ready")
    for k in range(1, of + 1):
        done = batch(CASE, "--shard", f"{k}/{of}", cwd=tmp_path)
        assert done.returncode == 0 and "line Straße: " in done.stdout
        assert done.stderr == (
            "rockfall-batch: warning: no boulder can cross apart: outside the terrain\n"
        )
    parts = [tmp_path / f"case.part{k}of{of}" for k in range(1, of + 1)]
    result = rockfall.run(case)
    assert len(np.unique(result["status"])) > 1
    same_results(rockfall.merge(parts[::-1]), result)
    if of > 1:
        rockfall.write_result(rockfall.run(case, shard=(2, of)), parts[1])
        same_results(rockfall.merge(parts), result)


@pytest.mark.all
def test_the_blocks_of_tables_go_with_the_parts_of_both_programs(batch, tmp_path):
    """A merged result has the block radius of ground with constant strength, and none for classical
    ground."""
    names = np.where(np.arange(60) < 25, 1, -1) + np.zeros((80, 1), "i2")
    make_raster(tmp_path / "grounds.tif", names.astype("i2"), crs="EPSG:32632", nodata=-1)
    (tmp_path / "grounds.csv").write_text(
        "name,id,model,r_n,r_t,strength,relief,source\nice,1,constant,0.3,0.8,,,by hand\n"
        "firm,,ploughed,,,1e6,13,by hand\n"
    )
    own = {"ground_map": "grounds.tif", "ground_table": "grounds.csv", "ground": "firm"}
    case = make_full_case(tmp_path, impact={"form": "table"}, surface=own)
    prepare(case, tmp_path / "ready")
    assert batch(CASE, "-o", "part.nc", cwd=tmp_path).returncode == 0
    merged = rockfall.merge([tmp_path / "part.nc"])
    radii = dict(zip(merged["ground"].values, merged["ground_block_radius"].values, strict=True))
    (firm,) = (one for one in read_scene(case).grounds if one.name == "firm")
    assert radii["firm"] == firm.block_radius > 0.5 and np.isnan(radii["ice"])
    same_results(merged, rockfall.run(case))


def test_options_change_what_they_name(ready, batch):
    """Options, and keys of the case that change no prepared array, take effect without preparing
    again."""
    case = rockfall.read_case(ready / "case.nml").replace(
        surface={"rg_reading": "radius"}, release={"drop_height": 2.0}, impact={"stop_speed": 0.3}
    )
    (ready / CASE).write_text(case.text(), encoding="utf-8")
    words = ["--boulders=3", "--seed", "77", "--threads", "2", "-o", "part", "--quiet"]
    done = batch(CASE, *words, cwd=ready)
    assert (done.returncode, done.stdout) == (0, "")
    changed = case.replace(case={"boulders": 3, "seed": 77, "threads": 2})
    result = rockfall.merge([ready / "part"])
    same_results(result, rockfall.run(changed))
    assert rockfall.Case.text(changed) == result.attrs["case"]


def test_a_scene_file_is_the_variables_of_its_description(ready):
    with netCDF4.Dataset(ready / "ready/scene.nc") as file:
        found = file.variables.items()
        assert {name: (one.dtype.str[1:], one.dimensions) for name, one in found} == {
            "crs": ("i4", ()), "x": ("f8", ("x",)), "y": ("f8", ("y",)),
            "elevation": ("f8", ("y", "x")), "zone": ("i1", ("y", "x")),
            "material_size": ("f8", ("material", "size")), "source_x": ("f8", ("source",)),
            "source_y": ("f8", ("source",)), "impact_sets": ("S1", ("impact_sets_length",)),
        }  # fmt: skip
        assert all(one.filters()["fletcher32"] for one in file.variables.values() if one.ndim)
        assert file["elevation"].grid_mapping == "crs" and "crs_wkt" in file["crs"].ncattrs()


ARGUMENTS = {
    (): "give a case file: see rockfall-batch --help",
    ("none.nml",): "none.nml: no such file",
    (CASE, CASE): f"{CASE}: only one case file is allowed, and {CASE} is given: see "
                  "rockfall-batch --help",
    (CASE, "--bolders=3"): "--bolders=3: unknown option: see rockfall-batch --help",
    (CASE, "--boulders"): "--boulders: a value is missing: see rockfall-batch --help",
    (CASE, "--boulders", "many"): "--boulders many: must be an integer",
    (CASE, "--seed", "1 / &case"): "--seed 1 / &case: must be an integer",
    (CASE, "--seed", "-1"): f"{CASE}: &case seed = -1: must be >= 0",
    (CASE, "--checkpoint", "-1"): "--checkpoint -1: must be >= 0 seconds",
    (CASE, "--checkpoint", "nan"): "--checkpoint nan: must be >= 0 seconds",
    (CASE, "--scene", "none.nc"): "none.nc: no such file",
    (CASE, "--scene", CASE): f"{CASE}: cannot be read as netCDF-4",
    (CASE, "-o", "none/x"): "none/x: folder none/ does not exist",
    (CASE, "-o", "ready"): "ready: is a folder: give a file name",
    (CASE, "-o", CASE): f"{CASE}: is an input; not overwritten",
    (CASE, "-o", "ready/scene.nc"): "ready/scene.nc: is an input; not overwritten",
    (CASE, "-o", "zones.csv"): "zones.csv: already exists; not overwritten (--overwrite "
    "replaces it)",
}  # fmt: skip
if sys.platform != "win32":  # except where /dev and /proc are ordinary names
    ARGUMENTS |= {
        (CASE, "-o", "/dev/null", "--overwrite"): "/dev/null: is not a regular file",
        (CASE, "-o", "/proc/x"): "/proc/x: cannot be written (is its folder writable?)",
    }


def test_bad_arguments_are_one_line(ready, batch, subtests):
    before = everything(ready)
    for words, said in ARGUMENTS.items():
        with subtests.test(words=words):
            refused_in_one_line(batch(*words, cwd=ready), said)
    done = batch(CASE, "--shard", "1/999", cwd=ready)
    assert done.returncode == 2
    assert done.stderr.endswith("rockfall-batch: --shard 1/999: the run has only 200 boulders\n")
    for text in ("0/3", "4/3", "3", "a/b", "1/0", "-1/3", "1/3/5", ""):
        said = f"--shard {text}: must be I/N with I from 1 to N"
        with subtests.test(shard=text):
            refused_in_one_line(batch(CASE, f"--shard={text}", cwd=ready), said)
    assert everything(ready) == before


def test_all_faults_of_a_case_are_told_at_once(ready, batch):
    text = (ready / CASE).read_text(encoding="utf-8")
    spoiled = text.replace("boulders =", "bolders =").replace("&output", "&outputs")
    (ready / CASE).write_text(spoiled, encoding="utf-8")
    with pytest.raises(rockfall.RockfallError) as error:
        rockfall.read_case(ready / CASE)
    assert [line.split(": ")[2:4] for line in error.value.faults] == [
        ["&case bolders", "unknown key (similar keys"],
        ["&outputs", "unknown group (similar groups"],
    ]  # fmt: skip
    named = [line.replace(str(ready / CASE), CASE) for line in error.value.faults]
    assert batch(CASE, cwd=ready).stderr.splitlines() == [
        f"rockfall-batch: {line}" for line in named
    ]


def test_help_and_version(batch, tmp_path):
    assert "usage: rockfall-batch CASE" in batch("--help", cwd=tmp_path).stdout
    assert batch("--version", cwd=tmp_path).stdout.startswith("rockfall-batch ")


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"terrain": {"dem": "other.tif"}}, "&terrain dem"),
        ({"surface": {"method": "A"}}, "&surface method"),
        ({"release": {"y": [4999980.0, 4999980.0, 4999980.0, 4999981.0]}}, "&release y"),
        ({"impact": {"sets": "other.nml"}}, "&impact sets"),
    ],
)
def test_another_scene_must_be_prepared_again(change, key, ready, batch):
    case = rockfall.read_case(ready / "case.nml").replace(**change)
    (ready / CASE).write_text(case.text(), encoding="utf-8")
    said = f"{CASE}: {key}: differs from the case of ready/scene.nc: run `rockfall prepare` again"
    refused_in_one_line(batch(CASE, cwd=ready), said)


def spoil(path, name, **about):
    """Write a netCDF file again with another value, type or shape of a variable, or without it."""
    with netCDF4.Dataset(path) as old:
        old.set_auto_maskandscale(False)
        with netCDF4.Dataset(f"{path}.new", "w") as new:
            new.setncatts({key: old.getncattr(key) for key in old.ncattrs()})
            for dim, one in old.dimensions.items():
                new.createDimension(dim, about.get(f"length_of_{dim}", len(one)))
            for other, one in old.variables.items():
                if other == name and about.get("gone"):
                    continue
                kind = about.get("kind", one.dtype) if other == name else one.dtype
                changed = any(f"length_of_{dim}" in about for dim in one.dimensions)
                made = new.createVariable(other, kind, one.dimensions, zlib=changed)
                made.setncatts({key: one.getncattr(key) for key in one.ncattrs() if key[0] != "_"})
                made.set_auto_maskandscale(False)
                values = one[...]
                if other == name and "change" in about:
                    values = about["change"](np.array(values))
                if not changed:
                    made[...] = values
    os.replace(f"{path}.new", path)


def put(value, at=0):
    def change(values):
        values.flat[at] = value
        return values

    return change


NO_SIZE = "zone, or the material_size of one,"
HOSTILE = {
    "no elevations": ("elevation", {"gone": True}, "elevation"),
    "whole elevations": ("elevation", {"kind": "i4"}, "elevation"),
    "far elevations": ("elevation", {"change": put(1e8)}, "elevation"),
    "infinite elevations": ("elevation", {"change": put(np.inf)}, "elevation"),
    "all missing": ("elevation", {"change": lambda z: z * np.nan}, "elevation"),
    "a zone too many": ("zone", {"change": put(4)}, "zone"),
    "a zone below zero": ("zone", {"change": put(-1)}, "zone"),
    "a zone without a size": ("material_size", {"change": put(np.nan)}, NO_SIZE),
    "a cell without a zone": ("zone", {"change": put(0)}, NO_SIZE),
    "no sizes": ("material_size", {"change": put(0.0)}, NO_SIZE),
    "sources nowhere": ("source_x", {"change": put(np.nan)}, "source_x, or source_y,"),
    "more cells than bytes": ("", {"length_of_x": 2**30, "length_of_y": 2**30}, "elevation"),
    "no sources": ("", {"length_of_source": 0}, "its number of sources"),
}  # fmt: skip


@pytest.mark.family(2)
@pytest.mark.parametrize("what", HOSTILE)
def test_a_scene_that_cannot_be_is_refused(what, ready, batch):
    name, about, said = HOSTILE[what]
    spoil(ready / "ready/scene.nc", name, **about)
    words = f"ready/scene.nc: is damaged: {said} is missing or malformed"
    refused_in_one_line(batch(CASE, cwd=ready), words)


def test_any_byte_that_is_another_is_refused_or_harmless(ready, batch):
    """Truncated files, and files with random changed bytes, are accepted or refused in one line;
    refusal writes no file."""
    good, random = (ready / "ready/scene.nc").read_bytes(), np.random.default_rng(7)
    before = sorted(os.listdir(ready))
    for turn in range(24):
        bad = bytearray(good)
        if turn % 4 == 0:
            bad = bad[: int(random.integers(len(bad)))]
        else:
            for at in random.integers(len(bad), size=20):
                bad[at] ^= int(random.integers(1, 256))
        (ready / "ready/scene.nc").write_bytes(bad)
        done = batch(CASE, "-o", "part", "--quiet", "--boulders", "1", cwd=ready)
        assert done.returncode in (0, 2)
        if done.returncode == 2:
            assert done.stderr.splitlines()[-1].startswith("rockfall-batch: ")
            assert len(done.stderr.splitlines()) <= 2  # one line may be a warning about the line
        assert (ready / "part").exists() == (done.returncode == 0)
        (ready / "part").unlink(missing_ok=True)
        assert sorted(os.listdir(ready)) == before


def test_sources_that_are_nowhere_are_refused_as_by_python(ready, batch):
    spoil(ready / "ready/scene.nc", "source_x", change=put(3.0))
    done = batch(CASE, cwd=ready)
    assert done.returncode == 2 and done.stderr.count("\n") == 2  # the other line is a warning
    assert (
        f"{CASE}: &release: source 1 (3.000, 4999980.000) lies outside the terrain" in done.stderr
    )


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("limit", "told"),
    [(10, "needs at least 1 MB of disk"), (15_000, "needs at least 1 MB"),
     (65_000, "cannot be written"), (300_000, "cannot be written")],
)  # fmt: skip
def test_a_full_disk_is_one_line(limit, told, ready, batch):
    """Rows of 200 boulders take 20 kB: a smaller limit is refused before the run, a larger limit
    when a file does not fit."""
    before = everything(ready)
    done = batch(CASE, "-o", "part", cwd=ready, limit=limit)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.splitlines()[-1].startswith(f"rockfall-batch: part: {told}")
    assert everything(ready) == before


def test_other_commands_say_what_finishes_a_part(ready, batch, capsys):
    assert batch(CASE, "-o", "part.nc", "--quiet", cwd=ready).returncode == 0
    path = ready / "part.nc"
    said = f"rockfall: {path}: is a part of a run: convert it to a result with `rockfall merge`\n"
    for words in (["lines", path], ["report", path], ["export", path, ready / "out"],
                  ["figures", path, ready / "out"]):  # fmt: skip
        assert main([*map(str, words)]) == 2
        assert capsys.readouterr().err == said
    assert not (ready / "out").exists()
    shutil.copy(path, ready / "other.nc")
    assert main(["merge", str(ready / "other.nc"), "-o", str(path), "--overwrite"]) == 0
    assert rockfall.read_result(path).attrs["complete"] == 1


def test_quantile_maps_take_memory_where_boulders_pass(batch, tmp_path):
    """Counts for all of a million cells would take 824 MB; the program may use 500 MB."""

    z, grid = (
        np.zeros((1000, 1000), "f4") - np.arange(1000)[:, None],
        Grid(0.0, 1000.0, 1.0, 1000, 1000),
    )
    maps = ["passages", "energy_q50", "speed_q50", "jump_height_q50"]
    case = rockfall.Case(
        case={"boulders": 8, "threads": 1}, surface={"uniform_mean_radius": 0.1}, terrain={},
        boulder={"volume_mean": 0.1}, release={"x": [500.0], "y": [990.0], "drop_height": 5.0},
        output={"maps": maps, "min_passages": 6}, folder=tmp_path,
    )  # fmt: skip
    prepare(case, tmp_path / "ready", dem=z, transform=grid)
    limit = 500 * 10**6
    done = subprocess.run(
        [find_program(), CASE, "-o", "part"], cwd=tmp_path, capture_output=True, text=True,
        preexec_fn=limited("RLIMIT_AS", limit),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = rockfall.run(case, dem=z, transform=grid)
    assert result["passages"].max() == 8
    same_results(rockfall.merge([tmp_path / "part"]), result)
