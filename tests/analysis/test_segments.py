# SPDX-License-Identifier: BSD-3-Clause
"""Road segments: each is hit by the boulders whose recorded paths touch its strip of ground,
boulders are weighted by their frequency, and nothing is silently omitted."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import rockfall
import scenes
from made import make_frame, make_layer, refused
from rockfall.analysis.objects.object_layers import File
from rockfall.analysis.objects.segments import edges_along, read_segments, strips_along
from rockfall.analysis.precision.intervals import between_ranks
from rockfall.analysis.precision.weighted import quantile_interval
from rockfall.cli import main
from rockfall.files.segment_files import segment_table
from rockfall.kernel_rules import fraction_limits
from rockfall.language import speaking
from rockfall.plots.hazard.hazard_figures import hazard_figures
from rockfall.result.crossings import at_lines
from rockfall.studies.hazard import read_study
from rockfall.tables.dossier import answer_table
from rockfall.tables.hazard import period_tables
from rockfall.tables.hazard import segment_table as shown_segments

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

Z = scenes.rough()
GRID = scenes.grid(Z)
CRS = "EPSG:32632"
YEARLY, BOULDERS, WIDTH, STEP = 0.5, 200, 8.0, 30.0
ROAD = shapely.LineString([(60, 250), (240, 250)])
ENDS = ("", "_low", "_high")


def make_case(folder, *scenarios, **groups):
    release = {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0}
    groups = {"release": release, "case": {"boulders": 100}} | groups
    groups = {"boulder": {"volume": "normal", "volume_mean": 2.0, "volume_std": 0.5}} | groups
    case = scenes.make_case(folder, *scenes.sets(2.0), **groups)
    return case.replace(scenario=scenarios or [{"name": "one", "frequency": YEARLY}])


def make_roads(folder, *shapes, width=WIDTH, **columns):
    columns |= {} if width is None else {"width": [width] * len(shapes)}
    return make_layer(folder / "road.gpkg", list(shapes), CRS, **columns)


def hazard(case, roads, length=STEP, **how):
    about = {"dem": Z, "transform": GRID, "segment_length": length} | how
    return rockfall.hazard(case, segments=roads, **about)


def boulders_of(case):
    output = {"trajectories": BOULDERS}
    result = rockfall.run(case.replace(scenario=[], output=output), dem=Z, transform=GRID)
    at = {name: result[f"trajectory_{name}"].values for name in ("boulder", "x", "y")}
    points = np.stack([at["x"], at["y"]], axis=1)
    cuts = np.flatnonzero(np.diff(at["boulder"])) + 1
    paths = [shapely.LineString(part) for part in np.split(points, cuts)]
    assert len(paths) == BOULDERS
    return np.array(paths, dtype=object), np.cbrt(0.75 * result.volume.values / np.pi)


# ---- by hand


def test_a_segment_is_hit_by_the_paths_that_touch_its_ground(tmp_path):
    """Segments of a straight road are rectangles of 30 x 8 m. A boulder on the border of two
    segments hits both."""
    case = make_case(tmp_path)
    found = hazard(case, make_roads(tmp_path, ROAD))
    paths, radius = boulders_of(case)
    west = np.arange(60.0, 240.0, STEP)
    ground = shapely.box(west, 246.0, west + STEP, 254.0)
    hit = shapely.distance(paths[:, None], ground) <= radius[:, None]
    counts = hit.sum(axis=0)
    assert found.segment_passages.values[0].tolist() == counts.tolist()
    assert (hit.sum(axis=1) > 1).any() and counts.max() > 40
    assert found.segment_frequency.values == pytest.approx(YEARLY * counts / BOULDERS, rel=1e-12)
    for k, count in enumerate(counts):
        limits = YEARLY * np.array(fraction_limits(count / BOULDERS, BOULDERS))
        mine = [found[f"segment_frequency{end}"].values[k] for end in ENDS[1:]]
        assert mine == pytest.approx(limits, rel=1e-12)
    assert (found.segment_end - found.segment_start).values == pytest.approx(STEP)
    assert found.segment_start.values == pytest.approx(west - 60)


def test_all_segments_together_are_hit_by_what_hits_the_road(tmp_path):
    case, roads = make_case(tmp_path), make_roads(tmp_path, ROAD)
    found, whole = hazard(case, roads), hazard(case, roads, length=None)
    assert whole.sizes["segment"] == 1
    assert found.segment_passages.sum() > whole.segment_passages.sum()
    paths, radius = boulders_of(case)
    touched = (shapely.distance(paths, shapely.box(60, 246, 240, 254)) <= radius).sum()
    assert whole.segment_passages.values.item() == touched


def test_numbers_weigh_boulders_as_often_as_they_come(tmp_path):
    """Means and quantiles weight boulders by the frequency of their scenario, 0.5 or 0.01 per year.
    Expected values are from runs with a line along the outline of the road."""
    scenarios = [
        {"name": "small", "frequency": 0.5, "volume_mean": 0.5},
        {"name": "large", "frequency": 0.01, "volume_mean": 5.0},
    ]
    fixed = {"boulder": {"volume_mean": 2.0}}
    case = make_case(tmp_path, *scenarios, **fixed)
    found = hazard(case, make_roads(tmp_path, ROAD), length=None)
    energies, edges, weights, diameters, above = [], [], [], [], 0.0
    x, y = shapely.box(60, 246, 240, 254).exterior.xy
    line = [{"name": "r", "x": [*x], "y": [*y], "object_width": 0.0}]
    for one in scenarios:
        changed = {"scenario": [], "boulder": {"volume_mean": one["volume_mean"]}, "line": line}
        result = rockfall.run(case.replace(**changed), dem=Z, transform=GRID)
        energy = sum(
            at_lines(result)[f"line_energy_{kind}"].values[0]
            for kind in ("translational", "rotational")
        )
        hit = np.isfinite(energy)
        radius = np.cbrt(0.75 * one["volume_mean"] / np.pi)
        energies.append(energy[hit])
        edges.append(upper_edges(result)[hit])
        weights.append(np.full(hit.sum(), one["frequency"] / BOULDERS))
        diameters.append(np.full(hit.sum(), 2 * radius))
        above += one["frequency"] * (energy > 300_000).sum() / BOULDERS
    energy, edge, weight, diameter = map(np.concatenate, (energies, edges, weights, diameters))
    assert min(map(len, weights)) > 50
    row = segment_table(found).iloc[0]
    assert row["frequency"] == pytest.approx(weight.sum(), rel=1e-12)
    assert row["frequency_above_300kJ"] == pytest.approx(above, rel=1e-12) and above > 0
    assert row["return_period"] == pytest.approx(1 / weight.sum(), rel=1e-12)
    assert row["return_period_low"] == pytest.approx(1 / row["frequency_high"], rel=1e-12)
    for name, values in {
        "energy_{}_kJ": energy / 1000, "upper_edge_{}": edge, "diameter_{}": diameter
    }.items():  # fmt: skip
        mean = (weight * values).sum() / weight.sum()
        assert row[name.format("mean")] == pytest.approx(mean, rel=1e-6)
        order = np.argsort(values)
        reached = np.cumsum(weight[order]) / weight.sum()
        k = int(np.searchsorted(reached, 0.95))
        around = values[order][[k - 1, k + 1]]
        assert around[0] - 1e-9 <= row[name.format("q95")] <= around[1] + 1e-9
    assert row["energy_q95_kJ"] > row["energy_mean_kJ"] > 0
    assert row["boulders"] == energy.size


def upper_edges(result):
    radius = np.cbrt(0.75 * result.volume.values / np.pi)
    return at_lines(result)["line_passing_height"].values[0] + radius


def test_classes_are_those_of_the_matrix(tmp_path):
    """Segments hit with more than 300 kJ at least once in 30 years have class high; segments
    certainly hit less than once in 300 years have at most class residual."""
    found = hazard(make_case(tmp_path), make_roads(tmp_path, ROAD))
    rows = segment_table(found)
    often = rows["frequency_above_300kJ"] >= 1 / 30
    assert (rows["hazard"][often] == "high").all() and often.any()
    never = rows["frequency_high"] < 1 / 300
    assert set(rows["hazard"][never]) <= {"none", "residual"}


@pytest.mark.family(3)
@pytest.mark.parametrize(
    ("language", "expected"),
    [
        ("en", "road, 0 to 22.5 m"), ("de-CH", "road, 0 bis 22.5 m"),
        ("de-AT", "road, 0 bis 22,5 m"), ("fr", "road, de 0 à 22,5 m"),
        ("it", "road, da 0 a 22,5 m"),
    ],
)  # fmt: skip
def test_pages_name_segments_in_their_language(tmp_path, language, expected):
    """Pages translate the names of segments; Python has English names in any language."""
    found = hazard(make_case(tmp_path), make_roads(tmp_path, ROAD), length=22.5)
    with speaking(language):
        for table in (shown_segments(found), answer_table(found, 100.0), *period_tables(found)):
            assert expected in [str(row[0]) for row in table.texts()]
        assert hazard_figures(found)
        assert rockfall.return_period(found, "road, 0 to 22.5 m").value > 0


def test_a_winding_road_is_hit_wherever_it_is_crossed(tmp_path):
    """A boulder that crosses both legs of a road counts at each of them."""
    case = make_case(tmp_path)
    legs = shapely.LineString([(60, 300), (240, 300), (240, 250), (60, 250)])
    found = hazard(case, make_roads(tmp_path, legs), length=180.0)
    paths, radius = boulders_of(case)
    upper = shapely.distance(paths, shapely.box(60, 296, 240, 304)) <= radius
    assert found.segment_passages.values[0, 0] == upper.sum() > 100
    assert found.segment_passages.values[0].sum() > BOULDERS


def test_a_road_that_closes_is_hit_from_within(tmp_path):
    """The road surrounds the sources: boulders that stop on it have not touched its outer edge."""
    release = {"x": [120.0, 180.0], "y": [340.0, 345.0], "drop_height": 5.0}
    case = make_case(tmp_path, release=release)
    ring = shapely.LineString([(60, 280), (240, 280), (240, 395), (60, 395), (60, 280)])
    found = hazard(case, make_roads(tmp_path, ring, width=40.0), length=None)
    paths, radius = boulders_of(case)
    ground = shapely.buffer(ring, 20.0, cap_style="flat")
    assert len(ground.interiors) == 1
    hit = (shapely.distance(paths, ground) <= radius).sum()
    outer = (shapely.distance(paths, ground.exterior) <= radius).sum()
    assert found.segment_passages.values.item() == hit > outer


def test_each_road_has_a_figure(tmp_path):
    pytest.importorskip("matplotlib", reason="the report extra is not installed").use("Agg")
    lane = shapely.LineString([(60, 200), (140, 200)])
    found = hazard(make_case(tmp_path), make_roads(tmp_path, ROAD, lane, name=["$1", "lane"]))
    first, second = hazard_figures(found)[-2:]
    assert [first.name, second.name] == ["segments_1", "segments_2"]
    classes, frequency, energy, edge = first.draw().axes
    assert classes.get_title(loc="left") == r"\$1" and len(classes.patches) == 6
    assert len(frequency.lines) == 18 and frequency.get_yscale() == "log"
    highest = np.nanmax(found.segment_energy_q95.values[:6]) / 1000
    assert energy.get_ylim()[1] > highest and edge.get_xlim() == (0.0, 180.0)
    drawn = [line.get_ydata()[0] for line in energy.lines]
    assert drawn == pytest.approx(found.segment_energy_q95.values[:6] / 1000, nan_ok=True)
    assert second.draw().axes[3].get_xlim() == (0.0, 80.0)


# ---- statistics


def test_equal_weights_are_those_of_line_statistics():
    values = np.random.default_rng(1).gamma(2.0, size=400)
    found = quantile_interval(values, np.full(400, 0.3), 0.95)
    assert found[0] == pytest.approx(np.quantile(values, 0.95, method="hazen"), rel=1e-12)
    assert found[1:] == pytest.approx(between_ranks(np.sort(values), 0.95, 400), rel=1e-12)
    few = quantile_interval(values, np.full(400, 0.3), 0.95, unit=3.0)
    assert few[0] == found[0] and few[1] < found[1] and not few[2] < found[2]


def test_few_values_or_weights_give_no_upper_limit():
    """None of 20 values need be above the 95 % quantile, nor of 500 if one has all the weight."""
    values = np.arange(1.0, 501.0)
    assert np.isnan(quantile_interval(values[:20], np.ones(20), 0.95)[2])
    assert np.isfinite(quantile_interval(values, np.ones(500), 0.95)).all()
    heavy = np.where(values == 1, 1e6, 1e-6)
    assert np.isnan(quantile_interval(values, heavy, 0.95)[2])
    assert np.isnan(quantile_interval(values[:0], values[:0], 0.95)).all()


@pytest.mark.all
def test_intervals_hold_the_quantile():
    """Each limit is right in more than 96 % of 1,000 trials. Boulders have three weights; the few
    boulders with the highest weight have the highest values."""
    random, low_held, high_held, trials = np.random.default_rng(2), 0, 0, 1000
    weights = np.repeat([3.2, 0.5, 0.02], [100, 1000, 3000])
    scales = np.repeat([3.0, 1.0, 1.0], [100, 1000, 3000])
    shares = np.array([320.0, 500.0, 60.0]) / 880.0
    truth = brentq(lambda x: 0.95 - shares @ (1 - np.exp(-x / np.array([3.0, 1.0, 1.0]))), 0, 50)
    for _ in range(trials):
        _, low, high = quantile_interval(random.exponential(scales), weights, 0.95)
        low_held += low <= truth
        high_held += truth <= high
    assert low_held > 0.96 * trials and high_held > 0.96 * trials


# ---- cuts of roads


@pytest.mark.parametrize(
    ("length", "step", "edges"),
    [
        (100.0, 25.0, [0, 25, 50, 75, 100]),
        (110.0, 25.0, [0, 25, 50, 75, 110]),
        (115.0, 25.0, [0, 25, 50, 75, 100, 115]),
        (10.0, 25.0, [0, 10]),
        (110.0, None, [0, 110]),
    ],
)
def test_a_short_rest_belongs_to_the_piece_before_it(length, step, edges):
    assert edges_along(length, step).tolist() == edges


def test_strips_cover_the_road_in_its_bends():
    """Strips are cut at the corner, where straight ends would leave a wedge uncovered."""
    corner = shapely.LineString([(0, 0), (100, 0), (130, 90)])
    axes = [shapely.LineString(corner.coords[:2]), shapely.LineString(corner.coords[1:])]
    strips = strips_along(corner, axes, 8.0)
    whole = shapely.buffer(corner, 4.0, cap_style="flat")
    assert whole.difference(shapely.union_all(strips)).area < 1e-9 * whole.area
    bare = shapely.buffer(axes, 4.0, cap_style="flat")
    assert whole.difference(shapely.union_all(bare)).area > 1.0


@pytest.fixture
def read(tmp_path):
    """Function that reads a layer of roads and returns its segments and remarks."""
    scene = read_study(make_case(tmp_path), dem=Z, transform=GRID).scene

    def segments(*shapes, length=None, **columns):
        path = make_roads(tmp_path, *shapes, **columns)
        remarks = []
        return read_segments(File(path, None, "roads"), length, scene, remarks), remarks

    return segments


def test_chainage_goes_on_where_lines_meet(read):
    first, second = [(20, 200), (120, 200)], [(120, 200), (120, 250)]
    apart = [(200, 200), (260, 200)]
    lines = [shapely.LineString(one) for one in (first, second, apart)]
    found, remarks = read(*lines, length=50.0)
    assert found.start.tolist() == [0, 50, 100, 0] and found.end.tolist() == [50, 100, 150, 60]
    assert found.roads == ["roads 1"] * 3 + ["roads 2"] and remarks == []
    assert found.labels[2] == "roads 1, 100 to 150 m"
    _, unequal = read(*lines[:1], shapely.LineString([(120, 200), (120, 230)]))
    assert "segments are 30 to 100 m long" in unequal[0] and "--segment-length" in unequal[0]
    named, _ = read(*lines, name=["K 12", "K 12", "lane"])
    assert named.roads == ["K 12", "K 12", "lane"] and named.names == ["K 12", "K 12", "lane"]
    one_line, _ = read(shapely.MultiLineString([first, second]))
    assert one_line.end.tolist() == [150]


def test_chainage_may_be_an_attribute(tmp_path, read):
    lines = [shapely.LineString([(x, 200), (x + 60, 200)]) for x in (20, 200)]
    found, _ = read(*lines, length=30.0, name=["K", "K"], chainage=[1200.0, 1380.0])
    assert found.start.tolist() == [1200, 1230, 1380, 1410] and found.roads == ["K"] * 4
    where, rule = f"{tmp_path}/road.gpkg: feature 1: chainage = 5: ", "must be one line"
    with refused(f"{where}has 2 parts that are not connected: {rule}"):
        read(shapely.MultiLineString([one.coords for one in lines]), chainage=[5.0])


def test_what_lies_beyond_the_terrain_is_said(read):
    """There is no terrain west of x = 0: four segments are omitted, one is partly outside."""
    found, remarks = read(shapely.LineString([(-90, 200), (50, 200)]), length=20.0)
    assert found.start.tolist() == [80, 100, 120] and found.within.tolist() == [False, True, True]
    left, low = remarks
    assert left.endswith("road.gpkg: 4 of 7 segments lie outside the terrain and are left out")
    assert "1 of 3 segments extend beyond the terrain" in low and "too low" in low


def test_sources_on_the_road_are_said(read):
    """Sources are at (120, 380) and (180, 385); a boulder that stays there crosses no edge."""
    _, remarks = read(shapely.LineString([(60, 380), (150, 380)]))
    assert "1 sources are on the road" in remarks[0] and "too low" in remarks[0]
    assert read(shapely.LineString([(60, 300), (150, 300)]))[1] == []


def test_a_line_without_width_is_said(read):
    lines = [shapely.LineString([(x, 200), (x + 40, 200)]) for x in (20, 100)]
    assert "lines have no width" in read(*lines, width=np.nan)[1][0]
    found, remarks = read(shapely.LineString([(20, 200), (60, 200)]), width=None)
    assert found.width.tolist() == [0] and found.lines[0]["x"] == [20, 60]
    assert "lines have no width, so only boulders that touch the axis" in remarks[0]


# ---- study


def test_segments_change_nothing_else(tmp_path):
    case = make_case(tmp_path)
    house = make_layer(tmp_path / "o.gpkg", [shapely.box(140, 280, 155, 292)], CRS)
    bare = rockfall.hazard(case, dem=Z, transform=GRID, objects=house)
    found = hazard(case, make_roads(tmp_path, ROAD), objects=house)
    for name in bare.variables:
        assert np.array_equal(bare[name].values, found[name].values) or (
            bare[name].values.dtype.kind == "f"
            and np.array_equal(bare[name].values, found[name].values, equal_nan=True)
        ), name
    assert {name for name in found.dims if name not in bare.dims} == {"segment"}


def test_a_sample_of_sources_has_wider_limits(tmp_path):
    """With two sampled sources, limits are between those of independent boulders and those of two
    boulders."""
    release = {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0, "sources": "sample"}
    found = hazard(make_case(tmp_path, release=release), make_roads(tmp_path, ROAD), length=None)
    fraction = found.segment_passages.values.item() / BOULDERS
    few, many = (YEARLY * np.array(fraction_limits(fraction, n)) for n in (2, BOULDERS))
    low, high = (found[f"segment_frequency{end}"].values.item() for end in ("_low", "_high"))
    assert few[0] * (1 - 1e-9) <= low < many[0] < many[1] < high <= few[1] * (1 + 1e-9)
    assert np.isnan(found.segment_energy_q95_high.values.item())


def test_frames_are_roads_too(tmp_path):
    case = make_case(tmp_path)
    of_frame = hazard(case, make_frame([ROAD], CRS, width=[WIDTH]))
    of_file = hazard(case, make_roads(tmp_path, ROAD))
    assert (of_frame.segment_passages.values == of_file.segment_passages.values).all()
    with refused("segments = (GeoDataFrame): feature 1: width = -1.0: must be 0 to 100"):
        hazard(case, make_frame([ROAD], CRS, width=[-1.0]))


@pytest.mark.parametrize("length", [0.0, -5.0, np.nan, np.inf, 0.01, 0.999])
def test_a_length_must_be_one(tmp_path, length):
    with refused(f"--segment-length {length:g}: must be at least 1 m"):
        hazard(make_case(tmp_path), make_roads(tmp_path, ROAD), length=length)


def test_what_cannot_be_is_refused(tmp_path):
    case, road = make_case(tmp_path), make_roads(tmp_path, ROAD)
    with refused("--segment-length requires --segments"):
        hazard(case, None)
    with refused("--segments-layer requires --segments"):
        hazard(case, None, length=None, segments_layer="roads")
    hairpins = [(10.0 + 380.0 * (k % 2), 10.0 + 5.0 * k) for k in range(56)]
    long = make_layer(tmp_path / "long.gpkg", [shapely.LineString(hairpins)], CRS)
    with refused(f"{long}: gives 20,902 segments: must be at most 20,000: give a longer "
                 "--segment-length"):  # fmt: skip
        hazard(case, long, length=1.0)
    far = make_layer(tmp_path / "far.gpkg", [shapely.LineString([(900, 0), (990, 0)])], CRS)
    with refused(f"{far}: no segment lies on the terrain"):
        hazard(case, far)
    points = make_layer(tmp_path / "points.gpkg", [shapely.Point(100, 200)], CRS)
    with refused(f"{points}: feature 1: is a Point, but lines are required"):
        hazard(case, points)
    with refused("case: &output kept = 'none': objects with a width, lines, polygons and segments "
                 "of roads need the rows of all boulders: kept = 'all'"):  # fmt: skip
        hazard(case.replace(output={"kept": "none"}), road)
    many = tmp_path / "many.gpkg"
    for layer in ("a", "b"):
        make_layer(many, [ROAD], CRS, layer=layer)
    with refused(f"{many}: has 2 layers (a, b): choose one with --segments-layer"):
        hazard(case, many)


# ---- command


LINE = shapely.LineString([(600005, 4999905), (600110, 4999925)])


@pytest.fixture
def site(place):
    """Command for the hazard of a road, with its files in the current folder."""
    from slope_case import CASE

    Path("case.nml").write_text(CASE + "&scenario name = 'one', frequency = 0.5 /\n")
    make_layer("road.gpkg", [LINE], name=["K 12"], width=[6.0])
    return ["hazard", "case.nml", "--segments", "road.gpkg", "--segment-length", "25"]


@pytest.mark.all
def test_the_command_writes_a_layer_and_a_table(site, monkeypatch, capsys):
    pyogrio = pytest.importorskip("pyogrio", reason="the vector extra is not installed")
    figure = pytest.importorskip("matplotlib.figure", reason="the report extra is not installed")
    monkeypatch.setattr(
        "rockfall.cli.commands.hazard.hazard_sheet", lambda *_: figure.Figure((1, 1))
    )
    assert main([*site, "-o", "out"]) == 0
    said = capsys.readouterr().out
    assert "K 12, 0 to 25 m" in said
    assert "segments.csv" in said and Path("out", "segments.png").is_file()
    info = pyogrio.read_info("out/hazard.gpkg", layer="segments")
    head, *rows = Path("out/segments.csv").read_text().splitlines()
    assert [*info["fields"]] == head.split(",") and info["geometry_type"] == "LineString"
    assert info["features"] == len(rows) == 4
    _, _, wkb, (start, end) = pyogrio.raw.read(
        "out/hazard.gpkg", layer="segments", columns=["chainage_from", "chainage_to"]
    )
    assert shapely.length(shapely.from_wkb(wkb)) == pytest.approx(end - start)
    assert end[-1] == pytest.approx(LINE.length)
    style = pyogrio.raw.read("out/hazard.gpkg", layer="layer_styles", columns=["f_table_name"])
    assert "segments" in style[3][0]
    found = rockfall.hazard(rockfall.read_case("case.nml"), segments="road.gpkg", segment_length=25)
    assert len(shown_segments(found).rows) == 4


def test_results_without_the_lines_are_refused_with_what_to_do(site, capsys):
    assert main([*site, "--write-cases"]) == 0
    case = rockfall.read_case("case_scenario1.nml")
    assert [one["name"] for one in case.line][:2] == ["segment 1 part 1", "segment 2 part 2"]
    rockfall.write_result(rockfall.run(case), "with.nc")
    rockfall.write_result(rockfall.run(case.replace(line=[])), "without.nc")
    original = rockfall.read_case("case.nml")
    about = {"segments": "road.gpkg", "segment_length": 25}
    found = rockfall.hazard(original, results=["with.nc"], **about)
    assert found.equals(rockfall.hazard(original, **about))
    with refused("without.nc: scenario 'one': its &line groups do not match the given objects "
                 "and segments: write the cases with --write-cases"):  # fmt: skip
        rockfall.hazard(original, results=["without.nc"], **about)
    with refused("with.nc: scenario 'one': is the result of another case: see --write-cases"):
        rockfall.hazard(original.replace(case={"seed": 8}), results=["with.nc"], **about)
    assert json.loads(found.attrs["input_warnings"]) is not None
