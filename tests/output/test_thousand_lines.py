# SPDX-License-Identifier: BSD-3-Clause
"""A result with a thousand lines read by CDO, NCO, GDAL, QGIS and R: each finds the values of
`rockfall.crossings` and of the maps. Tests of missing programs are skipped."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import netCDF4
import numpy as np
import pytest

import rockfall
from scenes import grid, make_case, rough, sets

pytestmark = pytest.mark.all

LINES = 1000
STORED = ("time", "distance", "velocity_x", "velocity_y", "velocity_z", "omega", "jump_height",
          "passing_height")  # fmt: skip
#: R packages, and how each reads a variable of the file `f`.
R = {"RNetCDF": ("open.nc", "var.get.nc"), "ncdf4": ("nc_open", "ncvar_get")}
R_SCRIPT = """
suppressPackageStartupMessages(library({package}))
f <- {open}("out.nc")
line <- {get}(f, "crossing_line")
v <- sqrt({get}(f, "crossing_velocity_x")^2 + {get}(f, "crossing_velocity_y")^2
          + {get}(f, "crossing_velocity_z")^2)
passing <- as.vector({get}(f, "crossing_passing_height"))
name <- {get}(f, "line_name")
size <- {get}(f, "row_size")
stopifnot(identical(as.vector(tabulate(line + 1, length(name))), as.integer(size)))
table <- data.frame(line = name[line + 1], boulder = as.vector({get}(f, "crossing_boulder")),
                    speed = as.vector(v), passing_height = passing)
con <- file("r.csv", "w", encoding = "UTF-8")
write.csv(format(table, digits = 15), con, row.names = FALSE)
close(con)
writeBin(as.vector({get}(f, "passages")), "passages")
"""
QGIS_SCRIPT = """
import json, os
from qgis.core import QgsApplication, QgsRasterLayer, QgsVectorLayer
QgsApplication.setPrefixPath("/usr", True)
app = QgsApplication([], False)
app.initQgis()
layer = QgsRasterLayer('NETCDF:"out.nc":passages', "passages")
block = layer.dataProvider().block(1, layer.extent(), layer.width(), layer.height())
found = {"passages": [[block.value(row, column) for column in range(layer.width())]
                      for row in range(layer.height())]}
table = QgsVectorLayer("out.gpkg|layername=crossings", "crossings")
names = "line", "boulder", "speed_m_s"
found["crossings"] = [[one[name] for name in names] for one in table.getFeatures()]
open("qgis.json", "w").write(json.dumps(found))
os._exit(0)  # PyQGIS may crash while it is taken down
"""


def needs(program):
    return pytest.mark.skipif(not shutil.which(program), reason=f"{program} is not installed")


def has_qgis():
    find = ["/usr/bin/python3", "-c", "import qgis.core"]
    return Path(find[0]).exists() and not subprocess.run(find, capture_output=True).returncode


def has_r(package):
    find = ["Rscript", "-e", f"library({package})"]
    return shutil.which(find[0]) and not subprocess.run(find, capture_output=True).returncode


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """File of a result with bent lines one below the other, most of which a boulder crosses."""
    folder = tmp_path_factory.mktemp("lines")
    y = np.linspace(398.0, 5.0, LINES)
    line = [{"name": f"Straße {k}", "x": [0.0, 140.0, 295.0], "y": [at, at - 4.0, at]}
            for k, at in enumerate(y.tolist())]  # fmt: skip
    case = make_case(
        folder, *sets(), line=line, case={"boulders": 10},
        release={"x": [150.0, 120.0], "y": [380.0, 390.0]}, output={"maps": ["passages"]},
    )  # fmt: skip
    z = rough()
    rockfall.write_result(rockfall.run(case, dem=z, transform=grid(z)), folder / "out.nc")
    return folder / "out.nc"


@pytest.fixture(scope="module")
def result(file):
    return rockfall.read_result(file)


@pytest.fixture
def run(file, tmp_path, monkeypatch):
    """Function that runs a program in a folder with a copy of the file, and returns its output."""
    shutil.copy(file, tmp_path / "out.nc")
    monkeypatch.chdir(tmp_path)

    def run(*words, **env):
        done = subprocess.run(words, capture_output=True, text=True, env=os.environ | env)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


def has_crossings(path, result):
    """Check that a file has the crossings of a result, and their number at each line, bit for
    bit."""
    with netCDF4.Dataset(path) as file:
        for name in (*STORED, "line", "boulder"):
            values = result[f"crossing_{name}"].values
            np.testing.assert_array_equal(file[f"crossing_{name}"][:].filled(), values)
        np.testing.assert_array_equal(file["row_size"][:], result["row_size"].values)


@needs("cdo")
def test_cdo_copies_all_crossings_and_computes_with_them(run, result):
    run("cdo", "-s", "copy", "out.nc", "copy.nc")
    has_crossings("copy.nc", result)
    table = rockfall.crossings(result)
    speed = "speed=sqrt(sqr(crossing_velocity_x)+sqr(crossing_velocity_y)+sqr(crossing_velocity_z))"
    said = run("cdo", "-s", "outputf,%.9g,1", f"-expr,{speed}", "out.nc")
    np.testing.assert_allclose(np.array(said.split(), "f8"), table["speed"], rtol=1e-6)
    said = run("cdo", "-s", "outputf,%.9g,1", "-selname,passages", "out.nc")
    np.testing.assert_array_equal(np.array(said.split(), "f8"), result["passages"].values.ravel())


@needs("ncks")
def test_nco_copies_all_crossings_and_computes_with_them(run, result):
    run("ncks", "-O", "out.nc", "copy.nc")
    has_crossings("copy.nc", result)
    with netCDF4.Dataset("copy.nc") as file:
        assert file["line_name"][:].tolist() == result["line_name"].values.tolist()
    speed = "speed=sqrt(crossing_velocity_x^2+crossing_velocity_y^2+crossing_velocity_z^2)"
    run("ncap2", "-O", "-v", "-s", speed, "out.nc", "speed.nc")
    with netCDF4.Dataset("speed.nc") as file:
        wanted = rockfall.crossings(result)["speed"]
        np.testing.assert_allclose(file["speed"][:], wanted, rtol=1e-6)


@needs("gdalmdiminfo")
def test_gdal_reads_all_crossings_and_the_map(run, result):
    for name in ("boulder", "line", "omega"):
        said = run("gdalmdiminfo", "-detailed", "-array", f"crossing_{name}", "out.nc")
        values = np.array(json.loads(said)["values"])
        np.testing.assert_allclose(values, result[f"crossing_{name}"].values, rtol=1e-7)
    run("gdal_translate", "-q", "-of", "XYZ", 'NETCDF:"out.nc":passages', "passages.xyz")
    x, y, passages = np.loadtxt("passages.xyz").T
    wanted = result["passages"].stack(place=["y", "x"])
    for name, found in (("x", x), ("y", y), (None, passages)):
        np.testing.assert_array_equal(found, wanted[name].values if name else wanted.values)


def test_qgis_shows_the_map_and_the_exported_crossings(run, result):
    if not has_qgis():
        pytest.skip("QGIS is not installed: see ./run qgis")
    pytest.importorskip("pyogrio", reason="the vector extra is not installed")
    rockfall.export(result, "exported", formats=["gpkg"])
    shutil.copy("exported/rockfall.gpkg", "out.gpkg")
    Path("seen.py").write_text(QGIS_SCRIPT)
    run("/usr/bin/python3", "seen.py", QT_QPA_PLATFORM="offscreen", HOME=str(Path.cwd()))
    found = json.loads(Path("qgis.json").read_text())
    np.testing.assert_array_equal(found["passages"], result["passages"].values)
    table = rockfall.crossings(result)
    line, boulder, speed = zip(*found["crossings"], strict=True)
    assert [*line] == [*table["line"]] and [*boulder] == [*table["boulder"]]
    np.testing.assert_allclose(speed, table["speed"], rtol=1e-7)


@pytest.mark.parametrize("package", R)
def test_r_reads_all_crossings_and_the_map(package, run, result):
    if not has_r(package):
        pytest.skip(f"R or its package {package} is not installed")
    begin, get = R[package]
    Path("read.R").write_text(R_SCRIPT.format(package=package, open=begin, get=get), "utf-8")
    run("Rscript", "read.R", LC_ALL="C.UTF-8")
    pd = pytest.importorskip("pandas")
    found, table = pd.read_csv("r.csv", encoding="utf-8"), rockfall.crossings(result)
    assert found["line"].tolist() == table["line"].tolist()
    assert found["boulder"].tolist() == table["boulder"].tolist()
    for name in ("speed", "passing_height"):
        np.testing.assert_allclose(found[name], table[name], rtol=1e-6)
    passages = np.fromfile("passages", "f8" if package == "RNetCDF" else "i4")
    np.testing.assert_array_equal(passages, result["passages"].values.ravel())
