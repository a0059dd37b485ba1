# SPDX-License-Identifier: BSD-3-Clause
"""Boulders by impact tables that fall from a height: rebounds beyond the records of a table are
counted, and boulders that fall farther do not travel less far."""

import itertools

import numpy as np
import pytest

from falling import (
    BOULDERS,
    DENSITY,
    GRAVITY,
    GROUNDS,
    RADIUS,
    RATIO,
    SPREAD,
    YIELDS,
    error,
    fall,
    passing,
    write_grounds,
)
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.case import case_of
from rockfall.grounds.impact_tables import (
    BLOCK_SHAPES,
    open_table,
    plane_table,
    shipped_tables,
)

#: Slopes on which some boulders stop [degrees].
STEADY = {"firm": 19.0, "hard": 18.0, "rocky-slope": 32.0}


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory):
    """Folder with a table of the grounds in GROUNDS."""
    place = tmp_path_factory.mktemp("grounds")
    write_grounds(place)
    return place


def fastest(name, shape, slope, radius=RADIUS, density=DENSITY):
    """Maximum speeds [m/s] of records at the incidence and spin of a vertical fall, one for each
    part of the table that the boulders use."""
    unit = np.sqrt(GRAVITY * radius)
    if name == "rocky-slope":
        data = open_table(shipped_tables()[name])
        return [unit * _fastest_of_part(data, list(data.size).index(RATIO), slope)]
    model, ground = GROUNDS[name]
    own = ground.sizes(np.array(radius)) * density / DENSITY
    heavy = ground._replace(strength=ground.strength * DENSITY / density)  # the same parts
    data = plane_table(model, shape, heavy, np.array([radius, radius]))
    assert len(data.size) <= 2 and len(data.relief) <= 2
    parts = itertools.product(range(len(data.relief)), range(len(data.size)))
    return [
        unit * np.sqrt(data.size[column] / own)  # the ground yields at rho V^2
        * _fastest_of_part(data, row * len(data.size) + column, slope)
        for row, column in parts
    ]  # fmt: skip


def _fastest_of_part(data, part, slope):
    """Maximum speed of records in a part, over sqrt(g R_b) with the R_b of the part."""
    sine2, no_spin = np.cos(np.radians(slope)) ** 2, 0.0
    i = int((data.edges["flight_edge_1"][part] < sine2).sum())
    j = int((data.edges["flight_edge_2"][part, i] < no_spin).sum())
    _, second, third = data.bins["flight"]
    bins = (len(data.first) - 1) // (len(data.size) * len(data.relief))
    bin_ = part * bins + (i * second + j) * third
    records = data.record[data.first[bin_] : data.first[bin_ + third], 3].astype(float)
    return records.max()


def beyond(folder, name, shape, speed, slope, radius=RADIUS, density=DENSITY):
    """Number of 50 boulders, thrown down at `speed` [m/s], whose first rebound is faster than the
    records."""
    result = fall(
        folder, name, slope, 0.001, boulders=50, speed=speed, impact={"impact_limit": 1},
        boulder={"volume_mean": 4 / 3 * np.pi * radius**3, "density": density,
                 "block_shape": shape},
    )  # fmt: skip
    return int(result["rebounds_out_of_speed"])


TABLES = [*itertools.product(GROUNDS, BLOCK_SHAPES), ("rocky-slope", "compact")]


SIZES = [(RADIUS, DENSITY), (0.45, 2700.0), (0.6, 1900.0), (0.3, 3300.0)]


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("name", "shape", "size"),
    [(*table, SIZES[0]) for table in TABLES]
    + [
        pytest.param(g, "compact", s, marks=[pytest.mark.all] * (k > 0))
        for k, g in enumerate(GROUNDS)
        for s in SIZES[1:]
    ],
)
def test_rebounds_beyond_the_records_are_counted(folder, name, shape, size):
    """Rebounds are counted if they are faster than the records of all parts, and not if they are
    slower than the limit of each part. Limits depend on size and density."""
    if name == "rocky-slope":
        size = (RADIUS, size[1])
    slope = (STEADY | YIELDS)[name]
    limits = fastest(name, shape, slope, *size)
    slow, fast = min(limits), max(limits)
    counts = [beyond(folder, name, shape, speed, slope, *size)
              for speed in (0.5 * slow, 0.99 * slow, 1.01 * fast, 1.5 * fast)]  # fmt: skip
    assert counts == [0, 0, 50, 50]


def test_boulders_that_fall_too_fast_are_warned_of(folder):
    result = fall(folder, "scree", 28.0, 130.0)
    assert result["rebounds_out_of_speed"] >= BOULDERS  # at least the first rebound of each
    said = [
        remark
        for remark in model_remarks(result, case_of(result))
        if "faster than all impacts of their table" in remark.text
    ]
    assert [remark.is_warning for remark in said] == [True]
    low = fall(folder, "scree", 28.0, 2.0)
    assert low["rebounds_out_of_speed"] < 0.001 * low["rebounds"]


@pytest.mark.parametrize("ground", STEADY)
def test_reach_does_not_fall_with_the_height(folder, ground):
    low, high = (passing(fall(folder, ground, STEADY[ground], drop)) for drop in (2.0, 20.0))
    assert 0.02 < low < 0.98
    assert high >= low - 4.5 * error((low, BOULDERS), (high, BOULDERS)) - SPREAD
