# SPDX-License-Identifier: BSD-3-Clause
"""Commands import only what they use, so that small cases start quickly."""

import subprocess
import sys

import netCDF4
import numpy as np
import pytest
from affine import Affine

import rockfall
from made import make_raster, write_ascii
from rockfall.cli import main
from rockfall.cli.arguments import make_parser
from rockfall.result import variables
from scenes import case_in, grid, place, rough

HEAVY = {
    "xarray", "pandas", "dask", "rasterio", "pyproj", "affine", "matplotlib", "jinja2", "scipy",
    "babel", "shapely", "pyogrio", "rich.console", "importlib.metadata",
}  # fmt: skip
COMMANDS = """
import sys
from rockfall.cli import main
for words in sys.argv[1:]:
    assert main(words.split()) == 0, words
print("modules", *sys.modules)
"""


def case_of_files(folder, maps, **groups):
    """Write a case and its terrain, with given maps, a line, histograms and trajectories."""
    output = {"maps": maps, "rebounds": True, "trajectories": 3, "energy_balance": True}
    groups["hazard"] = {"thresholds": [30.0, 300.0]}
    z = rough()
    write_ascii(folder / "dem.asc", z, grid(z))
    case = case_in(folder, case={"boulders": 20}, output=output, **groups, **place())
    (folder / "case.nml").write_text(case.replace(terrain={"dem": "dem.asc"}).text())


def modules(*commands, cwd):
    """Names of the modules imported by a process that has run these commands."""
    words = [sys.executable, "-W", "error", "-c", COMMANDS, *commands]
    done = subprocess.run(words, cwd=cwd, check=True, capture_output=True, text=True)
    return set(done.stdout.splitlines()[-1].split())


def described(path):
    """Yield everything in a netCDF file except values and times: dimensions, types, storage,
    attributes."""
    clocks = ("date_created", "wall_seconds", "cpu_seconds")
    with netCDF4.Dataset(path) as file:
        yield {dim: one.size for dim, one in file.dimensions.items()}
        yield [(name, file.getncattr(name)) for name in file.ncattrs() if name not in clocks]
        for name, one in file.variables.items():
            about = [(key, repr(one.getncattr(key))) for key in one.ncattrs()]
            yield name, one.dtype, one.dimensions, one.chunking(), one.filters(), about


def test_a_small_case_waits_for_no_package_that_it_does_not_use(tmp_path):
    case_of_files(tmp_path, [name for name in variables.MAP if "tree" not in name])
    part = "run case.nml --quiet --shard {}/2 -o part{}of2"
    found = modules(
        "check case.nml", "run case.nml -o whole.nc", part.format(1, 1), part.format(2, 2),
        "merge part1of2 part2of2 -o merged.nc", "prepare case.nml prepared", cwd=tmp_path,
    )  # fmt: skip
    assert "netCDF4" in found
    assert (HEAVY | {"rockfall_lab"}) & found == set()


@pytest.mark.all
@pytest.mark.parametrize(
    "command", ["lines whole.nc", "report whole.nc --overwrite", "export whole.nc exported"]
)
def test_a_command_that_reads_a_result_waits_for_no_dask_or_geopandas(tmp_path, command):
    pytest.importorskip("dask.array")
    case_of_files(tmp_path, [])
    assert main(["run", str(tmp_path / "case.nml"), "-o", str(tmp_path / "whole.nc")]) == 0
    words = [sys.executable, "-X", "importtime", "-m", "rockfall", *command.split()]
    done = subprocess.run(words, cwd=tmp_path, check=True, capture_output=True, text=True)
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "xarray" in imported
    assert not {"dask", "geopandas.geoseries"} & imported


def test_help_and_version_need_no_numpy(tmp_path):
    found = modules("--help", "--version", "run --help", cwd=tmp_path)
    assert (HEAVY | {"numpy", "rockfall_lab"}) & found == set()


@pytest.mark.parametrize("words", [["--help"], ["impact", "lab.nml"]])
def test_the_laboratory_may_be_missing(words, monkeypatch, capsys):
    make_parser.cache_clear()  # another test may have filled it
    monkeypatch.setattr("rockfall.cli.arguments.find_spec", lambda package: None)
    assert main(["lab", *words]) == 2
    said = capsys.readouterr()
    assert not said.out and said.err.count("\n") == 1
    assert "rockfall lab: the laboratory is not installed" in said.err


def test_command_and_function_write_the_same_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    forest = {"uniform_stems": 300.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 8.0}
    case_of_files(tmp_path, [*variables.MAP], forest={**forest, "uniform_conifers": 50.0})
    make_raster("dem.tif", rough(), crs=None, transform=Affine(5, 0, 0, 0, -5, 400))
    case = rockfall.read_case("case.nml").replace(terrain={"dem": "dem.tif"})
    (tmp_path / "case.nml").write_text(case.text())
    loaded = modules("run case.nml --quiet -o command.nc", cwd=tmp_path)
    assert "rasterio" in loaded  # Dask would take longer than writing the result
    assert not [name for name in loaded if name.startswith(("dask.array.", "distributed."))]
    rockfall.write_result(rockfall.run(rockfall.read_case("case.nml")), "function.nc")
    assert [*described("command.nc")] == [*described("function.nc")]
    with netCDF4.Dataset("command.nc") as one, netCDF4.Dataset("function.nc") as other:
        for name in one.variables:
            np.testing.assert_array_equal(one[name][...], other[name][...], err_msg=name)
