# SPDX-License-Identifier: BSD-3-Clause
"""Line statistics by source, by volume and along the line, for artificial results."""

import json

import numpy as np
import pytest
import xarray as xr

import rockfall
from crossed import crossed
from made import refused
from rockfall.analysis.lines.groups import groups
from rockfall.cli import main
from rockfall.result.crossings import at_lines, line_values
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import input_warnings
from rockfall.terrain.line_beyond import vertices_key
from rockfall.terrain.polyline import lengths
from rockfall.text.lines import profile_text
from scenes import grid, make_case, rough, sets

LIMITS = ["fraction", "fraction_low", "fraction_high", "mean", "mean_low", "q95_high"]


def made(n=3000, sources=3, names=None, volume=None, **heights):
    """Result with `n` boulders of 2 kg, divided equally among the sources. Boulders of later
    sources cross farther along a line of 95 m with two sides, are faster, and fewer of them
    cross."""
    random = np.random.default_rng(5)
    source = np.repeat(np.arange(1, sources + 1), n // sources)
    place = random.beta(2, 2, source.size) * 95 * source / sources
    came = random.random(source.size) < 0.9 - 0.2 * source / sources
    speed = 10.0 * source + random.normal(0, 1, source.size)
    volume = random.uniform(0.1, 2, source.size) if volume is None else volume
    at_line = {"distance": place, "speed": speed, "jump_height": 1.0,
               "passing_height": 1 + np.cbrt(volume), "omega": speed} | heights  # fmt: skip
    number = np.arange(1, source.size + 1)
    values = {name: np.where(came, one, np.nan) for name, one in at_line.items()}
    data = crossed(number, ["road"], **values)
    of_boulder = {"boulder": number, "source": source, "start_x": source * 1.0,
                  "start_y": 0.0 * source, "mass": np.full(source.size, 2.0)}  # fmt: skip
    if names:
        of_boulder["source_feature"] = source
        data["feature"] = "feature", np.arange(1, len(names) + 1)
        data["feature_name"] = "feature", np.array(names, object)
    data |= {key: ("boulder", of) for key, of in (of_boulder | {"volume": volume}).items()}
    data |= {"line_vertex_x": ("line_vertex", [0.0, 50.0, 50.0])}
    data |= {"line_vertex_y": ("line_vertex", [0.0, 0.0, 45.0])}
    data |= {"line_vertex_line": ("line_vertex", [0, 0, 0])}
    vertices = (np.array(data[f"line_vertex_{axis}"][1]) for axis in "xy")
    return xr.Dataset(data, attrs={"lines_beyond": json.dumps({vertices_key(*vertices): []})})


@pytest.mark.parametrize(("by", "classes"), [("source", None), ("volume", [0.5, 1.0])])
def test_a_group_has_the_numbers_of_its_boulders_and_the_groups_are_all(by, classes):
    result = made(names=["north", "south", "north"])
    whole = rockfall.line_statistics(result).set_index("quantity")
    table = rockfall.line_statistics(result, by, classes).set_index([by, "quantity"])
    speed = table.xs("speed", level=1)
    assert speed["n"].sum() == whole.loc["speed", "n"] and speed["boulders"].sum() == 3000
    assert (speed["fraction"] * speed["boulders"]).sum() == pytest.approx(speed["n"].sum())
    names = {"source": ["north (1)", "south", "north (3)"],
             "volume": ["below 0.5 m3", "0.5 to 1 m3", "1 m3 and more"]}  # fmt: skip
    assert speed.index.tolist() == names[by]
    for name, chosen in groups(result, by, classes):
        alone = rockfall.line_statistics(result.isel(boulder=chosen)).set_index("quantity")
        for quantity in ("speed", "upper_edge", "position"):
            row = table.loc[(name, quantity)]
            if by == "source":  # with intervals: a stratum does not depend on others
                assert row[LIMITS].tolist() == pytest.approx(alone.loc[quantity, LIMITS], rel=1e-3)
            assert row["std"] == alone.loc[quantity, "std"]
            assert row["fraction"] == alone.loc[quantity, "fraction"]


def test_intervals_of_groups_are_those_of_strata():
    """Sources differ by ten standard deviations: intervals of means are narrower than those of an
    unstratified sample, but wider than those of one source."""
    speed = rockfall.line_statistics(made(), "volume", [1.0]).set_index("quantity").loc["speed"]
    half = (speed["mean_high"] - speed["mean_low"]) / 2
    n = speed["n"].to_numpy()
    as_from_anywhere = 1.96 * speed["std"] / np.sqrt(n)
    assert (half < 0.9 * as_from_anywhere).all() and (half > 1.96 / np.sqrt(n)).all()


def test_default_classes_are_the_few_volumes_or_quarters():
    few = made(volume=np.tile([0.5, 2.0, 7.5], 1000))
    assert [name for name, _ in groups(few, "volume")] == ["0.500 m3", "2.00 m3", "7.50 m3"]
    sizes = [chosen.sum() for _, chosen in groups(made(), "volume")]
    assert sum(sizes) == 3000 and len(sizes) == 4 and min(sizes) > 600
    edge = made(volume=np.repeat([1.0, 2.0], 1500))
    assert [(name, of.sum()) for name, of in groups(edge, "volume", [2.0])] == [
        ("below 2 m3", 1500), ("2 m3 and more", 1500)
    ]  # fmt: skip


def test_hundreds_of_sources_share_groups():
    found = groups(made(sources=300), "source")
    assert len(found) == 20 and found[0][0] == "1 to 15" and found[-1][0] == "286 to 300"
    assert (np.sum([of for _, of in found], axis=0) == 1).all()


def test_windows_add_up_to_the_line():
    result = made()
    row = rockfall.line_statistics(result).set_index("quantity").loc["energy_total"]
    place, energy = (line_values(result, name, 0) for name in ("position", "energy_total"))
    for width, windows in ((10.0, 10), (2.5, 38), (500.0, 1), (None, 38)):
        profile = rockfall.line_profile(result, "road", width)
        assert len(profile) == windows and profile["end"].iloc[-1] == 95
        assert (profile["start"].to_numpy()[1:] == profile["end"].to_numpy()[:-1]).all()
        length = profile["end"] - profile["start"]
        assert profile["n"].sum() == row["n"]
        assert (profile["per_metre"] * length).sum() == pytest.approx(row["fraction"])
        mean = (profile["energy_total_mean"] * profile["n"]).sum() / row["n"]
        assert mean == pytest.approx(row["mean"])
        here = (place >= profile["start"][0]) & (place < profile["end"][0])
        assert profile["energy_total_q95"][0] == np.quantile(energy[here], 0.95)
        assert (profile["fraction_low"] <= profile["fraction"]).all()
        assert (profile["per_metre_high"] * length).to_list() == pytest.approx(
            profile["fraction_high"].to_list()
        )


def test_heights_of_a_sphere_on_a_slope_of_60_degrees():
    """A sphere of R = 1 m has a jump height of 3 m, which is 1.5 m normal to the slope. Other
    heights are calculated by hand."""
    result = made(volume=np.full(3000, 4 / 3 * np.pi), jump_height=3.0, passing_height=3.0 + 2.0)
    table = rockfall.line_statistics(result).set_index("quantity")
    expected = {"upper_edge": 6.0, "normal_height": 2.5, "normal_upper_edge": 3.5}
    for name, height in expected.items():
        assert table.loc[name, ["mean", "max", "q95"]].tolist() == pytest.approx([height] * 3)


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (("line_statistics", "zone"), "by = 'zone': must be one of: source, volume, shape"),
        (("line_statistics", "volume", [1.0, 0.5]), "classes = 1, 0.5: must increase"),
        (("line_statistics", "volume", []), "classes: must be volumes > 0 m3"),
        (("line_statistics", "volume", [0.0, 1.0]), "classes: must be volumes > 0 m3"),
        (("line_statistics", "volume", [1.0, np.nan]), "classes: must be volumes > 0 m3"),
        (
            ("line_statistics", "source", [1.0]),
            "classes: are only valid with by = 'volume', not 'source'",
        ),
        (("line_profile", "rail"), "along = 'rail': no such line (lines: road)"),
        (
            ("line_profile", "road", 0.001),
            "width = 0.001: gives 95,000 windows along the line: must be at most 10,000",
        ),
        (("line_profile", "road", 0.0), "width = 0.0: must be > 0 m"),
        (("line_profile", "road", -1.0), "width = -1.0: must be > 0 m"),
        (("line_profile", "road", np.nan), "width = nan: must be > 0 m"),
        (("line_profile", "road", np.inf), "width = inf: must be > 0 m"),
    ],
)
def test_what_makes_no_sense_is_refused(ask, message):
    function, *words = ask
    with refused(message):
        getattr(rockfall, function)(made(), *words)


@pytest.mark.all
def test_the_command_prints_what_it_writes(tmp_path, capsys):
    line = [{"name": "road", "x": [0.0, 300.0], "y": [280.0, 280.0]}]
    release = {"x": [140.0, 160.0], "y": [380.0, 380.0]}
    case = make_case(tmp_path, *sets(), line=line, case={"boulders": 100}, terrain={},
                     release=release)  # fmt: skip
    result = rockfall.run(case, dem=rough(), transform=grid(rough()))
    rockfall.write_result(result, path := tmp_path / "out.nc")

    def command(*words):
        code = main(["lines", str(path), *map(str, words)])
        return code, *capsys.readouterr()

    n = int(np.isfinite(at_lines(result)["line_speed"]).sum())
    table = tmp_path / "t.csv"
    code, said, _ = command("--by", "source", "-o", table)
    assert code == 0 and said.endswith(f"{table}\n") and "  2 " in said
    lines = table.read_text().splitlines()
    assert lines[0].startswith("line,source,boulders,quantity,n,") and len(lines) == 1 + 2 * 12
    assert command("--by", "volume", "--classes", "0.1,1", "-o", table, "--overwrite")[0] == 0
    code, said, _ = command("--along", "road", "--width", "50", "-o", tmp_path / "p.csv")
    assert code == 0 and said.endswith("p.png\n")
    rows = np.genfromtxt(tmp_path / "p.csv", delimiter=",", names=True)
    assert rows["n"].sum() == n and rows["end"][-1] == 300
    assert (tmp_path / "p.png").read_bytes()[:4] == b"\x89PNG"
    for words, error in (
        (["--width", "5"], "--width: needs --along"),
        (["--classes", "1"], "--classes: needs --by volume"),
        (["--by", "source", "--along", "road"], "--by: needs no --along"),
        (["--by", "volume", "--classes", "1,x"], "--classes 1,x: must be volumes [m3] separated "
                                                 "by commas, such as 0.1,0.5,1"),
    ):  # fmt: skip
        assert command(*words) == (2, "", f"rockfall: {error}\n")


def test_a_frequency_per_metre_is_that_of_the_metres_on_the_terrain(tmp_path, capsys):
    """The line extends 100 m beyond the outermost cell centres and crosses a hole of 10 cells,
    which removes another half cell on either side."""
    z = rough()
    z[23:25, 40:50] = np.nan
    line = [{"name": "road", "x": [-97.5, 397.5], "y": [280.0, 280.0]}]
    release = {"x": [20.0, 140.0, 160.0], "y": [380.0] * 3}
    case = make_case(tmp_path, *sets(), line=line, case={"boulders": 300}, terrain={},
                     release=release)  # fmt: skip
    result = rockfall.run(case, dem=z, transform=grid(z))
    profile = rockfall.line_profile(result, "road", 49.5)
    known = [0.0, 0.0, 48.5, 49.5, 49.5, 47.5, 0.0, 45.0, 0.0, 0.0]  # x from 1.5, 51, ...
    assert profile["length"].tolist() == pytest.approx(known)
    assert profile["n"].sum() > 100 and (profile["n"][profile["length"] == 0] == 0).all()
    for name in "per_metre", "per_metre_high":
        share = profile[name.replace("per_metre", "fraction")] / np.where(known, known, np.nan)
        assert profile[name].tolist() == pytest.approx(share.tolist(), nan_ok=True)
    rockfall.write_result(result, path := tmp_path / "out.nc")
    assert main(["lines", str(path), "--along", "road"]) == 0
    assert "name = 'road': 255 of 495 m lie outside the terrain" in capsys.readouterr().err
    result["line_vertex_x"] = result["line_vertex_x"] + 1.0  # not the line that was checked
    moved = rockfall.line_profile(result, "road")
    assert moved[["length", "per_metre", "per_metre_high"]].isna().all(axis=None)
    assert "per metre is unknown" in profile_text(moved, "road", result)


@pytest.mark.parametrize("seed", range(5))
def test_a_line_is_on_the_terrain_where_boulders_can_start(tmp_path, seed):
    random = np.random.default_rng(seed)
    z = rough()
    z[random.random(z.shape) < 0.1] = np.nan
    x, y = random.uniform(-50, 350, 4), random.uniform(-50, 450, 4)
    line = [{"name": "road", "x": x.tolist(), "y": y.tolist()}]
    z[4, 28:32] = 1400.0
    case = make_case(tmp_path, *sets(), line=line, release={"x": [147.5], "y": [377.5]})
    scene = read_scene(case, dem=z, transform=grid(z))
    input_warnings(scene)
    at = lengths(x + 1j * y)
    middle = (np.arange(100_000) + 0.5) * at[-1] / 100_000
    points = np.interp(middle, at, x), np.interp(middle, at, y)
    known = scene.known_at(*points)
    off = np.array(scene.beyond[vertices_key(x, y)])
    assert 0.2 < known.mean() < 0.9 and len(off) > 5
    beyond = ((middle[:, None] > off[:, 0]) & (middle[:, None] < off[:, 1])).any(axis=1)
    assert (beyond != known).all()
