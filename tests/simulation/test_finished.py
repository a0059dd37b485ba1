# SPDX-License-Identifier: BSD-3-Clause
"""`--resume` of a finished run, and a merge repeated: exit status 0, one line, and no byte
changes."""

import contextlib
import subprocess
from pathlib import Path

import netCDF4
import pytest

import rockfall
import slope_case
from programs import Killed, everything, find_program, killed_after
from rockfall.cli import main
from rockfall.simulation import simulate

FINISHED = "already contains the finished run of this case: nothing was changed"


def prepare(folder):
    """Write a small case, prepare it for rockfall-batch, and run it with both programs."""
    slope_case.write_slope(folder)
    with contextlib.chdir(folder):
        assert by_python("-o", "rockfall.nc") == 0
        if find_program():
            assert main(["prepare", "case.nml", "ready"]) == 0
            assert by_batch("-o", "rockfall-batch.nc") == 0


@pytest.fixture
def case(gallery, tmp_path, monkeypatch):
    """Work in a folder with a small case, prepared for rockfall-batch, and the results of both
    programs as `.done` files."""
    monkeypatch.chdir(tmp_path)
    gallery.copy("finished", prepare, tmp_path)
    for path in Path().glob("rockfall*.nc"):
        path.rename(path.with_suffix(".done"))
    return tmp_path


def by_python(*words):
    return main(["run", "case.nml", "--quiet", *words])


def by_batch(*words):
    if not find_program():
        pytest.skip("rockfall-batch is not built")
    return subprocess.run([find_program(), "ready/case.nml", "--quiet", *words]).returncode


PROGRAMS = {"rockfall": by_python, "rockfall-batch": by_batch}
SAME = ([], ["--overwrite"], ["--threads", "2"], ["--checkpoint", "0"])


@pytest.mark.family(3)
@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("shard", [(), ("--shard", "20/20")])
def test_a_finished_output_is_left_as_it_is(program, shard, case, capfd):
    run = PROGRAMS[program]
    words = ["-o", "a.nc", *shard]
    assert run(*words) == 0
    before = everything(Path())
    for more in SAME:
        capfd.readouterr()
        assert run(*words, "--resume", *more) == 0
        assert capfd.readouterr() == ("", f"{program}: a.nc: {FINISHED}\n")
        assert everything(Path()) == before


@pytest.mark.parametrize("shard", [(), ("--shard", "2/2")])
def test_parts_of_the_other_program_are_finished_too(shard, case, capfd):
    """A part of a run is finished for both programs; a part with all boulders is finished only for
    rockfall-batch."""
    assert by_batch("-o", "a.nc", *shard) == 0
    assert by_python("-o", "a.nc", "--resume", *shard) == (0 if shard else 2)
    said = FINISHED if shard else "already exists; not overwritten (--overwrite replaces it)"
    assert capfd.readouterr().err == f"rockfall: a.nc: {said}\n"


@pytest.mark.family(3)
@pytest.mark.parametrize("program", PROGRAMS)
@pytest.mark.parametrize("change", [
    ["--seed", "8"], ["--shard", "1/2"], "case", "dem", "damaged",
    *(pytest.param(one, marks=pytest.mark.all)
      for one in (["--boulders", "21"], ["--boulders-total", "19"], "version", "text")),
])  # fmt: skip
def test_what_is_not_the_same_is_not_overwritten_unasked(program, change, case, capfd):
    run, words = PROGRAMS[program], ["-o", "a.nc", "--resume"]
    if not Path(f"{program}.done").exists():
        pytest.skip("rockfall-batch is not built")
    Path(f"{program}.done").rename("a.nc")
    path, more = Path("a.nc"), change if isinstance(change, list) else []
    if change == "case":
        for name in filter(Path.exists, map(Path, ("case.nml", "ready/case.nml"))):
            name.write_text(name.read_text().replace("drop_height = 2.0", "drop_height = 2.5"))
    elif change == "damaged":
        path.write_bytes(path.read_bytes()[:-500])
    elif change == "text":
        path.write_text("mine\n")
    elif change in ("dem", "version"):
        with netCDF4.Dataset(path, "r+") as file:
            sums = file.input_checksums.replace("dem", "DEM")
            file.setncatts({"version": "9"} if change == "version" else {"input_checksums": sums})
    before = everything(Path())
    capfd.readouterr()
    assert run(*words, *more) == 2
    said = "a.nc: already exists; not overwritten (--overwrite replaces it)"
    assert capfd.readouterr().err == f"{program}: {said}\n"
    assert everything(Path()) == before
    assert run(*words, *more, "--overwrite") == 0
    assert path.read_bytes() != before[path]
    assert run(*words, *more) == 0 and FINISHED in capfd.readouterr().err


def test_a_result_that_was_interrupted_is_not_finished(case, monkeypatch, capsys):
    monkeypatch.setattr(simulate, "FIRST_CHUNK", 5)
    words = ["-o", "a.nc", "--checkpoint", "0"]
    with monkeypatch.context() as patch:
        killed_after(patch, 1)
        patch.setattr(simulate, "Interrupted", Killed)
        with pytest.raises(Killed):
            by_python(*words)
    assert by_python(*words, "--boulders", "3") == 0
    with netCDF4.Dataset("a.nc", "r+") as file:
        file.boulder_last, file.complete = 2, 0
    assert by_python(*words, "--boulders", "3", "--resume") == 2
    assert "not overwritten" in capsys.readouterr().err


@pytest.mark.all
def test_a_second_merge_changes_nothing(case, capfd):
    for k in (1, 2):
        assert by_python("-o", f"part{k}of2", "--shard", f"{k}/2") == 0
    words = ["merge", "part1of2", "part2of2", "-o", "out.nc"]
    assert main(words) == 0
    assert rockfall.read_result("out.nc").equals(rockfall.run(rockfall.read_case("case.nml")))
    before = everything(Path())
    capfd.readouterr()
    for again in (words, [words[0], words[2], words[1], *words[3:]]):
        assert main(again) == 0
        assert capfd.readouterr() == ("", f"rockfall: out.nc: {FINISHED}\n")
    assert by_python("-o", "out.nc", "--resume") == 0  # the undivided run is the same
    assert everything(Path()) == before
    assert main([*words, "--overwrite"]) == 0  # merged again on request
    assert main(["merge", "part1of2", "-o", "out.nc"]) == 2  # boulders are missing
    assert "boulders 11 to 20 are missing" in capfd.readouterr().err
    assert by_python("-o", "other.nc", "--seed", "8") == 0
    assert main([*words[:-1], "other.nc"]) == 2
    assert "other.nc: already exists; not overwritten" in capfd.readouterr().err
