# SPDX-License-Identifier: BSD-3-Clause
"""Generalised outlines of zones: no cell gets a lower class, outlines do not overlap, and no part
is narrower than allowed."""

import numpy as np
import pytest

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

from rockfall.analysis.hazard.outlines import GRID, generalised, polygons_of  # noqa: E402

CELL = 4.0


def areas_of(classes):
    """Polygons of the classes 1, 2, ... of a raster."""
    rows, columns = np.indices(classes.shape)
    west, south = CELL * columns, -CELL * rows
    cells = shapely.box(west, south, west + CELL, south + CELL)
    return [shapely.union_all(cells[classes == k]) for k in range(1, classes.max() + 1)]


def noise(seed, shape=(36, 48)):
    """Classes of a random smooth surface, with narrow strips and islands."""
    pytest.importorskip("scipy", reason="the lab extra is not installed")
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    smooth = gaussian_filter(rng.normal(size=shape), 3.0) + 0.2 * gaussian_filter(
        rng.normal(size=shape), 0.7
    )
    return np.digitize(smooth, np.quantile(smooth, [0.5, 0.7, 0.8, 0.9]))


@pytest.mark.all
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("width", [3.0, 10.0, 25.0])
def test_no_cell_gets_a_lower_class(seed, width):
    classes = noise(seed)
    raw = areas_of(classes)
    shown = generalised(raw, width, CELL)
    assert len(shown) == len(raw) == 4
    for k in range(4):
        above = shapely.union_all(shown[k:])
        assert shapely.union_all(raw[k:]).difference(above).area < 1e-3
        for other in shown[k + 1 :]:
            assert shown[k].intersection(other).area < 1e-3
        steps = shapely.get_coordinates(shown[k]) / (GRID * CELL)
        assert np.array_equal(steps, np.round(steps)), "not on the grid"
    grown = shapely.union_all(shown).difference(shapely.union_all(raw))
    assert shapely.union_all(raw).buffer(width + CELL).contains(grown)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.all) for k in (1, 2))])
def test_hardly_a_part_is_narrow(seed):
    """More than half of the classes' area is narrow before, and less than 6 % in the outlines: at
    corners, and where many outlines meet."""
    width, about = 10.0, {"join_style": "mitre", "mitre_limit": 2.0}
    raw = areas_of(noise(seed))
    before, after = (
        sum(
            area.difference(area.buffer(-0.45 * width, **about).buffer(0.451 * width, **about)).area
            for area in areas
        )
        for areas in (raw, generalised(raw, width, CELL))
    )
    total = shapely.union_all(raw).area
    assert before > 0.5 * total and after < 0.06 * total


def test_a_rim_takes_the_class_above_it():
    """A rim one cell wide takes the class of the block inside it; a broad rim remains."""
    classes = np.ones((30, 40), int)
    classes[8:16, 8:16], classes[9:15, 9:15] = 2, 3
    classes[5:25, 22:38], classes[10:20, 27:33] = 2, 3
    low, middle, high = generalised(areas_of(classes), 10.0, CELL)
    rims, blocks = list(polygons_of(middle, 1.0)), list(polygons_of(high, 1.0))
    assert len(rims) == 1 and len(rims[0].interiors) == 1 and len(blocks) == 2
    small = min(blocks, key=lambda one: one.area)
    assert small.area == pytest.approx((8 * CELL) ** 2, rel=0.15)
    assert low.area > 0


def test_a_thread_alone_is_widened_and_a_gap_is_filled():
    classes = np.zeros((30, 40), int)
    classes[10, 5:35] = 1
    (thread,) = generalised(areas_of(classes), 10.0, CELL)
    assert thread.contains(areas_of(classes)[0])
    assert thread.buffer(-4.9).area > 0 and len(list(polygons_of(thread))) == 1
    classes = np.ones((20, 20), int)
    classes[:, 10] = 0
    (whole,) = generalised(areas_of(classes), 10.0, CELL)
    assert len(list(polygons_of(whole))) == 1 and whole.area >= (20 * CELL) ** 2
