# SPDX-License-Identifier: BSD-3-Clause
"""Extreme scenes and stiff impact sets: properties that must always hold, as in the benchmark."""

from fractions import Fraction

import numpy as np
import pytest

import rockfall
import scenes as made_scenes
from benchmarks.stability import extremes, stability
from made import every_third
from rockfall.errors import RockfallError

SCENES = {scene.name: scene for scene in extremes.scenes()}


def broken(rows):
    return [row for row in rows if not row.holds]


@pytest.mark.family(2)
@pytest.mark.parametrize("name", every_third(SCENES))
def test_scenes_hold(name, tmp_path):
    """Boulders have an expected status, no NaN and no gain of energy; flights follow their
    parabolas."""
    scene = SCENES[name]
    case, result = stability.run(scene, tmp_path, boulders=120)
    rows = stability.check(scene, case, result)
    assert len(rows) == 2 and not broken(rows)
    assert int(result.impacts.sum()) > 20
    recorded = np.unique(result.trajectory_boulder.values)
    assert recorded.size == 100
    off = [first_flight_off(scene, result, number) for number in recorded[::12]]
    assert max(off) <= stability.UNITS * extremes.EPSILON * scene.size(case)


def first_flight_off(scene, result, number):
    """Maximum depth of a boulder's first flight below the ground, or distance of its end from the
    parabola [m], in exact fractions."""
    start, end = np.flatnonzero(result.trajectory_boulder.values == number)[:2]
    columns = {name: result[f"trajectory_{name}"].values for name in ("x", "y", "z", "time")}
    x0, y0 = scene.grid.west + scene.grid.cell / 2, scene.grid.south + scene.grid.cell / 2
    shift = [x0, y0, 0.0]
    p, q = (
        [Fraction(float(columns[axis][k] - s)) for axis, s in zip("xyz", shift, strict=True)]
        for k in (start, end)
    )
    v = [Fraction(float(result[f"trajectory_velocity_{axis}"].values[start])) for axis in "xyz"]
    time, g = Fraction(float(columns["time"][end])), Fraction(scene.gravity)

    def place(t):
        return p[0] + v[0] * t, p[1] + v[1] * t, p[2] + v[2] * t - g * t * t / 2

    def above(t, column, row):
        x, y, z = place(t)
        return z - height(scene, x / cell, y / cell, column, row)

    cell = Fraction(scene.cell)
    off = max(abs(float(a - b)) for a, b in zip(place(time), q, strict=True))
    times = sides(p[0], v[0], cell, time) + sides(p[1], v[1], cell, time)
    times = sorted({Fraction(0), *times, time})
    for t0, t1 in zip(times[:-1], times[1:], strict=True):
        x, y, _ = place((t0 + t1) / 2)
        column = min(int(x // cell), scene.z.shape[1] - 2)
        row = min(int(y // cell), scene.z.shape[0] - 2)
        a, m, b = (above(t, column, row) for t in (t0, (t0 + t1) / 2, t1))
        lowest = [a, b]
        bend = 2 * (a - 2 * m + b)
        if bend > 0 and 0 < 3 * a + b - 4 * m < 2 * bend:
            lowest.append(a - (4 * m - 3 * a - b) ** 2 / (4 * bend))
        off = max(off, -float(min(lowest)))
    return off


def sides(start, speed, cell, time):
    """Times of a flight at which a coordinate reaches a side of a patch."""
    if not speed:
        return []
    low, high = sorted((start / cell, (start + speed * time) / cell))
    return [(k * cell - start) / speed for k in range(int(low) + 1, int(high) + 1)]


def height(scene, u, w, column, row):
    """Elevation on the bilinear surface of a patch, as a fraction."""
    r = scene.z.shape[0] - 1 - row
    corners = scene.z[r - 1 : r + 1, column : column + 2][::-1]
    (sw, se), (nw, ne) = (map(Fraction, map(float, line)) for line in corners)
    u, w = u - column, w - row
    return (1 - w) * ((1 - u) * sw + u * se) + w * ((1 - u) * nw + u * ne)


def test_contacts_on_planes_and_drift_over_thousands(tmp_path):
    rows = list(stability.planes(tmp_path))
    assert len(rows) == 12 and not broken(rows)


def test_no_admissible_draw_is_counted_and_keeps_the_energy(tmp_path):
    scene = SCENES["no admissible draw"]
    _, result = stability.run(scene, tmp_path)
    assert not broken(stability.forced(scene, result))
    assert int(result.rebounds) > 1000


def test_an_elastic_impact_keeps_the_energy(tmp_path):
    scene = SCENES["R_t, R_n = 1 in a bowl"]
    assert stability.bowl(scene, *stability.run(scene, tmp_path)).holds


@pytest.mark.parametrize("name", [name for name in SCENES if name.startswith("R_n =")])
def test_ever_shorter_hops_end_in_bounded_work(name, tmp_path):
    assert not broken(stability.hops(SCENES[name], tmp_path))


def test_a_single_known_cell_is_refused(tmp_path):
    """A single known elevation makes no surface that a boulder could hit."""
    z = np.full((60, 40), np.nan)
    z[30, 20] = 5.0
    release = {"x": [40.0], "y": [58.0]}
    case = made_scenes.make_case(tmp_path, *made_scenes.sets(), release=release)
    with pytest.raises(
        RockfallError,
        match=(
            r"source 1 \(40.000, 58.000\) lies on or next to a "
            r"nodata cell"
        ),
    ):
        rockfall.run(case, dem=z, transform=made_scenes.grid(z, cell=2.0, west=-1.0, south=-1.0))
