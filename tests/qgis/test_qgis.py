# SPDX-License-Identifier: BSD-3-Clause
"""Processing provider: results in QGIS are those of the program, with the same messages. Tests that
need QGIS are skipped without it: `./run qgis` installs it."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import rasterio

import rockfall
import scenes
from made import make_layer, make_raster
from rockfall.cli import main
from rockfall.cli.arguments import make_parser
from rockfall.draft.grounds import GROUNDS

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

ROOT = Path(__file__).parents[2]
PLUGIN = ROOT / "python/rockfall_qgis"
# Debian's wrapper passes on a desktop option that 3.22 refuses
PROCESS = shutil.which("qgis_process.bin") or shutil.which("qgis_process")
PYTHON = "/usr/bin/python3"  # PyQGIS of the distribution is for this Python
W, N = 600000.0, 5000000.0
#: Program that passes its commands to tests/qgis/forks.py.
CLIENT = """#!{python} -IS
import json, os, socket, sys
server = socket.socket(socket.AF_UNIX)
server.connect({path!r})
about = {{"words": sys.argv[1:], "folder": os.getcwd(), "env": dict(os.environ)}}
socket.send_fds(server, [json.dumps(about).encode()], [0, 1, 2])
sys.exit(server.recv(1)[0])
"""
needs_qgis = pytest.mark.skipif(PROCESS is None, reason="no QGIS: see ./run qgis")


def load(path):
    """Module from a file; the plugin is not part of the package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = sys.modules[path.stem] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_grounds_are_those_of_the_program():
    assert load(PLUGIN / "commands.py").GROUND.choices == (*GROUNDS,)


def test_the_program_inherits_no_python_of_qgis(tmp_path, monkeypatch):
    """Environment variables of the Python in QGIS are not passed on to the program."""

    class Feedback:
        def isCanceled(self):
            return False

        def __getattr__(self, name):
            return lambda *_: None

    for name in ("PYTHONHOME", "PYTHONPATH", "PYTHONSTARTUP", "PYTHONEXECUTABLE", "GDAL_DATA",
                 "VIRTUAL_ENV", "PROJ_LIB", "__PYVENV_LAUNCHER__"):  # fmt: skip
        monkeypatch.setenv(name, str(tmp_path / "elsewhere"))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    printed = load(PLUGIN / "program.py").call(["/usr/bin/env"], Feedback())
    assert not [line for line in printed if "elsewhere" in line]
    assert "OMP_NUM_THREADS=1" in printed and "ROCKFALL_PROGRESS=lines" in printed


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder with dem.tif, site.gpkg, and bin/rockfall, which runs this package."""
    folder = tmp_path_factory.mktemp("site")
    z = scenes.rough(60, 80, 5.0, gradient=0.8, relief=8, dtype="f4")
    make_raster(folder / "dem.tif", z, nodata=-9999)
    site, box = folder / "site.gpkg", shapely.box
    make_layer(site, [box(W + 100, N - 60, W + 200, N - 30)], layer="sources", id=[1])
    halves = [box(W, N - 200, W + 300, N), box(W, N - 390, W + 300, N - 200)]
    make_layer(site, halves, layer="zones", mean_radius=[0.3, 0.1], name=["scree", "wiese"])
    road = [shapely.LineString([(W, N - 45), (W + 300, N - 45)])]
    make_layer(site, road, layer="lines", name=["road"])
    program = folder / "bin/rockfall"
    program.parent.mkdir()
    where = Path(rockfall.__file__).parents[1]
    program.write_text(f'#!/bin/sh\nPYTHONPATH={where} exec {sys.executable} -m rockfall "$@"\n')
    program.chmod(0o755)
    return folder


@pytest.fixture(scope="module")
def qgis(site):
    """Function that runs a command with a QGIS profile of its own, and returns its output."""
    plugins = site / "profile/profiles/default/python/plugins"
    plugins.mkdir(parents=True)
    (plugins / PLUGIN.name).symlink_to(PLUGIN)
    settings = plugins.parents[1] / "QGIS/QGIS3.ini"
    settings.parent.mkdir()
    settings.write_text("[PythonPlugins]\nrockfall_qgis=true\n")
    (site / "runtime").mkdir(mode=0o700)
    env = {
        "HOME": str(site), "XDG_RUNTIME_DIR": str(site / "runtime"), "QT_QPA_PLATFORM": "offscreen",
        "QGIS_CUSTOM_CONFIG_PATH": str(site / "profile"), "PYTHONDONTWRITEBYTECODE": "1",
        "PATH": f"{site / 'bin'}:/usr/bin:/bin",
    }  # fmt: skip

    def run(*words, cwd=site):
        done = subprocess.run(
            [*map(str, words)], cwd=cwd, env=env, capture_output=True, text=True, timeout=1200
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="module")
def forked(site):
    """Program that is used like `bin/rockfall`, but starts at once."""
    module, path, program = Path(__file__).with_name("forks.py"), site / "socket", site / "forked"
    env = {**os.environ, "PYTHONPATH": str(Path(rockfall.__file__).parents[1])}
    command = [sys.executable, module, path]
    with subprocess.Popen(command, env=env, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout.readline() == "ready\n"
        program.write_text(CLIENT.format(python=sys.executable, path=str(path)))
        program.chmod(0o755)
        yield program
        server.terminate()


@pytest.fixture(scope="module")
def within(site, qgis, forked):
    """Output of tests/qgis/within.py, decoded."""
    folder = site / "within"
    folder.mkdir()
    words = [Path(__file__).with_name("within.py"), PLUGIN.parent, site / "dem.tif", forked]
    said = qgis(PYTHON, *words, cwd=folder)
    return json.loads(said.splitlines()[-1])


@pytest.mark.all
@needs_qgis
def test_qgis_process_gives_the_maps_of_the_command_line(site, qgis, monkeypatch):
    layers = [f"{name.upper()}={site / 'site.gpkg'}|layername={name}" for name in
              ("sources", "zones", "lines")]  # fmt: skip
    words = ["DEM=dem.tif", *layers, "BOULDERS=20", "SEED=7", "FOLDER=gis"]
    said = qgis(PROCESS, "--json", "run", "rockfall:run", "--", *words)
    monkeypatch.chdir(site)
    assert main(["new", "dem.tif", "site.gpkg", "-o", "own/case.nml"]) == 0
    assert main("run own/case.nml --boulders 20 --seed 7 -o own/result.nc".split()) == 0
    assert main(["export", "own/result.nc", "own/maps"]) == 0
    mine, own = site / "gis/maps", site / "own/maps"
    assert sorted(os.listdir(mine)) == sorted(os.listdir(own))
    maps = [path for path in sorted(own.iterdir()) if path.suffix == ".tif"]
    assert len(maps) >= 5
    for path in maps:
        with rasterio.open(path) as one, rasterio.open(mine / path.name) as other:
            assert one.read().tobytes() == other.read().tobytes(), path.name
            assert one.transform == other.transform and one.crs == other.crs
    for path in own.glob("*.[cq][sm][vl]"):  # tables, styles
        assert path.read_bytes() == (mine / path.name).read_bytes(), path.name
    assert (own / "line_road.csv").read_text().count("\n") > 10
    loaded = json.loads(said[said.index("{") :])["results"]["LAYERS"]
    names = {re.sub(r".*layername=|.*/", "", one) for one in loaded}
    assert names >= {path.name for path in maps} | {"source_areas", "stops", "lines", "crossings"}
    assert "sources" not in names  # one area, not thousands of points


@pytest.mark.all
@needs_qgis
def test_layers_in_memory_run_and_results_load_with_their_styles(within):
    loaded = within["run"]["loaded"]
    energy = loaded["energy_q95_kJ"]
    assert energy[0] == "singlebandpseudocolor"
    assert "30" in " ".join(energy[1:]) and all("kJ" in label for label in energy[1:])
    assert all(len(one) > 2 for one in loaded.values() if isinstance(one, list))
    shapes = {name: one["shapes"] for name, one in loaded.items() if isinstance(one, dict)}
    assert (shapes["source_areas"], shapes["stops"]) == (2, 360)  # one per feature
    styles = {name: loaded[name]["type"] for name in shapes}
    assert styles["source_areas"] == styles["trajectories"] == "singleSymbol"
    assert styles["stops"] == "categorizedSymbol"
    assert {"stopped", "left domain"} < set(loaded["stops"]["labels"])
    assert loaded["flights"]["plays"] == ["begin", "end"] and not loaded["stops"]["plays"]
    assert loaded["flights"]["kind"] == loaded["trajectories"]["kind"] == "LineStringZM"
    assert "60 x 80 cells" in within["check"]["found"]["TEXT"]


@pytest.fixture(scope="module")
def opened(site, qgis):
    """Output of tests/qgis/opened.py for a project that was moved, and the folder above it."""
    folder, before = site / "opened", Path.cwd()
    folder.mkdir()
    os.chdir(folder)
    try:
        assert main(["new", "../dem.tif", "../site.gpkg", "-o", "case.nml"]) == 0
        assert main("run case.nml --boulders 20 --seed 7 --quiet -o result.nc".split()) == 0
        assert main("export result.nc here --qgis --author Somebody".split()) == 0
    finally:
        os.chdir(before)
    (folder / "here").rename(folder / "there")
    script = Path(__file__).with_name("opened.py")
    said = qgis(PYTHON, script, folder / "there/project.qgz", folder / "picture")
    return json.loads(said.splitlines()[-1]), folder


@pytest.mark.all
@needs_qgis
def test_a_project_opens_elsewhere_with_all_its_layers(opened):
    seen, _ = opened
    assert seen["read"] and not seen["bad"] and not seen["missing"]
    assert seen["crs"] == "EPSG:32632" and {*seen["layer_crs"]} == {"EPSG:32632"}
    assert seen["groups"] == ["Trajectories", "Evaluation lines", "Sources", "Maps", "Terrain"]
    assert seen["visible"][0] == "Trajectories" and len(seen["visible"]) == 6
    west, south, east, north = seen["extent"]
    assert west <= W + 100 and east >= W + 200 and south < N - 60 and north >= N - 30
    assert seen["labelled"] == ["Evaluation lines"]


@pytest.mark.all
@needs_qgis
def test_each_map_has_a_layout_that_prints(opened):
    seen, folder = opened
    assert {*seen["themes"]} == {one["name"] for one in seen["layouts"]}
    for one in seen["layouts"]:
        assert one["printed"] == 0 and one["paper"] == [420.0, 297.0]
        assert abs(one["scale"] / seen["layouts"][0]["scale"] - 1) < 1e-6
        assert "Band" not in " ".join(one["legend"])
        assert one["legend_bottom"] < one["foot_top"] and one["legend_right"] < 410, one
    digits = f"{seen['layouts'][0]['scale']:.0f}"
    assert digits[0] in "1235" and digits.strip("0") in {"1", "2", "25", "5", "125", "15", "3"}
    shown = {one["name"]: one["legend"] for one in seen["layouts"]}
    (energy,) = [text for name, text in shown.items() if "kJ" in name and "95" in name]
    assert "\u2264 10 kJ" in energy and "Sources" in energy


@pytest.mark.all
@needs_qgis
def test_what_is_drawn_is_neither_blank_nor_hidden(opened):
    seen, _ = opened
    ink = seen["ink"]
    assert ink["all"] > 0.3  # fraction of the picture
    assert ink["Trajectories"] > 0.001  # pixels of its colour, on top of everything else
    assert ink["Sources"] > 0.0005


@pytest.mark.all
@needs_qgis
@pytest.mark.parametrize(
    "what, line",
    [
        ("no program", r".*dem\.tif: cannot be started: Permission denied"),
        ("bad case", r"rockfall: bad\.nml: line 2: &cse: unknown group.*"),
        ("both", "Unable to execute algorithm\nGive either a case, or elevations .*"),
        ("neither", "Unable to execute algorithm\nGive either a case, or elevations .*"),
        ("not zones", r".*layer zones: left out \(.*mean_radius.*\)"),
        ("not a dam", r".*a dam needs an attribute height \[m\].*"),
        ("no ground", r".*dem\.tif: ground is missing: give --ground GROUND, of rock, .*"),
        ("again", r".*case\.nml: already exists; not overwritten.*"),
    ],
)
def test_what_is_wrong_is_one_line_and_leaves_nothing(within, what, line):
    assert re.fullmatch(line, within[what]["refused"]), within[what]
    assert within[what]["left"] == []


@pytest.mark.all
@needs_qgis
def test_layers_of_a_project_become_a_case_with_dams_nets_and_a_forest(within):
    assert within["new"]["found"]["CASE"] == "drawn/case.nml"
    groups = re.findall(r"^&(\w+)", within["case"], re.MULTILINE)
    assert {"barrier", "dam", "forest", "line", "release"} <= {*groups}
    assert re.search(r"^ +ground = 'meadow' ", within["case"], re.MULTILINE)
    assert "layer dams: dams" in within["new"]["found"]["TEXT"]
    assert "layer forest: stands" in within["new"]["found"]["TEXT"]
    assert "dams" in within["protected"]["loaded"] and "barriers" in within["protected"]["loaded"]


@pytest.mark.all
@needs_qgis
@pytest.mark.parametrize(
    "what, files",
    [
        ("ensemble", ["varied.csv"]),
        ("hazard", ["zones/hazard.nc", "zones/hazard.gpkg", "zones/objects.csv"]),
        ("back", ["back/posterior.csv"]),
        ("observed", ["seen_table.csv"]),
        ("compare", ["variants.csv", "variants.html", "differences/differences.csv"]),
        ("export", ["whole/project.qgz", "whole/passages.tif"]),
    ],
)
def test_studies_write_what_the_program_writes(within, what, files):
    assert "refused" not in within[what], within[what]
    assert {*files} <= {*within["written"]}, within[what]
    assert within[what]["found"]["TEXT"]


@pytest.mark.all
@needs_qgis
def test_zones_and_differences_are_loaded(within):
    zones = within["hazard"]["loaded"]["zones"]
    assert zones["type"] == "categorizedSymbol" and "high" in zones["labels"]
    assert within["hazard"]["loaded"]["objects"]["shapes"] == 1
    assert any("passing" in name for name in within["compare"]["loaded"])


@pytest.mark.all
@needs_qgis
def test_the_program_is_a_setting(within):
    assert within["setting"].endswith("/dem.tif")


class Feedback:
    """Feedback as in QGIS that records messages and progress, and cancels as soon as there is
    progress."""

    def __init__(self):
        self.progress, self.said = [], []
        self.pushInfo = self.pushWarning = self.said.append
        self.setProgress = self.progress.append

    def isCanceled(self):
        return any(0 < one < 100 for one in self.progress)


@pytest.mark.all
def test_a_cancelled_run_keeps_what_is_done(site, monkeypatch):
    monkeypatch.chdir(site)
    program = load(PLUGIN / "program.py")
    assert main(["new", "dem.tif", "site.gpkg", "-o", "long/case.nml"]) == 0
    words = [str(site / "bin/rockfall"), "run", "long/case.nml", "-o", "long/result.nc"]
    with pytest.raises(program.Interrupted, match="contains the first .* is a valid result"):
        program.call([*words, "--boulders", "20000", "--threads", "1"], Feedback())
    result = rockfall.read_result(site / "long/result.nc")
    assert 0 < result.sizes["boulder"] < 2_400_000


def test_every_option_of_the_plugin_is_one_of_the_program():
    parser = make_parser()
    (commands,) = [one for one in parser._actions if one.choices and "run" in one.choices]
    for command in load(PLUGIN / "commands.py").COMMANDS:
        known = commands.choices[command.name]._option_string_actions
        assert {one.flag for one in command.options} - {""} <= {*known}, command.name


def test_the_zip_is_what_qgis_installs(tmp_path):
    tool = load(ROOT / "tools/qgis_plugin.py")
    with zipfile.ZipFile(tool.write_zip(tmp_path / "plugin.zip")) as file:
        names = set(file.namelist())
        metadata = file.read("rockfall_qgis/metadata.txt").decode()
    assert names == {f"rockfall_qgis/{path.name}" for path in PLUGIN.glob("*.*")} | {
        "rockfall_qgis/LICENSE"
    }
    version = re.search(r"version: '(.*?)'", (ROOT / "meson.build").read_text())[1]
    assert f"\nversion={version}\n" in metadata and "hasProcessingProvider=yes" in metadata
