# SPDX-License-Identifier: BSD-3-Clause
"""Command line: exit status, one line for each error, and no file after an error."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import rockfall
import scenes
from made import every_third, make_raster
from programs import (
    PROGRESS,
    SAYS_PROGRESS,
    limited,
    refuses,
    runs_shell,
    sends_signals,
    wait_until_running,
)
from rockfall.analysis.lines.samples import worst_lines
from rockfall.cli import main
from rockfall.result.crossings import at_lines
from rockfall.result.dataset import read_result
from slope_case import CASE, slope, zones


def command(*arguments, prefix=(), **options):
    """Run `rockfall` in a process of its own; `options` are those of subprocess.run."""
    program = [*prefix, sys.executable, "-m", "rockfall", *map(str, arguments)]
    return subprocess.run(program, capture_output=True, text=True, timeout=600, **options)


def files(folder):
    return sorted((path.name, path.stat().st_size) for path in folder.rglob("*"))


# ---- errors in the files of a case


def change(old, new, file="case.nml"):
    """Function that replaces the first `old` in a file of the case by `new`."""

    def harm():
        text = Path(file).read_text()
        assert old in text
        Path(file).write_text(text.replace(old, new, 1))

    return harm


def write(file, content):
    return lambda: Path(file).write_bytes(content)


def remove(file):
    return lambda: Path(file).unlink()


def halve(file):
    def harm():
        content = Path(file).read_bytes()
        Path(file).write_bytes(content[: len(content) // 2])

    return harm


def raster(file, array, **about):
    return lambda: make_raster(file, array, **about)


def several(*harms):
    return lambda: [harm() for harm in harms]


def with_hole():
    z = slope()
    z[2:6, 10:14] = -9999
    return raster("dem.tif", z, nodata=-9999)


def without_set(ratio):
    def harm():
        groups = scenes.CALM_SETS.split("&impact_set ")
        kept = [group for group in groups if not group.startswith(f"ratio = {ratio}")]
        assert len(kept) == 5
        Path("sets.nml").write_text("&impact_set ".join(kept))

    return harm


ZONES = "zones = 'zones.tif', table = 'zones.csv'"
RADII = change(ZONES, "mean_radius = 'rm.tif'")
CELLS = change("x = 600060.0, y = 4999980.0", "cells = 'cells.tif'")
HOSTILE = {
    "removed key": (change("seed", "sampling"),
        "case.nml: &case sampling = .*: was removed: omit it, boulders are always drawn at random"),
    "unknown key": (change("density", "densty"),
        r"case.nml: line 5: &boulder densty: unknown key \(similar keys: density, .*"),
    "unknown word": (change("'energy_mean'", "'energy_mean', 'passage'"),
        r"case.nml: &output maps \(value 3\) = 'passage': must be a map such as "
        r"passages(, \w+){4} \(all maps: docs/result.md, Maps\)"),
    "NaN": (change("2800.0", "NaN"), r"case.nml: &boulder density = NaN: must be a finite .*"),
    "out of range": (change("2800.0", "-3.0"),
        r"case.nml: &boulder density = -3.0: must be > 0 \[kg/m3\]"),
    "key given twice": (change("density = 2800.0", "density = 2800.0, density = 2700.0"),
        r"case.nml: line 5: &boulder density: is given twice in this group \(first in line 5\)"),
    "group given twice": (change("&terrain", "&case seed = 2 /\n&terrain"),
        r"case.nml: line 1: &case: this group must occur only once; only &line, &barrier, &dam, "
        r"&scenario, &variant may repeat"),
    "case missing": (remove("case.nml"), r"case.nml: cannot be read: No such file or directory"),
    "case empty": (write("case.nml", b""), r"case.nml: &terrain dem is missing: .*"),
    "case of bytes": (write("case.nml", CASE.replace("Slope", "Hänge").encode("latin-1")),
        r"case.nml: line 1: character code 228 is not text \(UTF-8 expected\)"),
    "DEM missing": (remove("dem.tif"), r"case.nml: &terrain dem = 'dem.tif': no such file"),
    "DEM truncated": (halve("dem.tif"),
        r"dem.tif: cannot be read as a raster \(unknown format, truncated or damaged\): .*"),
    "zone without a row": (raster("zones.tif", zones() + 1),
        r"zones.tif: zone 3 \(360 cells\) has no row in zones.csv"),
    "radius of zero in a raster": (several(RADII, raster("rm.tif", 0 * slope())),
        r"rm.tif: .*720.* > 0 .*"),
    "raster of radii with holes": (several(RADII, raster("rm.tif", np.full_like(slope(), np.nan))),
        r"rm.tif: 720 cells of the terrain without a value, .*"),
    "release outside the DEM": (change("y = 4999980.0", "y = 5000001.0"),
        r"case.nml: &release: source 1 \(600060.000, 5000001.000\) lies outside the terrain .*"),
    "release on nodata": (with_hole(),
        r"case.nml: &release: source 1 \(600060.000, 4999980.000\) lies on or next to a nodata "
        r"cell.*"),
    "covariance indefinite": (change("-0.000681", "-0.681", "sets.nml"),
        r"sets.nml: line \d+: &impact_set .*(definite|eigenvalue).*"),
    "covariance with a negative variance": (change("0.000894", "-0.000894", "sets.nml"),
        r"sets.nml: line \d+: &impact_set .*"),
    "covariance too short": (change("0.000000, 0.002672,", "0.002672,", "sets.nml"),
        r"sets.nml: .*covariance.*must have 45 values, not 44"),
    "covariance with NaN": (change("0.002672", "NaN", "sets.nml"),
        r"sets.nml: .*covariance \(value 1\) = NaN: must be a finite real number.*"),
    "ratio missing": (without_set(3), r"sets.nml: &impact_set is missing for ratio 3: .* ratios "
                                      r"1 to 5"),
    "sets missing": (remove("sets.nml"),
        r"case.nml: &impact sets = 'sets.nml': no such file \(shipped sets: .*vaujany-observed.*"),
    "no boulders": (change("boulders = 20", "boulders = 0"),
        r"case.nml: &case boulders = 0: must be 1 to 1e15"),
    "number of boulders missing": (change("boulders = 20, ", ""),
        r"case.nml: &case boulders, boulders_total: give one of the two: .*"),
    "no source cells": (several(CELLS, raster("cells.tif", 0 * zones())),
        r"cells.tif: no source cells: at least one cell must be above zero"),
    "more boulders than memory": (change("boulders = 20", "boulders = 2000000000"),
        r"case.nml: 2000000000 boulders .* do not fit in memory"),
    "more boulders than cells count": (
        change("boulders = 20", "boulders = 1000000000000"),
        r"case.nml: &case boulders = 1000000000000 from each of 1 sources: must be at most "
        r"2147483647 in total: use boulders_total",
    ),
}  # fmt: skip


@pytest.mark.family(2)
@pytest.mark.parametrize("name", HOSTILE)
def test_bad_input_is_one_line_and_nothing_is_written(name, place, capfd):
    harm, message = HOSTILE[name]
    harm()
    refuses(["check", "case.nml"], message, capfd)
    refuses(["run", "case.nml", "-o", "out.nc"], message, capfd)
    if "memory" not in name:  # another machine may have more
        refuses(["prepare", "case.nml", "prepared"], message, capfd)


FAULTS = (
    (change("seed", "sed"), r"line 1: &case sed: unknown key \(similar keys: seed, .*"),
    (
        change("&impact", "&impakt"),
        r"line .*: &impakt: unknown group \(similar groups: &impact, .*",
    ),
    (change("2800.0", "-3.0"), r"&boulder density = -3.0: must be > 0 \[kg/m3\]"),
)


def test_all_faults_of_a_case_are_told_at_once(place, capfd):
    for harm, _ in FAULTS:
        harm()
    lines = "\n".join(f"rockfall: case.nml: {said}" for _, said in FAULTS)
    refuses(["run", "case.nml", "-o", "out.nc"], lines.removeprefix("rockfall: "), capfd)


def test_all_missing_files_are_told_at_once(place, capfd):
    Path("dem.tif").unlink()
    Path("zones.csv").unlink()
    line = "case.nml: &terrain dem = 'dem.tif': no such file\nrockfall: case.nml: &surface table .*"
    refuses(["run", "case.nml", "-o", "out.nc"], line, capfd)


ARGUMENTS = {
    "no command": ([], r"the following arguments are required: COMMAND: see rockfall --help"),
    "unknown command": (["fly"], r".*invalid choice: 'fly'.*: see rockfall --help"),
    "no case": (["run"], r".*required: CASE: see rockfall run --help"),
    "unknown option": (["run", "case.nml", "--fast"], r"unrecognized arguments: --fast: see .*"),
    "negative seed": (["run", "case.nml", "--seed=-1"], r"case.nml: &case seed = -1: must be >= 0"),
    "folder of the output missing": (["run", "case.nml", "-o", "no/out.nc"],
        r"no/out.nc: folder no does not exist"),
    "output is another file": (["run", "case.nml", "-o", "dem.tif"],
        r"dem.tif: is an input; not overwritten"),
    "prepare over the case": (["prepare", "case.nml", ".", "--overwrite"],
        r"case.nml: is an input; not overwritten"),
}  # fmt: skip
if sys.platform != "win32":  # except where /dev and /proc are ordinary names
    ARGUMENTS |= {
        "output is a device": (["run", "case.nml", "-o", "/dev/null"],
            r"/dev/null: is not a regular file"),
        "folder that takes no files": (["run", "case.nml", "-o", "/proc/out.nc"],
            r"/proc/out.nc: folder /proc is not writable: .*"),
        "prepare where no folder can be": (["prepare", "case.nml", "/proc/prepared"],
            r"/proc/prepared: folder /proc is not writable: .*"),
    }  # fmt: skip


@pytest.mark.parametrize("name", ARGUMENTS)
def test_bad_arguments_are_one_line_and_nothing_is_written(name, place, capfd):
    words, message = ARGUMENTS[name]
    refuses(words, message, capfd)


@pytest.mark.all
@pytest.mark.parametrize("size", [0, 20_000])
def test_full_disk_leaves_nothing(place, size):
    before = files(place)
    first = limited("RLIMIT_FSIZE", size)
    done = command("run", "case.nml", "-o", "out.nc", cwd=place, preexec_fn=first)
    assert done.returncode == 2 and done.stdout == ""
    assert re.fullmatch(
        r"rockfall: out.nc: (cannot be written|needs at least [\d.]+ MB of disk): .*\n", done.stderr
    )
    assert files(place) == before
    first = limited("RLIMIT_FSIZE", size // 10)
    done = command("prepare", "case.nml", "new", cwd=place, preexec_fn=first)
    assert done.returncode == 2 and done.stdout == ""
    assert re.fullmatch(r"rockfall: new.*: cannot be written: .*\n", done.stderr)
    assert files(place) == before


def test_letters_that_the_terminal_does_not_have(place):
    Path("case.nml").write_text(CASE.replace("Slope", "Straße"))
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = command("run", "case.nml", "-o", "out.nc", cwd=place, env=ascii_only)
    assert (done.returncode, done.stderr) == (0, "") and "Stra?e" in done.stdout


@pytest.mark.all
@runs_shell
def test_output_that_nobody_takes(place):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "rockfall", "check", "case.nml"],
            stdout=full, stderr=subprocess.PIPE, text=True, cwd=place, timeout=600,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == "rockfall: output: No space left on device\n"
    shell = f"{sys.executable} -m rockfall check case.nml | true; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", shell], capture_output=True, text=True, cwd=place)
    assert (done.stdout, done.stderr) == ("0\n", "")


# ---- valid use


def test_check_says_what_would_run_and_writes_nothing(place, capsys):
    before = files(place)
    assert main(["check", "case.nml"]) == 0
    out, err = capsys.readouterr()
    assert files(place) == before and err == ""
    rows = {line[2:15].strip(): line[15:] for line in out.splitlines()[1:]}
    assert out.startswith("case.nml: Slope\n")
    assert rows["terrain"] == "24 x 30 cells of 5 m, 0.0% nodata, float32, EPSG:32632"
    assert rows["surface"] == "method B, zones.tif: 2 of 2 zones used"
    assert rows["sizes"].startswith("R_b 0.576 m, volume 0.8 m3, mass 2,240 kg")
    assert "zone 1: R_m 0.3 m, R_b/R_m 1.92; neutral slope " in out
    assert "zone 2: R_m 0.2 m, R_b/R_m 2.88; neutral slope " in out
    assert "by R_b/R_m, 0.0% by speed, 0.0% by angle, in a pilot run" in rows["rebounds"]
    assert rows["impact sets"].endswith(", fitted on speeds and angles that it does not state")
    assert rows["boulders"] == "20, 20 from each source; sources: 1 (points)"
    assert rows["lines"] == "L" and rows["maps"] == "passages, energy_mean"
    assert re.match(r"about \d+ MB \(rasters", rows["memory"])
    assert re.search(r"of CPU, .* \(estimated from 20 boulders\)", rows["time"])


@pytest.mark.family(2)
@pytest.mark.parametrize("more", [0, 1, pytest.param(5, marks=pytest.mark.all)])
def test_the_terminal_shows_twenty_lines_and_says_how_to_get_the_others(place, more, capsys):
    lines = [{"name": f"L{k}", "x": [600000.0, 600120.0], "y": [4999930.0 - k] * 2}
             for k in range(20 + more)]  # fmt: skip
    case = rockfall.read_case("case.nml").replace(line=lines)
    Path("many.nml").write_text(case.text())
    said = f"  and {more} more: `rockfall lines OUT.nc -o FILE.csv` writes all"
    for words in ["run", "many.nml", "-o", "many.nc"], ["lines", "many.nc", "-o", "many.csv"]:
        assert main(words) == 0
        out = capsys.readouterr().out
        shown = [k for k in range(20 + more) if re.search(rf"^ *L{k}\b", out, re.M)]
        assert len(shown) == 20
        assert {*worst_lines(read_result("many.nc"), 3)} <= {*shown}
        assert (said in out.splitlines()) == (more > 0)
    names = [row.split(",")[0] for row in Path("many.csv").read_text().splitlines()]
    assert {f"L{k}" for k in range(20 + more)} <= {*names}


def test_run_writes_the_result_of_the_api_and_a_summary(place, capsys):
    assert main(["run", "case.nml"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    case = rockfall.read_case("case.nml")
    result = rockfall.run(case)
    with xr.open_dataset("case.nc", mask_and_scale=False, decode_times=False) as written:
        xr.testing.assert_equal(written, result)
    lines = out.splitlines()
    assert lines[0] == "Slope: 20 boulders" and lines[-1] == "case.nc"
    table = rockfall.line_statistics(result).set_index("quantity")
    speed, height = table.loc["speed"], table.loc["passing_height"]
    low, high = (100 * speed[f"fraction_{end}"] for end in ("low", "high"))
    at = next(k for k, line in enumerate(lines) if line.split()[:1] == ["L"])
    _, n, *numbers = lines[at].split()
    assert int(n) == speed["n"]
    fraction, *means = map(float, numbers)
    assert fraction == pytest.approx(100 * speed["fraction"], abs=(high - low) / 4)
    assert means == pytest.approx([speed["mean"], height["mean"]], rel=0.02)
    assert lines[at + 1].split()[1:] == ["(–)", "(–)"]  # 3 pass
    assert any(line.endswith("20     100 %") for line in lines)


def test_overrides_are_those_of_the_case(place, capsys):
    words = ["--boulders", "5", "--seed", "3", "--threads", "1", "--quiet"]
    assert main(["run", "case.nml", "-o", "o.nc", *words]) == 0
    assert capsys.readouterr() == ("", "")
    case = rockfall.read_case("case.nml").replace(case={"boulders": 5, "seed": 3})
    with xr.open_dataset("o.nc", mask_and_scale=False, decode_times=False) as written:
        xr.testing.assert_equal(written, rockfall.run(case))
        assert written.attrs["seed"] == 3 and written.sizes["boulder"] == 5
        assert written.attrs["threads"] == 1


def test_a_case_elsewhere_leaves_its_result_here(place, monkeypatch, capsys):
    (place / "here").mkdir()
    monkeypatch.chdir(place / "here")
    assert main(["run", "../case.nml", "--quiet"]) == 0
    assert [path.name for path in Path().iterdir()] == ["case.nc"]


def test_a_line_outside_the_terrain_is_a_warning(place, capsys):
    change("4999930.0, 4999930.0", "4000000.0, 4000000.0")()
    for words in (["check", "case.nml"], ["run", "case.nml", "--quiet"]):
        assert main(words) == 0
        assert capsys.readouterr().err == (
            "rockfall: warning: case.nml: &line name = 'L': lies entirely outside the terrain\n"
        )
    with xr.open_dataset("case.nc") as written:
        assert np.isnan(at_lines(written)["line_speed"]).all()


def test_a_release_at_rest_on_the_ground_is_a_warning(place, capsys):
    change(", drop_height = 2.0", "")()
    assert main(["check", "case.nml"]) == 0
    assert capsys.readouterr().err == (
        "rockfall: warning: case.nml: &release: no drop_height and no velocity: "
        "boulders rest at the source where the ground is less steep than rest_angle\n"
    )


def test_version_and_help(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"rockfall {rockfall.__version__}\n"
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    assert all(name in shown for name in ("check", "run", "prepare", "export"))


def test_start_is_light(place):
    code = "import sys; from rockfall.cli import main; main(['--help']); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.splitlines()[-1].split())
    assert not loaded & {"xarray", "pandas", "netCDF4", "rasterio", "matplotlib", "rich", "shapely"}


def test_a_fault_of_ours_is_one_line(place, capsys, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("oh\nno")

    monkeypatch.setattr("rockfall.cli.given.read_scene", broken)
    assert main(["run", "case.nml"]) == 1
    assert capsys.readouterr().err == (
        "rockfall: internal error: ZeroDivisionError: oh no "
        "(please report: set ROCKFALL_TRACEBACK=1 for the trace)\n"
    )
    monkeypatch.setenv("ROCKFALL_TRACEBACK", "1")
    assert main(["run", "case.nml"]) == 1
    assert "Traceback" in capsys.readouterr().err


@sends_signals
def test_ctrl_c_keeps_the_boulders_done(place):
    whole = 3_000_000
    words = ["run", "case.nml", "-o", "part.nc", "--boulders", str(whole)]
    child = subprocess.Popen(
        [sys.executable, "-m", "rockfall", *words], env=os.environ | SAYS_PROGRESS,
        cwd=place, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    wait_until_running(child)
    child.send_signal(signal.SIGINT)
    out, err = child.communicate(timeout=600)
    assert child.returncode == 130 and out == ""
    said = re.fullmatch(
        rf"(?:{PROGRESS})*rockfall: interrupted: part.nc contains the first ([\d,]+) of 3,000,000 "
        "boulders and is a valid result: continue with --resume\n",
        err,
    )
    assert said
    done = int(said[1].replace(",", ""))
    with xr.open_dataset("part.nc", mask_and_scale=False, decode_times=False) as part:
        assert 0 < done < whole and part.sizes["boulder"] == part.attrs["boulder_last"] == done
        assert not part.attrs["complete"]
        few = min(done, 2000)
        case = rockfall.read_case("case.nml").replace(case={"boulders": few})
        first = rockfall.run(case)
        for name, variable in first.data_vars.items():
            if "boulder" in variable.dims:
                xr.testing.assert_equal(part[name].isel(boulder=slice(few)), variable)
    assert not list(place.glob(".*"))


def test_ctrl_c_before_the_first_boulder_writes_nothing(place, capsys, monkeypatch):
    def pressed(*_, **__):
        raise KeyboardInterrupt

    before = files(place)
    monkeypatch.setattr("rockfall.cli.given.read_scene", pressed)
    assert main(["run", "case.nml"]) == 130
    assert capsys.readouterr().err == "rockfall: interrupted: no incomplete file was written\n"
    assert files(place) == before


@pytest.mark.parametrize(
    ("command", "more"),
    every_third([
        ("ensemble", ["--runs", "8"]), ("models", []), ("convergence", ["--reference", "40"]),
        ("back", ["seen.csv", "--members", "64", "--effective", "2"]),
    ]),
)  # fmt: skip
def test_studies_of_many_runs_say_what_is_doubtful_in_their_case(place, capsys, command, more):
    """A volume given in litres causes a warning, as in `check` and `run`."""
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    text = CASE.replace("volume_mean = 0.8", "volume_mean = 800.0")
    Path("case.nml").write_text(text + "&ensemble runs = 8, volume_factor = 1.2 /\n")
    Path("seen.csv").write_text("line,quantity,unit,mean,std,n\nL,speed,m/s,12.5,5.2,80\n")
    boulders = ["4", "8"] if command == "convergence" else ["4"]
    main([command, "case.nml", *more, "--boulders", *boulders])
    err = capsys.readouterr().err
    assert "warning: case.nml: &boulder volume_mean = 800 m3: a boulder 12 m across: is" in err
