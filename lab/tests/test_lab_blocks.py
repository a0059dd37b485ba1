# SPDX-License-Identifier: BSD-3-Clause
"""Block laboratory: reproducibility, properties of contacts, shapes, refusals."""

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from affine import Affine

from made import make_raster, refused
from programs import refuses
from rockfall.cli import main
from rockfall.grounds.relief import CELLS, Spectrum, patches
from rockfall.grounds.shapes import SHAPES, random_block, refine, volume
from rockfall_lab.blocks import contacts as module
from rockfall_lab.blocks.case import BlockCase, block_case_of, grounds, read_block_case
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.case import LabCase
from rockfall_lab.contact_records import ENTRIES, EXITS, open_contacts

GROUPS = "lab", "block", "ground", "throw"
SMALL = BlockCase(
    lab={"ground": "meadow", "shape": "platy", "throws": 24, "seed": 5},
    block={"count": 6},
    ground={"patches": 1},
)
FLIES, ROLLS_ON, STOPS = range(3)
CUBE = np.array([[x, y, z] for x in (0, 2) for y in (0, 2) for z in (0, 2)])


@pytest.fixture(scope="module")
def data():
    return run_throws(SMALL, threads=1)


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("m.nml").write_text(SMALL.text())
    return tmp_path


def numbers(data):
    return data.drop_attrs(deep=False)


def write_points(path, points):
    rows = "\n".join(",".join(map(str, point)) for point in points)
    Path(path).write_text(f"x,y,z\n{rows}\n")


# ---- reproducibility, however the case is run


def test_threads_and_chunks_change_no_bit(data, monkeypatch):
    monkeypatch.setattr(module, "THROWS_IN_CHUNK", 7)
    xr.testing.assert_identical(numbers(run_throws(SMALL, threads=2)), numbers(data))


def test_more_throws_do_not_change_the_first(data):
    more = run_throws(SMALL.replace(lab={"throws": 28}))
    first = more.isel(contact=more["sequence"].values <= 24)
    xr.testing.assert_identical(numbers(first), numbers(data))


def test_another_seed_throws_others(data):
    other = run_throws(SMALL.replace(lab={"seed": 6}))
    assert not np.isin(other["speed"].values, data["speed"].values).any()


def test_a_file_has_all_that_makes_it_again(place, data):
    assert main(["lab", "impact", "m.nml", "-o", "m.nc", "--quiet"]) == 0
    kept = open_contacts("m.nc")
    xr.testing.assert_identical(numbers(kept), numbers(data))
    assert block_case_of(kept.attrs["lab_case"], "m.nc") == SMALL


# ---- properties of contacts


def test_a_contact_that_flies_leaves_the_ground(data):
    assert (data["vn_out"].values[data["exit"] == FLIES] > 0).all()


def test_a_contact_begins_downwards_or_where_one_was_cut(data):
    entry, before, order = (data[name].values for name in ("entry", "exit", "order"))
    assert (data["incidence"].values[entry == 0] >= 0).all()
    follows = order[1:] > 1
    assert (order[np.r_[True, ~follows]] == 1).all()
    assert ((entry[1:] == 1) == (before[:-1] == ROLLS_ON))[follows].all()
    assert (entry[order == 1] == 0).all()
    assert (before[:-1][follows] != STOPS).all(), "nothing moves on after a stop"


def test_where_a_contact_is_cut_the_next_begins_with_what_the_block_has(data):
    """A contact after a cut contact begins with the velocity at the end of the cut contact, plus
    the gain from gravity along the fall line."""
    rolls = np.flatnonzero((data["exit"].values[:-1] == ROLLS_ON) & (data["order"].values[1:] > 1))
    assert len(rolls) > 20
    before = {name: values.values[rolls].astype("f8") for name, values in data.items()}
    after = {name: values.values[rolls + 1].astype("f8") for name, values in data.items()}
    angle = np.radians(after["incidence"])
    out = before["speed"] * before["vn_out"]
    assert out == pytest.approx(-after["speed"] * np.sin(angle), abs=1e-4)
    heading = np.exp(1j * np.radians(before["heading"]))
    turned = heading * np.exp(1j * np.radians(before["lateral"]))
    gained = data.attrs["gravity"] * before["duration"] * np.sin(np.radians(before["slope"]))
    along = before["speed"] * before["vt_out"] * turned + gained
    expected = after["speed"] * np.cos(angle) * np.exp(1j * np.radians(after["heading"]))
    assert np.abs(along - expected).max() < 1e-3


def test_contacts_are_cut_at_their_time(data):
    rolling = (data["entry"] == 1) & (data["exit"] == ROLLS_ON)
    late = data["duration"].values[rolling] / data.attrs["cut_time"]
    assert (late > 1).all()
    assert np.median(late) < 1.02


def test_gravity_is_taken_out_along_the_slope():
    """On a smooth plane without friction, only gravity changes the velocity along the plane,
    whatever the attitude of the block."""
    case = SMALL.replace(
        ground={"plough": False, "friction": 0, "relief": 0, "soil_density": 0},
        throw={"slope": [45, 45], "angle": [5, 30, 60], "speed": [1, 3, 8]},
    )
    data = run_throws(case)
    before = np.cos(np.radians(data["incidence"].values))
    assert data["vt_out"].values == pytest.approx(before, abs=2e-5)
    assert np.abs(data["lateral"].values).max() < 0.01
    assert data["duration"].values.max() > 0.1, "so that it mattered"
    rolls = np.flatnonzero((data["exit"].values[:-1] == ROLLS_ON) & (data["order"].values[1:] > 1))
    way, advance = data["downhill"].values, data["advance"].values
    assert len(rolls) > 0
    assert way[rolls + 1] == pytest.approx(way[rolls] + advance[rolls], abs=1e-3)


@pytest.mark.parametrize("ground", ["rock", "meadow"])
def test_every_block_comes_to_rest_on_flat_ground(ground):
    case = SMALL.replace(lab={"ground": ground, "throws": 15, "contacts": 200})
    data = run_throws(case.replace(throw={"slope": [0, 0]}))
    last = np.r_[np.diff(data["sequence"].values) > 0, True]
    assert (data["exit"].values[last] == STOPS).all()
    assert (data["exit"].values == STOPS).sum() == 15
    assert data.attrs["unfinished"] == 0


def test_a_softer_ground_takes_more():
    left = []
    for strength in 0.3e6, 1e6, 3e6:
        case = SMALL.replace(
            lab={"throws": 100, "contacts": 1, "shape": "compact"},
            ground={"yield_pressure": strength, "relief": 0},
            throw={"slope": [0, 0], "speed": [10, 15, 20]},
        )
        left.append(float(run_throws(case)["energy_out"].mean()))
    assert left[0] < left[1] < left[2] < 0.9


@pytest.mark.parametrize("plough", [False, True])
def test_the_restitution_is_that_of_a_sphere_at_5_m_s(place, plough):
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(300)
    z = (2 * np.arange(300) + 1) / 300 - 1
    radius = np.sqrt(1 - z**2)
    write_points("sphere.csv", np.column_stack([radius * np.cos(turn), radius * np.sin(turn), z]))
    case = BlockCase(
        lab={"ground": "rock", "shape": "points", "throws": 10, "contacts": 1},
        block={"points": "sphere.csv", "edge": 0.2},
        ground={"plough": plough, "relief": 0},
        throw={"slope": [0, 0], "speed": [5] * 3, "angle": [90] * 3, "spin": [0] * 3},
    )
    assert float(run_throws(case)["vn_out"].mean()) == pytest.approx(0.5, rel=0.2)


def test_relief_turns_blocks_aside(data):
    case = SMALL.replace(lab={"throws": 60})
    flat, rough = (run_throws(case.replace(ground={"relief": one})) for one in (0, 25))
    assert rough["lateral"].std() > 1.2 * flat["lateral"].std()


# ---- shapes and relief


@pytest.mark.parametrize("axes", [*SHAPES.values(), (1.0, 0.3, 0.2)])
def test_random_blocks_have_their_axes_and_differ(axes):
    ratios = []
    for number in range(12):
        surface = random_block(axes, 3, number)
        extent = np.ptp(surface.vertices, axis=0)
        ratios.append(extent / extent[0])
    assert np.mean(ratios, axis=0) == pytest.approx(axes, abs=0.12)
    assert len({tuple(one) for one in ratios}) == len(ratios)


def test_facets_are_cut_until_they_are_short_and_the_block_stays():
    block = random_block(SHAPES["elongated"], 1, 4)
    fine = refine(block, 0.3)
    assert volume(fine) == pytest.approx(volume(block), rel=1e-12)
    sides = fine.vertices[fine.triangles] - fine.vertices[np.roll(fine.triangles, 1, axis=1)]
    radius = np.cbrt(3 * volume(block) / (4 * np.pi))
    assert np.linalg.norm(sides, axis=2).max() <= 0.3 * radius
    assert len(fine.triangles) > 3 * len(block.triangles)


def test_a_block_of_points_has_its_own_inertia(place):
    write_points("cube.csv", [*CUBE, (1, 1, 1)])  # an inner point changes nothing
    case = BlockCase(
        lab={"ground": "rock", "shape": "points", "throws": 4}, block={"points": "cube.csv"}
    )
    found = run_throws(case).attrs["inertia_factor"]
    assert found == pytest.approx((4 * np.pi / 3) ** (2 / 3) / 6, rel=1e-6)


def test_axes_of_a_class_give_its_blocks(place):
    """Only the ratios of the axes count: 0.5, 0.4, 0.21 are those of platy blocks."""
    Path("own.nml").write_text(
        "&lab ground = 'rock', shape = 'axes', throws = 4 / &block axes = 0.5, 0.4, 0.21 /\n"
    )
    own = read_block_case("own.nml")
    assert block_case_of(own.text(), "text") == own
    classed = BlockCase(lab={"ground": "rock", "shape": "platy", "throws": 4})
    found, as_class = run_throws(own), run_throws(classed)
    assert found.attrs["shape"] == "axes"
    for name in found:
        assert np.array_equal(found[name], as_class[name])


@pytest.mark.parametrize("slope", [4.0, 30.0])
def test_relief_has_its_slope_and_no_waves_but_its_own(slope):
    spectrum = Spectrum(slope, shortest=2, longest=8, hurst=0.8)
    heights, width = patches(spectrum, 2, seed=1)
    heights = heights[..., 0]
    wave = np.fft.fftfreq(CELLS, width / CELLS)
    power = np.abs(np.fft.fft2(heights)) ** 2
    along = 2j * np.pi * wave[:, None]
    rise = np.fft.ifft2(along * np.fft.fft2(heights)).real
    across = np.fft.ifft2(along.T * np.fft.fft2(heights)).real
    slopes = np.sqrt((rise.var() + across.var()) / 2)
    assert np.degrees(np.arctan(slopes)) == pytest.approx(slope, rel=1e-3)
    length = 1 / np.maximum(np.hypot(wave[:, None], wave[None, :]), 1e-9)
    outside = (length < 1.99) | (length > 8.01)
    assert power[outside].sum() < 1e-6 * power.sum()
    assert abs(heights.mean()) < 1e-6


def patch_file(path, slope, hurst, cell=0.1):
    """Elevations of a patch for blocks of 0.4 m on a hillside of 35 degrees, by cell size."""
    heights, width = patches(Spectrum(slope, 2, 16, hurst), 1, seed=3)
    every = round(cell * CELLS / (0.4 * width))
    side = 0.4 * heights[::every, ::every, 0]
    tilt = 0.7 * every * 0.4 * width / CELLS * np.arange(len(side))
    cell = every * 0.4 * width / CELLS
    affine = Affine(cell, 0, 600000, 0, -cell, 5000000)
    make_raster(path, side + tilt[:, None] + 2000, transform=affine)


@pytest.mark.parametrize(("slope", "hurst"), [(12.0, 0.8), (25.0, 0.3)])
def test_the_spectrum_of_a_measured_patch_comes_back(place, capsys, slope, hurst):
    patch_file("patch.tif", slope, hurst)
    assert main(["lab", "relief", "patch.tif", "--longest", "16"]) == 0
    said = capsys.readouterr().out
    found = {key: float(value) for key, value in re.findall(r"(\w+) = ([\d.]+)", said)}
    assert found["relief"] == pytest.approx(slope, rel=0.1)
    assert found["hurst"] == pytest.approx(hurst, abs=0.25)
    Path("measured.nml").write_text(f"&lab ground = 'meadow' /\n{said}")
    assert read_block_case("measured.nml").ground["relief"] == found["relief"]


def test_a_patch_that_cannot_hold_the_waves_is_refused(place, capsys):
    patch_file("patch.tif", 12, 0.8)
    words = ["lab", "relief", "patch.tif"]
    refuses([*words, "--longest", "32"], "patch.tif: 25.6 m wide: .*use --longest 16", capsys)
    refuses([*words, "--shortest", "0.5"], "patch.tif: cells of 0.1 m: .*use --shortest 1", capsys)
    refuses([*words, "--radius", "0"], "--radius 0.0: must be > 0", capsys)
    refuses([*words, "--shortest", "16"], "--shortest 16.0: must be below --longest", capsys)


def test_flat_ground_is_flat():
    heights, _ = patches(Spectrum(0.0), 4, seed=1)
    assert not heights.any()


# ---- cases


def test_every_ground_that_is_shipped_runs():
    for ground in grounds():
        data = run_throws(
            BlockCase(lab={"ground": ground, "throws": 3, "contacts": 8}, block={"count": 2})
        )
        assert data.attrs["ground"] == ground
        assert data.attrs["unfinished"] == 0
        assert np.isfinite(data["energy_out"]).all()


def test_a_case_says_every_value_and_is_read_again(place):
    assert read_block_case("m.nml") == SMALL
    for group in GROUPS:
        assert f"&{group}" in SMALL.text()


def test_single_values_of_a_ground_can_be_changed():
    case = BlockCase(lab={"ground": "talus"}, ground={"friction": 0.7})
    assert case.ground["friction"] == 0.7
    assert case.ground["yield_pressure"] == grounds()["talus"]["yield_pressure"]
    other = case.replace(lab={"ground": "rock"}).ground
    assert other["friction"] == grounds()["rock"]["friction"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("&lab ground='medow' /", "&lab ground = 'medow': unknown; known: rock, compact"),
        ("&lab ground='' /", "&lab ground = ''"),
        ("&lab ground='meadow', shape='round' /", "&lab shape = 'round': unknown; known: compact"),
        ("&lab ground='meadow', trows=3 /", "&lab trows: unknown key (similar keys: throws"),
        ("&lab ground='meadow', throws=0 /", "throws = 0: must be 1 to"),
        ("&lab ground='meadow', ratios=1,2 /", "&lab ratios: unknown key"),
        ("&lab ground='meadow' / &packing depth=3 /", "&packing: unknown group"),
        ("&lab ground='meadow' / &ground friction=-1 /", "friction must be 0 to 5"),
        ("&lab ground='meadow' / &ground plough=3 /", "plough = 3: must be .true. or .false."),
        ("&lab ground='meadow' / &ground relief=60 /", "relief must be 0 (flat) to 45 degrees"),
        (
            "&lab ground='meadow' / &throw speed=5, 3, 9 /",
            "must be min, median and max, in this order",
        ),
        ("&lab ground='meadow' / &throw slope=5 /", "must be two values: min, max"),
        ("&lab ground='meadow' / &throw slope=5, 60 /", "slope must be min and max, 0 to 45"),
        ("&lab ground='meadow' / &block count=0 /", "count must be 1 to 10000"),
        ("&lab ground='meadow', shape='points' /", "need each other"),
        ("&lab ground='meadow' / &block points='p.csv' /", "need each other"),
        ("&lab ground='meadow', shape='axes' /", "&block axes = 0.5, 0.4, 0.3 need each other"),
        ("&lab ground='meadow' / &block axes=3, 2, 1 /", "need each other"),
        ("&lab ground='meadow', shape='axes' / &block axes=3, 1 /", "must be three lengths"),
        ("&lab ground='meadow', shape='axes' / &block axes=1, 0, 1 /", "must be > 0"),
        ("&lab ground='meadow', shape='axes' / &block axes=6, 1, 1 /", "at most five times"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(place, capsys, text, message):
    Path("bad.nml").write_text(text + "\n")
    refuses(["lab", "impact", "bad.nml"], f"bad.nml: .*{re.escape(message)}.*", capsys)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (CUBE[CUBE[:, 2] == 0], "span no volume"),
        ([(1, 1, 1)], "span no volume"),
        ([(1, 1, "a")], "z = a"),
    ],
)
def test_points_without_a_volume_are_refused(place, capsys, points, message):
    write_points("p.csv", points)
    Path("bad.nml").write_text("&lab ground='rock', shape='points' / &block points='p.csv' /\n")
    refuses(["lab", "impact", "bad.nml"], f"p.csv.*{re.escape(message)}.*", capsys)


def test_what_is_for_rocks_says_so(place, capsys):
    rule = (
        "&lab ground: is for `rockfall lab impact`, which throws blocks at it; "
        "this needs a case of rocks"
    )
    refuses(["lab", "pack", "m.nml"], f"m.nml: {rule}", capsys)
    refuses(["lab", "impact", "m.nml", "--resume"], "--resume: .* are not resumed", capsys)
    with refused(f"laboratory case: {rule}"):
        LabCase(lab={"ground": "meadow"})


def test_another_file_is_not_taken_for_contacts(place):
    xr.Dataset({"speed": ("contact", [1.0])}).to_netcdf("other.nc")
    with refused("other.nc: is not a file of contacts of the laboratory"):
        open_contacts("other.nc")


def test_the_summary_counts_all_contacts(place, capsys, data):
    assert main(["lab", "impact", "m.nml"]) == 0
    said = capsys.readouterr().out
    assert f"{data.sizes['contact']:,} contacts" in said
    for k, name in enumerate(EXITS):
        assert f"{int((data['exit'] == k).sum()):,} {name}" in said
    assert data["entry"].attrs["flag_meanings"].split() == [*ENTRIES]
