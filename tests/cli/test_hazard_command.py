# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall hazard`: layers in the coordinates of the terrain, and one-line errors."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import netCDF4
import numpy as np
import pytest
import rasterio

import rockfall
from made import UTM, draw_no_hazard, make_layer, refused, write_few_maps
from programs import (
    PROGRESS,
    SAYS_PROGRESS,
    Killed,
    killed_after,
    refuses,
    sends_signals,
    wait_until_running,
)
from rockfall import quantities
from rockfall.analysis.hazard.classes import CLASSES
from rockfall.analysis.hazard.variables import TABLE, map_names
from rockfall.cli import main
from rockfall.files.hazard_files import object_table, read_hazard
from rockfall.result.maps.flat_maps import flat_maps
from rockfall.simulation import simulate
from rockfall.text.hazard import hazard_warnings, warning_groups
from scenes import CALM_SETS
from slope_case import CASE as SLOPE
from slope_case import write_slope

pyogrio = pytest.importorskip("pyogrio", reason="the vector extra is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

POINT = "&release x = 600060.0, y = 4999980.0, drop_height = 2.0 /"
POINTS = "&release x = 600040., 600060., 600080., y = 3*4999990., drop_height = 10.0 /"
CASE = SLOPE.replace(POINT, POINTS).replace("boulders = 20", "boulders = 100")
SCENARIOS = """&scenario name = 'small', frequency = 3.0, volume_mean = 0.1 /
&scenario name = 'large', return_period = 40.0, volume_mean = 2.0 /
"""
HOUSE = shapely.box(600040, 4999900, 600070, 4999920)
ROAD = shapely.LineString([(600000, 4999905), (600120, 4999930)])
ARGUMENTS = ["hazard", "case.nml", "-o", "out", "--objects", "objects.gpkg", "--quiet"]


@pytest.fixture(scope="module", autouse=True)
def no_figures():
    with pytest.MonkeyPatch.context() as patch:
        draw_no_hazard(patch)
        yield


def write_case():
    write_slope()
    Path("case.nml").write_text(CASE + SCENARIOS)
    columns = {"name": ["house", "road"], "vulnerability": [0.5, 1.0], "value": [100.0, 1.0]}
    make_layer("objects.gpkg", [HOUSE, ROAD], **columns)


@pytest.fixture
def hazard_case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_case()


@pytest.fixture
def few_maps(monkeypatch):
    write_few_maps(monkeypatch)


@pytest.fixture(scope="module")
def made(no_figures, tmp_path_factory):
    """Folder with the files of the command, and the result of the same hazard in Python; both are
    read-only."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as here:
        here.chdir(folder)
        write_case()
        assert main(ARGUMENTS) == 0
        return folder, rockfall.hazard(rockfall.read_case("case.nml"), objects="objects.gpkg")


@pytest.fixture
def found(made, monkeypatch):
    """Result of the hazard in Python; the current folder has the files of the command."""
    monkeypatch.chdir(made[0])
    return made[1]


@pytest.fixture
def written(hazard_case, made):
    """Copy the command's files to `out`, next to the case."""
    shutil.copytree(made[0] / "out", "out")


@pytest.mark.all
def test_gdal_opens_every_map_where_the_terrain_lies(found):
    flat = flat_maps(found)
    names = dict(map_names(rockfall.read_case("case.nml")))
    assert {path.stem for path in Path("out").glob("*.tif")} == {*names}
    with rasterio.open("dem.tif") as dem:
        crs, transform, bounds = dem.crs, dem.transform, dem.bounds
    for name, variable in names.items():
        with rasterio.open(f"out/{name}.tif") as file:
            values, nodata = file.read(1), file.nodata
            assert file.crs == crs and file.transform.a == transform.a
            assert rasterio.coords.disjoint_bounds(file.bounds, bounds) is False
            assert file.xy(0, 0) == (flat.x.values[0], flat.y.values[0])
            assert file.descriptions == (flat[name].attrs["long_name"],)
        expected = flat[name].values
        if variable.words:
            assert values.dtype == "uint8" and nodata == (255 if "certain" in name else 0)
        assert np.array_equal(values, expected, equal_nan=values.dtype.kind == "f"), name
    with rasterio.open("netcdf:out/hazard.nc:hazard_class") as file:
        assert file.crs == crs and (file.read(1) == found.hazard_class.values).all()


def test_a_style_names_and_colours_every_class(found):
    for path in Path("out").glob("*.qml"):
        with rasterio.open(path.with_suffix(".tif")) as file:
            words = file.tags().get("flag_meanings", "").replace("_", " ")
        root = ElementTree.parse(path).getroot()
        renderer = root.find("pipe/rasterrenderer")
        kind = "paletted" if words else "singlebandpseudocolor"
        assert root.tag == "qgis" and renderer.get("type") == kind
        if not words:
            continue
        entries = {
            int(one.get("value")): one.get("label")
            for one in renderer.iter("paletteEntry")
            if len(one.get("color")) == 7
        }
        shown = {0: "no"} if "certain" in path.stem else entries
        assert entries == shown and entries
        assert all(label in words for label in entries.values())
    styles, maps = ({path.stem for path in Path("out").glob(f"*.{end}")} for end in ("qml", "tif"))
    assert styles == maps


def test_the_file_holds_all_of_it(found):
    import xarray as xr

    with xr.open_dataset("out/hazard.nc", mask_and_scale=False) as file:
        assert {*file.variables} == {*found.variables}
        for name in found.variables:
            one, other = file[name].values, found[name].values
            if one.dtype.kind in "OU":
                assert one.tolist() == other.tolist()
            else:
                assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f"), name
            assert TABLE.get(name) is None or file[name].dims == TABLE[name].dims
        assert file.attrs["Conventions"] == "CF-1.11"
        assert "&scenario" in file.attrs["case"]


def test_zones_are_the_cells_of_each_class(found):
    names = ["hazard", "class", "area", "certain"]  # the order depends on pyogrio
    about, _, wkb, values = pyogrio.raw.read(
        "out/hazard.gpkg", layer="zones_by_cell", columns=names
    )
    columns = dict(zip(about["fields"], values, strict=True))
    hazard, number, area, certain = (columns[name] for name in names)
    info = pyogrio.read_info("out/hazard.gpkg", layer="zones_by_cell")
    assert rasterio.crs.CRS.from_user_input(info["crs"]) == rasterio.crs.CRS.from_string(UTM)
    shapes = shapely.from_wkb(wkb)
    assert shapely.area(shapes) == pytest.approx(area)
    classes, sure = found.hazard_class.values, found.hazard_class_certain.values
    for k, word in enumerate(["residual", "low", "moderate", "high"], start=1):
        here = number == k
        assert {*hazard[here]} <= {word}
        assert area[here].sum() == pytest.approx(25 * (classes == k).sum())
        assert (certain * area)[here].sum() == pytest.approx(25 * sure[classes == k].sum())
    union = shapely.union_all(shapes)
    assert union.area == pytest.approx(area.sum())  # no two overlap
    assert {2, 3, 4} & {*number}
    names = ["lowest_class", "highest_class"]
    about, _, wkb, values = pyogrio.raw.read("out/hazard.gpkg", layer="uncertain", columns=names)
    columns = dict(zip(about["fields"], values, strict=True))
    low, high = (columns[name] for name in names)
    assert shapely.area(shapely.from_wkb(wkb)).sum() == pytest.approx(25 * (sure == 0).sum())
    assert (low < high).all()


@pytest.mark.all
def test_small_patches_go_to_their_neighbours(hazard_case):
    assert main([*ARGUMENTS[:2], "-o", "all", "--quiet"]) == 0
    text = Path("case.nml").read_text() + "&hazard minimum_area = 500.0 /\n"
    Path("case.nml").write_text(text)
    assert main([*ARGUMENTS[:2], "-o", "few", "--quiet"]) == 0

    def areas(folder):
        about = {"layer": "zones_by_cell", "columns": ["area"]}
        return pyogrio.raw.read(f"{folder}/hazard.gpkg", **about)[3][0]

    assert areas("few").min() >= 500 > areas("all").min()
    assert len(areas("few")) < len(areas("all"))
    for name in "hazard_class.tif", "passage_frequency.tif":  # maps are not changed
        assert Path("few", name).read_bytes() == Path("all", name).read_bytes()


def test_a_class_that_small_patches_lose_is_not_forgotten(hazard_case, few_maps):
    """Each zone has the highest class of its cells; a warning gives the area, by class, that is
    shown with a lower class."""
    text = Path("case.nml").read_text() + "&hazard minimum_area = 500.0, minimum_width = 0 /\n"
    Path("case.nml").write_text(text)
    found = rockfall.hazard(rockfall.read_case("case.nml"))
    rockfall.write_hazard(found, "few")
    _, _, wkb, (number, highest) = pyogrio.raw.read(
        "few/hazard.gpkg", layer="zones", columns=["class", "highest"]
    )
    classes, shown = found.hazard_class.values, np.zeros(found.hazard_class.shape, int)
    for shape, of, word in zip(shapely.from_wkb(wkb), number, highest, strict=True):
        inside = shapely.contains_xy(shape, *np.meshgrid(found.x.values, found.y.values))
        shown[inside] = of
        assert word == CLASSES[classes[inside].max()]
    *_, warning = hazard_warnings(found)
    lost = classes[shown < classes]
    assert lost.max() > 1
    for k in np.unique(lost):
        assert f"{quantities.number(25.0 * (lost == k).sum())} m2 {CLASSES[k]}" in warning
    case = rockfall.read_case("case.nml").replace(
        hazard={"minimum_area": 0.0, "minimum_width": 10.0}
    )
    assert not any("minimum_area" in one for one in hazard_warnings(rockfall.hazard(case)))


def test_an_object_beyond_the_elevations_is_said(hazard_case, few_maps, capsys):
    """A line that extends beyond the terrain has a warning; a point on the corner of the terrain
    has none. A file with two layers requires --objects-layer."""
    beyond = shapely.LineString([(599800, 4999905), (600020, 4999910)])
    bounds = rasterio.open("dem.tif").bounds
    corner = shapely.Point(bounds.right, bounds.bottom)
    make_layer(
        "several.gpkg", [beyond, ROAD, corner], layer="objects", name=["far", "road", "pole"]
    )
    make_layer("several.gpkg", [HOUSE], layer="houses", name=["house"])
    words = [*ARGUMENTS[:5], "several.gpkg", "--quiet"]
    refuses(words, r"several.gpkg: has 2 layers \(objects, houses\): choose one with "
            "--objects-layer", capsys)  # fmt: skip
    assert main([*words, "--objects-layer", "objects"]) == 0
    said = capsys.readouterr().err
    line = "several.gpkg: 1 objects extend beyond the terrain, where no boulder hits them: use a"
    assert said == f"rockfall: warning: {line} larger DEM (far)\n"


def test_commands_repeat_the_warnings_of_a_hazard_and_of_a_result(hazard_case, few_maps, capsys):
    """Each command prints two warnings once: 40 of 160 m of a line lie beyond the cell centres, and
    rebounds follow a classical model."""
    text = Path("case.nml").read_text(encoding="utf-8").replace("x = 600000.0,", "x = 599960.0,")
    surface = "zones = 'zones.tif', table = 'zones.csv'"
    soil = "ground = 'soil_4', uniform_mean_radius = 0.2"
    Path("case.nml").write_text(text.replace(surface, soil), encoding="utf-8")
    assert main(ARGUMENTS) == main(["run", "case.nml", "-o", "run.nc", "--quiet"]) == 0
    for command in (
        "lines out", "design out", "origins out --line L -o from", "export out drawn --formats kml",
        "lines run.nc", "design run.nc",
    ):  # fmt: skip
        capsys.readouterr()
        assert main(command.split()) == 0
        printed = capsys.readouterr()
        said = [line for line in (printed.out + printed.err).splitlines() if "arning: " in line]
        assert sum("m lie outside the terrain" in line for line in said) == 1, command
        assert sum("followed classical grounds (soil_4" in line for line in said) == 1, command


def test_objects_are_a_layer_and_a_table(found):
    table = object_table(found)
    assert Path("out/objects.csv").read_text() == table.to_csv(index=False, lineterminator="\n")
    assert table["object"].tolist() == ["house", "road"]
    assert table["geometry"].tolist() == ["polygon", "line"]
    meta, _, wkb, fields = pyogrio.raw.read("out/hazard.gpkg", layer="objects")
    assert [*meta["fields"]] == [*table]
    assert shapely.from_wkb(wkb).tolist() == [HOUSE, ROAD]
    assert fields[[*table].index("risk")].tolist() == table["risk"].tolist()
    assert (table["risk"] > 0).all()


def test_the_summary_says_what_was_run(hazard_case, capsys):
    assert main(ARGUMENTS[:-1]) == 0
    said = capsys.readouterr().out
    assert said.startswith("Slope: 2 scenarios\n")
    for words in "small", "large", "hazard", "house", "road", "risk per year":
        assert words in said
    assert "run 3,483 boulders" in said  # to exclude 300 years: z2 (300 (3 + 1/40) - 1)
    folder, _, names = said.splitlines()[-1].partition(": ")
    named = [name for name in names.split(", ") if "." in name.lstrip("0123456789 .")]
    assert {"hazard.nc", "hazard.gpkg", "return_periods.csv"} <= {*named}
    for name in named:
        assert (Path(folder) / name).is_file()
    tifs = len([*Path(folder).glob("*.tif")])
    assert f"{tifs} .tif" in names.split(", ")


def test_a_hazard_says_what_a_run_of_each_scenario_says(hazard_case, few_maps, capsys):
    """A warning of one scenario starts with its name; in the report it is in the scenario's
    section."""
    narrow = CALM_SETS.replace("/\n&", " speed_range = 100, 101 /\n&").replace(
        "ratio = 5", "ratio = 5, speed_range = 100, 101"
    )
    Path("sets.nml").write_text(narrow)
    stand = "&forest uniform_stems = 200.0, uniform_dbh_mean = 30., uniform_dbh_std = 5., "
    Path("case.nml").write_text(CASE + SCENARIOS + stand + "uniform_conifers = 50.0 /\n")
    assert main(["hazard", "case.nml", "--write-cases"]) == 0
    for k in (1, 2):
        assert main(["run", f"case_scenario{k}.nml", "-o", f"{k}.nc"]) == 0
    runs = capsys.readouterr().out
    said = [line.partition(": ")[2] for line in runs.splitlines() if line.startswith("  caution:")]
    speeds = [text for text in said if "(speed_range)" in text]
    assert len(speeds) == 2 and speeds[0] != speeds[1]
    assert main(ARGUMENTS[:-1]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert f"  warning: small: {speeds[0]}" in printed
    assert f"  warning: large: {speeds[1]}" in printed
    (forest,) = {text for text in said if "forest model is not validated" in text}
    assert printed.count(f"  warning: {forest}") == 1
    found = read_hazard("out/hazard.nc")
    assert forest in [*hazard_warnings(found)]
    assert forest not in [*hazard_warnings(found, {"model.forest"})]  # already shown
    assert [f"  warning: {text}" for text in hazard_warnings(found)] == [
        line for line in printed if "  warning: " in line
    ]
    groups = {group.scenarios: group.texts for group in warning_groups(found)}
    assert forest in groups[""] and speeds[0] in groups["small"] and speeds[1] in groups["large"]
    assert Path("out/hazard_sheet.pdf").read_bytes().count(b"/Type /Page ") == 2  # with warnings
    found.assign_attrs(hazard_layout=1).to_netcdf("other.nc")
    with refused("other.nc: has hazard_layout = 1, not 4: run again"):
        read_hazard("other.nc")


@pytest.mark.all
def test_a_hazard_that_was_killed_goes_on(written, monkeypatch, capsys):
    whole = Path("out/hazard_class.tif").read_bytes(), rockfall_counts()
    monkeypatch.setattr(simulate, "FIRST_CHUNK", 3)
    monkeypatch.setattr(simulate, "CHUNK_SECONDS", 0.0)
    fly = simulate._run_range
    killed_after(monkeypatch, 9)
    with pytest.raises(Killed):
        main([*ARGUMENTS, "--checkpoint", "1e-9", "--overwrite"])
    assert Path("out.scenario1.checkpoint").exists()
    monkeypatch.setattr(simulate, "_run_range", fly)
    capsys.readouterr()
    assert main([*ARGUMENTS, "--overwrite"]) == 2  # must not be overwritten unless requested
    assert "continue with --resume" in capsys.readouterr().err
    assert main([*ARGUMENTS, "--resume", "--overwrite", "--threads", "2"]) == 0
    assert (Path("out/hazard_class.tif").read_bytes(), rockfall_counts()) == whole
    assert not list(Path().glob("*.checkpoint")) and not list(Path().glob("*.lock"))


def test_a_finished_scenario_is_not_run_again(hazard_case, few_maps, monkeypatch):
    fly = simulate._run_range
    monkeypatch.setattr(simulate, "FIRST_CHUNK", 300)
    killed_after(monkeypatch, 1)  # the first scenario completely
    with pytest.raises(Killed):
        main(ARGUMENTS)
    calls = []
    monkeypatch.setattr(simulate, "_run_range", lambda *given: calls.append(given) or fly(*given))
    assert main([*ARGUMENTS, "--resume"]) == 0
    assert len(calls) == 1


def rockfall_counts():
    with netCDF4.Dataset("out/hazard.nc") as file:
        return file["scenario_energy_exceeded"][...].tobytes()


# ---- refusals, in one line, with nothing written


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "case.nml: a hazard needs a &scenario: a class of boulders with its frequency"),
        ("&scenario name = 'a', frequency = -1.0 /",
         r"case.nml: &scenario frequency = -1.0: must be > 0 \[1/year\]"),
        ("&scenario name = 'a', frequency = 1.0, return_period = 1.0 /",
         "case.nml: &scenario frequency, return_period, activity: give one of the three"),
        ("&scenario frequency = 1.0 /",
         "case.nml: &scenario name is missing: text, name of a class of boulders with its "
         "frequency"),
        (SCENARIOS + "&hazard thresholds = 30.0, 20.0 /",
         "case.nml: &hazard thresholds = 30.0, 20.0: must increase"),
        (SCENARIOS + "&hazard return_periods = 3e1, 20. /",
         "case.nml: &hazard return_periods = 3e1, 20.: must increase"),
        (SCENARIOS + "&hazard matrix = 9*'fatal' /",
         "case.nml: &hazard matrix .value 1. = 'fatal': must be one of: residual, low, moderate, "
         "high"),
        (SCENARIOS + "&hazard minimum_area = -1.0 /",
         r"case.nml: &hazard minimum_area = -1.0: must be >= 0 \[m2\]"),
        (SCENARIOS + "&scenario name = 'small', frequency = 1.0 /",
         "case.nml: line 11: &scenario name = 'small': must be unique among scenarios"),
        ("&scenario name = 'a', frequency = 1.0, volume_std = 1.0 /",
         "case.nml: &scenario name = 'a': &boulder volume_std = 1.0: is not valid for volume = "
         "'fixed'"),
    ],
)  # fmt: skip
def test_bad_scenarios_are_one_line_and_nothing_is_written(hazard_case, capsys, text, message):
    Path("case.nml").write_text(CASE + text)
    refuses(ARGUMENTS, message, capsys)


def test_bad_places_and_layers_are_one_line(hazard_case, capsys):
    refuses([*ARGUMENTS[:3], "none/out"], "none/out: folder none does not exist", capsys)
    refuses([*ARGUMENTS[:3], "dem.tif"], "dem.tif: is a file: give a folder", capsys)
    refuses([*ARGUMENTS, "--checkpoint", "-1"], "--checkpoint -1.0: must be >= 0 seconds", capsys)
    refuses([*ARGUMENTS[:4], "--objects", "far.gpkg"], "far.gpkg: .*", capsys)
    Path("out").mkdir()
    Path("out/hazard_class.tif").write_text("mine")
    taken = r"already exists; not overwritten \(--overwrite replaces it\)"
    refuses(ARGUMENTS, f"out/hazard_class.tif: {taken}", capsys)
    Path("out/hazard_class.tif").unlink()
    Path("out/hazard_class.qml").write_text("<!DOCTYPE qgis>")
    refuses(ARGUMENTS, f"out/hazard_class.qml: {taken}", capsys)
    Path("out/hazard_class.qml").unlink()
    make_layer("bare.gpkg", [ROAD], crs=None, name=["a"])
    refuses([*ARGUMENTS[:5], "bare.gpkg"], "bare.gpkg: .*EPSG:.*", capsys)


def test_scenarios_may_be_run_elsewhere(written, few_maps, capsys):
    """Results of the scenarios' cases, also in shards, give the same hazard. Results of other
    scenarios or inputs are refused."""
    assert main([*ARGUMENTS[:2], *ARGUMENTS[4:], "--write-cases"]) == 0
    cases = ["case_scenario1.nml", "case_scenario2.nml"]
    assert capsys.readouterr().out.split() == cases
    for shard in "1/2", "2/2":
        assert main(["run", cases[0], "--shard", shard, "-o", f"{shard[0]}.nc", "--quiet"]) == 0
    assert main(["merge", "1.nc", "2.nc", "-o", "first.nc"]) == 0
    assert main(["run", cases[1], "-o", "second.nc", "--quiet"]) == 0
    elsewhere = [*ARGUMENTS[:2], "-o", "again", *ARGUMENTS[4:], "--results"]
    assert main([*elsewhere, "first.nc", "second.nc"]) == 0
    for path in Path("again").iterdir():
        if path.suffix in (".tif", ".csv"):
            assert path.read_bytes() == Path("out", path.name).read_bytes()
    capsys.readouterr()
    elsewhere[3] = "other"
    other = "is the result of another case: see --write-cases"
    refused_as = f"second.nc: scenario 'small': {other}"
    assert main([*elsewhere, "second.nc", "first.nc"]) == 2
    assert capsys.readouterr().err == f"rockfall: {refused_as}\n"
    assert main([*elsewhere, "first.nc"]) == 2
    said = "results: 1 for 2 scenarios: give one for each, in this order"
    assert capsys.readouterr().err == f"rockfall: {said}\n"
    Path(cases[0]).write_text("mine")
    assert main([*ARGUMENTS[:2], "--write-cases"]) == 2
    assert Path(cases[0]).read_text() == "mine"


def test_too_little_memory_is_said_before_the_runs(hazard_case, capsys):
    line = (
        r"case.nml: a hazard of [\d,]+ cells, 2 scenarios and 2 thresholds needs 0.2 MB, of 0.1: "
        r"cut the terrain to the slope, or raise --memory"
    )
    refuses([*ARGUMENTS, "--memory", "80KB"], line, capsys)


@pytest.mark.all
def test_an_earlier_hazard_is_replaced(written):
    before = Path("out/hazard.nc").stat().st_mtime_ns
    assert main([*ARGUMENTS, "--seed", "3", "--overwrite"]) == 0
    assert Path("out/hazard.nc").stat().st_mtime_ns > before


@pytest.mark.all
def test_a_library_user_writes_the_same(written, made):
    _, found = made
    paths = rockfall.write_hazard(found, "mine")
    assert {path.name for path in paths} == {
        path.name for path in Path("out").iterdir() if path.suffix not in (".png", ".pdf")
    }
    for path in paths:
        if path.suffix in (".tif", ".qml", ".csv"):
            assert path.read_bytes() == Path("out", path.name).read_bytes()
    with refused("mine: is a file: give a folder"):
        Path("mine").rename("theirs")
        Path("mine").touch()
        rockfall.write_hazard(found, "mine")


@pytest.mark.all
@sends_signals
def test_ctrl_c_keeps_what_is_done_and_writes_nothing_else(hazard_case):
    words = [*(word for word in ARGUMENTS if word != "--quiet"), "--boulders", "1000000"]
    child = subprocess.Popen(
        [sys.executable, "-m", "rockfall", *words], env=os.environ | SAYS_PROGRESS,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    wait_until_running(child)
    child.send_signal(signal.SIGINT)
    out, said = child.communicate(timeout=600)
    assert (child.returncode, out) == (130, "")
    assert re.fullmatch(
        rf"(?:{PROGRESS})*rockfall: interrupted: completed boulders are in "
        r"\S*/out.scenario1.checkpoint: continue with --resume\n",
        said,
    )
    assert not Path("out").exists() and Path("out.scenario1.checkpoint").exists()
