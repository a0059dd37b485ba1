# SPDX-License-Identifier: BSD-3-Clause
"""Impact tables from contacts of blocks: contents, runs that agree with the laboratory, and
refusals."""

import itertools
import shutil

import numpy as np
import pytest
import xarray as xr
from rockfall._core import rockfall_f2py as _core

import rockfall
from made import refused
from programs import refuses
from rockfall.cli import main
from rockfall.grounds.impact_tables import (
    FIELDS,
    KINDS,
    open_table,
    save_table,
    shipped_tables,
)
from rockfall.result.crossings import at_lines
from rockfall.result.trajectories import vertices_of
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from rockfall_lab import tables
from rockfall_lab.blocks.case import BlockCase, block_case_of
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.contact_records import open_contacts, save_contacts
from rockfall_lab.tables import cases_of, table_of
from same import same
from scenes import case_in, place
from table_scenes import on_plane, terrain

CASE = BlockCase(
    lab={"ground": "meadow", "throws": 100, "seed": 5}, block={"count": 6}, ground={"patches": 1}
)
FEW = CASE.replace(lab={"contacts": 12})  # the first contacts of a throw cost the least
MANY = FEW.replace(lab={"throws": 500})


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder with contacts of a small laboratory case and a table made from them."""
    folder = tmp_path_factory.mktemp("made")
    contacts = run_throws(MANY)
    save_contacts(contacts, folder / "contacts.nc")
    save_table(table_of([contacts]), folder / "meadow.nc")
    return folder


def test_rebounds_are_those_of_the_laboratory(made):
    """The mean normal velocity after a first contact is that of records of similar incidence."""
    table = open_table(made / "meadow.nc")
    record = dict(zip(FIELDS, table.record.T.astype(float), strict=True))
    result = on_plane(made, 30.0, 3000)
    first = np.stack([one[:, 1] for one in vertices_of(result, "in_t", "in_n", "out_n", "out_t")])
    speed = np.hypot(first[:, 0], first[:, 1])
    sine = first[:, 1] / speed
    flight = np.arange(len(table.record)) < table.first[np.prod(table.bins["flight"])]
    near = flight & (np.abs(-record["vn_in"] / record["speed_in"] - np.abs(sine).mean()) < 0.08)
    near &= np.abs(record["w_in"]) < 0.3 * record["speed_in"]
    assert near.sum() > 20
    of_records = (record["vn_out"] / record["speed_in"])[near]
    of_boulders = first[:, 2] / speed
    error = of_records.std() / np.sqrt(near.sum())
    assert abs(of_boulders.mean() - of_records.mean()) < 4 * error + 0.03


def test_speeds_on_talus_go_with_the_root_of_the_size(tmp_path):
    """Strength is proportional to R_b, and relief constant: there is no length scale."""
    talus = CASE.replace(lab={"ground": "talus", "throws": 200})
    case = talus.replace(ground={"hurst": 1.0, "yield_exponent": 1.0}).at_radius(0.4)
    save_table(table_of([run_throws(case)]), tmp_path / "talus.nc")
    scaled = []
    for radius in 0.2, 0.4, 1.0:
        result = on_plane(
            tmp_path, 34.0, 400, impact={"form": "table", "table": "talus.nc"},
            boulder={"volume_mean": 4 / 3 * np.pi * radius**3},
            line=[{"name": "low", "x": [0.0, 100.0], "y": [314.0, 314.0]}],
            output={"trajectories": 0}, surface={"uniform_mean_radius": 0.1},
        )  # fmt: skip
        scaled.append(np.nanmean(at_lines(result)["line_speed"]) / np.sqrt(radius))
    assert max(scaled) < 1.15 * min(scaled), scaled


@pytest.mark.parametrize("ground", ["meadow", "rock"])
def test_contacts_in_the_laboratory_are_similar(ground):
    """Contacts are similar at equal strength over rho_b g R_b, relief and scaled speed."""
    first = CASE.replace(
        lab={"ground": ground, "throws": 60, "contacts": 1}, ground={"hurst": 1.0},
        throw={"speed": [3.0, 6.0, 9.0]},
    ).at_radius(0.4)  # fmt: skip
    times, heavier = 16.0, 1.25
    strength = first.ground["yield_pressure"] * times * heavier
    soil = first.ground["soil_density"] * heavier
    other = first.replace(
        block={"radius": 0.4 * times, "density": first.block["density"] * heavier},
        throw={"speed": [one * times**0.5 for one in first.throw["speed"]]},
        ground={
            "yield_pressure": strength, "fitted_radius": 0.4 * times, "soil_density": soil,
            "restitution": first.ground["restitution"] * times**0.25,
        },
    )  # fmt: skip
    small, large = (run_throws(case) for case in (first, other))
    for name in "vt_out", "vn_out", "w_out", "lateral", "energy_out":
        assert np.allclose(small[name], large[name], rtol=1e-3, atol=1e-3), name
    assert np.allclose(small["duration"] * times**0.5, large["duration"], rtol=1e-3, atol=1e-4)


SIZES = 0.2, 0.6


@pytest.fixture(scope="module")
def sized(tmp_path_factory):
    """Folder with tables for blocks of two sizes, and one table for both."""
    folder = tmp_path_factory.mktemp("sized")
    contacts = [run_throws(FEW.at_radius(radius)) for radius in SIZES]
    every = 2 * max(data.sizes["contact"] for data in contacts)
    for radius, data in zip(SIZES, contacts, strict=True):
        save_table(table_of([data], every), folder / f"{radius}.nc")
    save_table(table_of(contacts[::-1], 2 * every), folder / "both.nc")
    return folder


def of_size(folder, table, radius, **groups):
    """Run of boulders of a given size by a table."""
    boulder = {"volume_mean": 4 / 3 * np.pi * radius**3}
    case = {"impact": {"table": table, "form": "table"}, "boulder": boulder}
    return on_plane(folder, 34.0, 100, **(case | groups))


@pytest.mark.parametrize(("radius", "part"), [(0.1, 0.2), (0.2, 0.2), (0.6, 0.6), (2.0, 0.6)])
def test_a_boulder_takes_the_part_of_its_size(sized, radius, part):
    """At a size of the table, or beyond its sizes, results are bit-identical to those by a table of
    only the nearest size."""
    table = open_table(sized / "both.nc")
    weight = 2700.0 * 9.81 * np.array(SIZES)  # weight over area [Pa]
    assert np.allclose(table.size * table.ground.strength, weight, rtol=1e-12)
    both, alone = (of_size(sized, table, radius) for table in ("both.nc", f"{part}.nc"))
    for name in "stop_y", "speed_max", "path_length", "impacts":
        assert np.array_equal(both[name], alone[name], equal_nan=True), name
    assert int(both["rebounds_out_of_range"]) == 0
    assert both["ground_model"].values.tolist() == ["impact_table"]


def test_a_boulder_between_two_sizes_takes_both_parts(sized):
    """Halfway in the logarithm of size, the results are between those of both sizes."""
    between = np.sqrt(np.prod(SIZES))
    speeds = [
        of_size(sized, table, between, output={"trajectories": 0})["speed_max"].values
        for table in ("0.2.nc", "both.nc", "0.6.nc")
    ]
    low, mixed, high = (one.mean() for one in speeds)
    error = max(one.std() for one in speeds) / np.sqrt(100)
    assert min(low, high) - 2 * error < mixed < max(low, high) + 2 * error
    assert not any(np.array_equal(speeds[1], speeds[k]) for k in (0, 2))


@pytest.mark.parametrize("lanes", [1, 2, 3])
def test_parts_by_size_are_taken_alike_in_lanes(sized, lanes):
    volumes = {"volume": "lognormal", "volume_mean": 0.3, "volume_std": 0.4}
    case = case_in(
        sized, case={"boulders": 100}, impact={"form": "table", "table": "both.nc"},
        boulder=volumes, **place(),
    )  # fmt: skip
    scene = read_scene(case, **terrain())
    _core.carry_in_lanes(scene.kernel.handle, lanes)
    same(run_scene(scene), rockfall.run(case, **terrain()))


def test_talus_is_as_rough_for_a_larger_block_and_stronger():
    ground = CASE.replace(lab={"ground": "talus"}).ground
    large = CASE.replace(lab={"ground": "talus"}).at_radius(1.6)
    factor = 1.6 / ground["fitted_radius"]
    assert large.ground["relief"] == ground["relief"]
    assert large.ground["yield_pressure"] == pytest.approx(ground["yield_pressure"] * factor)
    stiffness = [
        0.06 * one["yield_pressure"] / one["restitution"] ** 4 for one in (ground, large.ground)
    ]
    assert stiffness[1] == pytest.approx(stiffness[0], rel=1e-3)
    again = large.at_radius(1.6)
    assert again == large
    assert large.block["radius"] == 1.6 and large.ground["longest"] == ground["longest"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"block": {"radius": 0.4}},
            "files must be of different sizes over strength, or of all pairs",
        ),
        ({"lab": {"shape": "platy"}, "block": {"radius": 1.0}}, "files that differ in shape"),
        (
            {"ground": {"rest_angle": 30.0}, "block": {"radius": 1.0}},
            "files that differ in rest",
        ),
    ],
)
def test_contacts_that_do_not_belong_together_are_refused(
    made, tmp_path, monkeypatch, capsys, change, words
):
    monkeypatch.chdir(tmp_path)
    save_contacts(run_throws(CASE.replace(lab={"throws": 4}).replace(**change)), "o.nc")
    refuses(
        ["lab", "table", str(made / "contacts.nc"), "o.nc", "-o", "t.nc"],
        f"contacts: {words}.*",
        capsys,
    )


THROWN = CASE.replace(lab={"ground": "talus", "throws": 40})


def test_contacts_of_sizes_and_reliefs_make_columns_and_rows():
    """Files in any order are sorted by relief and size; files without all pairs are refused."""
    cases = {
        (relief, strength): THROWN.replace(
            ground={"relief": relief, "yield_pressure": strength, "yield_exponent": 0.0}
        )
        for relief in (16.0, 9.0)
        for strength in (2e6, 1e5)
    }
    contacts = [run_throws(case) for case in cases.values()]
    table = table_of(contacts)
    assert table.relief.tolist() == [9.0, 16.0]
    weight = 2700.0 * 9.81 * THROWN.block["radius"]
    assert table.size == pytest.approx([weight / 2e6, weight / 1e5], rel=1e-12)
    bins = (len(table.first) - 1) // 4
    for part, (relief, strength) in enumerate(itertools.product((9.0, 16.0), (2e6, 1e5))):
        own = table_of([contacts[[*cases].index((relief, strength))]])
        rows = slice(*table.first[[part * bins, (part + 1) * bins]])
        for name in ("vt_in", "along_out", "vn_out", "duration", "exit"):
            values = table.record[rows, FIELDS.index(name)]
            assert np.array_equal(values, own.record[:, FIELDS.index(name)]), (relief, strength)
    with refused(
        "contacts: files must be of different sizes over strength, or of all pairs of some sizes "
        "and reliefs"
    ):
        table_of(contacts[:3])


@pytest.mark.parametrize("exponent", [0.0, 1.0])
def test_a_boulder_like_the_block_thrown_is_like_it_on_the_ground_of_the_table(exponent):
    """A boulder of the block's radius has the size and relief of the laboratory, whatever the
    radius for which the yield pressure of the ground is given."""
    case = THROWN.replace(
        block={"radius": 0.4}, ground={"fitted_radius": 0.9, "yield_exponent": exponent}
    )
    table = table_of([run_throws(case)])
    radius = np.array(0.4)
    assert float(table.ground.sizes(radius)) == pytest.approx(table.size[0], rel=1e-9)
    assert float(table.ground.reliefs(radius)) == pytest.approx(case.ground["relief"], rel=1e-9)


def test_strength_that_grows_with_another_power_makes_no_table():
    with refused("contacts: yield_exponent = 0.5: must be 0 or 1 for a table"):
        table_of([run_throws(THROWN.replace(ground={"yield_exponent": 0.5}))])


def test_a_radius_for_the_laboratory_of_blocks(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "m.nml").write_text("&lab ground = 'meadow', throws = 4 /\n")
    assert main(["lab", "impact", "m.nml", "--radius", "0.8", "--quiet"]) == 0
    assert "radius = 0.8" in open_contacts(tmp_path / "m.nc").attrs["lab_case"]
    for text, words in ("-1", "must be > 0"), ("nan", "must be > 0"):
        command = ["lab", "impact", "m.nml", "--radius", text, "-o", "n.nc"]
        refuses(command, f"--radius {text}: {words}", capsys)
    (tmp_path / "r.nml").write_text("&lab throws = 4 /\n")
    command = ["lab", "impact", "r.nml", "--radius", "1", "-o", "n.nc"]
    refuses(command, "--radius: is for blocks on a ground", capsys)


def test_a_table_is_made_again_bit_for_bit(made, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["lab", "table", str(made / "contacts.nc"), "-o", "again.nc"]) == 0
    assert open_table(tmp_path / "again.nc").equals(open_table(made / "meadow.nc"))
    save_contacts(run_throws(CASE.replace(lab={"throws": 16})), tmp_path / "few.nc")
    assert main(["lab", "table", "few.nc", "-o", "few-table.nc"]) == 0
    assert main(["lab", "remake", "few-table.nc", "--quiet"]) == 0
    assert "the same in every bit" in capsys.readouterr().out


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name == "hard-platy-11" else pytest.mark.all)
        for name in shipped_tables()
        if name != "rocky-slope"
    ],
)
def test_a_shipped_table_of_a_plane_has_the_ground_and_parts_of_its_cases(name):
    """Check against the cases stored in the file, because remaking the table takes minutes."""
    table = open_table(shipped_tables()[name])
    cases = [block_case_of(text, name) for text in cases_of(table.attrs)]
    files = [
        xr.Dataset(
            attrs={
                "lab_case": case.text(), "radius": case.block["radius"],
                "density": case.block["density"], "gravity": case.throw["gravity"],
                "yield_pressure": case.ground["yield_pressure"],
                "rest_angle": case.ground["rest_angle"],
            }
        )
        for case in cases
    ]  # fmt: skip
    parts, columns, rows = tables._grid(tables._parts(files))
    assert table.ground == tables._ground(parts[0].data)
    assert np.array_equal(table.size, columns)
    assert np.array_equal(table.relief, rows)


def reached_bins(table, kind):
    """Bins of a table with one part, without padding bins, whose edges no key reaches."""
    edges = [table.edges[f"{kind}_edge_{key}"][0] for key in (1, 2, 3)]
    own = [int((one[(0,) * (one.ndim - 1)] < 1e30).sum()) + 1 for one in edges]
    before = 0 if kind == "flight" else np.prod(table.bins["flight"])
    return [before + np.ravel_multi_index(at, table.bins[kind]) for at in np.ndindex(*own)]


def test_bins_hold_their_records(made):
    table = open_table(made / "meadow.nc")
    flights = table.bins["flight"]
    edge = table.edges["flight_edge_1"][0]
    sine2 = (table.record[:, 1] / table.record[:, 3]).astype(float) ** 2
    for bin_number in reached_bins(table, "flight"):
        rows = slice(table.first[bin_number], table.first[bin_number + 1])
        k = bin_number // (flights[1] * flights[2])
        low = edge[k - 1] if k else 0.0
        high = edge[k] if k < len(edge) else 1.0
        assert (sine2[rows] >= low * 0.99).all() and (sine2[rows] <= high * 1.01).all()
        assert (np.diff(table.record[rows, FIELDS.index("pull_along")]) >= 0).all()


def test_a_record_knows_what_followed_it_in_its_throw(made):
    """A rolling record ends with the speed at which the next contact begins; a stopping record has
    no follower."""
    table = open_table(made / "meadow.nc")
    record = dict(zip(FIELDS, table.record.T.astype(float), strict=True))
    follower = record["follower"].astype(int)
    reached = np.concatenate([
        np.arange(*table.first[k : k + 2]) for kind in KINDS for k in reached_bins(table, kind)
    ])  # fmt: skip
    known = (follower > 0) & np.isin(np.arange(len(follower)), reached)
    assert known[reached].mean() > 0.8 and not known[record["exit"] == 2].any()
    assert len(np.unique(follower[known])) == known.sum(), "each contact follows one"
    rolls = known & (record["exit"] == 1)
    ends = np.sqrt(sum(record[name] ** 2 for name in ("along_out", "across_out", "vn_out")))
    begins = record["speed_in"][follower - 1]
    assert np.allclose(ends[rolls], begins[rolls], rtol=0.01, atol=1e-3)
    risen = record["height_in"] + record["rise"]
    assert np.allclose(risen[rolls], record["height_in"][follower - 1][rolls], atol=0.02)


def test_as_many_stop_as_blocks_do(made):
    """On a slope of 20 degrees, where some blocks stop in hollows, the fractions of blocks and
    boulders that pass 10 m and 40 m agree."""
    slope, away = np.radians(20.0), np.radians(30.0)  # thrown at 30 degrees from the plane
    throw = {"slope": [20.0] * 2, "speed": [5.0] * 3, "angle": [30.0] * 3, "spin": [0.0] * 3}
    lab = {"throws": 240, "contacts": 300, "seed": 6}
    rough_ground = CASE.replace(
        block={"count": 24},
        ground={"relief": 18.0, "hurst": 0.8, "yield_pressure": 1e6, "patches": 16},
    )
    blocks = run_throws(rough_ground.replace(lab=lab, throw=throw))
    far = blocks["downhill"].groupby(blocks["sequence"]).max().values * blocks.attrs["radius"]
    table = table_of([run_throws(rough_ground.replace(lab={"throws": 500}))])
    save_table(table, made / "rough.nc")
    velocity = [0.0, -5 * np.cos(slope + away), -5 * np.sin(slope + away)]

    release = {"drop_height": 0.001, "velocity": velocity}
    result = on_plane(made, 20.0, 400, impact={"table": "rough.nc"}, release=release)
    along = (480.0 - result["stop_y"].values) / np.cos(slope)
    for mark in (10.0, 40.0):
        error = np.hypot(*(np.std(one > mark) / np.sqrt(len(one)) for one in (far, along)))
        assert abs((far > mark).mean() - (along > mark).mean()) < 3 * error, mark


def test_what_is_no_table_is_refused(made, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(made / "meadow.nc", tmp_path)
    words = "meadow.nc: is not a file of contacts of the laboratory"
    refuses(["lab", "table", "meadow.nc", "-o", "t.nc"], words, capsys)


def block_case_of_part(text):
    return block_case_of(text, "part")


@pytest.mark.parametrize("path", shipped_tables().values(), ids=shipped_tables())
def test_shipped_tables_are_of_the_cases_that_they_name(path):
    table = open_table(path)
    if path.stem == "rocky-slope":
        return
    model, _, relief = path.stem.split("-")
    for size, case in zip(table.size, map(block_case_of_part, cases_of(table.attrs)), strict=True):
        weight = case.block["density"] * case.throw["gravity"] * case.block["radius"]
        assert weight / case.ground["yield_pressure"] == pytest.approx(size, rel=1e-12)
        assert case.ground["relief"] == float(relief)
        assert case.ground["plough"] == (model == "ploughed")
