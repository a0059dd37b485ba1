# SPDX-License-Identifier: BSD-3-Clause
"""Sources from layers and tables: positions, attributes, distribution of boulders, and
identification in results."""

from dataclasses import replace

import numpy as np
import pytest

import rockfall
from made import make_layer
from programs import find_program, make_full_case, refuses, run_program, same_results
from rockfall.analysis.observed.compare import compare
from rockfall.analysis.observed.observations import read_observed
from rockfall.cli import main
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.scene.releases.source_attributes import values_of
from rockfall.scene.rules.plausible import input_warnings
from rockfall.simulation.simulate import run_scene
from rockfall.studies.back.evidence import evidence
from rockfall.studies.ensemble.study import run_ensemble
from rockfall.studies.ensemble.uncertain_inputs import Uncertain, drawn_scene
from rockfall.studies.hazard import read_study

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
pytestmark = pytest.mark.filterwarnings("ignore:.*lies entirely outside the terrain")

W, N = 600000.0, 5000000.0
X, Y = np.array([120.0, 130.0, 140.0, 180.0]) + W, np.full(4, N - 20.0)
POINTS = [shapely.Point(*xy) for xy in zip(X, Y, strict=True)]
#: Attributes of each point.
ABOUT = {
    "name": ["left", "left", "tower", None], "volume": ["lognormal", None, None, None],
    "volume_mean": [1.5, None, 2.0, None], "volume_std": [0.3, None, None, None],
    "volume_class": [None, "0.5-1.5", None, None],
    "density": [2600.0, None, 2500.0, None], "drop_height": [1.0, 9.0, None, 0.0],
    "velocity_x": [None, None, None, 2.0], "velocity_y": [None, None, None, -3.0],
    "remark": ["a", "b", "c", "d"],
}  # fmt: skip
CLIFFS = [
    shapely.box(W + 50, N - 40, W + 80, N - 20),
    shapely.box(W + 100, N - 45, W + 115, N - 20),
]


@pytest.fixture
def case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    output = {"maps": ["passages", "sources"], "rebounds": False, "trajectories": 10}
    return make_full_case(tmp_path, case={"boulders": 20}, output=output)


def at(case, file="p.gpkg", **release):
    kind = "polygons" if file.startswith("cliff") else "points"
    return case.replace(release={"x": None, "y": None, kind: file, **release})


def total(case, n):
    return case.replace(case={"boulders": None, "boulders_total": n})


def only(result):
    """Result without variables and attributes that identify its sources."""
    names = [
        name
        for name in ("source_feature", "feature", "feature_name", "mass")
        if name in result.variables
    ]
    attrs = {"input_checksums": "", "source_features": "", "decoded_checksums": ""}
    return result.drop_vars(names).assign_attrs(attrs)


def csv(path, **columns):
    names = ["x", "y", *columns]
    rows = zip(X, Y, *columns.values(), strict=True)
    lines = [",".join("" if v is None else str(v) for v in row) for row in rows]
    path.write_text("\n".join([",".join(names), *lines]) + "\n")


@pytest.mark.family(2)
@pytest.mark.parametrize("name", ["p.gpkg", "p.shp", "p.geojson", "p.csv", "q.gpkg"])
def test_points_of_layers_give_the_bits_of_typed_ones(case, name):
    if name == "p.csv":
        csv(case.folder / name)
    elif name == "q.gpkg":
        make_layer(name, [shapely.MultiPoint(POINTS[:3]), POINTS[3]], layer="a")
        make_layer(name, CLIFFS, layer="b")
    else:
        make_layer(name, POINTS)
    layer = {"points_layer": "a"} if name == "q.gpkg" else {}
    one, other = rockfall.run(case), rockfall.run(at(case, name, **layer))
    same_results(only(other), only(one))
    assert other["source"].values.tolist() == np.repeat([1, 2, 3, 4], 20).tolist()
    assert np.array_equal(other["source_feature"], other["source"])


def test_a_reprojected_layer_is_its_own_within_a_millimetre_and_the_result_says_so(case, capsys):
    import pyproj

    to = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:25833", always_xy=True)
    make_layer("p.gpkg", [shapely.Point(*to.transform(*xy)) for xy in zip(X, Y, strict=True)],
               "EPSG:25833")  # fmt: skip
    scene = read_scene(at(case))
    assert np.hypot(scene.x - X, scene.y - Y).max() < 1e-3
    (case.folder / "case.nml").write_text(at(case).text())
    assert main(["run", "case.nml", "-o", "out.nc", "--quiet"]) == 0
    said = "reprojected from EPSG:25833 to EPSG:32632"
    assert capsys.readouterr().err.count(said) == 1
    assert f", {said}" in rockfall.read_result("out.nc").attrs["input_checksums"]


@pytest.mark.parametrize("has_frequency", [True, False])
def test_polygons_that_release_nothing_are_named(case, has_frequency):
    """The first polygon lies between cell centres, the second off the terrain, and the third in
    another polygon."""
    narrow = shapely.box(W + 10.1, N - 40, W + 10.2, N - 20)
    away, covered = shapely.box(W - 50, N - 40, W - 20, N - 20), CLIFFS[0].buffer(-8.0)
    about = {"name": ["narrow", "away", None, "cliff", "tower"]}
    if has_frequency:
        about["frequency"] = [3.0, 1.0, 4.0, 1.0, 1.0]
    make_layer("cliffs.gpkg", [narrow, away, covered, *CLIFFS], **about)
    scene = read_scene(total(at(case, "cliffs.gpkg"), 50))
    texts = [text for _, text in input_warnings(scene)]
    said = "3 of 5 polygons or parts (narrow; away; 3) have no source cell and release nothing: "
    assert sum(text.startswith(said) for text in texts) == 1, texts
    lost = "polygons without a source cell have 80.0 % of the total frequency"
    assert sum(text.startswith(lost) for text in texts) == has_frequency
    make_layer("cliffs2.gpkg", CLIFFS)
    texts = [text for _, text in input_warnings(read_scene(at(case, "cliffs2.gpkg")))]
    assert not any("release nothing" in text for text in texts)


def test_attributes_are_those_of_the_feature_or_else_of_the_case(case):
    make_layer("p.gpkg", POINTS, **ABOUT)
    case = at(case.replace(case={"boulders": 2000}, output={"maps": None, "trajectories": 0}))
    result = rockfall.run(case)
    volume = result["volume"].values.reshape(4, -1)
    mean, std = [1.5, 1.0, 2.0, 0.8], [0.3, 1 / np.sqrt(12), 0.2, 0.2]
    error = np.array(std) / np.sqrt(volume.shape[1])
    assert (abs(volume.mean(axis=1) - mean) < 4 * error).all()
    assert np.allclose(volume.std(axis=1), std, rtol=0.15)
    assert 0.5 < volume[1].min() < 0.51 and 1.49 < volume[1].max() < 1.5
    ground = case.replace(
        release={"points": None, "x": X, "y": Y, "drop_height": 0.0}, case={"boulders": 1}
    )
    with pytest.warns(UserWarning, match="boulders rest at the source where"):
        heights = result["start_z"].values[::2000] - rockfall.run(ground)["start_z"].values
    assert np.allclose(heights, [1.0, 9.0, 5.0, 0.0])
    assert result["feature_name"].values.tolist() == ["left", "left", "tower", "4"]
    densities = (result["mass"] / result["volume"]).values.reshape(4, -1)
    assert np.allclose(densities.T, [2600, 2800, 2500, 2800], rtol=1e-15)
    assert values_of(case, read_scene(case).features).tolist() == [
        [2600, 1, 0, 0, 0], [2800, 9, 0, 0, 0], [2500, 5, 0, 0, 0], [2800, 0, 2, -3, 0],
    ]  # fmt: skip


def test_one_law_for_all_features_is_that_of_the_case(case):
    """Equal attributes of all points give the boulders of a case with these values, bit for bit."""
    said = {"volume": ["normal"] * 4, "volume_mean": [1.5] * 4, "volume_std": [0.3] * 4}
    make_layer("p.gpkg", POINTS, density=[2500.0] * 4, drop_height=[3.0] * 4, **said)
    law = {"volume": "normal", "volume_mean": 1.5, "volume_std": 0.3, "density": 2500.0}
    of_case = case.replace(boulder=law, release={"drop_height": 3.0})
    one, other = only(rockfall.run(of_case)), only(rockfall.run(at(case)))
    same_results(other, one)
    source = dict.fromkeys(("volume_mean", "volume_std")) | {"volume": "source"}
    again = only(rockfall.run(at(case).replace(boulder=source)))
    same_results(again, other)


@pytest.mark.all
def test_both_programs_and_parts_know_the_sources(case):
    if not find_program():
        pytest.skip("no rockfall-batch")
    frequency = [0.5, 0.5, 2.0, 1.0]
    make_layer("p.gpkg", POINTS, frequency=frequency, **ABOUT)
    make_layer("cliff.gpkg", CLIFFS, name=["west", "east"], drop_height=[4.0, 7.0])
    for scene in total(at(case), 203), total(at(case, "cliff.gpkg", by_area=True), 203):
        whole = rockfall.run(scene)
        parts = [rockfall.run(scene, shard=(k, 3), threads=2) for k in (3, 1, 2)]
        same_results(rockfall.merge(parts), whole)
        prepare(scene, "ready")
        done = run_program(
            "ready/case.nml", "--output", "part.nc", "--quiet", "--overwrite", cwd="."
        )
        assert done.returncode == 0, done.stderr
        same_results(rockfall.merge(["part.nc"]), whole)
    assert set(whole["source_feature"].values) == {1, 2}
    assert whole["feature_name"].values.tolist() == ["west", "east"]
    rockfall.write_result(whole, "out.nc")
    assert rockfall.read_result("out.nc")["feature_name"].values.tolist() == ["west", "east"]


def test_a_cell_is_of_the_later_polygon_and_results_say_which(case):
    make_layer(
        "cliff.gpkg", [*CLIFFS, shapely.box(W + 65, N - 40, W + 80, N)], name=["a", "b", "c"]
    )
    result = rockfall.run(at(case, "cliff.gpkg"))
    places = zip(result["start_x"].values - W, result["source_feature"].values, strict=True)
    assert all(k == (1 if x < 65 else 3 if x < 80 else 2) for x, k in places)


def released(scene):
    return np.array([len(scene.numbers_of(k)) for k in range(scene.x.size)])


@pytest.mark.family(2)
@pytest.mark.parametrize("n", [1, 3, 4, 10, 80, 203])
def test_a_total_is_shared_evenly_or_by_frequency(case, n):
    each = released(read_scene(total(case, n)))
    assert each.sum() == n and np.ptp(each) <= 1
    frequency = np.array([1.0, 2.0, 3.0, 0.1])
    make_layer("p.gpkg", POINTS, frequency=frequency.tolist())
    each = released(read_scene(total(at(case), n)))
    assert each.sum() == n
    assert (abs(np.cumsum(each) - n * np.cumsum(frequency) / frequency.sum()) < 1).all()


def test_a_total_that_each_source_divides_is_the_number_from_each(case):
    one, other = (only(rockfall.run(of)) for of in (case, total(case, 80)))
    same_results(other.assign_attrs(case=""), one.assign_attrs(case=""))


def test_a_polygon_shares_its_frequency_among_its_cells_by_area_if_asked(case):
    make_layer("cliff.gpkg", CLIFFS, frequency=[3.0, 1.0])
    for by_area in False, True:
        scene = read_scene(total(at(case, "cliff.gpkg", by_area=by_area), 10_000))
        of = np.bincount(scene.features.number, released(scene))[1:]
        assert np.allclose(of, [7500, 2500], atol=scene.x.size)
        west = released(scene)[scene.features.number == 1]
        assert (np.ptp(west) > 1) == by_area
    with pytest.warns(UserWarning, match="frequency is not used with &case boulders"):
        rockfall.run(at(case.replace(case={"boulders": 1}), "cliff.gpkg"))


@pytest.mark.all
def test_check_and_options_say_which_number_is_meant(case, capsys):
    (case.folder / "case.nml").write_text(case.replace(line=[]).text())
    assert main(["check", "case.nml"]) == 0
    assert "80, 20 from each source; sources: 4 (points)" in capsys.readouterr().out
    words = ["--boulders-total", "10", "-o", "out.nc", "--quiet"]
    assert main(["run", "case.nml", *words]) == 0
    (case.folder / "again.nml").write_text(rockfall.read_result("out.nc").attrs["case"])
    assert main(["check", "again.nml"]) == 0
    said = "10 from all sources together, 2 to 3 from each; sources: 4 (points)"
    assert said in capsys.readouterr().out
    words = ["--boulders", "7", "-o", "new.nc", "--quiet"]
    assert main(["run", "again.nml", *words]) == 0
    assert rockfall.read_result("new.nc").sizes["boulder"] == 28
    if find_program():
        prepare(total(case.replace(line=[]), 10), "ready")
        words = ("--boulders", "5", "--output", "p.nc", "--quiet")
        assert run_program("ready/case.nml", *words, cwd=".").returncode == 0
        assert rockfall.merge(["p.nc"]).sizes["boulder"] == 20


@pytest.mark.all
def test_a_hundred_thousand_points(case):
    n = 100_000
    x, y = np.random.default_rng(1).uniform(20, 280, (2, n))
    shapes, volume = shapely.points(W + x, N - 10 - y / 4), np.linspace(0.1, 9.0, n)
    make_layer("p.fgb", list(shapes), volume=volume, name=[f"block {k}" for k in range(n)])
    scene = read_scene(at(case, "p.fgb").replace(case={"boulders": 1}))
    assert scene.boulders == n and np.unique(scene.features.value[:, 0]).size == n
    assert np.array_equal(np.sort(scene.x), np.sort(W + x))  # FlatGeobuf changes the order


def test_many_names_are_kept(case):
    """Names of 8,000 features are more than an attribute of netCDF-4 can have (64 KiB)."""
    n = 8000
    make_layer("p.gpkg", POINTS[:1] * n, name=[f"block number {k}" for k in range(n)])
    case = at(case).replace(case={"boulders": 1}, output={"maps": None}, impact={"impact_limit": 1})
    rockfall.write_result(rockfall.run(case), "out.nc")
    assert rockfall.read_result("out.nc")["feature_name"].values[-1] == f"block number {n - 1}"


def refused_cases():
    def points(file="p.gpkg", **columns):
        path = f"{len(points.made)}{file}"
        points.made.append(path)
        make_layer(path, POINTS[: len(next(iter(columns.values()), POINTS))], **columns)
        return path

    points.made = []
    where = r"\d+p.gpkg: feature 2: "
    for columns, message in (
        ({"drop_height": [1.0, -2.0]}, r"drop_height = -2: must be >= 0 \[m\]"),
        ({"density": ["2600", "heavy"]}, "density = '2600': must be a number"),
        ({"volume_mean": [1.0, 0.0]}, r"volume_mean = 0: must be > 0 \[m3\]"),
        ({"volume": [1.0, -1.0]}, r"volume = -1.0: must be > 0 \[m3\]"),
        ({"volume": ["fixed", "large"]}, "volume = 'large': must be a number .*"),
        ({"volume_class": ["1-2", "2-1"]}, "&boulder volume_max = 1.0: must not be below .*"),
        ({"volume_class": ["1-2", "big"]}, r"volume_class = 'big': must be MIN-MAX \[m3\]"),
        ({"volume": [None, "normal"]}, "&boulder volume_mean is missing: needed for .*"),
        ({"volume": [None, "normal"], "volume_min": [None, 1.0]}, "&boulder volume_.*"),
        ({"volume": ["normal"] * 2, "volume_mean": [0.8, 0.8], "volume_std": [0.1, 15.0]},
         "&boulder volume_std = 15.0: must be at most 5 times volume_mean: .*"),
        ({"frequency": [1.0, None]}, "has no frequency: all sources or none must have a frequency"),
        ({"frequency": [1.0, 0.0]}, "frequency = 0: must be > 0 .*"),
        ({"drop_height": [1.0, np.inf]}, "drop_height = inf: must be at most 1e12 .*"),
    ):  # fmt: skip
        at_feature = where.replace("2: ", "1: ") if "density" in columns else where
        yield {"points": points(**columns)}, at_feature + message
    many = points(velocity=[1.0, 2.0])
    yield {"points": many}, r".*attribute velocity: must be velocity_x, velocity_y, velocity_z .*"
    plain = points()
    yield (
        {"points": plain, "name_field": "id"},
        rf"{plain}: attribute id is missing \(attributes: none\)",
    )
    yield {"points": plain, "points_layer": "b"}, rf"{plain}: no layer b \(layers: .*\)"
    yield {"points": plain, "polygons": plain}, "case.nml: &release: give one of: points .*"
    yield (
        {"points": plain, "by_area": True},
        ".*&release by_area = .true.: is not valid for points",
    )
    yield {"polygons": plain}, f"{plain}: feature 1: is a Point, but polygons are required"
    yield {"points": "none.gpkg"}, "case.nml: &release points = 'none.gpkg': no such file"
    make_layer("mixed.gpkg", [POINTS[0], CLIFFS[0]])
    yield {"points": "mixed.gpkg"}, "mixed.gpkg: feature 2: is a Polygon, but points are required"
    make_layer("empty.gpkg", [])
    yield {"points": "empty.gpkg"}, "empty.gpkg: the layer is empty: must contain points"
    make_layer("off.gpkg", [shapely.Point(W - 9, N)])
    yield {"points": "off.gpkg"}, ".*source 1 .* lies outside the terrain .*"
    with open("a.csv", "w") as file:
        file.write("x,y,drop_height\n600120,4999980,1\n600130,4999980,high\n")
    yield {"points": "a.csv"}, "a.csv: line 3: drop_height = 'high': must be a number"
    yield {"points": "a.csv", "points_layer": "b"}, ".*points_layer: is not valid for a table"
    with open("b.csv", "w") as file:
        file.write("x,z\n600120,1\n")
    yield {"points": "b.csv"}, r"b.csv: line 1: column y is missing \(columns: x, z\)"
    with open("c.csv", "w") as file:
        file.write("x,y\n600120,\n")
    yield {"points": "c.csv"}, "c.csv: line 2: y = '': must be a number"


def test_what_cannot_be_is_refused_in_one_line(case, capsys, subtests):
    case = total(case.replace(line=[]), 8)
    text = "".join(f"{line}\n" for line in case.text().splitlines() if " x = " not in line)
    text = "".join(f"{line}\n" for line in text.splitlines() if " y = " not in line)
    for release, message in refused_cases():
        says = {"by_area = .false.": "by_area = .true."} if release.pop("by_area", 0) else {}
        keys = "".join(f"    {key} = '{value}'\n" for key, value in release.items())
        now = text.replace("&release\n", f"&release\n{keys}")
        for old, new in says.items():
            now = now.replace(old, new)
        (case.folder / "case.nml").write_text(now)
        with subtests.test(release=release):
            refuses(["run", "case.nml", "--output", "new.nc"], message, capsys)
    both = case.text().replace("&case\n", "&case\n    boulders = 4\n")
    (case.folder / "case.nml").write_text(both)
    either = r"case.nml: &case boulders, boulders_total: give one of the two: .*"
    refuses(["run", "case.nml", "--output", "new.nc"], either, capsys)
    make_layer("f.gpkg", POINTS, frequency=[1.0, 2.0, 3.0, 4.0])
    with pytest.raises(
        rockfall.RockfallError, match="sources have a frequency: an ensemble requires"
    ):
        run_ensemble(at(case, "f.gpkg"))


# ---- use by commands


@pytest.fixture
def described(case):
    make_layer("p.gpkg", POINTS, **ABOUT)
    return at(case)


def test_factors_of_an_ensemble_are_on_what_the_layer_or_the_case_gives(described):
    factors = {"volume_factor": 1.2, "drop_height_factor": 1.3}
    scene = read_scene(described.replace(ensemble=factors))
    inputs = Uncertain(scene)
    point = np.full(inputs.ends[-1], 0.9)
    draws = [inputs.at(name, point, 0) for name in ("volume", "drop_height")]
    made = drawn_scene(scene, draws, described.case["seed"])
    size, height = draws[0].kept["volume"], draws[1].kept["drop_height"]
    assert size > 1.1 and height > 1.1
    before, after = (values_of(one.case, one.features) for one in (scene, made))
    assert after[:, 1] == pytest.approx(height * before[:, 1])
    assert np.array_equal(np.delete(after, 1, axis=1), np.delete(before, 1, axis=1))
    volumes = [run_scene(one)["volume"].values for one in (scene, made)]
    assert volumes[1] == pytest.approx(size * volumes[0])


def test_a_factor_on_what_nobody_gives_is_refused(case):
    make_layer("p.gpkg", POINTS, volume=[1.0, 1.0, 2.0, 2.0])
    bare = at(case, drop_height=0.0)
    for key, where in (("volume_std_factor", "volume_std"), ("drop_height_factor", "drop_height")):
        own = {"boulder": {"volume": "fixed", "volume_std": None}} if "std" in key else {}
        with pytest.raises(rockfall.RockfallError, match=f"{key}: is only valid with a {where}"):
            Uncertain(read_scene(bare.replace(ensemble={key: 1.2}, **own)))
    smooth = {"zones": None, "table": None, "uniform_mean_radius": 0.0, "ground": "soil_4"}
    with pytest.raises(rockfall.RockfallError, match="radius_factor: has no effect: no zone has"):
        Uncertain(read_scene(bare.replace(surface=smooth, ensemble={"radius_factor": 1.5})))


def test_scenarios_give_what_the_layer_does_not(case):
    """Scenarios give volumes that the layer does not give. They are refused if all sources have a
    volume; volumes of some sources are kept and reported."""
    both = case.replace(line=[], scenario=[
        {"name": "small", "frequency": 1.0, "volume": "fixed", "volume_mean": 0.1},
        {"name": "large", "frequency": 0.1, "volume": "fixed", "volume_mean": 4.0},
    ])  # fmt: skip
    make_layer("p.gpkg", POINTS, drop_height=[1.0, 9.0, 2.0, 3.0])
    study = read_study(at(both))
    for one, volume in zip(study.scenarios, (0.1, 4.0), strict=True):
        scene = replace(study.scene, case=one.case)
        assert set(run_scene(scene)["volume"].values) == {volume}
        assert values_of(scene.case, scene.features)[:, 1].tolist() == [1, 9, 2, 3]
    make_layer("q.gpkg", POINTS, volume=[1.0, None, None, 2.0])
    study = read_study(at(both, "q.gpkg"))
    assert any("2 of 4 take it from the layer in all scenarios" in line for line in study.remarks)
    scene = replace(study.scene, case=study.scenarios[1].case)
    assert sorted(set(run_scene(scene)["volume"].values)) == [1, 2, 4]
    make_layer("r.gpkg", POINTS, volume=[1.0, 1.5, 1.5, 2.0])
    with pytest.raises(rockfall.RockfallError, match="gives a volume, but the layer gives it"):
        read_study(at(both, "r.gpkg"))


def test_observed_boulders_are_set_beside_those_of_their_polygon(case, tmp_path):
    """Observed boulders are compared with all boulders of their polygon; in results without
    features, with those of their cliff."""
    make_layer("cliffs.gpkg", CLIFFS, name=["left", "right"])
    result = rockfall.run(at(case, "cliffs.gpkg"))
    mine = result["source_feature"].values == 1
    n, some = int(mine.sum()), np.flatnonzero(mine)[::37][:10]
    assert len({*result["source"].values[some]}) > 3 and n < mine.size
    rows = np.column_stack([result[name].values[some] for name in
                            ("stop_x", "stop_y", "start_x", "start_y")])  # fmt: skip
    np.savetxt("seen.csv", rows + [3, 4, 1, 0], delimiter=",", header="x,y,start_x,start_y",
               comments="")  # fmt: skip
    seen = read_observed("seen.csv")
    for one, names in (
        (result, ["left"]),
        (result.drop_vars(["source_feature", "feature"]), ["1"]),
    ):
        found = compare(one, seen)
        assert found.notes[0] == (
            f"Run-out is compared with {n:,} of {mine.size:,} boulders, those from the observed "
            f"release points: {names[0]}."
        )
        assert found.ks["n_simulated"].tolist() == [n]
        assert set(found.run_out["n_simulated"]) == {n} and set(found.run_out["n_observed"]) == {10}
        distances = result["plan_distance"].values[mine]
        assert found.passing["simulated"].to_numpy() == pytest.approx(
            [(distances >= d).mean() for d in found.passing["distance"]]
        )
        data, notes = evidence(one, seen, [])
        assert [part.n for part in data] == [10, 10] and notes[0] == found.notes[0]
        assert (~np.isnan(data[0].take(one))).sum() == n
    (far := rows[:2].copy())[:, 2:] += 1000.0
    np.savetxt("far.csv", far, delimiter=",", header="x,y,start_x,start_y", comments="")
    assert "m from the nearest source" in compare(result, "far.csv").notes[0]
