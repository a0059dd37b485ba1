# SPDX-License-Identifier: BSD-3-Clause
"""Surveyed points that are probably mistakes give one line each; correct surveys give none."""

import re

import numpy as np
import pytest

from made import PLACE, make_raster
from rockfall.cli import main
from rockfall.draft.dem import dem_of_points, edited, read_source
from rockfall.errors import RockfallError

EAST, NORTH = 2_600_000.0, 1_200_000.0
SIDE = 150.0  # side of the survey [m]


def survey(seed=3, n=900):
    """Random points on a slope of 37 degrees with a cliff of 40 m, a terrace and noise of 5 cm."""
    random = np.random.default_rng(seed)
    x, y = random.uniform(0, SIDE, (2, n))
    z = 800.0 + 0.75 * y + 40.0 * (y > 90) - 10.0 * (x > 70) * (y < 50) + random.normal(0, 0.05, n)
    return np.stack([EAST + x, NORTH + y, z], axis=1)


def write(folder, points):
    path = folder / "points.csv"
    path.write_text("x,y,z\n" + "".join(f"{x!r},{y!r},{z!r}\n" for x, y, z in points.tolist()))
    return path


def more(*rows):
    """Function that adds points, given in metres from the corner of the survey, to an array."""
    extra = np.array(rows, float) + (EAST, NORTH, 0.0)
    return lambda points: np.concatenate([points, extra])


def scaled(factor, offset=0.0):
    return lambda points: points * (1.0, 1.0, factor) + (0.0, 0.0, offset)


MISTAKES = {
    "z in feet": (scaled(1 / 0.3048), {}, "half of the terrain is steeper than 6. degrees: are"),
    "z in feet, near the sea": (scaled(1 / 0.3048, -2600.0), {}, "half of the terrain is steeper"),
    "z in cm, near the sea": (scaled(100.0, -80_000.0), {}, "elevations from -[0-9.]+ to 1[0-9.]+"),
    "z in dm": (scaled(10.0, -5000.0), {}, "half of the terrain is steeper than 8. degrees: are"),
    "x and y in km": (lambda p: p * (1e-3, 1e-3, 1.0), {}, "half of the terrain is steeper than 9"),
    "0 for missing": (more((40, 40, 0)), {}, "elevation 0 m in 1 of 901 points, 7.. m below all o"),
    "0 for missing, thrice": (more((40, 40, 0), (60, 60, 0), (70, 70, 0)), {},
        "elevation 0 m in 3 of 903 points, 7.. m below all others: remove these points, or "
        "declare"),
    "-1 for missing": (more((40, 40, -1)), {}, "elevation -1 m in 1 of 901 points, 7.. m below al"),
    "-99 for missing": (more((40, 40, -99)), {}, "elevation -99 m in 1 of 901 points, 8.. m below"),
    "a satellite": (more((40, 40, 5000)), {}, "elevation 5000 m in 1 of 901 points, 4,0.. m above"),
    "z in feet of one": (more((40, 40, 2723)), {}, "elevation 2723 m in 1 of 901 points, 1,7.. m "),
    "a bird": (more((40, 40, 880)), {}, "1 points are isolated spikes or pits, the largest of "
                                        "[3-6]. m at 2600040, 1200040: remove them"),
    "a multipath": (more((40, 120, 830)), {}, "1 points are isolated .* 2600040, 1200120: "),
    "birds": (more((40, 40, 880), (90, 20, 870)), {}, "2 points are isolated"),
    "two surveys": (more((40, 40, 828), (40, 40, 836)), {}, "1 places have several points, up to "
        "8 m apart in height: their mean is used, so remove wrong"),
    "a survey of another datum": (lambda p: np.concatenate([p, p[:100] + (0, 0, 49.3)]), {},
        "100 places have several points, up to 49.3 m apart in height"),
    "--cell in cm": (scaled(1.0), {"cell": 60.0}, "cells of 60 m from points 4.[89]. m apart los"),
    "--cell of a laboratory": (scaled(1.0), {"cell": 0.4}, "cells of 0.4 m add nothing to points "),
}  # fmt: skip


@pytest.mark.family(2)
@pytest.mark.parametrize("what", MISTAKES)
def test_a_mistake_gives_its_line_and_no_other(what, tmp_path):
    change, options, words = MISTAKES[what]
    _, made = dem_of_points(write(tmp_path, change(survey())), **options)
    (line,) = made.remarks
    assert line.startswith(f"{tmp_path / 'points.csv'}: ")
    assert re.search(words, line), line


@pytest.mark.family(3)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("options", [{}, {"cell": 1.0}, {"cell": 15.0}, {"within": 50.0}])
def test_sound_surveys_give_none(seed, options, tmp_path):
    """Cliffs, repeated points and survey errors give no remark."""
    points = survey(seed)
    points = np.concatenate([points, points[:9], points[9:12] + (0.0, 0.0, 0.3)])
    assert dem_of_points(write(tmp_path, points), **options)[1].remarks == ()


@pytest.mark.parametrize(("cell", "message"), [
    (200.0, "--cell 200: the points cover 149.8 x 149.7 m: must be at most half of this extent"),
    (80.0, "--cell 80: the points cover"),
    (0.04, "--cell 0.04: points are 4.99 m apart: must be at least 0.0499"),
    (1e-9, "--cell 1e-09: points are 4.99 m apart: must be at least 0.0499"),
])  # fmt: skip
def test_cells_that_cannot_be_are_refused(cell, message, tmp_path):
    with pytest.raises(RockfallError, match=message):
        dem_of_points(write(tmp_path, survey()), cell=cell)


def test_a_grid_of_nodes_is_doubted_too(tmp_path):
    x, y = np.meshgrid(EAST + 2.0 * np.arange(30), NORTH - 2.0 * np.arange(30))
    points = np.stack([x, y, (900 - 0.75 * (NORTH - y)) / 0.3048], axis=-1).reshape(-1, 3)
    _, made = dem_of_points(write(tmp_path, points))
    assert made.nodes is not None and "steeper than 68 degrees" in made.remarks[0]
    points[17, 2] = 0.0
    _, made = dem_of_points(write(tmp_path, points))
    assert "elevation 0 m in 1 of 900 points, 2,810 m below all others" in made.remarks[0]


def quarry():
    """Slope with a quarry 10 m deep, a pit of 1 m, and a hole of 20 x 20 cells."""
    z = 800.0 - 2.0 * np.arange(60.0)[:, None] + np.zeros(60)
    z[10:20, 10:20] = z[10:20, 10:20].min() - 12.0
    z[40, 40] -= 3.0
    z[25:45, 15:35] = np.nan
    return z


@pytest.mark.parametrize(("steps", "words"), [
    ([("pits", 1.5)], None),
    ([("pits", 100.0)], "--pits 100: raises 10[01] cells by up to 10 m and also fills ditches"),
    ([("fill", 40.0)], None),
    ([("fill", 500.0)], "--fill 500: fills 400 cells from up to 500 m away, where the terr"),
    ([("smooth", 4.0)], None),
    ([("smooth", 50.0)], "--smooth 50: smooths over 25 cells, and removes edges, ditches and d"),
])  # fmt: skip
def test_edits_in_another_unit_are_told(steps, words, tmp_path):
    make_raster(tmp_path / "dem.tif", quarry(), PLACE * PLACE.scale(0.4))
    remarks = []
    edited(read_source(tmp_path / "dem.tif"), steps, remarks)
    assert len(remarks) == bool(words)
    assert not words or re.match(words, remarks[0]), remarks


def test_the_command_warns_and_refuses_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, more((40, 40, 0))(survey()))
    assert main(["dem", "points.csv", "-o", "a.tif", "--crs", "EPSG:2056"]) == 0
    assert capsys.readouterr().err.startswith(
        "rockfall: warning: points.csv: elevation 0 m in 1 of"
    )
    assert main(["dem", "points.csv", "-o", "b.tif", "--cell", "200"]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not (tmp_path / "b.tif").exists()
