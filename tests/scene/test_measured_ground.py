# SPDX-License-Identifier: BSD-3-Clause
"""Ground from evidence: strength from scars, compared with the laboratory's, and relief from
surveyed patches."""

import csv
import math

import numpy as np
import pytest
from rasterio import Affine

import rockfall
from made import make_raster
from programs import ROOT
from rockfall.cli import main
from rockfall.errors import RockfallError
from rockfall.grounds import GroundTable, shipped_rows, yielding_ground
from rockfall.grounds.measured_ground import GRAVITY, scaled_strength
from rockfall.grounds.relief import CELLS, Spectrum, measure, patches, slope_between

SCAR = ["--depth", "0.2", "--mass", "780", "--fall", "10"]


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def patch_file(hurst=0.8, longest=16, slope=12.0):
    """Write elevations for blocks of R_b = 0.5 m: a patch of 32 m with cells of 0.125 m."""
    heights, width = patches(Spectrum(slope, 2, longest, hurst), 1, seed=3)
    cell = 2 * 0.5 * width / CELLS
    affine = Affine(cell, 0, 600000, 0, -cell, 5000000)
    make_raster("patch.tif", 0.5 * heights[::2, ::2, 0] + 2000, transform=affine)


def test_on_hard_ground_the_energy_is_strength_times_displaced_volume():
    head, depth = 12.0, 0.6
    displaced = np.pi * depth**2 * (1 - depth / 3)
    energy = 4 / 3 * np.pi * (head + depth)
    (found,) = scaled_strength(depth, head, 2700.0, "hard", "sphere")
    assert found == pytest.approx(energy / displaced, rel=0.02)


@pytest.mark.all
@pytest.mark.parametrize("shape", ["compact", "elongated", "platy"])
def test_scars_of_blocks_of_any_attitude_give_one_strength_back(shape):
    """Corners penetrate deeper, so that each attitude of a block leaves another scar in the same
    ground. The mean strength from all scars is the given strength; the scatter of single strengths
    is that of the attitudes."""
    radius, head = 0.5, 10.0
    depths = np.geomspace(0.1, 1.8, 15)
    scaled = np.array([scaled_strength(z, head, 2700.0, "ploughed", shape) for z in depths])
    given = np.exp(np.log(scaled[10]).mean())
    (ball,) = scaled_strength(depths[10], head, 2700.0, "ploughed", "sphere")
    assert 1.1 < given / ball < 2
    left = [np.exp(np.interp(-np.log(given), -np.log(by), np.log(depths))) for by in scaled.T]
    scar = {"volume": 4 / 3 * np.pi * radius**3, "fall": head * radius}
    ground = rockfall.measure_ground([scar | {"depth": z * radius} for z in left], shape=shape)
    strength = given * 2700 * GRAVITY * radius
    assert ground.strength == pytest.approx(strength, rel=0.15)
    assert np.log(ground.strengths).std() == pytest.approx(ground.attitude_sigma, rel=0.3)
    assert ground.strength_sigma < 0.5 * ground.attitude_sigma


def test_errors_of_depth_and_fall_are_propagated():
    def strength(depth, fall):
        scar = {"depth": depth, "mass": 780.0, "fall": fall}
        return math.log(rockfall.measure_ground([scar], shape="sphere").strength)

    scar = {"depth": 0.25, "mass": 780.0, "fall": 10.0, "depth_error": 0.01, "fall_error": 1.0}
    found = rockfall.measure_ground([scar], shape="sphere")
    by_depth = (strength(0.26, 10) - strength(0.24, 10)) / 2
    by_fall = (strength(0.25, 11) - strength(0.25, 9)) / 2
    assert by_depth < 0 < by_fall
    assert found.scar_errors == pytest.approx(math.hypot(by_depth, by_fall), rel=0.05)
    assert found.strength_error == pytest.approx(found.scar_errors[0])


def test_two_scars_have_a_median_and_a_scatter():
    scars = [{"depth": depth, "mass": 780.0, "fall": 10.0} for depth in (0.15, 0.3)]
    found = rockfall.measure_ground(scars, shape="sphere")
    low, high = sorted(found.strengths)
    sigma = math.log(high / low) / math.sqrt(2)
    assert found.strength == pytest.approx(math.sqrt(low * high))
    assert found.strength_sigma == pytest.approx(sigma)
    assert found.strength_error == pytest.approx(sigma / math.sqrt(2))
    read = [scar | {"depth_error": 0.03} for scar in scars]
    known = rockfall.measure_ground(read, shape="sphere")
    expected = math.sqrt(sigma**2 - np.mean(known.scar_errors**2))
    assert known.strength_sigma == pytest.approx(expected)
    assert known.strength_sigma < 0.98 * sigma


def test_strength_in_proportion_to_the_radius_is_that_of_the_mean_radius():
    scars = [{"depth": 0.25 * r, "speed": 8 * r**0.5, "volume": r**3} for r in (0.5, 2.0)]
    for scar, factor in zip(scars, (0.5, 2.0), strict=True):
        one = rockfall.measure_ground([scar], shape="sphere").strength
        first = rockfall.measure_ground(scars[:1], shape="sphere").strength
        assert one == pytest.approx(first * factor / 0.5)  # exact similarity
    found = rockfall.measure_ground(scars, shape="sphere", proportional=True)
    assert found.strength_sigma == pytest.approx(0, abs=1e-6)


def test_the_error_of_the_relief_is_its_scatter_between_patches():
    band, found = Spectrum(0, 2, 8), []
    for seed in range(6):
        heights, width = patches(Spectrum(14, 2, 8, 0.8), 1, seed=seed)
        for x in (0, CELLS // 2):
            for y in (0, CELLS // 2):
                part = heights[x : x + CELLS // 2 : 2, y : y + CELLS // 2 : 2, 0]
                found.append(measure(part, 2 * width / CELLS, 1.0, band, "patch"))
    slopes = np.array([spectrum.slope for spectrum, _ in found])
    assert slopes.mean() == pytest.approx(14, rel=0.05)
    assert np.mean([error for _, error in found]) == pytest.approx(slopes.std(), rel=0.5)


@pytest.mark.parametrize("hurst", [0.5, 0.8, 1.0])
def test_the_slope_of_other_waves_follows_from_hurst(hurst):
    narrow, wide = Spectrum(10, 2, 8, hurst), Spectrum(0, 2, 32)
    waves = np.geomspace(1 / 32, 1 / 2, 100001)
    density = waves ** (2 - 2 * hurst)  # variance of the slope by logarithm of the wavelength
    ratio = density[:-1].sum() / density[:-1][waves[:-1] >= 1 / 8].sum()
    expected = np.degrees(np.arctan(np.tan(np.radians(10)) * np.sqrt(ratio)))
    assert slope_between(narrow, wide) == pytest.approx(expected, rel=1e-3)
    assert slope_between(narrow, narrow) == pytest.approx(10)


def test_the_command_writes_a_row_and_adds_others(place, capsys):
    patch_file()
    words = ["ground", *SCAR, "--patch", "patch.tif", "--radius", "0.5", "--longest", "16"]
    words += ["-o", "own.csv"]
    assert main([*words, "--name", "first"]) == 0
    said = capsys.readouterr().out
    assert "Nearest shipped ground of this model:" in said
    assert "cannot separate a factor of 2 in strength from 4 to 5 degrees" in said
    assert main([*words, "--name", "second", "--rest-angle", "33"]) == 0
    assert list(GroundTable("own.csv").rows) == ["first", "second"]
    with open("own.csv", newline="") as file:
        first, second = csv.DictReader(file)
    assert first["strength"] == second["strength"]
    assert (first["model"], second["rest_angle"]) == ("ploughed", "33")
    assert float(first["relief"]) == pytest.approx(12, abs=3)  # with waves up to 32 R_b


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "needs scars for its strength, or a patch"),
        (["--depth", "29", *SCAR[2:]], "depth = 29.0: must be in m and at most the block"),
        ([*SCAR, "--depth", "nan"], "depth = nan: must be a number"),
        ([*SCAR, "--volume", "0.3"], "needs either mass or volume"),
        (SCAR[:4], "needs either fall or speed"),
        ([*SCAR, "--depth-error", "0.3"], "depth_error = 0.3: must be below depth"),
        ([*SCAR, "--speed-error", "0.3"], "speed_error = 0.3: needs speed"),
        ([*SCAR, "--depth", "0.1", "0.2", "--fall", "1", "2", "3"], "--depth: has 2 values"),
        ([*SCAR, "--model", "soft"], "model = 'soft': must be ploughed or hard"),
        ([*SCAR, "--shape", "cube"], "shape = 'cube': must be sphere"),
        ([*SCAR, "--rest-angle", "100"], "rest_angle = 100: must be 0 to 90"),
        ([*SCAR, "--longest", "1"], "waves from 2 to 1 R_b"),
        (SCAR, "own-ground: a row in a table of grounds requires a patch"),
        (["--patch", "no.tif", "--radius", "1"], "no.tif"),
    ],
)
def test_what_cannot_be_meant_is_refused(place, capsys, words, message):
    assert main(["ground", *words, "-o", "own.csv"]) == 2
    said = capsys.readouterr()
    assert message in said.err
    assert said.err.count("\n") == 1
    assert not said.out
    assert not (place / "own.csv").exists()


def test_tables_that_cannot_take_the_row_are_left_alone(place, capsys):
    patch_file()
    words = ["ground", *SCAR, "--patch", "patch.tif", "--radius", "0.5", "--longest", "16"]
    words += ["-o", "own.csv"]
    for text, message in (
        ("name,model,source\nroad,absorbs,me\n", "column strength, "),
        ("name,model,source\nown-ground,absorbs,me\n", "has a ground own-ground"),
        ("x,y\n1,2\n", "column x"),
    ):
        (place / "own.csv").write_text(text)
        assert main(words) == 2
        assert message in capsys.readouterr().err
        assert (place / "own.csv").read_text() == text


def test_a_table_of_scars(place):
    (place / "scars.csv").write_text("depth,mass,fall\n0.2,780,10\n0.25,500,12\n")
    assert len(rockfall.measure_ground("scars.csv").strengths) == 2
    (place / "scars.csv").write_text("depth,weight,fall\n0.2,780,10\n")
    with pytest.raises(RockfallError, match="column weight: must be"):
        rockfall.measure_ground("scars.csv")


@pytest.mark.family(2)
@pytest.mark.parametrize("name", shipped_rows().yielding)
def test_scars_on_the_page_of_grounds_are_those_of_their_strengths(name):
    """The scar on the page, in whole centimetres, is that of a block of R_b = 0.4 m after a fall of
    1 m."""
    page = (ROOT / "docs" / "impact_tables.md").read_text(encoding="utf-8")
    (row,) = (line for line in page.splitlines() if line.startswith(f"| `{name}` |"))
    depth, radius = float(row.split("|")[-2]) / 100, 0.4
    model, ground = yielding_ground(shipped_rows().rows[name])
    strength = ground.strength * (radius / (ground.strength_radius or radius))
    scar = {"volume": 4 / 3 * np.pi * radius**3, "density": 2700.0, "fall": 1.0}
    high, low = (
        rockfall.measure_ground([scar | {"depth": depth + off}], model=model).strength
        for off in (-0.005, 0.005)
    )
    assert low <= strength <= high
