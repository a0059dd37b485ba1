# SPDX-License-Identifier: BSD-3-Clause
"""Origins: the contributions of sources to a place sum to its total, and none exceeds what the
source releases."""

import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import rockfall
import scenes
from made import make_layer, refused, write_few_maps
from rockfall.analysis.hazard.origins import (
    Arrivals,
    Origins,
    origin_areas,
    origin_numbers,
    origins_at,
)
from rockfall.analysis.precision.weighted import quantile_interval
from rockfall.cli import main
from rockfall.io.rasters.grid import Grid
from rockfall.language import LANGUAGES, speaking
from rockfall.plots.cartography.sheet import Room
from rockfall.plots.hazard.origin_map import (
    origin_map,
    origin_place,
    parts_and_words,
    parts_of_total,
)
from rockfall.quantities import number
from rockfall.result.variables import ENDS
from rockfall.studies.hazard import read_study
from rockfall.text.hazard import origins_text
from slope_case import CASE as SLOPE
from slope_case import write_slope

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

Z, GRID = scenes.cut_below(scenes.rough(), 140.0)
PLACE = {"dem": Z, "transform": GRID}
LINES = [
    {"name": "road", "x": [0.0, 300.0], "y": [200.0, 200.0]},
    {"name": "left", "x": [0.0, 75.0], "y": [330.0, 330.0]},
    {"name": "above", "x": [0.0, 300.0], "y": [398.0, 398.0]},
]
SCENARIOS = [
    {"name": "often", "frequency": 8.0},
    {"name": "large", "frequency": 0.5, "volume_mean": 6.0},
]


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    release = {"x": [52.0, 120.0, 121.0, 260.0], "y": [380.0] * 4, "drop_height": 5.0}
    groups = {"release": release, "case": {"boulders": 150}, "line": LINES}
    case = scenes.make_case(folder, *scenes.sets(2.0), **groups).replace(scenario=SCENARIOS)
    make_layer(folder / "houses.gpkg", [shapely.box(130.0, 150.0, 150.0, 170.0)], crs=None,
               name=["house"])  # fmt: skip
    make_layer(folder / "point.gpkg", [shapely.Point(140.0, 160.0)], crs=None, name=["pole"])
    return case


@pytest.fixture(scope="module")
def hazard(case):
    return rockfall.hazard(case, objects=case.path("houses.gpkg"), **PLACE)


def test_sources_sum_up_to_what_comes(hazard):
    assert hazard["source_frequency"].values.sum() == pytest.approx(8.5, rel=1e-12)
    for kind in ("line", "object"):
        rates = hazard[f"{kind}_source_frequency"].values
        assert np.allclose(rates.sum(axis=1), hazard[f"{kind}_frequency"].values, rtol=1e-12)
        assert (rates <= hazard["source_frequency"].values * (1 + 1e-12)).all()


def test_two_sources_of_one_cell_are_one_and_stand_in_its_middle(hazard):
    assert sorted(hazard["source_x"].values.tolist()) == [52.5, 122.5, 262.5]
    released = dict(zip(hazard["source_x"].values, hazard["source_frequency"].values, strict=True))
    assert released[122.5] == pytest.approx(2 * released[52.5], rel=1e-12)


def test_origins_are_sorted_shares_of_what_comes(hazard):
    found = rockfall.origins(hazard, "road")
    assert found["share"].sum() == pytest.approx(1.0) and (found["reach"] <= 1 + 1e-12).all()
    assert (found["frequency"].diff()[1:] <= 0).all()
    left = rockfall.origins(hazard, "left")
    assert left["x"][0] == 52.5 and left["share"][0] > 0.9  # the only source above the place
    assert rockfall.origins(hazard, "above").empty
    with refused("roof: no line or object (names: road, left, above, house)"):
        rockfall.origins(hazard, "roof")


def test_energies_are_those_of_the_boulders_that_start_in_the_cell_and_come(hazard, case):
    values, weights = [], []
    for scenario in read_study(case, **PLACE).scenarios:
        result = rockfall.run(scenario.case, **PLACE)
        at = rockfall.crossings(result, "road")
        x = result["start_x"].values[at["boulder"].to_numpy() - 1]
        here = (x >= 120.0) & (x < 125.0)
        energy = at["energy_translational"] + at["energy_rotational"]
        values.append(energy.to_numpy()[here])
        weights.append(np.full(here.sum(), scenario.frequency / result.sizes["boulder"]))
    energy, weight = np.concatenate(values), np.concatenate(weights)
    assert min(map(len, values)) > 20
    found = rockfall.origins(hazard, "road").set_index("x").loc[122.5]
    assert found["frequency"] == pytest.approx(weight.sum(), rel=1e-12)
    assert found["energy_mean"] == pytest.approx(np.average(energy, weights=weight), rel=1e-12)
    limits = quantile_interval(energy, weight, 0.95, 8.5 / 600)  # shared random numbers
    names = ["energy_q95", "energy_q95_low", "energy_q95_high"]
    assert found[names].tolist() == pytest.approx(list(limits), nan_ok=True)
    assert np.average(energy <= found["energy_q95"], weights=weight) == pytest.approx(
        0.95, abs=0.02
    )


def test_two_scenarios_with_equal_boulders_have_the_limits_of_one():
    """Scenarios share random numbers: the same boulders twice give no more information."""
    energy, grid = np.random.default_rng(5).exponential(1e5, 4000), Grid(0, 10, 10.0, 1, 1)
    cells, numbers = np.zeros(1, int), np.array([energy.size])
    run = Origins(cells, numbers, {"line": [Arrivals(np.zeros(energy.size, int), energy)]})
    one, two = (
        origin_numbers([run] * n, [1.0 / energy.size / n] * n, 1.0 / energy.size, grid)
        for n in (1, 2)
    )
    for end in ENDS:
        name = f"line_source_energy_q95{end}"
        assert two[name] == pytest.approx(one[name], rel=5e-3), name
    assert one["line_source_energy_q95_low"] < 0.98 * one["line_source_energy_q95"]


def test_a_cell_of_which_none_comes_has_no_energy(hazard):
    left = hazard.sel(line="left")
    none = left["line_source_frequency"].values == 0
    assert none.any() and not none.all()
    for name in ("mean", "q95", "q95_low", "q95_high"):
        assert np.isnan(left[f"line_source_energy_{name}"].values[none]).all()
    assert (left["line_source_energy_mean"].values[~none] > 0).all()


def test_classes_hold_half_and_the_next_third_of_the_sum():
    rates = np.array([4.0, 1.0, 3.0, 2.0])
    assert parts_of_total(rates).tolist() == [0, 2, 0, 1]
    random = np.random.default_rng(1).exponential(1.0, 500)
    classes = parts_of_total(random)
    sums = [random[classes == k].sum() / random.sum() for k in range(3)]
    assert sums == pytest.approx([0.5, 0.3, 0.2], abs=0.02)


def test_a_geopackage_has_the_sources(hazard, tmp_path):
    pyogrio = pytest.importorskip("pyogrio", reason="the vector extra is not installed")
    rockfall.write_hazard(hazard, tmp_path / "out")
    names, _, _, columns = pyogrio.raw.read(tmp_path / "out/hazard.gpkg", layer="sources")
    table = dict(zip(names["fields"], columns, strict=True))
    assert np.allclose(table["to road"], hazard["line_source_frequency"].sel(line="road"))
    assert {"frequency", "to left", "to above", "to house"} <= {*table}
    for name in "energy_mean", "energy_q95", "energy_q95_low", "energy_q95_high":
        values = 1e-3 * hazard[f"object_source_{name}"].sel(object="house").values
        assert np.allclose(table[f"to house {name}"], values, equal_nan=True)


CELL = 97.5, 152.5


@pytest.fixture
def beside(case, monkeypatch):
    """Make the folder of the case's files current, because their paths are relative."""
    monkeypatch.chdir(case.path("sets.nml").parent)


def hits_at(case):
    """Boulders of each scenario that hit an object in `CELL`, from the maps of a hazard."""
    at = {"x": CELL[0], "y": CELL[1]}
    return rockfall.hazard(case, **PLACE)["scenario_hits"].sel(at).values.astype(int)


@pytest.mark.usefixtures("beside")
def test_sources_of_a_cell_are_those_without_which_its_hits_on_the_map_are_fewer(case, hazard):
    """The hits of a source are those that it adds to the map: sources are added one by one, which
    leaves the boulders of the others unchanged."""
    x, y = case.release["x"], case.release["y"]
    sums = [hits_at(case.replace(release={"x": x[:k], "y": y[:k]})) for k in range(1, len(x) + 1)]
    counts = np.diff(sums, axis=0, prepend=0)
    by_source = dict(zip(x, counts @ (np.array([8.0, 0.5]) / 600), strict=True))
    found = rockfall.origins(hazard, CELL, **PLACE).set_index("x")["frequency"]
    assert len(found) > 1 and found[122.5] == pytest.approx(by_source[120.0] + by_source[121.0])
    for cell, source in (52.5, 52.0), (262.5, 260.0):
        assert found.get(cell, 0.0) == pytest.approx(by_source[source])
    at = {"x": CELL[0], "y": CELL[1]}
    assert found.sum() == pytest.approx(float(hazard["hit_frequency"].sel(at)), rel=1e-6)


@pytest.mark.usefixtures("beside")
def test_a_circle_has_the_sources_of_a_point_of_its_width(case, hazard, tmp_path):
    path = tmp_path / "circle.gpkg"
    layer = make_layer(path, [shapely.Point(*CELL)], crs=None, name=["o"], width=[24.0])
    other = rockfall.origins(rockfall.hazard(case, objects=layer, **PLACE), "o")
    found = rockfall.origins(hazard, (*CELL, 12.0), **PLACE)
    assert found["frequency"].sum() > rockfall.origins(hazard, CELL, **PLACE)["frequency"].sum()
    assert found.equals(other)


@pytest.mark.parametrize("side", [1.0, 100.0, 1e9])
def test_areas_sum_up_their_cells(hazard, side):
    cells, areas = origins_at(hazard, "line", 0), origin_areas(hazard, "line", 0, side)
    assert len(areas) == {1.0: 3, 100.0: 3, 1e9: 1}[side]
    for name in "frequency", "share":
        assert areas[name].sum() == pytest.approx(cells[name].sum(), rel=1e-12)
    energy = [table["frequency"] @ table["energy_mean"] for table in (cells, areas)]
    assert energy[0] == pytest.approx(energy[1], rel=1e-12)
    assert areas["energy_q95"].max() == cells["energy_q95"].max()
    assert areas["energy_q95_high"].max() == cells["energy_q95_high"].max()
    if side == 1e9:
        assert areas["reach"][0] == pytest.approx(cells["frequency"].sum() / 8.5)


def test_an_area_has_no_limit_if_one_of_its_cells_has_none(hazard):
    name = "line_source_energy_q95_high"
    limits = hazard[name].values.copy()
    assert np.isfinite(limits[0]).all()
    limits[0, 1] = np.nan
    few = hazard.assign({name: hazard[name].copy(data=limits)})
    assert origin_areas(few, "line", 0, 1e9)["energy_q95_high"].isna().all()
    assert origin_areas(few, "line", 0, 1.0)["energy_q95_high"].isna().sum() == 1


@pytest.mark.parametrize("side", [1.0, 1e9])
def test_an_area_has_the_binomial_interval_of_its_boulders(hazard, side):
    """Limits follow Wilson's formula for areas with one, two or all four sources, each with 150
    boulders per scenario."""
    areas = origin_areas(hazard, "line", 0, side).sort_values("x", ignore_index=True)
    expected = np.zeros((len(areas), 2))
    for s, yearly in enumerate([8.0, 0.5]):
        came = hazard["line_source_boulders"].values[s, 0]
        n = hazard["source_boulders"].values[s]
        assert n.tolist() == [150, 300, 150]
        if side == 1e9:
            came, n = came.sum(keepdims=True), n.sum(keepdims=True)
        p, z = came / n, 1.959963984540054
        half = z * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
        ends = (p + z**2 / (2 * n) + np.outer([-1, 1], half)) / (1 + z**2 / n)
        expected += (yearly * n / 600 * ends).T
    assert np.allclose(areas[["frequency_low", "frequency_high"]], expected, rtol=1e-12)


def counted(hazard, came, released, per_cluster=1):
    """Hazard of one boulder per year: from each area, `came` of the `released` boulders cross the
    line."""
    n = int(np.sum(released))
    number = {"boulders": n, "frequency": 1.0, "boulders_per_cluster": per_cluster}
    data = {name: ("scenario", [value]) for name, value in number.items()}
    data |= {"source_boulders": (("scenario", "source"), np.array([released]))}
    data |= {"line_source_boulders": (("scenario", "line", "source"), np.array([[came]]))}
    data |= {"line_source_frequency": (("line", "source"), np.array([came]) / n)}
    for name in ("energy_mean", "energy_q95", "energy_q95_low", "energy_q95_high"):
        data[f"line_source_{name}"] = ("line", "source"), np.ones((1, len(came)))
    ones = np.ones(len(came))
    for name, values in (("x", np.arange(len(came)) + 0.5), ("y", 0 * ones), ("frequency", ones)):
        data[f"source_{name}"] = "source", values
    return xr.Dataset(data, attrs=hazard.attrs)


def limits_of_areas(hazard):
    """Lower and upper limit of the frequency of each area from which boulders arrive."""
    areas = origin_areas(hazard, "line", 0, 1.0).sort_values("x")
    return areas[["frequency_low", "frequency_high"]].to_numpy()


def test_intervals_of_areas_cover_a_binomial_number_of_boulders(hazard):
    """From each of 151 areas, 0, 1, ... 150 of 150 boulders arrive. The coverage of the limits
    follows from the binomial distribution: 94.5 to 96 % on average, and never below 92 %."""
    n, came = 150, np.arange(151)
    reach = came.size * limits_of_areas(counted(hazard, came, np.full(came.size, n)))
    assert len(reach) == n  # without the area from which none arrives
    fractions, covered = np.linspace(0.05, 0.95, 181), []
    for p in fractions:
        chance = [math.comb(n, k) * p**k * (1 - p) ** (n - k) for k in range(1, n + 1)]
        covered.append(np.dot(chance, (reach[:, 0] <= p) & (p <= reach[:, 1])))
    assert 0.945 < np.mean(covered) < 0.96 and np.min(covered) > 0.92


@pytest.mark.parametrize("each", [1, 5])
def test_intervals_of_areas_cover_all_sources_if_these_are_a_sample(hazard, case, each):
    """60 sampled sources with `each` boulders that behave alike. A source is in the first area, and
    reaches the line, with probability p: the frequency of that area. Limits cover p in more than 92
    % of samples."""
    sampled = case.replace(release={"sources": "sample"})
    attrs = {name: sampled.text() if text == case.text() else text
             for name, text in hazard.attrs.items()}  # fmt: skip
    sampled_hazard, n = hazard.assign_attrs(attrs), 60
    limits = np.full((n + 1, 2), np.nan)
    for k in range(1, n):  # all sources of the first area reach the line
        of_areas = each * np.array([k, n - k])
        some = counted(sampled_hazard, of_areas * [1, 0], of_areas, each)
        limits[k] = limits_of_areas(some)[0]
    for p in np.linspace(0.1, 0.9, 17):
        chance = [math.comb(n, k) * p**k * (1 - p) ** (n - k) for k in range(n + 1)]
        assert np.dot(chance, (limits[:, 0] <= p) & (p <= limits[:, 1])) > 0.92


MUST = "must be X,Y or X,Y,RADIUS, radius at most 50 m"


@pytest.mark.usefixtures("beside")
@pytest.mark.parametrize(
    ("place", "why"),
    [
        (
            (1e6, 312.5),
            "x = 1000000, y = 312.5: lies outside the terrain, x 0 to 300, y 140 to 400",
        ),
        ((202.5, 202.5), "x = 202.5, y = 202.5: the terrain has no elevation there"),
        ((np.nan, 312.5), f"nan, 312.5: {MUST}"),
        ((127.5, 312.5, 50.5), f"127.5, 312.5, 50.5: {MUST}"),
        ((127.5, 312.5, -1.0), f"127.5, 312.5, -1: {MUST}"),
        ((127.5,), f"127.5: {MUST}"),
    ],
)
def test_places_that_cannot_be_are_refused(hazard, place, why):
    hollow = Z.copy()
    hollow[39, 40] = np.nan  # 202.5, 202.5
    with refused(f"place{':' if why[0] == 'x' else ''} {why}"):
        rockfall.origins(hazard, place, dem=hollow, transform=PLACE["transform"])


@pytest.mark.usefixtures("beside")
def test_a_hazard_of_other_inputs_is_refused(hazard):
    with refused("place 97.5, 152.5: inputs or version differ from those of the hazard: rerun it"):
        rockfall.origins(
            hazard, CELL, dem=scenes.rough(ny=len(Z), seed=2), transform=PLACE["transform"]
        )


@pytest.mark.all
def test_the_command_writes_maps_that_sum_up_to_the_frequency(tmp_path, monkeypatch, capsys):
    rasterio, pd = pytest.importorskip("rasterio"), pytest.importorskip("pandas")
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    monkeypatch.chdir(tmp_path)
    write_slope()
    Path("case.nml").write_text(
        SLOPE.replace(
            "x = 600060.0, y = 4999980.0", "x = 600020., 600060., 600100., y = 3*4999980."
        )
        + "&scenario name = 'a', frequency = 3.0 /\n&scenario name = 'b', return_period = 40.0 /\n"
    )
    hazard = rockfall.hazard(rockfall.read_case("case.nml"))
    write_few_maps(monkeypatch)
    rockfall.write_hazard(hazard, "zones")
    place = 600062.5, 4999932.5
    at = {"x": place[0], "y": place[1]}
    for options, expected, own in (
        (["--line", "L"], "L", hazard["line_frequency"].values[0]),
        (["--at", "600062.5,4999932.5"], place, float(hazard["hit_frequency"].sel(at))),
    ):
        assert main(["origins", "zones", *options, "-o", "out", "--overwrite"]) == 0
        found, table = rockfall.origins(hazard, expected), pd.read_csv("out/cells.csv")
        assert np.allclose(table["frequency"], found["frequency"], rtol=1e-12)
        assert np.allclose(table["energy_q95_kJ"], 1e-3 * found["energy_q95"])
        for name, total in (("frequency", own), ("share", 100.0)):
            with rasterio.open(f"out/{name}.tif") as raster:
                assert np.nansum(raster.read(1)) == pytest.approx(total, rel=1e-6)
                assert np.isfinite(raster.read(1)).sum() == 3  # the sources
        printed = capsys.readouterr().out
        assert f"{options[1]}: {number(own)} boulders per year" in printed
    assert main(["origins", "zones", "--at", "600062.5,4999932.5", "-o", "out"]) == 2
    Path("dem.tif").rename("other.tif")
    assert main(["origins", "zones", "--line", "L", "-o", "out", "--overwrite"]) == 0
    assert "no relief" in capsys.readouterr().err
    Path("other.tif").rename("dem.tif")
    for option, text, why in (
        ("--line", "house", "house: no line (names: L)"),
        ("--object", "L", "L: no object (names: none)"),
        ("--at", "600002.5,4999995", "600002.5,4999995: no simulated boulder arrives"),
        ("--at", "1,2,3,4", "must be X,Y or X,Y,RADIUS"),
        ("--at", "1e308,1e308", "must be X,Y or X,Y,RADIUS"),
        ("--at", "here", "must be X,Y or X,Y,RADIUS"),
    ):
        capsys.readouterr()
        assert main(["origins", "zones", option, text, "-o", "none"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert why in line and not Path("none").exists()


def test_rare_boulders_of_an_area_are_printed_with_two_digits(hazard):
    areas = origin_areas(hazard, "line", 0, 100.0)
    names = ["frequency", "frequency_low", "frequency_high"]
    printed = origins_text(areas.assign(**{name: 1e-4 * areas[name] for name in names}), "road", 1)
    rare = [f" {number(1e-4 * value, 2)} " for value in areas["frequency"]]
    assert all(text in printed for text in rare) and "(0.000–" not in printed


def test_a_point_without_a_width_has_no_known_sources(case):
    found = rockfall.hazard(case, objects=case.path("point.gpkg"), **PLACE)
    assert np.isnan(found["object_source_frequency"].values).all()
    with refused("pole: is a point without a width, whose sources are unknown: give it a width"):
        rockfall.origins(found, "pole")


def test_the_key_of_the_map_has_the_energies_of_its_classes(hazard):
    found = rockfall.origins(hazard, "road")
    parts, words = parts_and_words(found)
    for k in range(3):
        own = found[parts == k]
        if own.empty:
            assert "kJ" not in words[k]
            continue
        mean = (own["frequency"] * own["energy_mean"]).sum() / own["frequency"].sum()
        most = own["energy_q95"].max()
        assert words[k].endswith(
            f"mean {number(mean / 1e3)} kJ, 95 % up to {number(most / 1e3)} kJ"
        )


@pytest.mark.parametrize("wide", [pytest.param(6.69, marks=pytest.mark.all), 4.0])
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_key_of_the_map_lies_on_the_sheet(hazard, language, wide):
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    with speaking(language):
        figure = origin_map(hazard, None, origin_place(hazard), Room(wide, 6.0))
    figure.canvas.draw()
    (key,) = figure.legends
    box, page = key.get_window_extent(), figure.bbox
    assert box.x0 >= page.x0 and box.x1 <= page.x1 and box.y0 >= page.y0
    bottom = figure.axes[0].get_window_extent().y0
    assert all(text.get_window_extent().y1 < bottom for text in key.get_texts())


@pytest.mark.parametrize(
    ("turns", "mirrored"),
    [(3, True)]
    + [pytest.param(*how, marks=pytest.mark.all) for how in ((0, True), (1, False), (2, True))],
)
def test_turned_and_mirrored_terrain_has_turned_and_mirrored_origins(tmp_path, turns, mirrored):
    """Paths agree up to rounding errors, because no source is on the edge of a cell."""
    side = 300.0

    def turned(x, y):
        points = (np.asarray(x) + 1j * np.asarray(y, float)) - side * (1 + 1j) / 2
        points = (-points.conj() if mirrored else points) * 1j**turns + side * (1 + 1j) / 2
        return {"x": points.real.tolist(), "y": points.imag.tolist()}

    z, starts = scenes.rough(60, 60), ([61.0, 101.0, 131.0, 201.0], [281.0] * 4)
    ends = [50.0, 170.0], [200.0, 180.0]
    plain = {"x": starts[0], "y": starts[1]}, {"x": ends[0], "y": ends[1]}
    found = []
    for release, line, dem in (
        (*plain, z),
        (turned(*starts), turned(*ends), np.rot90(z[:, :: -1 if mirrored else 1], turns)),
    ):
        groups = {"release": release | {"drop_height": 5.0}, "case": {"boulders": 300}}
        case = scenes.make_case(
            tmp_path, *scenes.sets(2.0), line=[{"name": "road"} | line], **groups
        ).replace(scenario=SCENARIOS)
        place = {"dem": np.ascontiguousarray(dem), "transform": scenes.grid(dem)}
        found.append(rockfall.origins(rockfall.hazard(case, **place), "road"))
    here, there = found
    here[["x", "y"]] = np.column_stack([*turned(here["x"], here["y"]).values()])
    here, there = (table.round({"x": 6, "y": 6}).set_index(["x", "y"]) for table in found)
    assert {*here.index} == {*there.index} and len(here) == 4
    assert np.allclose(here, there.loc[here.index], rtol=1e-6, equal_nan=True)
