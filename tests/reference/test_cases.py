# SPDX-License-Identifier: BSD-3-Clause
"""The cases: their files are those their scripts make, and hold the facts their READMEs state."""

import csv
import importlib.util
from fractions import Fraction
from pathlib import Path

import f90nml
import numpy as np
import pytest
import rasterio

import rockfall
from rockfall.lab import talus
from rockfall.lab.talus import Talus

CASES = Path(__file__).parents[2] / "cases"
VAUJANY, PLANE = CASES / "vaujany", CASES / "plane"
RELEASE_Y = 587.5


def script(path: Path):
    """A script of a case as a module."""
    spec = importlib.util.spec_from_file_location(f"{path.parent.name}_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def slope():
    """Profile of the Vaujany slope: plan distance from its top, mean elevation across [m]."""
    with rasterio.open(VAUJANY / "dem.tif") as file:
        elevation = file.read(1).mean(axis=1, dtype="f8")
    return 2.5 * (np.arange(240) + 0.5), elevation


def test_vaujany_rasters_are_those_of_the_script():
    elevation, zones = Talus().elevation(), talus.zones()
    with rasterio.open(VAUJANY / "dem.tif") as dem, rasterio.open(VAUJANY / "zones.tif") as ids:
        assert np.abs(dem.read(1) - elevation).max() < 1e-4
        assert (ids.read(1) == zones).all()
        assert dem.transform == ids.transform == rasterio.Affine(2.5, 0, 0, 0, -2.5, 600)
        assert dem.crs is None


def test_vaujany_mean_gradient_is_38_degrees(slope):
    s, z = slope
    talus = (s > 12.5) & (s < 330)
    angle = np.degrees(np.arctan(-np.gradient(z, s)[talus]))
    assert np.median(angle) == pytest.approx(38, abs=0.3)
    upper = np.interp([12.5, 330], s, z)
    assert np.degrees(np.arctan2(upper[0] - upper[1], 317.5)) == pytest.approx(38, abs=1)  # roads


def test_vaujany_lines_lie_185_and_235_m_down_the_slope(slope):
    s, z = slope
    for name in "case.nml", "case_A.nml":
        case = f90nml.read(VAUJANY / name)
        assert case["release"]["y"] == RELEASE_Y
        for line, along in zip(case["line"], (185, 235), strict=True):
            assert line["x"] == [1.25, 198.75]  # from the first to the last cell centre
            plan = RELEASE_Y - line["y"][0]
            assert plan == pytest.approx(along * np.cos(np.radians(38)), abs=0.01)
            top, level = np.interp([600 - RELEASE_Y, 600 - line["y"][0]], s, z)
            assert np.hypot(plan, top - level) == pytest.approx(along, rel=0.015)


def test_vaujany_channel_roads_and_river():
    s = np.array([150.0, 151.0])
    assert -np.diff(Talus().profile(s))[0] == pytest.approx(np.tan(np.radians(38)), rel=1e-3)
    for centre, width in talus.ROADS.values():
        across = Talus().profile(np.array([centre - 0.4 * width, centre + 0.4 * width]))
        assert 0 < across[0] - across[1] < 0.1 * width
    zones = talus.zones()
    assert (zones == 2).any(axis=0).all()  # the river crosses from edge to edge
    assert {1, 3, 4, 5, 10, 11, 12, 14} <= set(np.unique(zones))


def test_vaujany_relief_is_no_part_of_the_mean():
    relief = Talus().rough()
    assert relief.std() == pytest.approx(0.3) and abs(relief.mean()) < 1e-12
    assert np.abs(np.diff(relief, axis=0)).max() < 1  # filtered, not white


def test_what_is_not_known_of_the_slope_of_vaujany_changes_it_alone():
    z, smooth = Talus().elevation(), Talus(relief=0)
    assert (Talus(seed=2).elevation() - z).std() > 0.3
    assert np.abs(Talus(relief=0.6).rough() - 2 * Talus().rough()).max() < 1e-12
    deep = smooth.elevation() - Talus(relief=0, channel=1.0).elevation()
    assert deep.min() == pytest.approx(-1, abs=0.05) and abs(deep.max()) < 1e-4
    level = Talus(roads=1.0).profile(np.array([88.5, 91.5]))
    assert level[0] == level[1]
    assert (Talus(roads=0.0).profile(s := np.arange(600.0)) == Talus().natural(s)).all()


def test_vaujany_zones_all_have_rows():
    with open(VAUJANY / "zones.csv", encoding="utf-8") as file:
        rows = {int(row["zone"]): row for row in csv.DictReader(file)}
    assert sorted(rows) == list(range(1, 15))
    with rasterio.open(VAUJANY / "zones.tif") as file:
        assert set(np.unique(file.read(1))) <= set(rows)
    assert [rows[3][k] for k in ("mean_radius", "rg70", "rg20", "rg10")] == [
        "0.18",
        "0.30",
        "0.10",
        "0.45",
    ]
    assert float(rows[2]["mean_radius"]) == np.inf


def test_vaujany_cases_differ_by_the_method_only():
    a, b = (f90nml.read(VAUJANY / name).todict() for name in ("case_A.nml", "case.nml"))
    assert (a["surface"].pop("method"), b["surface"].pop("method")) == ("A", "B")
    assert a["case"].pop("title") != b["case"].pop("title")
    assert a == b


def test_paper_holds_every_number_of_table_2():
    with open(VAUJANY / "paper.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    table = {(r["line"], r["method"], r["quantity"]) for r in rows if r["max"]}
    assert len(table) == 2 * 3 * 3
    speeds = {(r["line"], r["method"]): r["mean"] for r in rows if r["quantity"] == "speed"}
    assert speeds["EL1", "B"] == "12.7" and speeds["EL2", "B"] == "12.1"


def test_plane_is_exactly_plane():
    made = script(PLANE / "make_terrain.py")
    lines = (PLANE / "dem.asc").read_text().split("\n")
    assert lines[0].split() == ["ncols", "400"] and lines[4].split() == ["cellsize", "1"]
    rows = set(lines[6:46])
    assert len(rows) == 1 and lines[46:] == [""]
    row = [Fraction(float(text)) for text in rows.pop().split()]
    assert len(row) == made.NX
    assert {a - b for a, b in zip(row, row[1:], strict=False)} == {Fraction(made.GRADIENT)}
    assert row[0] == Fraction(made.TOP) - Fraction(made.GRADIENT) / 2
    assert np.degrees(np.arctan(made.GRADIENT)) == pytest.approx(30, abs=1e-10)


def test_plane_matrix_is_that_of_the_closed_form_and_never_adds_energy():
    matrix = script(PLANE / "closed_form.py").MATRIX
    sets = f90nml.read(PLANE / "plane.nml")["impact_set"]
    assert [s["ratio"] for s in sets] == [1, 2, 3, 4, 5]
    for s in sets:
        assert np.array_equal(np.reshape(s["mean"], (3, 3)), matrix)
        assert s["covariance"] == 45 * [0.0]
    weight = np.sqrt([1, 1, 0.4])  # V_t^2 + V_n^2 + 2/5 W^2
    assert np.linalg.norm(weight[:, None] * matrix / weight, 2) < 1


def test_plane_closed_form_agrees_with_a_parabola_followed_in_space():
    made, theory = script(PLANE / "make_terrain.py"), script(PLANE / "closed_form.py")
    found = theory.contacts(100, made.GRADIENT, 2.0)
    p, g = made.GRADIENT, theory.GRAVITY
    along, normal = np.array([1, -p]) / np.hypot(1, p), np.array([p, 1]) / np.hypot(1, p)
    x, t, velocity, spin = 0.0, np.sqrt(4 / g), np.array([0, -np.sqrt(4 * g)]), 0.0
    for k in range(100):
        assert (found.distance[k], found.time[k]) == pytest.approx((x, t), rel=1e-11)
        v_t, v_n, spin = theory.MATRIX @ [velocity @ along, velocity @ normal, spin]
        assert v_n > 0 and v_t > 0
        velocity = v_t * along + v_n * normal
        flight = 2 * (velocity[1] + p * velocity[0]) / g  # z0 + vz t - g t^2/2 = z0 - p vx t
        x, t, velocity = x + velocity[0] * flight, t + flight, velocity - [0, g * flight]
    assert 200 < found.distance[-1] < 379  # to the end of the plane


def test_plane_run_follows_the_closed_form():
    made, theory = script(PLANE / "make_terrain.py"), script(PLANE / "closed_form.py")
    expected = theory.contacts(100, made.GRADIENT, 2.0)
    result = rockfall.run(rockfall.read_case(PLANE / "case.nml"))
    assert int(result["impacts"][0]) == 100
    x = result["trajectory_x"].values
    assert np.allclose(x[1:101] - 20, expected.distance, rtol=1e-10, atol=1e-10)
    assert np.allclose(result["trajectory_time"].values[1:101], expected.time, rtol=1e-10)
    assert np.abs(result["trajectory_y"].values - 20).max() < 1e-9
    assert int(result["rebounds_redrawn"]) == int(result["rebounds_forced"]) == 0
