# SPDX-License-Identifier: BSD-3-Clause
"""Parts of a run: joined, they are the run itself; anything else is refused by name."""

import numpy as np
import pytest
import xarray as xr

import rockfall
from made import refused
from rockfall import variables
from rockfall.cli import main
from scenes import grid, make_case, rough, sets

BOULDERS = 403
MAPS = list(variables.MAP)
LINE = [{"name": "L", "x": [0.0, 300.0], "y": [280.0, 280.0]}]
OWN = ("wall_seconds", "cpu_seconds", "threads")  # of a run, and not of its numbers


def case_in(folder, **groups):
    output = {"maps": MAPS, "rebounds": True, "trajectories": 90}
    groups = {"case": {"boulders": BOULDERS}, "output": output, **groups}
    return make_case(folder, *sets(2.0), line=LINE, terrain={}, **groups)


def run(case, **how):
    z = rough()
    z[60:64, 25:28] = np.nan
    return rockfall.run(case, dem=z, transform=grid(z), **how)


def place(x=150.0, y=380.0):
    return {"release": {"x": [x], "y": [y], "drop_height": 5.0}}


@pytest.fixture
def case(tmp_path):
    return case_in(tmp_path, **place())


def files(folder, case, of):
    paths = [folder / f"{k}.nc" for k in range(1, of + 1)]
    for k, path in enumerate(paths, start=1):
        rockfall.write_result(run(case, shard=(k, of), threads=2), path)
    return paths


def same(one, other):
    """The same variables, bits and attributes, but for times and threads."""
    xr.testing.assert_identical(
        one.assign_attrs(dict.fromkeys(OWN, 0)), other.assign_attrs(dict.fromkeys(OWN, 0))
    )
    for name in other.variables:
        assert one[name].dtype == other[name].dtype, name


@pytest.mark.parametrize("of", [2, 7])
def test_parts_joined_in_any_order_are_the_run(tmp_path, case, of):
    paths, whole = files(tmp_path, case, of), run(case)
    assert not any(name.startswith("tally_") for name in whole.variables)
    same(rockfall.merge(paths[::-1]), whole)


def test_parts_in_memory_too(case):
    parts = [run(case, shard=(k, 64)) for k in range(1, 65)]
    same(rockfall.merge(parts), run(case))


def test_several_sources_and_a_part_in_the_middle_of_one(tmp_path):
    release = {"x": [130.0, 150.0, 170.0], "y": [380.0, 381.0, 379.0], "drop_height": 5.0}
    case = case_in(tmp_path, release=release)
    whole, parts = run(case), [run(case, shard=(k, 5)) for k in range(1, 6)]
    bounds = [(part.attrs["boulder_first"], part.attrs["boulder_last"]) for part in parts]
    assert bounds[0][0] == 1 and bounds[-1][1] == 3 * BOULDERS
    assert all(b[0] == a[1] + 1 for a, b in zip(bounds, bounds[1:], strict=False))
    same(rockfall.merge(parts), whole)


def test_a_part_is_a_result_of_its_boulders(case):
    part, whole = run(case, shard=(2, 3)), run(case)
    numbers = part["boulder"].values
    assert numbers[0] == BOULDERS // 3 + 1 and numbers[-1] == 2 * BOULDERS // 3
    assert part.attrs["complete"] == 0 and part.attrs["boulders_asked"] == BOULDERS
    for name in ("stop_x", "line_speed"):
        assert np.array_equal(part[name], whole[name].isel(boulder=numbers - 1), equal_nan=True)
    passed = part["passages"].values
    assert part["reach_probability"].values == pytest.approx(passed / numbers.size)


def test_without_maps_lines_or_trajectories(tmp_path):
    case = case_in(tmp_path, output={}, **place()).replace(line=[])
    parts = [run(case, shard=(k, 4)) for k in range(1, 5)]
    same(rockfall.merge(parts), run(case))


def test_what_is_missing_twice_or_of_another_run_is_named(tmp_path, case):
    paths = files(tmp_path, case, 4)
    with refused("merge: boulders 101 to 201 are missing"):
        rockfall.merge([paths[0], *paths[2:]])
    with refused("merge: boulders 1 to 100 are missing; boulders 303 to 403 are missing"):
        rockfall.merge(paths[1:3])
    with refused(f"merge: boulders 101 to 201 are twice: {paths[1]}"):
        rockfall.merge([*paths, paths[1]])
    other = tmp_path / "other.nc"
    rockfall.write_result(run(case, shard=(100, BOULDERS)), other)  # boulder 100 alone
    with refused(f"merge: boulders 100 to 100 are twice: {other}"):
        rockfall.merge([*paths, other])
    rockfall.write_result(run(case.replace(case={"seed": 5}), shard=(2, 4)), other)
    with refused(f"{other}: is of another case than {paths[0]}"):
        rockfall.merge([paths[0], other, *paths[2:]])
    z = rough(seed=2)
    rockfall.write_result(rockfall.run(case, dem=z, transform=grid(z), shard=(2, 4)), other)
    with refused(f"{other}: has another dem than {paths[0]}"):
        rockfall.merge([paths[0], other, *paths[2:]])
    rockfall.write_result(run(case), other)
    with refused(f"{other}: is not a part of a run, as --shard makes them"):
        rockfall.merge([other])
    with refused("merge: needs the parts of a run"):
        rockfall.merge([])


@pytest.mark.parametrize("shard", [(0, 4), (5, 4), (1, BOULDERS + 1)])
def test_shards_that_cannot_be(case, shard):
    with pytest.raises(rockfall.RockfallError, match="^shard = "):
        run(case, shard=shard)


def test_the_commands(few_boulders, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for k in (1, 2, 3):
        assert main(["run", "case.nml", "--quiet", "--shard", f"{k}/3"]) == 0
    parts = [f"case.part{k}of3" for k in (1, 2, 3)]
    assert not list(tmp_path.glob("*.nc"))
    assert main(["merge", *parts, "-o", "all.nc"]) == 0
    assert main(["run", "case.nml", "--quiet"]) == 0
    same(rockfall.read_result("all.nc"), rockfall.read_result("case.nc"))
    capsys.readouterr()
    assert main(["merge", *parts[:2], "-o", "no.nc"]) == 2
    assert capsys.readouterr().err == "rockfall: merge: boulders 34 to 50 are missing\n"
    assert not (tmp_path / "no.nc").exists()


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "a/b", "1/0", "-1/3", "1/3/5", ""])
def test_a_wrong_shard_is_refused_in_one_line(few_boulders, tmp_path, monkeypatch, capsys, text):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "case.nml", f"--shard={text}"]) == 2
    assert capsys.readouterr().err == (
        f"rockfall: --shard {text}: must be I/N with I from 1 to N\n"
    )
    assert not list(tmp_path.glob("*.nc"))
