# SPDX-License-Identifier: BSD-3-Clause
"""Silent witnesses: densities by hand, unreachable witnesses, and recovered truths."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import rockfall
from crossed import crossed
from made import make_layer, make_raster
from programs import refuses
from rockfall.analysis.observed.deposits import (
    Blocks,
    Kernel,
    Rest,
    at_rest,
    fitted_kernel,
    kernel_sums,
    kernel_widths,
    log_densities_of_own,
    log_density,
    witnesses,
)
from rockfall.analysis.observed.marks import (
    Heights,
    Mark,
    height_sums,
    log_reach,
    passing_at,
    with_lines_at,
)
from rockfall.analysis.observed.marks import log_density as log_height
from rockfall.analysis.observed.observations import CONTACT, read_observed
from rockfall.cli import main
from rockfall.errors import RockfallError
from rockfall.result.crossings import at_lines
from rockfall.result.trajectories import left_terrain
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from rockfall.studies.back import study
from rockfall.studies.back.contributions import contributions
from rockfall.studies.back.deposited import Deposited
from rockfall.studies.back.marked import Marked
from rockfall.studies.back.posterior import alone_table, posterior_table, warnings
from rockfall.studies.validation import comparable_numbers
from rockfall.tables.back import back_text
from rockfall.tables.comparison import comparison_text as as_text
from scenes import grid, make_case, sets

stats = pytest.importorskip("scipy.stats")
NY, NX = 100, 60
RELEASE = {"x": [100.0, 200.0], "y": [480.0, 480.0], "drop_height": 5.0}


def run_out_slope():
    """South-facing slope of 0.8 with bumps, which flattens to 0.05 in its lowest 200 m."""
    y, x = np.mgrid[NY - 1 : -1 : -1, 0:NX] * 5.0
    rough = np.random.default_rng(1).normal(0, 0.2, x.shape)
    bumps = 2 * np.sin(x / 25) + 2 * np.sin(y / 20)
    return 1000 + np.interp(y, [0, 200, 500], [0, 10, 250]) + bumps + rough


TERRAIN = run_out_slope()
HOW = {"dem": TERRAIN, "transform": grid(TERRAIN)}


def blocks_at(*places, source="", volume=np.nan):
    return Blocks(source, np.array(places, float), np.full(len(places), volume))


def scattered(n, seed=1, scale=50.0):
    random = np.random.default_rng(seed)
    return Rest(scale * random.standard_normal((n, 2)), np.exp(0.5 * random.standard_normal(n)))


# ---- density of boulders at rest


def test_the_density_of_two_boulders_is_that_of_hand():
    """Kernels are 10 m wide, half the distance between two boulders; a third boulder is spread over
    1 ha."""
    kernel = Kernel(1.0, 2, np.inf, 1e4, 5.0)
    rest = Rest(np.array([[0.0, 0.0], [20.0, 0.0]]), np.ones(2))
    sums = kernel_sums(kernel, blocks_at((0, 0), (500, 0)), rest)
    near = (1 + np.exp(-2.0)) / (2 * np.pi * 100)
    assert sums.near[0] == pytest.approx(near) and sums.boulders.tolist() == [2, 2]
    found = log_density(kernel, sums.near, sums.boulders)
    assert found == pytest.approx(np.log([(near + 1e-4) / 3, 1e-4 / 3]))


def test_the_density_has_the_weight_of_all_boulders():
    """The density integrates to N/(N + 1) for N boulders; the rest is spread over the area."""
    rest = scattered(60)
    kernel = fitted_kernel(blocks_at((0, 0)), rest, 5.0)
    x, y = np.meshgrid(np.arange(-600, 600, 4.0), np.arange(-600, 600, 4.0))
    sums = kernel_sums(kernel, blocks_at(*zip(x.ravel(), y.ravel(), strict=True)), rest)
    assert sums.near.sum() * 16 == pytest.approx(60, rel=2e-3)


def test_a_boulder_given_the_others_is_one_that_was_never_there():
    rest = scattered(40)
    kernel = Kernel(5.0, 40, 0.3, 1e4, 1.0)
    found = log_densities_of_own(kernel, rest, np.arange(40))
    for k in (0, 17, 39):
        others = rest.of(np.arange(40) != k)
        alone = Kernel(5.0, 39, 0.3, 1e4, 1.0)
        sums = kernel_sums(alone, Blocks("", rest.place[[k]], rest.volume[[k]]), others)
        assert found[k] == pytest.approx(log_density(alone, sums.near, sums.boulders)[0])


def test_kernels_are_as_wide_as_boulders_lie_apart_and_no_one_chooses_by_how_many():
    """Kernels are more than 20 times wider for scattered boulders than in a heap, and use more
    neighbours if boulders are scattered evenly than in strips."""
    heap = scattered(200, 2, 0.5).place + 300.0
    rest = Rest(np.concatenate([scattered(200).place, heap]), np.ones(400))
    widths = kernel_widths(fitted_kernel(blocks_at((0, 0)), rest, 0.01), rest)[0]
    assert np.median(widths[:200]) > 20 * np.median(widths[200:])
    smooth = fitted_kernel(blocks_at((0, 0)), scattered(400), 1.0).neighbours
    lines = scattered(400).place * [1, 0] + [0, 1] * np.repeat(np.arange(40), 10)[:, None] * 40.0
    striped = fitted_kernel(blocks_at((0, 0)), Rest(lines, np.ones(400)), 1.0).neighbours
    assert striped < smooth


def test_boulders_count_by_their_volume_where_that_of_the_block_is_known():
    rest = Rest(np.zeros((2, 2)), np.array([1.0, np.e]))
    kernel = Kernel(1.0, 2, 0.5, 1e4, 5.0)
    sums = kernel_sums(kernel, blocks_at((0, 0), volume=1.0), rest)
    assert sums.boulders[0] == pytest.approx(1 + np.exp(-2))
    assert kernel_sums(kernel, blocks_at((0, 0)), rest).boulders[0] == 2


def test_boulders_count_by_their_shape_where_that_of_the_block_is_known():
    """Boulders of other shapes than the block are ignored, unless its shape is unknown or the run
    has no shapes."""
    rest = Rest(np.array([[0.0, 0.0], [20.0, 0.0], [0.0, 30.0]]), np.ones(3), np.array([1, 3, 3]))
    blocks = blocks_at((0, 0), (0, 0), (0, 0))._replace(shape=np.array([1, 2, 0]))
    kernel = fitted_kernel(blocks, rest, 5.0)
    assert kernel.by_shape
    sums = kernel_sums(kernel, blocks, rest)
    assert sums.boulders.tolist() == [1, 0, 3] and sums.near[1] == 0
    assert sums.near[0] < sums.near[2]
    one_shape = Rest(rest.place, rest.volume)
    assert not fitted_kernel(blocks, one_shape, 5.0).by_shape
    assert kernel_sums(kernel, blocks, one_shape).boulders.tolist() == [3, 3, 3]


def test_a_boulder_given_the_others_of_its_shape_is_one_that_was_never_there():
    rest = scattered(40)._replace(shape=np.arange(40) % 3 + 1)
    kernel = Kernel(5.0, 40, np.inf, 1e4, 1.0, True)
    found = log_densities_of_own(kernel, rest, np.arange(40))
    others = rest.of(np.arange(40) != 7)
    own = Blocks("", rest.place[[7]], rest.volume[[7]], None, rest.shape[[7]])
    sums = kernel_sums(kernel._replace(boulders=39), own, others)
    assert found[7] == pytest.approx(log_density(kernel, sums.near, sums.boulders)[0])


def test_shapes_of_blocks_are_read_and_refused(tmp_path):
    path = tmp_path / "blocks.csv"
    path.write_text("x,y,block_shape\n1,2,platy\n3,4,\n")
    assert read_observed(path).shapes.tolist() == [3, 0]
    path.write_text("x,y,block_shape\n1,2,flat\n")
    with pytest.raises(RockfallError, match="block_shape = flat: must be one of: compact, elong"):
        read_observed(path)


# ---- its likelihood


def in_places(counts, apart=1e4):
    """Coordinates of boulders at places `apart` m from each other, with `counts` boulders at
    each."""
    return np.repeat(np.arange(len(counts)) * [[apart], [0.0]], counts, axis=1).T


def made(blocks, rest, worth=1.0):
    """Evidence from blocks, with kernels one cell wide, and its sums for boulders at rest."""
    kernel = Kernel(1.0, len(rest.place), np.inf, 1e9, 5.0)
    data = Deposited([blocks], [kernel], [np.full(len(blocks.place), 5.0)], worth=worth)
    sums = np.array(kernel_sums(kernel, blocks, rest))
    return data, np.concatenate([sums.ravel(), np.zeros(Deposited.AGAIN)])


@pytest.mark.parametrize(("worth", "near"), [(1.0, 0.02), (0.2, 0.2)])
def test_blocks_in_places_apart_have_the_dirichlet_multinomial_probability(worth, near):
    """The likelihood adds half of the other blocks to the boulders, which approximates the product
    of the Polya urn by a midpoint rule. The approximation is poor if the weighted number of
    boulders is below that of blocks."""
    seen, runs = [8, 6, 6], ([40, 30, 30], [70, 20, 10])
    blocks = blocks_at(*in_places(seen))
    kept = [made(blocks, Rest(in_places(run), np.ones(100)), worth) for run in runs]
    ours = kept[0][0].log_likelihood(np.array([one for _, one in kept]))
    theirs = [
        stats.dirichlet_multinomial.logpmf(seen, worth * np.array(run) + 1e-6, 20) for run in runs
    ]
    assert ours[0] - ours[1] == pytest.approx(theirs[0] - theirs[1], rel=near)


def test_blocks_outside_of_all_deposits_are_finite_and_said():
    rest = Rest(in_places([50, 50]), np.ones(100))
    data, kept = made(blocks_at((0, 0), (3e4, 7)), rest)
    assert np.isfinite(data.log_likelihood(kept[None])[0])
    (said,) = data.remarks(kept[None], np.ones(1))
    assert (
        said.startswith("2 blocks at rest: ") and "1 outside of all deposits (x y: 30000 7)" in said
    )
    farther, many = made(blocks_at((0, 0), (3e4, 7)), Rest(in_places([500, 500]), np.ones(1000)))
    lost = data.log_likelihood(kept[None])[0] - farther.log_likelihood(many[None])[0]
    assert lost == pytest.approx(np.log(10), abs=0.05)  # ten times more boulders: a tenth of it


def test_runs_that_differ_by_more_than_their_boulders_are_worth_less():
    random = np.random.default_rng(3)
    blocks = Blocks("", 30 * random.standard_normal((20, 2)), np.full(20, np.nan))
    for shift, low, high in ((0.0, 0.5, 1.0), (40.0, 0.0, 0.3)):
        base = Rest(50 * random.standard_normal((300, 2)), np.ones(300))
        kernel = fitted_kernel(blocks, base, 5.0)
        data = Deposited([blocks], [kernel], [np.full(20, 20.0)])
        runs = []
        for _ in range(60):
            place = 50 * random.standard_normal((300, 2)) + shift * random.standard_normal(2)
            sums = kernel_sums(kernel, blocks, Rest(place, np.ones(300)))
            runs.append(np.concatenate([np.array(sums).ravel(), np.zeros(Deposited.AGAIN)]))
        data.learn_noise(np.array(runs))
        assert low < data.worth <= high


# ---- marks


def at_line(heights, heading=(0.0, -1.0)):
    """Result with boulders at line "mark 1": their passing heights [m], NaN for no passage, and
    heading."""
    number, (east, north) = np.arange(1, len(heights) + 1), heading
    made = crossed(number, ["mark 1"], passing_height=heights, velocity_x=east, velocity_y=north)
    one = "boulder", np.ones(number.size)
    return xr.Dataset(made | {"volume": one, "mass": one}, {"boulder": number})


MARK = Mark("o.csv: line 2", 0.0, 0.0, 1.5, line="mark 1")


def test_the_side_of_a_mark_says_which_boulders_could_make_it():
    """Only boulders that move south can make a scar on the northern side. A mark without a side may
    be made by all."""
    result = at_line([1.0, np.nan, 2.0])
    for side, n in ((np.nan, 2), (0.0, 2), (340.0, 2), (180.0, 0)):
        assert passing_at(result, replace(MARK, side=side)).heights.size == n


@pytest.mark.parametrize("hits", [1, 3])
def test_heights_of_marks_have_a_density(hits):
    """The densities of one hit, and of the highest of three, integrate to 1."""
    heights, kernel = np.array([2.0, 3.0, 3.2, 5.0]), Heights(0.3, 10.0)
    steps = np.arange(0.005, 10, 0.01)
    found = []
    for height in steps:
        near, _, below = (np.array(one) for one in height_sums(kernel, height, heights))
        mark = replace(MARK, height=height, hits=hits)
        found.append(np.exp(log_height(near, below, np.array(4.0), mark, kernel.top)))
    assert sum(found) * 0.01 == pytest.approx(1, rel=1e-3)


def test_where_no_boulder_comes_a_mark_is_less_likely_and_never_impossible():
    good, none, wrong = ([1.4, 1.6] * 10, [np.nan] * 20, [6.0, 7.0] * 10)
    data = Marked.of_run([MARK], at_line(good))
    runs = np.array([data.kept(at_line(one)) for one in (good, none, wrong)])
    found = data.log_likelihood(runs)
    assert found[0] > found[1] > found[2] and np.isfinite(found).all()
    assert log_reach(np.zeros(1), 20)[0] == pytest.approx(np.log(1 - (1 - 0.5 / 21) ** 20))
    said = data.remarks(runs[1:2], np.ones(1))
    assert said[1].endswith("fewer than 20 boulders of a run pass, so they hardly constrain the "
                            "height: o.csv: line 2.")  # fmt: skip


# ---- contributions


def normal_sets(apart):
    """Points from a normal prior of one parameter, and log-likelihoods of two data sets at -`apart`
    and `apart`."""
    points = np.random.default_rng(4).standard_normal((400, 1))
    return points, np.array([-((points[:, 0] - c) ** 2) / (2 * 0.3**2) for c in (-apart, apart)])


@pytest.mark.parametrize(("apart", "verdict"), [(0.1, "agrees"), (0.8, "conflict")])
def test_sets_of_data_that_pull_apart_are_in_conflict(apart, verdict):
    points, values = normal_sets(apart)
    weight = np.exp(values.sum(axis=0) - values.sum(axis=0).max())
    ahead, levels = np.zeros(len(points)), np.zeros(1, int)
    found = contributions(points, levels, ahead, weight / weight.sum(), values)
    assert [one.verdict for one in found] == [verdict] * 2
    assert all(one.alone.sum() == pytest.approx(1) for one in found)


# ---- files and refusals


def test_blocks_and_marks_are_read_from_tables_and_layers(tmp_path, monkeypatch):
    shapely = pytest.importorskip("shapely")
    monkeypatch.chdir(tmp_path)
    where = grid(TERRAIN)
    Path("o.csv").write_text("x,y,source,volume,note\n1,2,wall,0.5,a\n3,4,,,b\n")
    make_layer("o.gpkg", shapely.points([[5, 6], [7, 8]]), crs="EPSG:32632",
               Source=["cliff", None], VOLUME=[2.0, None])  # fmt: skip
    make_layer("marks.gpkg", shapely.points([[9, 10]]), impact=[7], height=[1.5], dbh=[40])
    seen = read_observed("o.csv", "o.gpkg", "marks.gpkg", grid=where)
    assert seen.stops.tolist() == [[1, 2], [3, 4], [5, 6], [7, 8]]
    assert seen.sources == ("wall", "", "cliff", "")
    assert seen.volumes[[0, 2]].tolist() == [0.5, 2.0] and np.isnan(seen.volumes[[1, 3]]).all()
    assert seen.contacts[["x", "y", "height", "dbh"]].values.tolist() == [[9, 10, 1.5, 40]]
    assert seen.where["stops"] == (
        "o.csv: line 2", "o.csv: line 3", "o.gpkg: feature 1", "o.gpkg: feature 2"
    )  # fmt: skip
    with pytest.raises(
        RockfallError,
        match=(
            r"o.gpkg: layers can only be read by compare, back "
            r"and"
        ),
    ):
        read_observed("o.gpkg")


CASE = """&case title = 'Slope', boulders = 30, seed = 7, threads = 1 /
&terrain dem = 'dem.tif' /
&surface uniform_mean_radius = 0.25 /
&impact sets = 'laboratory-spheres' /
&boulder volume = 'fixed', volume_mean = 0.8, density = 2800.0 /
&release x = 600100.0, 600200.0, y = 4999980.0, 4999980.0, drop_height = 2.0 /
&ensemble runs = 8, radius_factor = 1.5 /
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study, "ROUND", 16)
    z = TERRAIN.astype("f4")
    z[60:70, :4] = -9999
    make_raster("dem.tif", z, nodata=-9999)
    Path("case.nml").write_text(CASE)


HOSTILE = {
    "x,y\n600100,4999800\n599000,4999800\n": r"seen.csv: line 3: x = 599000, y = 4999800: lies "
    r"outside the terrain, x 600000 to 600300, y 4999500 to 5000000",
    "x,y\n600005,4999680\n": "seen.csv: line 2: x = 600005, y = 4999680: the terrain has no "
    "elevation there",
    "impact,x,y,height\n1,600100,5001000,2\n": "seen.csv: line 2: x = 600100, y = 5001000: lies "
    "outside the terrain, .*",
    "x,y,source\n600100,4999800,3\n": "seen.csv: line 2: source = 3: not a source of the run, "
    "sources: 1, 2",
    "x,y,volume\n600100,4999800,0\n": r"seen.csv: line 2: volume = 0: must be > 0 \[m3\], or empty",
    "impact,x,y,height,side\n1,600100,4999800,2,400\n": "seen.csv: line 2: side = 400: must be a "
    "number >= 0 and <= 360",
    "impact,x,y,height,hits\n1,600100,4999800,2,1.5\n": "seen.csv: line 2: hits = 1.5: must be an "
    "integer",
}


@pytest.mark.parametrize("text", HOSTILE)
def test_a_witness_that_cannot_be_is_one_line(place, capfd, text):
    Path("seen.csv").write_text(text)
    refuses(["back", "case.nml", "seen.csv"], HOSTILE[text], capfd)


@pytest.mark.all
def test_a_layer_of_blocks_in_another_crs_goes_through_the_commands(place, capsys):
    shapely = pytest.importorskip("shapely")
    pyproj = pytest.importorskip("pyproj")
    way = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    lon, lat = way.transform([600100.0, 600150.0, 600200.0], [4999700.0, 4999650.0, 4999690.0])
    make_layer("seen.gpkg", shapely.points(lon, lat), crs="EPSG:4326", source=["1", "2", "2"])
    rest = ["seen.gpkg", "--members", "32", "--effective", "2", "-o", "out"]
    assert main(["back", "case.nml", *rest]) == 0
    printed = capsys.readouterr().out
    assert "blocks at rest" in printed and "reprojected from EPSG:4326" in printed
    assert "data" in Path("out/by_data.csv").read_text().partition("\n")[0]
    for boulders, said in ((30, "fewer than 40 of its boulders"), (60, "outside of all")):
        few = rockfall.read_case("case.nml").replace(case={"boulders": boulders})
        rockfall.write_result(rockfall.run(few.replace(output={"maps": "passages"})), "result.nc")
        assert main(["compare", "result.nc", "seen.gpkg"]) == 0
        assert said in capsys.readouterr().out
        Path("result.nc").unlink()


# ---- truths


def test_marks_of_a_case_with_lines_and_barriers_have_lines_of_their_own(tmp_path):
    """Lines are as wide as trunk and boulder where many boulders pass, longer where few do, and run
    across the slope. The case's line and barrier remain."""
    line = [{"name": "mark 1", "x": [0.0, 300.0], "y": [330.0, 330.0]}]
    barrier = [{"name": "net", "x": [0.0, 300.0], "y": [300.0, 300.0], "height": 4.0, "class": 3}]
    read = read_scene(case(tmp_path, 200, 3, line=line).replace(barrier=barrier), **HOW)
    marks = [Mark("near", 100.0, 470.0, 1.0, 0.4), Mark("far", 290.0, 200.0, 1.0, 0.4)]
    scene, named = with_lines_at(read, marks)
    assert [one.line for one in named] == ["mark 1'", "mark 2"]
    assert [one["name"] for one in scene.case.lines] == ["mark 1", "mark 1'", "mark 2", "net"]
    wide = 2 * np.cbrt(0.75 / np.pi * 0.8)
    for one, extra, centre in zip(scene.case.line[1:], (0.4, 10.0), ([100, 470], [290, 200]),
                                  strict=True):  # fmt: skip
        x, y = np.array(one["x"]), np.array(one["y"])
        assert np.hypot(np.ptp(x), np.ptp(y)) == pytest.approx(wide + extra, rel=0.02)
        assert [x.mean(), y.mean()] == pytest.approx(centre)
    assert abs(np.diff(scene.case.line[1]["y"])[0]) < 0.3 * wide
    passed = [passing_at(run_scene(scene), one).heights.size for one in named]
    assert passed[0] >= 50 > passed[1]


def case(folder, boulders, seed, **groups):
    run = {"boulders": boulders, "threads": 1, "seed": seed}
    usual = {
        "boulder": {"volume": "normal", "volume_std": 0.2},
        "impact": {"sets": "laboratory-spheres", "ratio": "nearest"},
    }
    groups = usual | groups
    return make_case(folder, *sets(), terrain={}, release=RELEASE, case=run, **groups)


def witnessed(result, marks=15):
    """Observations from a result: blocks at rest, every second with its source, and marks at its
    line."""
    rest = np.flatnonzero(~left_terrain(result))
    stops = np.column_stack([result["stop_x"], result["stop_y"]])[rest]
    source = result["source"].values[rest].astype(str)
    source[::2] = ""
    heights = at_lines(result)["line_passing_height"].values[0]
    some = np.flatnonzero(np.isfinite(heights))[:marks]
    place = {axis: at_lines(result)[f"line_{axis}"].values[0][some] for axis in "xy"}
    rows = pd.DataFrame(place | {"height": heights[some]}).reindex(columns=list(CONTACT))
    where = {"stops": tuple(f"block {k}" for k in range(len(stops))),
             "contacts": tuple(f"tree {k}" for k in range(len(some)))}  # fmt: skip
    about = {"volumes": result["volume"].values[rest], "contacts": rows.assign(dbh=40.0)}
    return replace(read_observed(), stops=stops, sources=tuple(source), where=where, **about)


LINE = {"name": "trees", "x": [0.0, 300.0], "y": [330.0, 330.0]}


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """Folder, and a run with rocks of 0.2 m in it."""
    folder = tmp_path_factory.mktemp("witnesses")
    rocks = {"uniform_mean_radius": 0.2}
    return folder, rockfall.run(case(folder, 20, 77, line=[LINE], surface=rocks), **HOW)


@pytest.fixture(scope="module")
def found(truth):
    """Back-analysis of rocks of 0.2 m, with a prior median of 0.1 m, a factor of 2, and another
    seed."""
    folder, result = truth
    prior = {"surface": {"uniform_mean_radius": 0.1}, "ensemble": {"radius_factor": 2.0}}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "ROUND", 32)
        of = case(folder, 120, 5, **prior)
        return study.back_analysis(of, witnessed(result), members=96, enough=30, **HOW)


@pytest.mark.all
def test_the_rocks_are_found_by_blocks_whose_release_is_not_known(found):
    (rocks,) = posterior_table(found).to_dict("records")
    assert rocks["q05"] < 0.2 < rocks["q95"]
    assert rocks["verdict"] == "informed" and rocks["ratio"] < 0.7 and rocks["prior_median"] == 0.1
    assert found.data["data"].tolist() == ["blocks at rest", "marks"]
    assert found.data["n"].tolist()[1:] == [15] and found.data["counts"].tolist() == [1, 1]
    assert not any("does not explain" in one for one in warnings(found))


@pytest.mark.all
def test_each_kind_says_what_it_tells_alone_and_what_it_loses(found):
    table = alone_table(found)
    assert table["data"].tolist() == ["blocks at rest", "marks"]
    rest, marks = (table.iloc[k] for k in (0, 1))
    assert rest["ratio"] < marks["ratio"] < 0.7 and marks["q05"] < 0.2 < marks["q95"]
    assert "conflict" not in set(found.data["agreement"])
    assert (found.data["loss_error"] > 0).all()
    text = back_text(found)
    assert "lost with the" in text and "alone: median (5 to 95 %)" in text


def test_compare_and_validate_set_blocks_beside_the_density_of_a_run(truth, capsys):
    """Blocks agree with the density of boulders for the true rocks, and differ for smaller
    rocks."""
    folder, result = truth
    seen = replace(witnessed(result, 0), contacts=None)
    sizes = {0.2: None, 0.05: None}
    for size in sizes:
        run = rockfall.run(case(folder, 300, 8, surface={"uniform_mean_radius": size}), **HOW)
        sizes[size] = rockfall.compare(run, seen), comparable_numbers([(run, seen)])
    (good, in_good), (bad, in_bad) = sizes[0.2], sizes[0.05]
    assert good.at_rest["source"].tolist() == ["1", "2", "all"]
    assert good.at_rest["n_observed"].sum() == len(seen.stops)
    assert (good.at_rest["verdict"] == "undecided").all()
    assert (bad.at_rest["verdict"] == "differs").any()
    assert "[1/ha]" in as_text(good)
    key = ("", "at_rest", "log_density")
    assert (
        in_good[key].n == len(seen.stops) and in_good[key].simulated > in_bad[key].simulated + 0.5
    )


def test_only_boulders_in_the_area_that_was_walked_count(truth, tmp_path, monkeypatch):
    """Only boulders that stop in the mapped area, y >= 150 m, are used. Blocks outside it are
    refused, and so is an area off the terrain or a second area."""
    shapely = pytest.importorskip("shapely")
    monkeypatch.chdir(tmp_path)
    _, result = truth
    make_layer("walked.gpkg", [shapely.box(0, 150, 300, 500)])
    walked = read_observed("walked.gpkg", grid=grid(TERRAIN))
    assert "walked.gpkg: is the area in which blocks at rest were mapped." in walked.notes
    all_seen = witnessed(result)
    with pytest.raises(RockfallError, match=r"block \d+: .*: is outside the area"):
        witnesses(result, replace(all_seen, area=walked.area))
    inside = all_seen.stops[:, 1] >= 150
    seen = replace(
        all_seen, stops=all_seen.stops[inside], sources=("",) * inside.sum(), area=walked.area,
        volumes=None,
    )  # fmt: skip
    (blocks,) = witnesses(result, seen)
    rest = at_rest(result, blocks)
    assert rest.place[:, 1].min() >= 150 and len(rest.place) == inside.sum() < inside.size
    make_layer("away.gpkg", [shapely.box(900, 150, 950, 500)])
    with pytest.raises(RockfallError, match=r"^away.gpkg: lies outside the terrain$"):
        read_observed("away.gpkg", grid=grid(TERRAIN))
    with pytest.raises(RockfallError, match=r"^o.gpkg: is a second layer of polygons"):
        make_layer("o.gpkg", [shapely.box(0, 150, 300, 500)])
        read_observed("walked.gpkg", "o.gpkg", grid=grid(TERRAIN))


def test_blocks_of_a_source_are_set_beside_its_boulders_only(truth):
    _, result = truth
    sets_ = {one.source: one for one in witnesses(result, witnessed(result))}
    assert [*sets_] == ["1", "2", ""]
    one = Deposited.of_run([sets_["1"]], result, 5.0)
    moved = result.copy(deep=True)
    other = result["source"].values == 2
    moved["stop_x"].values[other] += 70.0
    assert np.array_equal(one.kept(result), one.kept(moved))
    every = Deposited.of_run([sets_[""]], result, 5.0)
    assert not np.array_equal(every.kept(result), every.kept(moved))
