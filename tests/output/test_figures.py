# SPDX-License-Identifier: BSD-3-Clause
"""Figures of any result: which of them exist, agreement with the result, and refusals."""

import base64
import re
import shutil
import warnings
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from PIL import Image

import rockfall
from crossed import STORED, crossed
from made import make_raster
from programs import refuses
from rockfall.cli import main
from rockfall.errors import RockfallError
from rockfall.html_report import render
from rockfall.io.rasters.arrays import north_up
from rockfall.io.rasters.grid import Grid
from rockfall.language import speaking
from rockfall.plots import extent, style, terrain
from rockfall.plots import map_figures as mapfigures
from rockfall.plots import rebound_figures as reboundfigures
from rockfall.plots.cartography import rasters, relief
from rockfall.plots.figures import figures, write_figures
from rockfall.plots.history_figure import history_figure
from rockfall.plots.line_figures import passing_figure
from rockfall.plots.map_figures import stops_figure
from rockfall.plots.terrain import terrain_of
from rockfall.result import trajectories
from rockfall.result.crossings import at_lines, line_values, most_crossed
from rockfall.result.variables import EXCEEDED, MAP
from rockfall.terrain.height import height
from scenes import grid, make_case, rough, sets

pytest.importorskip("matplotlib", reason="the report extra is not installed").use("Agg")
pytestmark = pytest.mark.filterwarnings("error")

Z = rough()
TERRAIN = (Z, grid(Z))
LINE = [{"name": "L", "x": [0.0, 300.0], "y": [280.0, 280.0]}]
FAR = [{"name": "far", "x": [0.0, 300.0], "y": [20.0, 20.0]}]
POINT = {"x": 150.0, "y": 380.0}
ALL = {"maps": list(MAP), "rebounds": True, "trajectories": 5}
TRAJECTORIES = ["trajectories", "profile"]
AT_LINES = ["line_speed", "line_passing_height", "line_energy_translational"]
AT_LINES += ["line_energy_rotational", "line_energy_total", "line_rotational_share"]
REBOUNDS = ["incident_energy", "incidence_angle", "restitution"]
LAYERS = {name: [f"{name}_30kJ", f"{name}_300kJ"] for name in EXCEEDED}
MAPS = [f"map_{layer}" for name in MAP if name not in ("passages", "reach_probability")
        for layer in LAYERS.get(name, [name])]  # fmt: skip
DRAWN_ALIKE = {*AT_LINES[2:-1], *MAPS} - {"map_deposits", "map_energy_q95"}


def run(folder, line=(), **groups):
    case = make_case(folder, *sets(), line=line, terrain={}, **groups)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # boulders that stop where they start
        return rockfall.run(case, dem=Z, transform=TERRAIN[1])


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    return run(tmp_path_factory.mktemp("full"), LINE, release=POINT, output=ALL)


@pytest.fixture
def observed():
    """Observations with the attributes that `read_observed` gives."""
    names = ["line", "method", "quantity", "mean", "std", "max"]
    rows = [("L", "observed", "energy_total", 2e5, 1e5, 9e5), ("L", "A", "speed", 9.0, 2.0, 20.0)]
    rows += [("L", "B", "speed", np.nan, np.nan, 21.0)]
    return SimpleNamespace(
        summaries=pd.DataFrame(rows, columns=names),
        samples={("L", "speed"): np.array([4.0, 9.0, 11.0, 40.0])},
        stops=np.array([[140.0, 200.0], [400.0, 50.0]]),
        distances=np.array([100.0, 300.0, 200.0, 400.0]),
        passing=pd.DataFrame({"distance": [50.0, 150.0], "fraction": [0.9, 0.4]}),
    )


def draw(result, name, *arguments):
    return {one.name: one for one in figures(result, *arguments)}[name].draw()


def curve(axes, label):
    (line,) = [line for line in axes.lines if str(line.get_label()).startswith(label)]
    return np.array(line.get_xdata()), np.array(line.get_ydata())


# ---- available figures, each of which can be drawn


@pytest.mark.all
@pytest.mark.parametrize(
    ("line", "groups", "names"),
    [
        (LINE, {"output": ALL},
         [*TRAJECTORIES, "passing", "stops", "pass_frequency", *AT_LINES, "along_1", *REBOUNDS,
          *MAPS]),
        ((), {}, ["passing", "stops"]),
        (FAR, {"case": {"boulders": 3}, "release": POINT | {"drop_height": 0.0},
               "impact": {"rest_angle": 90.0},
               "output": {"rebounds": True, "trajectories": 2, "maps": ["speed_max_map"]}},
         ["passing", "stops", *AT_LINES, "map_speed_max_map"]),
        (LINE + FAR + [LINE[0] | {"name": "again"}],
         {"release": {"x": [100.0, 200.0], "y": [380.0, 390.0]}, "output": {"maps": ["passages"]}},
         ["passing", "stops", "pass_frequency", *AT_LINES, "along_1", "along_2", "along_3"]),
    ],
    ids=["all", "no lines", "none moves", "two sources"],
)  # fmt: skip
def test_a_result_has_the_figures_that_it_can_feed(tmp_path, line, groups, names):
    from matplotlib.text import Text

    result = run(tmp_path, line, **{"release": POINT, **groups})
    shown = figures(result, TERRAIN)
    assert [one.name for one in shown] == names
    for one in shown:
        assert one.title and one.caption.endswith(".") and "\n" not in one.caption
        if one.name in DRAWN_ALIKE:
            continue
        drawn = one.draw()
        drawn.draw_without_rendering()  # as for users who save it outside the style
        assert 25.4 * drawn.get_figwidth() in (pytest.approx(90), pytest.approx(180))
        texts = [text for text in drawn.findobj(Text) if text.get_text().strip()]
        sizes = {text.get_fontsize() for text in texts}
        assert min(sizes) >= 7 and max(sizes) <= 9, one.name


def test_a_barrier_is_no_dashed_line(full):
    for result, dashes in ((full, "--"), (full.assign(barrier_height=("line", [3.0])), "-")):
        for name in "stops", "profile":
            (drawn,) = (
                one
                for axes in draw(result, name).axes[:1]
                for one in axes.lines
                if one.get_color() in (style.INK, style.BLUE) and len(one.get_xdata()) == 2
            )
            assert drawn.get_linestyle() == dashes, name
    barrier = draw(full.assign(barrier_height=("line", [3.0])), "line_speed")
    assert " arrive, " in barrier.axes[0].get_title() + barrier.axes[0].get_title("left")


def test_no_terrain_no_ground(full):
    assert len(draw(full, "profile", TERRAIN).axes) == 3
    assert len(draw(full, "profile").axes) == 2
    assert not draw(full, "trajectories").axes[0].images
    coarse = (Z[::2, ::2], Grid(0.0, 400.0, 10.0, 30, 40))
    assert len(draw(full, "profile", coarse).axes) == 2  # heights above it would be wrong


# ---- drawn values are those of the result


def test_trajectories_touch_the_ground_at_contacts_and_fly_above_it(full):
    for one in trajectories.trajectories(full):
        above = one.z - height(*TERRAIN, one.x, one.y)
        contacts = above[trajectories.POINTS - 1 :: trajectories.POINTS][
            :-1
        ]  # it may leave while in flight
        assert contacts == pytest.approx(0, abs=1e-6)
        assert above.min() > -1e-6 and above.max() > 1


def test_passing_is_the_survival_of_the_stopping_distances(full, observed):
    full = full.copy()
    full["status"] = full["status"].copy(data=np.ones(50, "i1"))  # no boulder left the terrain
    axes = draw(full, "passing", None, observed).axes[0]
    x, y = curve(axes, "this run")
    distance = full["plan_distance"].values
    assert y == pytest.approx([100 * np.mean(distance >= one) for one in x])
    assert x[-1] == pytest.approx(distance.max())
    x, y = curve(axes, "observed (4 boulders)")
    assert x.tolist() == [0, 100, 200, 300, 400] and y.tolist() == [100, 100, 75, 50, 25]
    x, y = curve(axes, "observed fractions")
    assert x.tolist() == [50, 150] and y.tolist() == pytest.approx([90, 40])
    assert axes.get_xlim()[1] >= 400


def test_beyond_the_terrain_passing_is_known_between_two_bounds(full):
    gone = full["status"].values == 3
    assert 0 < gone.sum() < 50
    axes = draw(full, "passing").axes[0]
    known, _ = curve(axes, "this run")
    distance = full["plan_distance"].values
    assert known.max() <= distance[gone].min()
    bounds = [line.get_ydata() for line in axes.lines if line.get_linestyle() == ":"]
    assert bounds[0][-1] == pytest.approx(100 * np.mean(distance >= distance.max()))
    assert bounds[1].min() >= 100 * gone.mean()


def test_distributions_hold_the_boulders_that_pass(full, observed):
    from matplotlib.patches import StepPatch

    (panel,) = draw(full, "line_energy_total", None, observed).axes
    energy = (
        at_lines(full)["line_energy_translational"] + at_lines(full)["line_energy_rotational"]
    ).values[0] / 1000
    energy = energy[np.isfinite(energy)]
    share, edges, _ = panel.findobj(StepPatch)[0].get_data()
    assert share == pytest.approx(100 * np.histogram(energy, edges)[0] / energy.size)
    assert share.sum() == pytest.approx(100, abs=100 / energy.size + 0.3)
    rows = [bar.get_children()[0].get_xdata()[0] for bar in panel.containers]
    assert rows == pytest.approx([energy.mean(), 200.0])
    labels = [text.get_text() for text in panel.get_yticklabels(minor=True)]
    assert labels == ["this run", "observed"]
    low, high = panel.get_ylim()
    places = panel.get_yticks(minor=True)
    assert low < places[1] < places[0] < 0 < min(high, share.max())
    assert min(panel.get_yticks()) == 0


def test_many_lines_are_drawn_a_few_at_a_time(tmp_path):
    """All lines are drawn, a few per figure. If `most_lines` is below their number, those with the
    most passing boulders are drawn, with a note."""
    y = [375.0 - 4 * k for k in range(19)]
    several = [{"name": f"L{k}", "x": [0.0, 300.0], "y": [one, one]} for k, one in enumerate(y)]
    result = run(tmp_path, several, case={"boulders": 30}, release=POINT)
    passed = np.isfinite(at_lines(result)["line_x"].values).sum(axis=1)
    drawn = {one.name: one for one in figures(result) if one.name.startswith("line_speed")}
    assert [*drawn] == ["line_speed_1", "line_speed_2", "line_speed_3"]
    assert [len(one.draw().axes) for one in drawn.values()] == [8, 8, 3]
    some = {one.name: one for one in figures(result, most_lines=8)}
    assert "The 8 of 19 lines with the most passing boulders" in some["line_speed"].caption
    assert "of 19 lines" not in drawn["line_speed_1"].caption
    which = most_crossed(result, 8)
    assert len(which) == 8 and min(passed[which]) >= max(np.delete(passed, which))
    assert [f"along_{k + 1}" in some for k in range(19)] == [k in which for k in range(19)]


@pytest.mark.all
def test_a_map_names_the_lines_passed_by_most_boulders(tmp_path):
    """All of 24 lines are drawn; 20 have names, also on the profile of passing boulders."""
    y = [375.0 - 3 * k for k in range(24)]
    several = [{"name": f"L{k}", "x": [0.0, 300.0], "y": [one, one]} for k, one in enumerate(y)]
    result = run(tmp_path, several, case={"boulders": 30}, release=POINT)
    most = {f"L{k}" for k in most_crossed(result, 20)}
    for figure in (stops_figure(result, (rough(), grid(rough()))), passing_figure(result)):
        axes = figure.axes[0]
        texts = {text.get_text().strip() for text in axes.texts}
        assert {text for text in texts if text.startswith("L")} <= most
    assert {text.get_text().strip() for text in axes.texts} == most
    drawn = stops_figure(result, (rough(), grid(rough()))).axes[0].lines
    level = {line.get_ydata()[0] for line in drawn if len(set(line.get_ydata())) == 1}
    assert level >= set(y)


@pytest.mark.parametrize(
    ("name", "value", "drawn"),
    [("passing_height", -3e38, "passing_height"), ("omega", 3e38, "energy_total")],
)
def test_a_number_past_all_bounds_gives_a_distribution_too(full, name, value, drawn):
    from matplotlib.patches import StepPatch

    result = full.copy(deep=True)
    result[f"crossing_{name}"].values[0] = value
    assert np.nanmax(np.abs(line_values(result, drawn, 0))) > 1e37
    upper = draw(result, f"line_{drawn}", None, None).axes[0]
    assert upper.findobj(StepPatch)[0].get_data().edges.size < 1000


def test_samples_and_printed_means_stand_beside_ours(full, observed):
    from matplotlib.patches import StepPatch

    (panel,) = draw(full, "line_speed", None, observed).axes
    share, edges, _ = panel.findobj(StepPatch)[-1].get_data()
    assert share.sum() == pytest.approx(100) and edges[-1] > 39
    labels = [text.get_text() for text in panel.get_yticklabels(minor=True)]
    assert labels == ["this run", "published, A", "observed (4)"]
    spread = [bar.lines[2][0].get_segments()[0][:, 0] for bar in panel.containers]
    assert spread[1].tolist() == [7.0, 11.0]
    assert np.diff(spread[2]) / 2 == pytest.approx(np.std([4, 9, 11, 40], ddof=1))


@pytest.mark.parametrize("name", ["passages", "energy_max"])
def test_a_map_shows_the_cells_where_they_are(full, name):
    image = mapfigures.map_figure(full, name).axes[0].images[-1]
    west, east, south, north = image.get_extent()
    shown = np.ma.filled(image.get_array(), 0)[::-1]  # south is first in the image
    scale = {"passages": 100 / 50, "energy_max": 1e-3}
    inside = full.sel(x=slice(west, east), y=slice(north, south))[name].fillna(0)
    assert shown == pytest.approx(scale[name] * inside.values, rel=1e-6)
    assert np.nansum(full[name]) == pytest.approx(float(inside.sum()))  # nothing is cut off


def test_the_upper_limit_is_blank_where_none_passed(tmp_path):
    """The limit is above 0 everywhere, but the map shows only cells with boulders."""
    groups = {"release": POINT, "case": {"boulders": 9}}
    result = run(tmp_path, output={"maps": ["passages", "reach_probability_high"]}, **groups)
    alone = result.drop_vars("passages")
    assert extent.reached(alone) == extent.reached(result)
    image = mapfigures.map_figure(alone, "reach_probability_high").axes[0].images[-1]
    west, east, south, north = image.get_extent()
    passed = result["passages"].sel(x=slice(west, east), y=slice(north, south)).values > 0
    assert (np.isfinite(np.ma.filled(image.get_array(), np.nan))[::-1] == passed).all()
    assert 0 < passed.sum() < passed.size


def test_captions_and_scales_say_where_a_number_needs_more_boulders(tmp_path):
    names = ["energy_mean", "speed_q50", "energy_max", "passages"]
    result = run(tmp_path, release=POINT, output={"maps": names, "min_passages": 4})
    shown = {one.name: one for one in figures(result)}
    for name, thin in (("energy_mean", 10), ("speed_q50", 6)):
        one = shown[f"map_{name}"]
        assert "blank where fewer than 4 boulders passed" in one.caption
        assert f"where fewer than {thin} boulders passed; hatched there" in one.caption
        drawn = one.draw().axes
        assert drawn[1].get_xlabel().replace("\n", " ").endswith("blank: fewer than 4 passed")
        hatched = [c for c in drawn[0].collections if getattr(c, "hatches", None)]
        assert len(hatched) == 1
        passed, cells = result["passages"].values, mapfigures.thin_cells(result, name)
        assert np.array_equal(cells, (passed >= 4) & (passed < thin)) and cells.any()
    assert "blank" not in shown["map_energy_max"].caption


@pytest.mark.all
def test_a_name_is_no_formula(full, tmp_path):
    from matplotlib.cbook import is_math_text

    named = full.assign(line_name=("line", np.array([r"$\frac$"], object)))
    for one in figures(named, TERRAIN):
        if one.name in ("trajectories", "profile", "line_speed"):
            drawn = one.draw()
            texts = [t for axes in drawn.axes for t in (*axes.texts, axes.title, axes._left_title)]
            shown = [text.get_text() for text in texts if "$" in text.get_text()]
            assert shown and not any(map(is_math_text, shown))
            style.save(drawn, tmp_path / f"{one.name}.png", 50)


def test_the_1_percent_outline_runs_along_the_edges_of_cells():
    from matplotlib.figure import Figure

    axes = Figure().add_subplot()
    inside = np.zeros((4, 5), bool)
    inside[1, 2] = True
    mapfigures._draw_outline(axes, inside, Grid(100.0, 220.0, 5.0, 5, 4))
    edges = {
        tuple(map(tuple, np.sort(edge, axis=0))) for edge in axes.collections[0].get_segments()
    }
    a, b, c, d = (110.0, 210.0), (115.0, 210.0), (110.0, 215.0), (115.0, 215.0)
    assert edges == {(a, b), (a, c), (b, d), (c, d)}


@pytest.mark.parametrize("flipped", [False, True])
def test_a_part_of_a_raster_keeps_its_place(flipped):
    whole = Grid(100.0, 220.0, 5.0, 12, 9)
    data = xr.DataArray(1000 * whole.y[:, None] + whole.x, {"y": whole.y, "x": whole.x})
    stored = north_up(data[::-1] if flipped else data)
    part, cells = rasters.cropped(*stored, (112.0, 139.0, 183.0, 201.0), np.fmax)
    assert (part == 1000 * cells.y[:, None] + cells.x).all()
    assert (cells.west, cells.east, cells.south, cells.north) == (110.0, 140.0, 180.0, 205.0)


def test_a_thinned_raster_keeps_its_edges(monkeypatch):
    monkeypatch.setattr(rasters, "DOTS", 4)
    whole = Grid(0.0, 50.0, 5.0, 7, 10)
    values = np.arange(70.0).reshape(10, 7)
    most, cells = rasters.cropped(values, whole, (0.0, 35.0, 0.0, 50.0), np.fmax)
    assert most.max() == 69 and most.shape == (4, 3) and cells.cell == 15
    mean, _ = rasters.cropped(values, whole, (0.0, 35.0, 0.0, 50.0), np.add)
    assert mean[0, 0] == values[:3, :3].mean() and mean[-1, -1] == 69


def test_histograms_are_those_of_the_result(full):
    from matplotlib.patches import StepPatch

    panels = reboundfigures.histogram_figure(full, "restitution_normal").axes
    share, edges, _ = panels[0].findobj(StepPatch)[0].get_data()
    counts = full["restitution_normal_histogram"].values
    assert share == pytest.approx(100 * counts / counts.sum()) and share.sum() == pytest.approx(100)
    assert edges == pytest.approx(0.1 * np.arange(51))


def test_observed_stops_are_on_the_maps_and_in_them(full, observed):
    for name in "stops", "pass_frequency":
        axes = draw(full, name, TERRAIN, observed).axes[0]
        x, y = curve(axes, "observed stop (2)")
        assert (x.tolist(), y.tolist()) == ([140, 400], [200, 50])
    assert draw(full, "stops", None, observed).axes[0].get_xlim()[1] > 400


def test_stops_are_told_apart_by_marker(full):
    axes = draw(full, "stops").axes[0]
    x, _ = curve(axes, "left domain")
    assert sorted(x) == sorted(full["stop_x"].values[full["status"].values == 3])
    markers = [line.get_marker() for line in axes.lines if "(" in str(line.get_label())]
    assert len(markers) == len(set(markers)) == 2


# ---- the terrain of a result


@pytest.fixture(scope="module")
def ready(tmp_path_factory):
    with pytest.MonkeyPatch.context() as here:
        here.chdir(tmp_path_factory.mktemp("ready"))
        make_raster("dem.tif", Z.astype("f4"), TERRAIN[1].transform, crs=None)
        case = make_case(
            Path(), *sets(), LINE, release=POINT, terrain={"dem": "dem.tif"}, case={"boulders": 8},
            output={"maps": ["passages"], "trajectories": 2},
        )  # fmt: skip
        Path("case.nml").write_text(case.text())
        assert main(["run", "case.nml", "-o", "out.nc", "--quiet"]) == 0
        return Path.cwd()


@pytest.fixture
def place(ready, tmp_path, monkeypatch):
    shutil.copytree(ready, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_terrain_is_found_by_the_case_or_given(place):
    result = rockfall.read_result("out.nc")
    for z, found in terrain_of(result), terrain_of(result, "dem.tif"):
        rows = np.searchsorted(-TERRAIN[1].y, -found.y)
        columns = np.searchsorted(TERRAIN[1].x, found.x)
        assert z == pytest.approx(Z[np.ix_(rows, columns)].astype("f4"))
        assert found.x == pytest.approx(TERRAIN[1].x[columns]) and z.size < Z.size
    stops = result["stop_x"].values
    assert found.west < stops.min() and stops.max() < found.east


def test_a_big_terrain_is_thinned_with_its_cells_where_they_are(place, monkeypatch):
    monkeypatch.setattr(terrain, "MAX_CELLS", 400)
    z, found = terrain_of(rockfall.read_result("out.nc"))
    assert z.size <= 400 and found.cell > 5 and z.shape == found.shape
    rows, columns = np.rint((400 - found.y) / 5 - 0.5), np.rint(found.x / 5 - 0.5)
    assert (400 - found.y) / 5 - 0.5 == pytest.approx(rows)
    assert z == pytest.approx(Z[np.ix_(rows.astype(int), columns.astype(int))].astype("f4"))


def test_another_dem_is_refused_when_given_and_left_out_when_found(place):
    result = rockfall.read_result("out.nc")
    make_raster("dem.tif", Z.astype("f4") + 1, TERRAIN[1].transform, crs=None)
    with pytest.warns(UserWarning, match="dem.tif: is not the DEM of the run"):
        assert terrain_of(result) is None
    with pytest.raises(RockfallError, match="^dem.tif: is not the DEM of the run"):
        terrain_of(result, "dem.tif")
    Path("dem.tif").unlink()
    with pytest.warns(UserWarning, match="dem.tif: cannot be read"):
        assert terrain_of(result) is None


def test_a_result_that_was_moved_with_its_dem_keeps_its_relief(place, monkeypatch):
    """The DEM of the run is found next to the result; if it is not, a warning lists the searched
    paths."""
    moved = place / "moved"
    moved.mkdir()
    Path("out.nc").rename(moved / "out.nc")
    Path("dem.tif").rename(moved / "dem.tif")
    result = rockfall.read_result(moved / "out.nc")
    assert terrain_of(result, None, moved) is not None
    other = make_raster("dem.tif", Z.astype("f4") + 1, TERRAIN[1].transform, crs=None)
    assert terrain_of(result, None, moved) is not None  # another DEM with that name is skipped
    Path(other).unlink()
    (moved / "dem.tif").unlink()
    with pytest.warns(UserWarning, match=r"dem.tif, .*moved.dem.tif: cannot be read: No such file"):
        assert terrain_of(result, None, moved) is None


def test_the_dem_of_a_run_from_an_array_must_lie_where_it_lay(full, tmp_path):
    with pytest.warns(UserWarning, match="were given as an array"):
        assert terrain_of(full) is None
    same = make_raster(tmp_path / "same.tif", Z, TERRAIN[1].transform, crs=None)
    assert terrain_of(full, same) is not None
    for moved in (2.5, 0.0), (0.0, -2.5), (1e6, 0.0), (0.0, -1e6):  # half a cell, and far away
        there = replace(TERRAIN[1], west=moved[0], north=TERRAIN[1].north + moved[1])
        apart = make_raster(tmp_path / "apart.tif", Z, there.transform, crs=None)
        with pytest.raises(
            RockfallError, match=r"apart.tif: corner .*, cells of 5 m: must match the run"
        ):
            terrain_of(full, apart)


def test_the_impact_set_is_drawn_where_it_is_still_the_same(place):
    result = rockfall.read_result("out.nc")
    assert "impact_set" in [one.name for one in figures(result)]
    with open("sets.nml", "a") as file:
        file.write("! changed\n")
    assert "impact_set" not in [one.name for one in figures(result)]


# ---- command and refusals


@pytest.mark.all
def test_the_command_writes_every_figure_and_says_so(place, capsys, monkeypatch):
    monkeypatch.setattr("rockfall.plots.figures.DRAWN", ("speed",))
    monkeypatch.setattr("rockfall.plots.figures.set_of", lambda _: None)
    assert main(["figures", "out.nc", "pictures", "--format", "svg"]) == 0
    out, err = capsys.readouterr()
    names = [one.name for one in figures(rockfall.read_result("out.nc"))]
    assert out.split() == [str(Path("pictures", f"{name}.svg")) for name in names]
    assert all(line.startswith("rockfall: warning: ") for line in err.splitlines())
    assert sorted(path.name for path in Path("pictures").iterdir()) == sorted(
        f"{name}.svg" for name in names
    )
    assert max(path.stat().st_size for path in Path("pictures").iterdir()) < 1e6


@pytest.mark.all
@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_the_same_result_gives_the_same_bytes(place, ending):
    result = rockfall.read_result("out.nc")
    some = [one for one in figures(result, terrain_of(result)) if one.name in ("stops", "passing")]
    first, second = (write_figures(some, folder, ending) for folder in ("a", "b"))
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


def test_the_command_warns_of_a_terrain_that_is_gone(place, capsys, monkeypatch):
    Path("dem.tif").unlink()
    monkeypatch.setattr("rockfall.products.figures_of", lambda *_, **__: [])
    assert main(["figures", "out.nc", "pictures"]) == 0
    err = capsys.readouterr().err
    assert err.startswith("rockfall: warning: dem.tif: cannot be read")
    assert err.count("dem.tif") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["dem.tif", "p"], "dem.tif: is not a netCDF result"),
        (["out.nc", "p", "--format", "bmp"], "format = 'bmp': must be one of png, pdf, svg"),
        (["out.nc", "dem.tif"], "dem.tif: is a file: give a folder"),
        (["out.nc", "p", "--dem", "none.tif"], "none.tif: cannot be read: No such file"),
    ],
)
def test_the_command_refuses_in_one_line(place, capsys, arguments, message):
    refuses(["figures", *arguments], f"{re.escape(message)}.*", capsys)


def test_a_result_without_boulders_is_refused(full):
    with pytest.raises(RockfallError, match="figures need a result with boulders"):
        figures(full.isel(boulder=slice(0)))


def test_a_small_fraction_is_not_rounded_to_nothing(full):
    """The caption has 0.0300 % for 6 of 20,000 boulders, with a lower limit above 0."""
    values, number = np.full(20_000, np.nan), np.arange(1, 20_001)
    values[:6] = 150.0
    rare = full.drop_dims(["boulder", "line", "crossing"]).assign(
        crossed(number, ["L"], **dict.fromkeys(STORED, values)) | {"boulder": number}
        | {name: ("boulder", np.resize(full[name].values, 20_000), full[name].attrs)
           for name in full if full[name].dims == ("boulder",)}
    )  # fmt: skip
    (speeds,) = (one for one in figures(rare, TERRAIN) if one.name == "line_speed")
    assert "6 at L (0.0300 %, 95 % confidence interval 0.01" in speeds.caption


@pytest.mark.all
@pytest.mark.parametrize("name", ["line_speed", "stops", "restitution", "profile"])
def test_kept_ticks_are_those_that_matplotlib_makes(full, name, monkeypatch, tmp_path):
    style.save(draw(full, name), tmp_path / "kept.svg")
    monkeypatch.setattr(style, "_keep_ticks", lambda figure: None)
    style.save(draw(full, name), tmp_path / "made.svg")
    assert (tmp_path / "kept.svg").read_bytes() == (tmp_path / "made.svg").read_bytes()


def test_ticks_of_logarithms_are_made_once_for_a_view(full, monkeypatch):
    drawn = history_figure(full, 0)
    axis, made = drawn.axes[0].xaxis, []
    make = axis._update_ticks
    monkeypatch.setattr(axis, "_update_ticks", lambda: made.append(1) or make())
    style._keep_ticks(drawn)
    first = axis._update_ticks()
    assert axis._update_ticks() is first and len(made) == 1 and first
    drawn.axes[0].set_xlim(1, 1e6)
    assert len(axis._update_ticks()) > len(first) and len(made) == 2


def test_contours_are_two_curves_of_all_their_levels(full):
    """Contours are one bold and one thin curve, with gaps between their pieces."""
    contours = relief.contours_of(TERRAIN, extent.reached(full))
    drawn = draw(full, "stops", TERRAIN)
    brown = [line for line in drawn.axes[0].lines if line.get_color() == relief.BROWN]
    assert [line.get_linewidth() for line in brown] == [0.5, 0.2]
    for line, bold in zip(brown, (True, False), strict=True):
        pieces = [piece for level, curves in contours.curves.items()
                  if contours.is_index(level) == bold for piece in curves]  # fmt: skip
        assert np.isnan(line.get_xdata()).sum() == len(pieces) > 0
        np.testing.assert_array_equal(
            line.get_xydata()[~np.isnan(line.get_xdata())], np.concatenate(pieces)
        )


def test_minor_ticks_of_logarithms_are_where_matplotlib_has_them(full, monkeypatch):
    monkeypatch.setattr("rockfall.plots.history_figure.sizes", lambda source: [1, 7, 20, 50])
    marked = history_figure(full, 0)
    monkeypatch.setattr("rockfall.plots.history_figure._mark_minor", lambda axes: None)
    for ours, theirs in zip(marked.axes, history_figure(full, 0).axes, strict=True):
        assert ours.get_xlim() == theirs.get_xlim() and ours.get_ylim() == theirs.get_ylim()
        assert ours.xaxis.get_minorticklocs().size == 0
        low, high = theirs.get_xlim()
        places = theirs.xaxis.get_minorticklocs()
        drawn = ours.lines[-1].get_xdata()
        np.testing.assert_allclose(drawn, places[(places >= low) & (places <= high)])
        assert drawn.size > 8 and (ours.lines[-1].get_ydata() == 0).all()


def test_a_dense_figure_is_dots_on_white(full, monkeypatch):
    monkeypatch.setattr(render, "MAX_VERTICES", 100)
    drawn = render.picture(draw(full, "profile", TERRAIN), "profile", "")
    kind, content = drawn.uri.split(",")
    assert kind == "data:image/png;base64"
    dots = np.asarray(Image.open(BytesIO(base64.b64decode(content))).convert("RGB"))
    wide, high = (round(inches * render.DOTS_PER_INCH / 96) for inches in (drawn.wide, drawn.high))
    assert dots.shape == (pytest.approx(high, abs=2), pytest.approx(wide, abs=2), 3)
    assert (dots[0] == 255).all() and (dots == 255).all(axis=2).mean() > 0.5
    blue = np.array([0x00, 0x72, 0xB2])
    assert (np.abs(dots.astype(int) - blue).max(axis=2) < 60).sum() > 500


@pytest.mark.parametrize(
    "locale, shown", [("en", "2,000"), ("fr", "2\u202f000"), ("de-CH", "2’000")]
)
def test_ticks_of_logarithms_are_in_the_language(full, locale, shown):
    with speaking(locale):
        (label, *_) = (
            history_figure(full, 0).axes[0].xaxis.get_major_formatter().format_ticks([2e3])
        )
    assert label == shown
