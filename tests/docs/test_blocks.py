# SPDX-License-Identifier: BSD-3-Clause
"""Every code block on every page runs, on a small site with the files used on the pages.

Blocks have these meanings:

    sh                    commands, with few boulders
    python                runs after the preceding blocks of its page; `case` and `result` exist
    fortran               groups of a case that reads its files, completed from case.nml; or a
                          complete laboratory case
    csv                   table with equal numbers of columns in all rows
    fortran, csv, python  with title="FILE": contents of this file, for the following blocks
    text                  output of a program, or a drawing

Blocks that cannot run here follow a line `<!-- not run: REASON -->`. The tutorial has a separate
test, which also compares output. Archived pages are not run.
"""

import argparse
import contextlib
import csv
import glob
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from affine import Affine

import rockfall
import scenes
from made import make_layer, make_page, make_raster, make_rockyfor3d, surveyed_blocks
from programs import ROOT, find_program
from rockfall.cli import main
from rockfall.cli.arguments import make_parser
from rockfall.scene.read import read_scene

PAGES = sorted(
    path.relative_to(ROOT)
    for pattern in (
        "*.md",
        "docs/**/*.md",
        "cases/*/README.md",
        "benchmarks/**/*.md",
        "lab/**/*.md",
    )
    for path in ROOT.glob(pattern)
    if path.parent not in (ROOT / "docs/tutorial", ROOT / "docs/archive")
)
BLOCK = re.compile(
    r"(?:^<!-- not run: (?P<reason>[^\n]+) -->\n)?"
    r"^(?P<indent> *)```(?P<kind>\w*)(?: title=\"(?P<title>.+?)\")?[^\n]*\n(?P<code>.*?)^ *```$",
    re.MULTILINE | re.DOTALL,
)
KINDS = {"sh", "python", "fortran", "csv", "text"}
PLACE = Affine(5.0, 0.0, 0.0, 0.0, -5.0, 600.0)
NY, NX = 120, 48
CASE = """&case title = 'Slope', boulders = 20, seed = 7 /
&terrain dem = 'dem.tif' /
&surface zones = 'zones.tif', table = 'zones.csv' /
&boulder volume = 'fixed', volume_mean = 0.8, density = 2800.0 /
&release polygons = 'site.gpkg', polygons_layer = 'cliff', drop_height = 2.0 /
&line name = 'road', x = 0.0, 235.0, y = 300.0, 300.0 /
&line name = 'EL1', x = 0.0, 235.0, y = 441.7, 441.7 /
&barrier name = 'net', x = 0.0, 235.0, y = 200.0, 200.0, height = 5.0, class = 4 /
&scenario name = 'blocks', return_period = 10.0 /
&ensemble runs = 8, radius_factor = 1.3, volume_factor = 1.1 /
&output maps = 'passages', 'reach_probability', 'energy_max', rebounds = .true., trajectories = 5 /
"""
#: A quarter of the cells in cases/tutorial.
COARSE = "CELL, NX, NY = 640_000.0, 5_230_000.0, 4.0, 90, 120"
#: Programs that a test cannot run, with reasons.
ELSEWHERE = {
    "./run": "sets a machine up; that it knows the command is tested",
    ".ci/run": "runs the tests",
    ".venv/bin/pre-commit": "changes the repository",
    "meson": "builds all from scratch",
    "jobs/submit.sh": "needs Slurm",
    "sbatch": "needs Slurm",
    "scancel": "needs Slurm",
    "scontrol": "needs Slurm",
    "qgis_process": "needs QGIS; tests/qgis runs the plugin there",
}
#: Message about positions on another site, which this site does not contain.
APART = "must lie between the outer cell centres of the DEM"
#: Options appended to the arguments on a page, for few boulders.
SMALL = {
    "until": ["--cap", "200"],
    "run": ["--boulders", "5"],
    "hazard": ["--boulders", "1"],
    "models": ["--boulders", "1"],
    "variants": ["--boulders", "1"],
    "ensemble": ["--boulders", "1", "--runs", "8"],
    "back": ["--boulders", "20", "--members", "32", "--effective", "2"],
    "convergence": ["--boulders", "10", "40", "--reference", "320"],
}


def blocks(page):
    return list(BLOCK.finditer((ROOT / page).read_text(encoding="utf-8")))


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """Folder with every file used on a page."""
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    folder, before = tmp_path_factory.mktemp("site"), Path.cwd()
    os.chdir(folder)
    down = np.minimum(np.arange(NY), 90)[:, None] * 5.0
    raster = {"transform": PLACE, "nodata": -9999}
    ones = np.ones((NY, NX))
    make_raster("dem.tif", (1100 - 0.75 * down + 0 * ones).astype("f4"), **raster)
    make_raster("zones.tif", (ones + (np.arange(NX) > 24)).astype("i4"), **raster)
    for name, value in (("stems", 400), ("dbh", 30), ("dbh_std", 5), ("conifers", 60)):
        make_raster(f"{name}.tif", (value * ones).astype("f4"), **raster)
    box, line = shapely.box, lambda *at: shapely.LineString(at)
    across = line((0, 300), (235, 300))
    make_layer("site.gpkg", [box(95, 575, 105, 585)], layer="cliff", name=["wall"])
    make_layer("site.gpkg", [across], layer="road", road_name=["Road 214"])
    make_layer("site.gpkg", [box(90, 150, 100, 160)], layer="houses", value=[1e6])
    halves = [box(-9, -9, 120, 609), box(120, -9, 249, 609)]
    make_layer("site.gpkg", halves, layer="ground", name=["scree", "pasture"],
               mean_radius=[0.3, 0.1])  # fmt: skip
    make_layer("net.gpkg", [line((0, 200), (235, 200))], layer="net", height=[5.0], capacity=[1e3])
    make_layer("nets.shp", [line((0, 200), (235, 200))], height=[4.0])
    make_layer("dam.gpkg", [line((40, 250), (200, 250))], height=[60.0])
    make_layer("ground.gpkg", halves, mean_radius=[0.3, np.nan], ground=[None, "meadow"])
    make_layer("drawn.gpkg", [line((0, 330), (235, 330))], name=["upper"])
    make_layer("ditch.gpkg", [box(40, 255, 200, 262)], depth=[2.0])
    make_layer("road.gpkg", [across], name=["Road 214"], width=[6.0])
    make_layer("houses.gpkg", [box(90, 150, 100, 160)], name=["house"])
    stand = {"stems": [400.0], "dbh_mean": [30.0], "dbh_std": [5.0], "conifers": [60.0]}
    make_layer("stands.gpkg", [box(20, 200, 200, 500)], **stand)
    make_layer("storm.gpkg", [box(20, 300, 200, 400)], id=[1])
    make_layer("logs.gpkg", [line((40, 280), (200, 280))], diameter=[40.0])
    for name in ("trees.geojson", "forest.gpkg"):
        make_layer(name, shapely.points([[90, 400], [100, 390]]), dbh=[30.0, 40.0])
    drawing = pytest.importorskip("ezdxf", reason="the cad extra is not installed").new()
    cliff, road = ({"layer": layer} for layer in ("Fels", "Strasse"))
    corners = [(95, 575), (105, 575), (105, 585), (95, 585)]
    drawing.modelspace().add_lwpolyline(corners, close=True, dxfattribs=cliff)
    drawing.modelspace().add_line((0, 300), (235, 300), dxfattribs=road)
    drawing.saveas("plan.dxf")
    files = {
        "zones.csv": "zone,mean_radius\n1,0.3\n2,0.2\n",
        "case.nml": CASE,
        "trees.csv": "x,y,dbh,species\n100,400,35,Picea abies\n",
        "points.csv": "x,y,z\n"
        + "".join(f"{x},{y},{y}\n" for x in range(0, 250, 12) for y in range(0, 610, 12)),
        "stops.csv": "x,y\n100,180\n110,170\n120,175\n",
        "speeds.csv": "line,quantity,unit,value\nEL1,speed,m/s,12.5\nEL1,speed,m/s,14.1\n",
        "seen.csv": "line,quantity,unit,mean,std,n\nEL1,speed,m/s,12.5,5.2,80\n",
        "sets.nml": scenes.CALM_SETS,
    }
    points = np.loadtxt(files["points.csv"].splitlines(), delimiter=",", skiprows=1)
    np.savetxt("ground.xyz", points)
    laspy = pytest.importorskip("laspy", reason="the points extra is not installed")
    for name in ("west.laz", "east.laz"):
        las = laspy.create(point_format=6, file_version="1.4")
        las.header.scales = [0.01] * 3
        las.x, las.y, las.z = points.T
        las.classification = np.full(len(points), 2)
        las.write(name)
    rows = surveyed_blocks()
    files["survey.csv"] = "volume,year\n" + "".join(rows)
    files["dated.csv"] = "volume,year\n" + "".join(rows[::6])
    files["deposit.csv"] = "volume\n" + "".join(f"{row.partition(',')[0]}\n" for row in rows)
    for name, text in files.items():
        Path(name).write_text(text)
    shutil.copy(scenes.FACTORS, "mine.csv")
    source = np.zeros((NY, NX))
    source[5, 20:28] = 1
    make_rockyfor3d("DIR", 1100 - 0.75 * down + 0 * ones, source)
    for copy, name in (("observed", "seen"), ("a", "seen"), ("b", "stops")):
        shutil.copy(f"{name}.csv", f"{copy}.csv")
    case = rockfall.read_case("case.nml").replace(case={"boulders": 5})
    result = rockfall.run(case)
    for name in ("prior", "bare", "ensemble", "hazard"):
        shutil.copy("case.nml", f"{name}.nml")
    for name in ("result", "one", "other", "case", "bare", "road", "net", "dam"):
        rockfall.write_result(result, f"{name}.nc")
    rockfall.write_hazard(rockfall.hazard(case), "hazard")
    shutil.copytree(ROOT / "cases", "cases")
    for path in Path("cases").rglob("*.nml"):
        few = re.sub(r"(boulders(?:_total)?) = \d+", r"\1 = 5", path.read_text(encoding="utf-8"))
        path.write_text(few, encoding="utf-8")
    layers = Path("cases/tutorial/make_layers.py")
    text = layers.read_text(encoding="utf-8")
    coarse = text.replace("CELL, NX, NY = 640_000.0, 5_230_000.0, 2.0, 180, 240", COARSE)
    assert coarse != text
    layers.write_text(coarse, encoding="utf-8")
    os.chdir(before)
    return folder


@pytest.fixture
def page_site(site, tmp_path, monkeypatch, blank_figures):
    """Work in a copy of the site; studies are shortened and figures left out."""
    folder = shutil.copytree(site, tmp_path / "site")
    monkeypatch.chdir(folder)
    monkeypatch.setattr("rockfall.studies.back.study.ROUND", 16)
    monkeypatch.setattr("rockfall.studies.convergence.MIN_REFERENCE", 1)  # minimum number of turns
    monkeypatch.setattr("rockfall.app.show.PAGE", make_page(tmp_path / "page"))
    return folder


def test_every_block_says_what_it_is():
    wrong = [
        f"{page}: a block of {block['kind'] or 'nothing'}: {block['code'].splitlines()[0]}"
        for page in PAGES
        for block in blocks(page)
        if block["kind"] not in KINDS and not block["reason"]
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.all
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    "page", [str(page) for page in PAGES if any(one["kind"] != "text" for one in blocks(page))]
)
def test_blocks_run(page, page_site, capfd):
    if "import geopandas" in (ROOT / page).read_text(encoding="utf-8"):
        pytest.importorskip("geopandas", reason="the test extra is not installed")
    if any("rockfall lab" in block["code"] for block in blocks(page) if not block["reason"]):
        pytest.importorskip("rockfall_lab", reason="the laboratory is not built")
    names = {"rockfall": rockfall}
    names["case"] = rockfall.read_case("case.nml")
    names["result"] = rockfall.read_result("result.nc")
    for block in blocks(page):
        if block["reason"] or block["kind"] == "text":
            continue
        code = re.sub(rf"^{block['indent']}", "", block["code"], flags=re.MULTILINE)
        if block["title"]:
            write(block["title"], code, block["kind"])
        elif block["kind"] == "sh":
            for line in code.replace("\\\n", " ").splitlines():
                for command in line.split(" && "):
                    execute(command, capfd)
        elif block["kind"] == "python":
            exec(compile(code, page, "exec"), names)
        elif block["kind"] == "csv":
            columns = {len(row) for row in csv.reader(code.splitlines())}
            assert len(columns) == 1, f"rows of {columns} columns"
        else:
            write("block.nml", code, "fortran")


def write(name, code, kind):
    of_simulation = kind == "fortran" and "&lab" not in code  # cases of the laboratory are complete
    few = re.sub(r"throws = \d{3,}", "throws = 16", code)
    Path(name).write_text(whole(code) if of_simulation else few)
    if of_simulation:
        try:
            case = rockfall.read_case(name)
            for one in rockfall.variants(case).values() if case.variant else [case]:
                read_scene(one)
        except rockfall.RockfallError as error:
            if APART not in str(error):
                raise


def whole(code):
    """Case of the groups in a block, completed with groups from case.nml."""
    has = re.findall(r"^\s*&(\w+)", code, re.MULTILINE)
    rest = [line for line in CASE.splitlines() if line[1:].partition(" ")[0] not in has]
    fits = code.replace("&dam\n", "&dam allow_coarse = .true.\n")  # allowed on cells of the site
    return "\n".join([*rest, fits])


@contextlib.contextmanager
def away(words):
    """Move away a file that `new` or `dem` is to write, and restore it afterwards."""
    path = Path(words[words.index("-o") + 1]) if words[0] in ("new", "dem") else Path()
    before = path.read_bytes() if path.is_file() else b""
    if before:
        path.unlink()
    yield
    if before:
        path.write_bytes(before)


def known_arguments(words):
    """Parsed arguments of a command; empty for one that only prints, such as --version."""
    try:
        return make_parser().parse_args(words)
    except SystemExit:
        return argparse.Namespace()


def execute(command, capfd):
    """Run a documented command, with file patterns expanded but without other shell substitutions.
    `rockfall` commands are shortened and overwrite; commands in ELSEWHERE are not run."""
    words = shlex.split(command, comments=True)
    words = [found for one in words for found in (sorted(glob.glob(one)) or [one])]
    if not words:
        return
    program, *rest = words
    if program == "cd":
        os.chdir(rest[0])
    elif program in ELSEWHERE:
        known = (ROOT / "run").read_text(encoding="utf-8")
        assert program != "./run" or f"./run {rest[0]} " in known, f"{command}: no such command"
    elif program == "rockfall":
        few = "until" if "--until" in rest else "shard" if "--shard" in rest else rest[0]
        words = [*rest, *SMALL.get(few, [])]
        if vars(known_arguments(words)).get("overwrite") is False:  # other pages wrote there before
            words.append("--overwrite")
        with away(rest):
            assert main(words) == 0, f"{command}\n{capfd.readouterr().err}"
    else:
        own = {"python": [sys.executable], "rockfall-batch": [find_program(), "--overwrite"]}
        done = subprocess.run([*own.get(program, [program]), *rest], capture_output=True, text=True)
        assert done.returncode == 0, f"{command}\n{done.stderr}"
