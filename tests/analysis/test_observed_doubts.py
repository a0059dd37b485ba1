# SPDX-License-Identifier: BSD-3-Clause
"""Observations in other units, or with x and y exchanged, are reported; correct data are not."""

import numpy as np
import pytest

import rockfall
from made import every_third, make_raster, refused
from rockfall.analysis.observed.compare import compare
from rockfall.analysis.observed.observations import read_observed
from rockfall.analysis.observed.ranks import rank_results
from rockfall.result.crossings import line_values
from rockfall.studies.validation import validate
from scenes import grid, make_case, rough, sets

WEST, SOUTH = 600_000.0, 5_000_000.0
Z = rough()


def site_of(folder):
    """Boulders that pass a line, in UTM coordinates."""
    line = [{"name": "S", "x": [WEST, WEST + 300.0], "y": [SOUTH + 280.0] * 2}]
    release = {"x": WEST + 150.0, "y": SOUTH + 380.0}
    return make_case(
        folder, *sets(), line=line, case={"boulders": 600}, terrain={}, release=release,
        output={"maps": "passages"},
    )  # fmt: skip


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return site_of(tmp_path_factory.mktemp("observed"))


@pytest.fixture(scope="module")
def result(case):
    return rockfall.run(case, dem=Z, transform=grid(Z).moved(WEST, SOUTH))


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def file(head, *rows, name="o.csv"):
    with open(name, "w") as out:
        out.write("\n".join([head, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return name


def doubts(result, path):
    return [note for note in compare(result, path).notes if note.endswith("?")]


RATIOS = {  # ratio of written to observed values
    "km/h": ("speed", "m/s", 3.6, "km/h"),
    "km/h, of a model that is 30 % off": ("speed", "m/s", 3.6 * 1.3, "km/h"),
    "m/s": ("speed", "m/s", 1.0, None),
    "m/s, of a model that is a half off": ("speed", "m/s", 1.5, None),
    "m/s, of a slow model": ("speed", "m/s", 0.5, None),
    "height in feet": ("passing_height", "m", 3.28, "ft"),
    "height in cm": ("passing_height", "m", 100.0, "cm"),
    "height in mm": ("jump_height", "m", 1000.0, "mm"),
    "height": ("passing_height", "m", 1.8, None),
    "rpm": ("omega", "rad/s", 9.55, "rpm"),
    "degrees a second": ("omega", "rad/s", 57.3, "degree/s"),
    "J as kJ": ("energy_total", "kJ", 1000.0, "J"),
    "kJ as J": ("energy_translational", "J", 1e-3, "MJ"),
    "MJ as kJ": ("energy_rotational", "kJ", 1e-3, "MJ"),
    "energy": ("energy_total", "J", 4.0, None),
}


@pytest.mark.parametrize("kind", ["samples", "means"])
@pytest.mark.parametrize("what", every_third(RATIOS))
def test_another_unit_at_a_line_is_named(what, kind, result):
    quantity, unit, ratio, other = RATIOS[what]
    values = line_values(result, quantity, 0)
    values = values[np.isfinite(values)] * ratio / (1000.0 if unit == "kJ" else 1.0)
    row = ("S", quantity, unit)
    if kind == "samples":
        path = file("line,quantity,unit,value", *((*row, value) for value in values[:50]))
    else:
        path = file("line,quantity,unit,mean,max", (*row, values.mean(), values.max()))
    found = doubts(result, path)
    assert len(found) == bool(other)
    if other:
        assert found[0].startswith("S: ")
        assert found[0].endswith(f" simulated ones: are they in {other}?")


@pytest.mark.family(2)
@pytest.mark.parametrize("ratio, other", [
    (1.0, None), (1.4, None), (0.6, None), (3.28, "ft"), (1e-3, "km"),
])  # fmt: skip
def test_another_unit_of_a_distance_is_named(ratio, other, result):
    ours = np.sort(result["plan_distance"].values)
    text = f"times the simulated ones: are they in {other}?"
    paths = [
        file("distance", *((value,) for value in ours[::10] * ratio)),
        file("distance,percent", *((np.quantile(ours, 1 - part / 100) * ratio, part)
             for part in (95, 60, 30, 5)), name="passing.csv"),
    ]  # fmt: skip
    for path in paths:
        found = doubts(result, path)
        assert len(found) == bool(other) and all(text in line for line in found)


@pytest.mark.parametrize("height, dbh, told", [
    (1.2, 38, None), (120, 38, "An observed mark is 120 m above the ground: is the value in cm?"),
    (1.2, 0.38, "An observed tree has a diameter of 0.38 cm: is the value in m?"),
    (1.2, 380, "An observed tree has a diameter of 380 cm: is the value in mm?"), ("", "", None),
])  # fmt: skip
def test_marks_at_trees_in_another_unit_are_told(height, dbh, told, result):
    path = file("impact,x,y,height,dbh", ("T1", WEST + 150, SOUTH + 300, height, dbh))
    assert doubts(result, path) == ([told] if told else [])


@pytest.mark.parametrize("volume, told", [
    (0.8, None), ("", None), (100, None),
    (800, "An observed block has 800 m3: is the value in dm3 (litres)?"),
])  # fmt: skip
def test_blocks_in_litres_are_told(volume, told, result):
    places = [(WEST + 150 + k, SOUTH + 200, volume) for k in range(3)]
    assert doubts(result, file("x,y,volume", *places)) == ([told] if told else [])


STOP = f"x = {SOUTH + 200:.10g}, y = {WEST + 150:.10g}"
EXCHANGED = "places lie on the terrain with x and y exchanged: exchange the columns"


@pytest.mark.parametrize("head, rows, where", [
    ("x,y", [(SOUTH + 200, WEST + 150)], "line 2: {}: 1 of 1"),
    ("x,y", [(WEST + 150, SOUTH + 200), (SOUTH + 200, WEST + 150)], "line 3: {}: 1 of 2"),
    ("impact,x,y", [("T", SOUTH + 200, WEST + 150)], "line 2: {}: 1 of 1"),
    ("y,x", [(WEST + 150, SOUTH + 200)], "line 2: {}: 1 of 1"),
])  # fmt: skip
def test_places_with_x_and_y_exchanged_are_refused(head, rows, where, result):
    path = file(head, *rows)
    message = f"o.csv: {where.format(STOP)} {EXCHANGED}"
    with refused(message):
        compare(result, path)
    with refused(message):
        rank_results({"a": result, "b": result}, read_observed(path))


def test_a_validation_refuses_them_before_its_runs(tmp_path):
    make_raster(tmp_path / "dem.tif", Z, grid(Z).moved(WEST, SOUTH).transform)
    own = site_of(tmp_path).replace(terrain={"dem": "dem.tif"})
    seen = read_observed(file("x,y", (SOUTH + 200, WEST + 150)))
    with refused(f"o.csv: line 2: {STOP}: 1 of 1 {EXCHANGED}"):
        validate(own, seen)


@pytest.mark.parametrize("x, y", [
    (WEST + 150, SOUTH + 200), (WEST - 900, SOUTH + 200), (WEST + 150, SOUTH - 3000),
    (SOUTH, SOUTH),
])  # fmt: skip
def test_other_places_are_not(x, y, result):
    compare(result, file("x,y", *((x + k, y) for k in range(3))))


def test_local_coordinates_cannot_tell(tmp_path):
    """Positions off the terrain give no warning if x and y have similar values."""
    line = [{"name": "S", "x": [0.0, 300.0], "y": [280.0] * 2}]
    case = make_case(
        tmp_path, *sets(), line=line, case={"boulders": 50}, terrain={},
        release={"x": 150.0, "y": 380.0},
    )  # fmt: skip
    made = rockfall.run(case, dem=Z, transform=grid(Z))
    compare(made, file("x,y", (350.0, 120.0), (380.0, 150.0)))
