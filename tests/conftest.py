# SPDX-License-Identifier: BSD-3-Clause
"""What several tests start from."""

import os
import resource
import subprocess
from pathlib import Path

import pytest

import batch_case
import rockfall
import slope_case
from programs import find_program


@pytest.fixture
def few_boulders(tmp_path):
    """The file of cases/vaujany with 50 boulders, in a folder of its own."""
    folder = (Path(__file__).parents[1] / "cases/vaujany").resolve()
    case = rockfall.read_case(folder / "case.nml")
    case = case.replace(
        case={"boulders": 50},
        terrain={"dem": folder / "dem.tif"},
        surface={key: folder / case.surface[key] for key in ("zones", "table")},
    )
    path = tmp_path / "case.nml"
    path.write_text(case.text())
    return path


@pytest.fixture(scope="session")
def batch():
    """Run the program in a folder; `limit` is the longest file it may write [bytes]."""
    program = find_program()
    assert program, "rockfall-batch is not built"

    def run(*arguments, cwd, limit=None, env=None):
        def lower_limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

        return subprocess.run(
            [program, *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=120,
            preexec_fn=lower_limit if limit else None, env={**os.environ, **(env or {})},
        )  # fmt: skip

    return run


@pytest.fixture(scope="session")
def netcdf(batch):
    """Skips a test where the program was built without netCDF."""
    if "without netCDF" in batch("--version", cwd=".").stdout:
        pytest.skip("rockfall-batch was built without netCDF")


@pytest.fixture
def made(tmp_path):
    """A folder with every raster that the cases of `batch_case` name."""
    folder = tmp_path / "case"
    folder.mkdir()
    batch_case.write_rasters(folder)
    return folder


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with a case that runs, made the current one."""
    monkeypatch.chdir(tmp_path)
    slope_case.write_slope()
    return tmp_path
