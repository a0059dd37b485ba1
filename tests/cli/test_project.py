# SPDX-License-Identifier: BSD-3-Clause
"""A project with layers, from drawing to report, in a dozen commands with equal values
everywhere."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rockfall
import scenes
from made import make_layer, make_raster
from rockfall.cli import main
from rockfall.studies import convergence
from rockfall.studies.back import study as study_of_back

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
pyproj = pytest.importorskip("pyproj", reason="the vector extra is not installed")

W, N = 600000.0, 5000000.0
BOX = shapely.box
CLIFFS = [BOX(W + 80, N - 55, W + 120, N - 35), BOX(W + 160, N - 60, W + 200, N - 40)]
HALVES = [(0, 150, 0, 150), (150, 300, 0, 150), (0, 150, 150, 400), (150, 300, 150, 400)]

SPEEDS = "line,quantity,unit,value\n" + "".join(f"L 214,speed,m/s,{v}\n" for v in range(4, 12))


def line(y, left=0, right=300):
    return shapely.LineString([(W + left, N - y), (W + right, N - y)])


def in_other_crs(shape):
    way = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:25833", always_xy=True)
    return shapely.transform(shape, lambda xy: np.column_stack(way.transform(*xy.T)))


def draw_site():
    """Write a terrain and layers to the current folder; zones are in another CRS."""
    z = scenes.rough(60, 80, 5.0, gradient=0.8, relief=8, dtype="f4")
    make_raster("dem.tif", z, nodata=-9999)
    zones = [in_other_crs(BOX(W + a, N - d, W + b, N - c)) for a, b, c, d in HALVES]
    make_layer(
        "site.gpkg", zones, crs="EPSG:25833", layer="Böden", mean_radius=[0.3, 0.2, 0.25, 0.15],
        ground=["rocky-slope"] * 4,
    )  # fmt: skip
    make_layer(
        "site.gpkg", CLIFFS, layer="cliff", name=["Nordwand", "<b>Süd</b>"], drop_height=[2.0, 5.0]
    )
    make_layer("site.gpkg", [line(45)], layer="road", name=["L 214"])
    make_layer(
        "site.gpkg",
        [line(280, 60, 200)],
        layer="nets",
        name=["net"],
        height=[4.0],
        capacity=[1000.0],
    )
    houses = [BOX(W + 100, N - 350, W + 115, N - 340)]
    make_layer("site.gpkg", houses, layer="houses", name=["Hof"], value=[1e5], vulnerability=[0.5])
    trees = [shapely.Point(W + x, N - 200) for x in range(20, 280, 20)]
    make_layer("trees.gpkg", trees, dbh=[30.0] * len(trees), species=["spruce"] * len(trees))
    Path("speeds.csv").write_text(SPEEDS)
    Path("stops.csv").write_text(f"x,y\n{W + 100},{N - 350}\n{W + 200},{N - 300}\n")


@pytest.fixture
def rockfall_says(capsys):
    """Run a command that must succeed; return its output and warnings."""

    def run(*words):
        capsys.readouterr()
        assert main(list(map(str, words))) == 0, capsys.readouterr().err
        return capsys.readouterr()

    return run


@pytest.mark.all
def test_a_project_in_a_dozen_commands(tmp_path, monkeypatch, blank_figures, rockfall_says):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study_of_back, "ROUND", 8)
    monkeypatch.setattr(convergence, "REFERENCE", 20_000)
    draw_site()
    said = rockfall_says("new", "dem.tif", "site.gpkg", "trees.gpkg", "-o", "case.nml")
    assert said.err.count("\n") == 1
    assert "site.gpkg, layer Böden: reprojected from EPSG:25833 to EPSG:32632" in said.err
    text = re.sub(r"boulders_total = \d+", "boulders_total = 2000", Path("case.nml").read_text())
    text = re.sub("maps = .*|rebounds = .*", "", text).replace(
        "&output", "&output maps = 'passages'"
    )
    text += "&ensemble runs = 8, radius_factor = 1.2 /\n&scenario name = 'a', frequency = 2.0 /\n"
    Path("case.nml").write_text(text)

    said = rockfall_says("check", "case.nml").out
    assert "2,000 from all sources together" in said and "Nordwand, <b>Süd</b>" in said
    summary = rockfall_says("run", "case.nml", "-o", "case.nc", "--threads", "1").out
    lines = rockfall_says("lines", "case.nc").out
    rockfall_says("report", "case.nc")
    rockfall_says("export", "case.nc", "maps")
    rockfall_says("design", "case.nc", "-o", "design")
    hazard = rockfall_says(
        "hazard", "case.nml", "--objects", "site.gpkg", "--objects-layer", "houses"
    )  # fmt: skip
    assert "Hof" in hazard.out and not hazard.err
    rockfall_says("compare", "case.nc", "stops.csv")
    rockfall_says("ensemble", "case.nml", "--boulders-total", "200", "-o", "ensemble.nc")
    few = "--members 16 --effective 2 --boulders-total 200".split()
    sought = rockfall_says("back", "case.nml", "speeds.csv", *few).out
    converged = rockfall_says("convergence", "case.nml").out

    # one value and one interval everywhere
    result = rockfall.read_result("case.nc")
    row = rockfall.line_statistics(result).query("line == 'L 214' and quantity == 'speed'").iloc[0]
    three = [100 * row[f"fraction{end}"] for end in ("", "_low", "_high")]
    n = f"{row['n']:,.0f}"
    said = re.search(rf"L 214 +{n} +([0-9.]+) .*\n +\(([0-9.]+)–([0-9.]+)\)", summary)
    fraction, low, high = said.groups()
    near = (three[2] - three[1]) / 8
    assert 2 < three[0] < 98 and [*map(float, said.groups())] == pytest.approx(three, abs=near)
    assert f"L 214: {n} of " in lines and f" boulders, {fraction} % ({low}–{high})\n" in lines
    page = Path("case.html").read_text()
    assert f"L 214: {n} boulders cross it" in page and f"({low}–{high})<" in page
    assert re.search(r"speed at L 214 +8 ", sought)
    assert str(Path("case_back/posterior.csv")) in sought
    sizes = re.search(r"from each of (\d+) sources:\s+(?:\d+ +){4}(\d+)\n", converged)
    assert int(sizes[1]) == np.unique(result["source"]).size
    assert int(sizes[2]) == convergence.REFERENCE // int(sizes[1])
    study = pd.read_csv("case_convergence/study.csv").query(
        "line == 'L 214' and statistic == 'fraction'"
    )
    assert study["value"].iloc[-1] == pytest.approx(row["fraction"], abs=24 * near / 100)
    assert "inf" not in converged
    # sources have their names, and texts of layers are not executed in pages
    assert result["feature_name"].values.tolist() == ["Nordwand", "<b>Süd</b>"]
    assert set(np.unique(result["source_feature"])) == {1, 2} and "<b>Süd" not in page
    assert json.loads(result.attrs["input_checksums"])["zones"]


def test_a_layer_is_reprojected_and_not_its_neighbours_in_the_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    draw_site()
    make_layer("roads.gpkg", [in_other_crs(line(330))], crs="EPSG:25833", layer="far", name=["L"])
    make_layer("roads.gpkg", CLIFFS, layer="cliff", name=["a", "b"])
    Path("case.nml").write_text(
        "&case boulders = 1 /\n&terrain dem = 'dem.tif' /\n"
        "&surface uniform_mean_radius = 0.2 /\n&boulder volume_mean = 1.0 /\n"
        "&release polygons = 'roads.gpkg', polygons_layer = 'cliff' /\n"
        "&line file = 'roads.gpkg', layer = 'far' /\n"
    )
    noted = json.loads(rockfall.run(rockfall.read_case("case.nml")).attrs["input_checksums"])
    assert "reprojected" in noted["line roads.gpkg, layer far"]
    assert "reprojected" not in noted["polygons"]


def test_a_grid_without_a_crs_gets_one(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    make_raster("none.tif", scenes.rough(6, 8, 5.0, dtype="f4"), crs=None)
    assert main(["dem", "none.tif", "-o", "dem.tif", "--crs", "EPSG:31254"]) == 0
    assert main(["dem", "dem.tif", "-o", "again.tif", "--crs", "EPSG:2056"]) == 2
    assert "dem.tif has its own CRS, EPSG:31254" in capsys.readouterr().err
    assert main(["dem", "none.tif", "-o", "again.tif", "--crs", "EPSG:4326"]) == 2
    assert not Path("again.tif").exists()
