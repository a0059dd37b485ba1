# SPDX-License-Identifier: BSD-3-Clause
"""Maps cover exactly the cells that boulders can reach."""

import numpy as np
import pytest

import rockfall
from rockfall.scene.read import read_scene
from scenes import grid, make_case, rough, sets

MAPS = ["passages", "deposits", "energy_max", "energy_mean", "speed_q90"]
GRAVITY = 9.81


def case_in(folder, boulders=100, maps=MAPS, **release):
    output = {"maps": maps}
    return make_case(
        folder, *sets(2.0), terrain={}, case={"boulders": boulders}, release=release, output=output
    )


def flooded(z, row, column, head):
    """Cells not above `head` that are connected with those around a cell, by a simple search."""
    near = [(row + dr, column + dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)]
    found = np.zeros(z.shape, bool)
    while near:
        r, c = near.pop()
        if not (0 <= r < z.shape[0] and 0 <= c < z.shape[1]) or found[r, c] or not z[r, c] <= head:
            continue
        found[r, c] = True
        near += [(r + dr, c + dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)]
    return found


def edges(cells, margin, shape):
    """First row and column of the marked cells with a margin, and one past the last row and
    column."""
    rows, columns = np.flatnonzero(cells.any(axis=1)), np.flatnonzero(cells.any(axis=0))
    first = max(0, rows[0] - margin), max(0, columns[0] - margin)
    return *first, min(shape[0], rows[-1] + margin + 1), min(shape[1], columns[-1] + margin + 1)


def box_of(case, z):
    scene = read_scene(case, dem=z, transform=grid(z))
    box = scene.survey().box(scene.kernel)
    return box.row, box.column, box.stop_row, box.stop_column


def test_maps_of_what_can_be_reached_are_cut_from_those_of_the_terrain(tmp_path):
    z = rough()
    z[:12] += 200.0 * np.linspace(1, 0, 12)[:, None]
    case = case_in(tmp_path, x=[150.0, 170.0], y=[250.0, 255.0], drop_height=5.0)
    part = rockfall.run(case, dem=z, transform=grid(z))
    whole = rockfall.run(case.replace(output={"map_extent": "terrain"}), dem=z, transform=grid(z))
    assert whole["passages"].shape == z.shape
    assert 8 < part.sizes["y"] < 0.8 * z.shape[0]
    assert set(part.y.values) < set(whole.y.values) and set(part.x.values) <= set(whole.x.values)
    for name in MAPS:
        cut = whole[name].sel(x=part.x, y=part.y)
        assert np.array_equal(part[name], cut, equal_nan=name not in ("passages", "deposits"))
    assert part["passages"].sum() == whole["passages"].sum() > 0
    assert np.array_equal(part["stop_x"], whole["stop_x"])
    assert part["crs"].attrs["GeoTransform"].split()[3] == repr(float(part.y[0] + 2.5))


@pytest.mark.parametrize("velocity", [[0.0, 0.0, 0.0], [0.0, 12.0, 16.0]])
def test_boulders_stay_below_their_energy_head(tmp_path, velocity):
    z = rough(relief=6.0)
    column, row = 30, 40
    release = {"x": [152.5], "y": [197.5], "drop_height": 5.0, "velocity": velocity}
    head = z[row, column] + 5.0 + np.dot(velocity, velocity) / (2 * GRAVITY)
    cells = flooded(z, row, column, head + 0.01)
    assert box_of(case_in(tmp_path, **release), z) == edges(cells, 3, z.shape)


def test_a_ridge_keeps_boulders_from_the_next_valley(tmp_path):
    x = np.abs(np.arange(60) - 30.0)
    z = np.where(x < 15, 100 + 3 * (15 - x), 100 + 3 * (x - 15)) + np.zeros((20, 1))
    assert z[0, 30] == 145 and z[0, 0] == 145
    below = case_in(tmp_path, x=[52.5], y=[50.0], drop_height=5.0)  # at 115 m in the western valley
    assert box_of(below, z)[1::2] == (9 - 3, 21 + 3 + 1)
    above = below.replace(release={"drop_height": 31.0})
    assert box_of(above, z)[1::2] == (0, 60)


def test_of_large_terrain_the_lowest_of_some_cells_counts(tmp_path):
    z = np.full((30, 2500), 500.0)  # blocks of three cells
    z[:, 1000:1100] = 100.0 + np.abs(np.arange(100) - 50)
    z[:, 1050:1056] = np.nan
    case = case_in(tmp_path, x=[5.0 * 1010 + 2.5], y=[70.0], drop_height=5.0)
    cells = flooded(z, 16, 1010, z[16, 1010] + 5.0)
    exact, found = edges(cells, 3, z.shape), box_of(case, z)
    assert exact[1] - 3 < found[1] <= exact[1] and exact[3] <= found[3] < exact[3] + 3
    assert (found[0], found[2]) == (0, 30)


def test_without_maps_nobody_looks(tmp_path):
    z = rough()
    case = case_in(tmp_path, maps=None, x=[150.0], y=[100.0], drop_height=5.0)
    assert box_of(case, z) == (0, 0, *z.shape)
