# SPDX-License-Identifier: BSD-3-Clause
"""Section: flights on a plane have the heights and energies of a hand calculation, a station on an
evaluation line has the kernel's values, and no recorded boulder exceeds the maps."""

import csv

import numpy as np
import pytest

import rockfall
from made import UTM, every_third, make_layer, refused
from rockfall.analysis.line_statistics import sample_numbers
from rockfall.analysis.lines.envelopes import envelopes, fewest_for
from rockfall.analysis.lines.section import COLUMNS, section_of
from rockfall.analysis.lines.section_maps import places_in_cells
from rockfall.analysis.lines.stations import SectionLine
from rockfall.analysis.precision.intervals import Sources
from rockfall.case import case_of
from rockfall.cli import main
from rockfall.io.rasters.grid import Grid
from rockfall.language import speaking
from rockfall.limits import MIN_FOR_MEAN
from rockfall.plots.figures import section_entry
from rockfall.plots.section_figure import section_figure
from rockfall.result.crossings import at_lines, has_crossed, line_values
from rockfall.result.variables import LEG
from rockfall.tables.section import section_notes
from rockfall.terrain.height import height
from rockfall.terrain.polyline import intersections
from scenes import grid, make_case, rough, sets

SINGLE = 1e-6  # results store crossings in single precision

Z = rough()
TERRAIN = Z, grid(Z)
ROAD = {"name": "road", "x": [0.0, 300.0], "y": [180.0, 180.0]}
DOWN = np.array([150 + 400j, 150 + 20j])
QUANTITIES = {
    "speed": ("speed", "speed_max_map"), "energy_total": ("energy", "energy_max"),
    "jump_height": ("jump_height", "jump_height_max_map"),
    "passing_height": ("passing_height", "passing_height_max"),
}  # fmt: skip
MAPS = ["passages", "reach_probability_low", "reach_probability_high"]
MAPS += [name for _, name in QUANTITIES.values()]
MAPS += [
    f"{start}_{of}" for start, _ in QUANTITIES.values()
    for of in ("mean", "q95", "q95_low", "q95_high")
]  # fmt: skip


BOULDERS = 4500


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    case = make_case(
        tmp_path_factory.mktemp("section"), *sets(), terrain={}, line=[ROAD],
        case={"boulders": BOULDERS // 3, "threads": 0},
        output={"trajectories": 60, "maps": MAPS},
        boulder={"volume": "normal", "volume_mean": 0.8, "volume_std": 0.2},
        release={"x": [100.0, 150.0, 200.0], "y": [380.0] * 3},
    )  # fmt: skip
    return rockfall.run(case, dem=Z, transform=TERRAIN[1])


@pytest.fixture(scope="module")
def wide(result):
    return section_of(result, SectionLine(DOWN, 150.0, 20.0), TERRAIN)


#: A plane of 45 degrees to the south, z = y, and gravity of 10 m/s2: a boulder thrown horizontally
#: to the south at v m/s from z = y = 100 is v t - 5 t^2 above the plane, and reaches it after v/5
#: s.
PLANE = np.tile(np.arange(147.5, 0, -5.0)[:, None], (1, 20))
GRAVITY, FROM = 10.0, 100.0


def thrown(result, speeds, x):
    """Result on the plane with other trajectories: one horizontal throw of each of the first
    boulders, from `x` and northing FROM."""
    speeds, x = np.asarray(speeds, float), np.asarray(x, float)
    time, number = speeds / 5, result["boulder"].values[: speeds.size]
    vertices = {
        "boulder": np.stack([number, number]), "x": np.stack([x, x]),
        "y": np.stack([np.full(x.size, FROM), FROM - speeds * time]),
        "time": np.stack([0 * time, time]),
        "velocity_x": np.zeros((2, x.size)), "velocity_y": np.stack([-speeds, -speeds]),
        "velocity_z": np.stack([0 * time, -GRAVITY * time]), "out_w": np.full((2, x.size), 3.0),
        "ratio": np.ones((2, x.size)),
        "leg": np.stack([np.full(x.size, LEG["flight"]), np.zeros(x.size, int)]),
    }  # fmt: skip
    vertices["z"] = vertices["y"]
    columns = {f"trajectory_{k}": ("trajectory_vertex", v.T.ravel()) for k, v in vertices.items()}
    return result.drop_dims("trajectory_vertex").assign(columns)


@pytest.fixture(scope="module")
def on_plane(tmp_path_factory):
    case = make_case(
        tmp_path_factory.mktemp("plane"), *sets(), terrain={}, line=[],
        output={"trajectories": 3}, release={"x": [50.0], "y": [100.0], "drop_height": 1.0},
        boulder={"volume_mean": 1.0, "density": 2700.0}, flight={"gravity": GRAVITY},
    )  # fmt: skip
    return rockfall.run(case, dem=PLANE, transform=grid(PLANE))


def test_flights_on_a_plane_by_hand(on_plane):
    """Flights at 10, 20 and 30 m/s are 10 m farther down in plan after 1, 1/2 and 1/3 s, at 5, 8.75
    and 85/9 m above the slope."""
    data = thrown(on_plane, [10.0, 20.0, 30.0], [50.0, 48.0, 61.5])
    line = SectionLine(np.array([50 + 120j, 50 + 20j]), 10.0, 10.0)
    found = section_of(data, line, (PLANE, grid(PLANE)))
    table = found.table.set_index("distance")
    np.testing.assert_allclose(table["elevation"], 120.0 - table.index)
    assert found.recorded == 3 and found.boulders == 50
    # the third boulder is beyond the corridor; the first lands 20 m away, the second 80 m
    assert table["recorded_n"].tolist() == [0, 0, 2, 2, 2, 1, 1, 1, 1, 1, 1]
    here = found.passages[found.passages["distance"] == 30.0]
    radius = (3 / (4 * np.pi)) ** (1 / 3)
    np.testing.assert_allclose(here["elevation"], [95.0, 98.75])
    np.testing.assert_allclose(here["jump_height"], [5.0, 8.75])
    np.testing.assert_allclose(here["passing_height"], [v + radius * 2**0.5 for v in (5.0, 8.75)])
    squared = np.array([10.0**2 + 10.0**2, 20.0**2 + 5.0**2])
    np.testing.assert_allclose(here["speed"], np.sqrt(squared))
    np.testing.assert_allclose(here["energy_total"], 1350.0 * (squared + 0.4 * 3.0**2))
    assert table.loc[30.0, "recorded_energy_total_max"] == pytest.approx(1350.0 * 428.6)
    assert table["recorded_energy_total_mean"].isna().all()  # two boulders are too few for a mean
    far = section_of(data, line._replace(within=11.6), (PLANE, grid(PLANE)))
    assert far.passages.query("distance == 30")["jump_height"].max() == pytest.approx(85 / 9)


def test_an_oblique_section_projects_on_itself(on_plane):
    """A flight at 45 degrees to the section passes a station where it crosses the perpendicular
    through that station."""
    data = thrown(on_plane, [10.0], [50.0])
    line = SectionLine(np.array([40 + 100j, 90 + 50j]), 20.0, 50 * 2**0.5)
    found = section_of(data, line, (PLANE, grid(PLANE))).passages
    # the line across the start at (40, 100) contains (50, 110): the flight begins beyond it
    assert not len(found)
    before = SectionLine(np.array([40 + 85j, 90 + 35j]), 20.0, 50 * 2**0.5)
    found = section_of(data, before, (PLANE, grid(PLANE))).passages
    # at (50, 95): after 0.5 s, 5 m down, 10 0.5 - 5 0.25 = 3.75 m above
    assert found["jump_height"].tolist() == pytest.approx([3.75])


def test_a_number_is_blank_where_too_few_boulders_give_it():
    values = np.random.default_rng(3).gamma(2.0, size=200)
    level = fewest_for(0.95)
    for n in (MIN_FOR_MEAN - 1, MIN_FOR_MEAN, level - 1, level):
        few = {name: values[:n] for name in QUANTITIES}
        row = envelopes(few, Sources.alone(n))
        assert row["speed_max"] == values[:n].max()
        assert ("speed_mean" in row) == (n >= MIN_FOR_MEAN)
        assert ("speed_q95_high" in row) == ("speed_q95" in row)
        if n >= level:
            assert row["speed_q95"] == sample_numbers(values[:n], Sources.alone(n))["q95"]
        elif n < level - 1:
            assert "speed_q95" not in row


def test_a_station_is_an_evaluation_line(result, wide):
    assert list(wide.table.columns) == COLUMNS
    here = wide.passages[wide.passages["distance"] == 220.0].set_index("boulder")
    recorded = np.isin(result["boulder"].values, result["trajectory_boulder"].values)
    crossed = np.isfinite(at_lines(result)["line_speed"].values[0]) & recorded
    assert wide.recorded == 60 and crossed.sum() > 20
    assert sorted(here.index) == result["boulder"].values[crossed].tolist()
    here = here.loc[result["boulder"].values[crossed]]
    at_line = {
        name: at_lines(result)[f"line_{name}"].values[0] for name in ("speed", "jump_height",
        "passing_height", "energy_translational", "energy_rotational")
    }  # fmt: skip
    at_line["energy_total"] = at_line["energy_translational"] + at_line["energy_rotational"]
    for name in QUANTITIES:
        np.testing.assert_allclose(here[name], at_line[name][crossed], rtol=SINGLE, atol=SINGLE)
    row = wide.table.set_index("distance").loc[220.0]
    assert row["recorded_energy_total_max"] == here["energy_total"].max()
    assert row["recorded_passing_height_mean"] == pytest.approx(here["passing_height"].mean())
    assert row["recorded_n"] == crossed.sum() and row["unknown_energy"] == 0


def test_all_boulders_count_at_a_line(result):
    rows = rockfall.line_statistics(result).set_index("quantity")
    found = section_of(result, SectionLine(DOWN, 1000.0), TERRAIN)
    assert found.lines[["name", "kind", "distance"]].values.tolist() == [["road", "line", 220.0]]
    (row,) = found.lines.to_dict("records")
    assert row["n"] == rows.loc["speed", "n"] > found.recorded
    for name in QUANTITIES:
        for number in ("mean", "q95", "q95_low", "q95_high", "max"):
            assert row[f"{name}_{number}"] == rows.loc[name, number]
    near = section_of(result, SectionLine(DOWN, 20.0), TERRAIN).lines["n"][0]
    assert near == (abs(at_lines(result)["line_x"].values[0] - 150.0) <= 20.0).sum() < row["n"]
    marked = found.table[found.table["crossed"] != ""]
    assert marked[["distance", "crossed"]].values.tolist() == [[220.0, "road"]]


@pytest.mark.filterwarnings("ignore:case. def test_barriers_and_dams_are_markeddam")
def test_barriers_and_dams_are_marked(tmp_path):
    net = {"name": "net", "x": [0.0, 300.0], "y": [300.0, 300.0], "height": 4.0, "class": 3}
    dam = {"x": [100.0, 200.0], "y": [100.0, 120.0], "height": 20.0, "crest_width": 10.0}
    case = make_case(
        tmp_path, *sets(), terrain={}, line=[ROAD],
        output={"trajectories": 9}, release={"x": [150.0], "y": [380.0]},
    ).replace(barrier=[net], dam=[dam | {"slope": 40.0, "allow_coarse": True}])  # fmt: skip
    run = rockfall.run(case, dem=Z, transform=TERRAIN[1])
    lines = section_of(run, SectionLine(DOWN, 150.0), TERRAIN).lines
    assert lines["name"].tolist() == ["net", "road", "dam 1"]
    assert lines["kind"].tolist() == ["barrier", "line", "dam"]
    assert lines["distance"].tolist() == [100.0, 220.0, 290.0]
    assert lines["height"].tolist() == pytest.approx([4.0, np.nan, 20.0], nan_ok=True)
    assert lines["capacity"][0] == 1e6
    came = np.isfinite(at_lines(run)["line_speed"].values).sum(axis=1)
    assert lines["n"].tolist() == pytest.approx([came[1], came[0], np.nan], nan_ok=True)


def test_without_rows_maps_are_what_is_known(tmp_path):
    case = make_case(
        tmp_path, *sets(), terrain={}, line=[ROAD], release={"x": [150.0], "y": [380.0]},
        output={"trajectories": 9, "maps": MAPS, "kept": "none"},
    )  # fmt: skip
    run = rockfall.run(case, dem=Z, transform=TERRAIN[1])
    found = section_of(run, SectionLine(DOWN, 150.0), TERRAIN)
    assert (found.recorded, found.boulders) == (0, 50)
    some = rockfall.run(case.replace(output={"kept": 20}), dem=Z, transform=TERRAIN[1])
    assert section_of(some, SectionLine(DOWN, 150.0), TERRAIN).lines["n"].isna().all()
    assert found.lines["name"].tolist() == ["road"] and found.lines["n"].isna().all()
    assert found.table["corridor_speed_max"].notna().any()


@pytest.mark.all
def test_trajectories_of_boulders_that_are_not_kept_are_named(tmp_path):
    """Trajectories left out because their boulders were not kept are counted, with the advice to
    keep all boulders."""

    def section(kept, maps):
        output = {"trajectories": 9, "maps": maps, "kept": kept}
        case = make_case(
            tmp_path, *sets(), terrain={}, line=[ROAD], output=output,
            release={"x": [150.0], "y": [380.0], "drop_height": 5.0},
        )  # fmt: skip
        run = rockfall.run(case, dem=Z, transform=TERRAIN[1])
        return section_of(run, SectionLine(DOWN, 150.0), TERRAIN)

    for kept, used in ((4, 4), (20, 9), ("all", 9)):
        found = section(kept, None)
        assert (found.recorded, found.not_kept, found.boulders) == (used, 9 - used, 50), kept
        said, caption = " ".join(section_notes(found)), section_entry(found).caption
        assert "9 of 50 boulders are recorded" in said, kept
        assert ("numbers at lines and barriers need the rows" in said) == (kept != "all")
        left_out = "5 recorded trajectories are left out: their boulders were not kept"
        assert (left_out in caption) == (used < 9), kept
        assert (left_out in section_figure(found).axes[0].get_title("left")) == (used < 9), kept
        assert ("the 4 of them that are kept count here" in said) == (used < 9), kept
        assert ("for more, set &output kept = 'all'" in said) == (used < 9), kept
        assert ("for more, set &output trajectories" in said) == (used == 9), kept
    found = " ".join(section_notes(section("none", MAPS)))
    assert "trajectories of 9 of 50 boulders are recorded, but none of these" in found
    with refused(
        "section: no rows are kept of the 9 boulders with recorded trajectories: run with "
        "&output kept = 'all', or a larger number"
    ):
        section("none", None)


def test_maps_below_are_the_cells_of_the_line(result, wide):
    table, about = wide.table, TERRAIN[1]
    rows, columns = about.cells(table["x"].to_numpy(), table["y"].to_numpy())
    west, north = result["x"].values[0], result["y"].values[0]
    rows -= round((about.y[0] - north) / about.cell)
    columns -= round((west - about.x[0]) / about.cell)
    inside = (rows >= 0) & (rows < result.sizes["y"])
    passed = result["passages"].values[rows[inside], columns[inside]]
    assert table["cell_n"][inside].tolist() == passed.tolist() and passed.max() > 100
    assert table["cell_n"][~inside].isna().all()
    assert (table["cell_fraction"][inside] == passed / BOULDERS).all()
    for name, (start, _) in QUANTITIES.items():
        for of in ("mean", "q95", "q95_low", "q95_high"):
            values = result[f"{start}_{of}"]
            wanted = values.values[rows[inside], columns[inside]]
            wanted = np.where(passed < values.attrs.get("thin_below", 0), np.nan, wanted)
            np.testing.assert_array_equal(table[f"cell_{name}_{of}"][inside], wanted)
        assert table[f"cell_{name}_q95"].notna().any() and table[f"cell_{name}_q95"].isna().any()


STEEPEST = 0.3  # maximum difference between the steepness of a patch and of its cell, for centres
#: Obstacles and contacts: rolls, slides and waits of contacts, trees, a weak net.
MEETINGS = {
    "sets": {},
    "table": {"impact": {"form": "table", "table": "talus"}},
    "ground": {"surface": {"uniform_mean_radius": 0.25, "ground": "soil_4"}},
    "forest": {
        "forest": {
            "uniform_stems": 300.0, "uniform_dbh_mean": 20.0, "uniform_dbh_std": 3.0,
            "uniform_conifers": 60.0,
        }
    },
    "net": {},
}  # fmt: skip
NET = {"name": "net", "x": [0.0, 300.0], "y": [301.0, 301.0], "height": 9.0, "capacity": 60.0}


@pytest.mark.all
@pytest.mark.parametrize("meeting", MEETINGS)
def test_recorded_boulders_have_the_kernels_numbers(meeting, tmp_path):
    """Passages have the kernel's values at every line, whatever the boulders met before, and do not
    exceed the maxima of the maps."""
    lines = [
        {"name": f"at {y}", "x": [0.0, 300.0], "y": [float(y)] * 2} for y in range(370, 20, -10)
    ]
    case = make_case(
        tmp_path, *sets(), terrain={}, line=lines, case={"boulders": 60, "threads": 0},
        output={"trajectories": 60, "maps": [name for _, name in QUANTITIES.values()]},
        release={"x": [150.0], "y": [380.0]}, **MEETINGS[meeting],
    ).replace(barrier=[NET] if meeting == "net" else [])  # fmt: skip
    run = rockfall.run(case, dem=Z, transform=TERRAIN[1])
    found = section_of(run, SectionLine(DOWN, 150.0, 10.0), TERRAIN)
    compared = 0
    for k, line in enumerate(lines):
        crossed = has_crossed(run, k)
        here = found.passages[found.passages["distance"] == 400.0 - line["y"][0]]
        assert sorted(here["boulder"]) == run["boulder"].values[crossed].tolist()
        here = here.set_index("boulder").loc[run["boulder"].values[crossed]]
        for name in QUANTITIES:
            wanted = line_values(run, name, k)[crossed]
            near = 1e-5 if meeting == "net" else SINGLE  # boulders restart slightly beyond a net
            np.testing.assert_allclose(here[name], wanted, rtol=near, atol=near)
        compared += crossed.sum()
    assert compared > 100
    below = 1.0 if meeting == "table" else 0.05  # rolls are stored as chords
    for one in rockfall.trajectories(run):
        assert (one.z >= height(*TERRAIN, one.x, one.y) - below).all()
    radius = 0.6 * STEEPEST
    for name in QUANTITIES:
        recorded, most = (found.table[f"{of}_{name}_max"] for of in ("recorded", "corridor"))
        known = recorded.notna().to_numpy()
        above = radius if name == "passing_height" else 1e-6  # maps use the slope of the cell
        assert (recorded[known] <= most[known] * (1 + 1e-6) + above).all(), name


def test_a_station_crosses_each_cell_once():
    cells = grid(Z)
    start, end = 12.3 + 41.7j, 88.1 + 3.3j
    places = places_in_cells(cells, start, end)
    fine = start + np.linspace(0, 1, 100001) * (end - start)
    fine_cells = set(zip(*(k.tolist() for k in cells.cells(fine.real, fine.imag)), strict=True))
    found = list(zip(*(k.tolist() for k in cells.cells(places.real, places.imag)), strict=True))
    assert len(found) == len({*found}) and {*found} == fine_cells
    along = places_in_cells(cells, 12.3 + 42j, 23.0 + 42j)
    np.testing.assert_allclose(along.real, [13.65, 17.5, 21.5])


def test_where_lines_meet():
    vertices = np.array([0, 10, 10 + 10j])
    along, along_other = intersections(vertices, np.array([5 - 5j, 5 + 5j, 15 + 5j]))
    np.testing.assert_allclose(along, [5.0, 15.0])
    np.testing.assert_allclose(along_other, [5.0, 15.0])
    corner, _ = intersections(vertices, np.array([5 - 5j, 15 + 5j]))
    np.testing.assert_allclose(corner, [10.0])  # once, although it meets both sides
    assert not intersections(vertices, np.array([0 + 1j, 8 + 1j]))[0].size


def test_masses_of_sources_with_densities_of_their_own(result, wide):
    """Masses are those of the result, where sources may have other densities than the case."""
    denser = np.where(result["source"].values == 2, 1.5, 1.0)
    mass = result["volume"] * case_of(result).boulder["density"] * denser
    found = section_of(result.assign(mass=mass), wide.line, TERRAIN).passages
    ratio = found["energy_total"] / wide.passages["energy_total"]
    source = result["source"].values[np.searchsorted(result["boulder"], found["boulder"])]
    np.testing.assert_allclose(ratio, np.where(source == 2, 1.5, 1.0), rtol=1e-10)


def test_only_near_trajectories_count(result, wide):
    near = section_of(result, SectionLine(DOWN, 5.0, 20.0), TERRAIN)
    few, many = near.table["recorded_n"], wide.table["recorded_n"]
    assert (few <= many).all() and 0 < few.sum() < many.sum()
    apart = [np.nanmax(abs(along)) for along, _ in near.paths]
    assert len(near.paths) < len(wide.paths) and max(apart) <= 380.0


def test_without_terrain_heights_are_unknown(result):
    table = section_of(result, SectionLine(DOWN, 150.0, 20.0)).table
    assert table["recorded_passing_height_max"].isna().all() and table["elevation"].isna().all()
    assert table["recorded_energy_total_max"].notna().any()
    assert table["cell_passing_height_q95"].notna().any()


def test_thinned_terrain_has_a_profile_but_no_heights(result, wide):
    """Large terrain is read with every second cell, which may miss bumps: heights of trajectories
    are then missing, elevations and speeds are not."""
    thin = Z[::2, ::2], Grid(0.0, 400.0, 10.0, 30, 40)
    found = section_of(result, wide.line, thin)
    assert found.table["recorded_passing_height_max"].isna().all()
    assert found.table["elevation"].notna().sum() > 10
    np.testing.assert_array_equal(
        found.table["recorded_speed_max"], wide.table["recorded_speed_max"]
    )
    assert any(note.startswith("heights of recorded trajec") for note in section_notes(found))
    assert not any(note.startswith("heights of recorded") for note in section_notes(wide))


def test_maps_alone_make_a_section(result):
    bare = result.drop_dims("trajectory_vertex")
    found = section_of(bare, SectionLine(DOWN, 150.0, 20.0), TERRAIN)
    assert found.recorded == 0 and (found.table["recorded_n"] == 0).all() and not found.paths
    assert found.table["corridor_energy_total_max"].notna().any()


def test_refusals(result):
    with refused("within = 0.0: must be > 0 m"):
        section_of(result, SectionLine(DOWN, 0.0))
    with refused("every = 0.001: gives 380,000 stations: must be at most 10,000"):
        section_of(result, SectionLine(DOWN, 10.0, 0.001))
    with refused("section: must have a length above 0 m"):
        section_of(result, SectionLine(np.array([1 + 1j, 1 + 1j])))
    bare = result.drop_dims("trajectory_vertex").drop_vars(
        [name for name in MAPS if name != "passages"]
    )
    about = "neither trajectories of boulders that moved (&output trajectories) nor maps of"
    with refused(f"section: the result has {about} speeds, energies or heights (&output maps)"):
        section_of(bare, SectionLine(DOWN))


@pytest.mark.all
def test_a_layer_and_pairs_are_the_same(result, tmp_path):
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    pairs = [(150.0, 400.0), (150.0, 20.0)]
    layer = make_layer(tmp_path / "drawn.gpkg", [shapely.LineString(pairs)], crs=UTM)
    with pytest.warns(UserWarning, match="elevations were given as an array"):
        one = rockfall.section(result, layer, within=20.0)
    with pytest.warns(UserWarning, match="elevations were given as an array"):
        other = rockfall.section(result, pairs, within=20.0)
    assert one.table.equals(other.table)
    two = make_layer(tmp_path / "two.gpkg", [shapely.LineString(pairs)] * 2, crs=UTM)
    for drawn, about in (
        (two, f"{two}: has 2 lines: a section requires exactly one"),
        ([1.0, 2.0], "section: a line must be pairs x, y, or a file with a line"),
        ("nowhere.gpkg", None),
    ):
        with pytest.warns(UserWarning), pytest.raises(rockfall.RockfallError) as caught:
            rockfall.section(result, drawn)
        assert about is None or str(caught.value) == about


def test_command(place, capsys):
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    assert main(["run", "case.nml", "--quiet"]) == 0
    words = ["section", "case.nc", "--line", "600060,4999990", "600060,4999890"]
    assert main([*words, "--within", "20", "--every", "10", "-o", "down.svg"]) == 0
    said = capsys.readouterr().out
    assert "3 of 20 boulders are recorded, at most 3 cross a station" in said
    assert said.splitlines()[-3:] == ["down.csv", "down_lines.csv", "down.svg"]
    with open("down.csv") as file:
        rows = list(csv.DictReader(file))
    assert [row["distance [m]"] for row in rows] == [f"{10.0 * k}" for k in range(11)]
    found = rockfall.section("case.nc", [(600060, 4999990), (600060, 4999890)], within=20.0,
                             every=10.0)  # fmt: skip
    most = found.table["recorded_energy_total_max"][4] / 1000
    assert float(rows[4]["recorded_energy_total_max [kJ]"]) == pytest.approx(most) and most > 1
    assert [row["crossed"] for row in rows].index("L") == 6
    assert float(rows[4]["elevation [m]"]) == pytest.approx(found.table["elevation"][4])
    for wrong, message in (
        ([*words, "-o", "down.csv"], "down.csv: already exists"),
        ([*words[:-1], "-o", "new.csv"], "--line 600060,4999990: must be X,Y X,Y ..."),
        (
            [*words[:-2], "1,2,3,4", "-o", "new.csv"],
            "--line 1,2,3,4: must be X,Y X,Y ...",
        ),
        ([*words[:-2], "nowhere.shp", "-o", "new.csv"], "nowhere.shp: no such file"),
        (["report", "case.nc", "--section", "1,2,3,4"], "--section 1,2,3,4: must be X,Y X,Y ..."),
        ([*words, "7", "-o", "new.csv"], "separated by spaces), or a file with one line"),
        ([*words, "-o", "new.txt"], "new.txt: output name must end in .csv, .png"),
        ([*words, "--within", "-1", "-o", "new.csv"], "within = -1.0: must be > 0 m"),
    ):
        assert main(wrong) == 2
        assert message in capsys.readouterr().err, message
    assert not list(place.glob("new*"))
    quoted = "-5.5,3 -6,4e2"
    assert main(["section", "case.nc", "--line", quoted, "-o", "far.csv"]) == 0


@pytest.mark.all
def test_the_command_says_that_a_layer_was_reprojected(place, capsys):
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    ends = [(10.257, 45.1532), (10.257, 45.1525)]
    layer = make_layer(place / "down.gpkg", [shapely.LineString(ends)], crs="EPSG:4326")
    assert main(["run", "case.nml", "--quiet"]) == 0
    assert main(["section", "case.nc", "--line", str(layer)]) == 0
    assert "warning: " + str(layer) + ": reprojected from EPSG:4326" in capsys.readouterr().err


@pytest.mark.parametrize("language", every_third(["de", "fr", "it"]))
def test_every_text_of_the_figure_is_translated(language, wide):
    with speaking(language):
        texts = section_figure(wide).findobj(lambda one: hasattr(one, "get_text"))
        words = {*" ".join(one.get_text() for one in texts).split()}
        assert not {"the", "of", "boulders", "recorded", "cell", "mean"} & words
        said = section_entry(wide)
    english = section_entry(wide)
    assert said.title != english.title and "60" in said.caption and "150 m" in said.caption
    assert not set(said.caption.split(". ")) & set(english.caption.split(". "))


def test_a_page_has_the_section(result, tmp_path, blank_figures):
    pytest.importorskip("jinja2", reason="the report extra is not installed")
    path = tmp_path / "page.html"
    with pytest.warns(UserWarning, match="elevations were given as an array"):
        rockfall.report(result, path, section=[(150, 400), (150, 20)], section_within=25.0)
    page = path.read_text()
    about = "60 of 4,500 boulders recorded."
    assert "Section along the drawn line" in page and about in page
    assert "within 25 m of the section" in page and "maxima of all boulders" in page
