# SPDX-License-Identifier: BSD-3-Clause
"""Run-out by impact tables depends on the fall height in the same way as in the laboratory."""

import numpy as np
import pytest

from falling import (
    BOULDERS,
    DENSITY,
    GRAVITY,
    GROUNDS,
    MARK,
    RADIUS,
    SPREAD,
    YIELDS,
    error,
    fall,
    passing,
    write_grounds,
)
from rockfall_lab.blocks.case import BlockCase, ground_values
from rockfall_lab.blocks.contacts import run_throws

BLOCKS = 60


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory):
    """Folder with an impact table for each ground of GROUNDS."""
    place = tmp_path_factory.mktemp("grounds")
    write_grounds(place)
    return place


def thrown(name, slope, drop):
    """Fraction of blocks that pass MARK on a slope [degrees] after a fall of `drop` [m]."""
    speed = np.sqrt(2 * GRAVITY * drop)
    throw = {"slope": [slope] * 2, "speed": [speed] * 3, "angle": [90 - slope] * 3}
    lab = {"ground": "meadow", "throws": BLOCKS, "contacts": 60, "seed": 7}
    model, ground = GROUNDS[name]
    case = BlockCase(
        lab=lab, throw=throw | {"spin": [0.0] * 3}, block={"density": DENSITY},
        ground=ground_values(model, ground),
    ).at_radius(RADIUS)  # fmt: skip
    data = run_throws(case.replace(ground={"hurst": 0.8}))  # Hurst exponent of the relief
    ends = data["advance"].values * np.cos(np.radians(data["heading"].values))
    place = (data["downhill"].values + np.maximum(0, ends)) * RADIUS
    return len(np.unique(data["sequence"].values[place >= MARK])) / BLOCKS


@pytest.mark.parametrize("ground", YIELDS)
def test_reach_falls_no_more_than_that_of_the_laboratorys_blocks(folder, ground):
    """Fewer blocks pass after a fall of 20 m than of 2 m, because steep, fast impacts dig in. The
    fraction of boulders is not below that of the blocks."""
    slope = YIELDS[ground]
    blocks = [thrown(ground, slope, drop) for drop in (2.0, 20.0)]
    assert blocks[0] - blocks[1] > 3 * error(*((part, BLOCKS) for part in blocks))
    for drop, part in zip((2.0, 20.0), blocks, strict=True):
        boulders = passing(fall(folder, ground, slope, drop))
        assert boulders >= part - 4.5 * error((boulders, BOULDERS), (part, BLOCKS)) - SPREAD
