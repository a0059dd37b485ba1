# SPDX-License-Identifier: BSD-3-Clause
"""The R example in docs/c_interface.md runs, and is bit-identical to Python."""

import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from affine import Affine

import rockfall
from made import make_raster
from programs import ROOT

BLOCK = r"```{} title=\"(.+?)\"\n(.*?)^```$"
#: Options that save time and do not change results.
QUICK = ["-Dpython=false", "-Dlibrary=true", "-Dnetcdf=disabled", "-Db_lto=false", "--libdir=lib"]


@pytest.mark.all
@pytest.mark.skipif(not shutil.which("Rscript"), reason="R is not installed")
def test_r_runs_a_case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs/c_interface.md").read_text("utf-8")
    for kind in "c", "r":
        ((name, code),) = re.findall(BLOCK.format(kind), page, re.MULTILINE | re.DOTALL)
        (tmp_path / name).write_text(code, "utf-8")
    shutil.copy(ROOT / "python/rockfall/data/impact_sets/vaujany-observed.nml", tmp_path)
    meson = [sys.executable, "-m", "mesonbuild.mesonmain"]
    setup = [*meson, "setup", "build", ROOT, f"--prefix={tmp_path}/.local", *QUICK]
    subprocess.run(setup, check=True, capture_output=True)
    subprocess.run([*meson, "install", "-C", "build"], check=True, capture_output=True)
    commands = re.search(r"^export PKG_CPPFLAGS.*?(?=^```$)", page, re.MULTILINE | re.DOTALL)
    with (tmp_path / "plane.R").open("a") as script:
        script.write('writeBin(c(result$stop_x, result$stop_y), "stops")\n')
    env = os.environ | {"HOME": str(tmp_path)}
    subprocess.run(["sh", "-ec", commands[0]], check=True, env=env)

    rows = np.arange(200)[:, None] + np.zeros(60)
    make_raster("dem.tif", 1000 - 1.6 * np.minimum(rows, 120), Affine(2, 0, 0, 0, -2, 400))
    text = re.search(r"^text <- \"\n(.*?)^\"$", (tmp_path / "plane.R").read_text(), re.M | re.S)[1]
    (tmp_path / "case.nml").write_text(text.replace("(array)", "dem.tif"))
    result = rockfall.run(rockfall.read_case("case.nml"))
    stops = np.concatenate([result["stop_x"].values, result["stop_y"].values])
    assert stops.size == 1000
    assert np.array_equal(np.fromfile("stops"), stops)
