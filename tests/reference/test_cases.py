# SPDX-License-Identifier: BSD-3-Clause
"""Cases: their scripts reproduce their files, and results agree with their READMEs."""

import csv
import importlib.util
import shutil
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import rasterio

import rockfall
from rockfall.analysis.objects.at_risk import AtRisk
from rockfall.case import read_case
from rockfall.case.text import read_values
from rockfall.evidence import only
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.result.crossings import at_lines, has_crossed
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible
from rockfall.studies.hazard import read_study, run_study

CASES = Path(__file__).parents[2] / "cases"
VAUJANY, PLANE = CASES / "vaujany", CASES / "plane"
ROAD = CASES / "protected-road"
RELEASE_Y = 587.5


def read(path: Path):
    return read_values(path.read_bytes(), str(path)).groups


def script(path: Path):
    spec = importlib.util.spec_from_file_location(f"{path.parent.name}_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def slope():
    """Profile of the Vaujany slope: plan distances from its top, and elevations averaged across it
    [m]."""
    with rasterio.open(VAUJANY / "dem.tif") as file:
        elevation = file.read(1).mean(axis=1, dtype="f8")
    return 2.5 * (np.arange(240) + 0.5), elevation


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
        case = read_case(VAUJANY / name)
        assert case.release["y"] == [RELEASE_Y]
        for line, along in zip(case.line, (185, 235), strict=True):
            assert line["x"] == [1.25, 198.75]  # from the first to the last cell centre
            plan = RELEASE_Y - line["y"][0]
            assert plan == pytest.approx(along * np.cos(np.radians(38)), abs=0.01)
            top, level = np.interp([600 - RELEASE_Y, 600 - line["y"][0]], s, z)
            assert np.hypot(plan, top - level) == pytest.approx(along, rel=0.015)


def test_vaujany_zones_all_have_rows():
    with open(VAUJANY / "zones.csv", encoding="utf-8") as file:
        rows = {int(row["zone"]): row for row in csv.DictReader(file)}
    assert sorted(rows) == list(range(1, 15))
    with rasterio.open(VAUJANY / "zones.tif") as file:
        assert set(np.unique(file.read(1))) <= set(rows)
    assert float(rows[2]["mean_radius"]) == np.inf


def test_vaujany_cases_differ_by_the_method_only():
    paths = (VAUJANY / name for name in ("case_A.nml", "case.nml"))
    a, b = ({group.name: group.given for group in read(path)} for path in paths)
    assert (a["surface"].pop("method"), b["surface"].pop("method")) == ("A", "B")
    assert a["case"].pop("title") != b["case"].pop("title")
    assert a["surface"].pop("rg_reading") == "radius"  # method B has none
    assert a == b


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
    sets = [impact_set.given for impact_set in read(PLANE / "plane.nml")]
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
    assert 200 < found.distance[-1] < 379  # up to the end of the plane


@pytest.fixture(scope="module")
def protected(tmp_path_factory):
    """Results for the road without protection, with a net and with a dam, by case name."""
    folder = tmp_path_factory.mktemp("road")
    terrain = script(ROAD / "make_terrain.py")
    terrain.write(folder / "dem.asc")
    terrain.write(folder / "dem_fine.asc", fine=True)
    results = {}
    for name in ("road", "net", "dam"):
        case = rockfall.read_case(shutil.copy(ROAD / f"{name}.nml", folder))
        assert implausible(read_scene(case)) == []
        results[name] = rockfall.run(case)
    return results


@pytest.mark.all
def test_the_road_is_reached_as_often_as_its_readme_says(protected):
    """Percentages are within four standard deviations, for a single run, of those in the README."""
    for name, percent, error in (("road", 57.6, 0.2), ("net", 2.77, 0.06), ("dam", 7.6, 0.2)):
        reached = 100 * np.isfinite(at_lines(protected[name])["line_speed"].values[0]).mean()
        assert reached == pytest.approx(percent, abs=4 * error * np.sqrt(6))


@pytest.mark.all
def test_the_net_changes_nothing_above_it(protected):
    above = [
        at_lines(protected[name])["line_energy_translational"].values[1] for name in ("road", "net")
    ]
    np.testing.assert_array_equal(*above)
    stopped = at_lines(protected["net"])["barrier_outcome"].values[1] == 1
    assert not np.isfinite(at_lines(protected["net"])["line_speed"].values[0][stopped]).any()


@pytest.mark.all
def test_settlement_is_what_its_readme_says(tmp_path):
    """The settlement has two faces as sources, a gully, a flat fan and ten objects; its case is a
    hazard."""
    folder = CASES / "settlement"
    made = script(folder / "make_terrain.py")
    z, zones = made.elevation(), made.zones()
    write_geotiff(tmp_path / "dem.tif", z, made.GRID)
    write_geotiff(tmp_path / "zones.tif", zones, made.GRID)
    for name in "case.nml", "zones.csv", "objects.geojson":
        shutil.copy(folder / name, tmp_path)
    case = rockfall.read_case(tmp_path / "case.nml").replace(case={"boulders": 2})
    study = read_study(case, AtRisk(tmp_path / "objects.geojson"))
    assert z.shape == (150, 110) and study.scene.x.size == 386
    assert ((study.scene.x > 60) & (study.scene.x < 390)).all() and study.scene.y.min() > 500
    area = 16 * study.scene.area.sum() / 1e6  # [km2]
    assert study.scenarios[0].frequency == pytest.approx(200 * area) == pytest.approx(2.17, 1e-3)
    assert study.scenarios[2].frequency == 1 / 80
    assert len(study.objects) == 10 and {*np.unique(zones)} == {1, 2, 3, 4, 5}
    found = run_study(study)
    assert {rule.name for rule in study.scene.grounds} >= {
        "rock",
        "talus",
        "vegetated-soil",
        "meadow",
    }
    assert found.object_frequency.values[study.objects.names.index("road")] == pytest.approx(
        1.6, 0.1
    )
    assert {*np.unique(found.hazard_class.values)} >= {0, 1, 3, 4}


@pytest.mark.all
def test_the_forested_slope_is_as_its_readme_says(tmp_path):
    """Percentages are within four standard deviations, for a single run, of those in the README."""
    place = CASES / "forested-slope"
    script(place / "make_terrain.py").write(tmp_path)
    known = {"bare": (98.7, 0.048), "forest": (69.6, 1.1), "forest-and-net": (13.8, 0.28)}
    shutil.copy(place / "zones.csv", tmp_path)
    for name, (percent, error) in known.items():
        case = rockfall.read_case(shutil.copy(place / f"{name}.nml", tmp_path))
        reached = 100 * has_crossed(rockfall.run(case), 0).mean()
        assert reached == pytest.approx(percent, abs=4 * error * np.sqrt(6)), name


def test_the_forest_experiment_is_as_the_table_of_evidence_says(tmp_path):
    """One run is within five standard deviations of the mean of 40 stored runs, which `expected.py
    --write` repeats."""
    place = CASES / "vaujany-forest"
    script(place / "make_terrain.py").write(tmp_path)
    expected = script(place / "expected.py")
    for name in expected.CASES:
        case = rockfall.read_case(shutil.copy(place / f"{name}.nml", tmp_path))
        found = expected.numbers(rockfall.run(case))
        for number, (quantity, (_, printed)) in zip(
            found, expected.QUANTITIES.items(), strict=True
        ):
            known = only("vaujany-forest", name, quantity, case.impact["sets"])
            assert known.observed == printed[name]
            apart = 5 * known.simulated_error * np.sqrt(40)
            assert number == pytest.approx(known.simulated, abs=apart), (quantity, name)
