# SPDX-License-Identifier: BSD-3-Clause
"""Boulders by tables of impacts that fall from a height: rebounds beyond the records of a table are
counted, and how far boulders come depends on the height as in the laboratory."""

from pathlib import Path

import numpy as np
import pytest

import rockfall
import scenes
from rockfall.analysis.model_limits import model_remarks
from rockfall.case import case_of
from rockfall.grounds.impact_tables import ENSEMBLE, open_table, shipped_tables, table_names
from rockfall.lab.blocks.case import BlockCase
from rockfall.lab.blocks.contacts import run_throws
from rockfall.lab.blocks.shapes import SHAPES

RADIUS, RATIO = 0.6, 4.0  # R_b [m], one of the parts; R_b/R_m, likewise
GRAVITY, DENSITY = 9.81, 2700.0  # [m/s2], [kg/m3]
MARK = 60.0  # down the plane [m]
BOULDERS, BLOCKS = 300, 60
SPREAD = 0.06  # between tables of the same ground (docs/impact_tables.md)

#: Slopes on which some boulders stop [degree].
STEADY = {"compact": 12.0, "meadow": 18.0, "rock": 18.0, "rocky-slope": 32.0}
#: Grounds that yield: the laboratory's own blocks come less far from a greater height.
YIELDING = {"talus": 28.0, "vegetated-soil": 20.0, "soft-soil": 22.0}


def fall(table, slope, drop, *, boulders=BOULDERS, speed=0.0, **groups):
    """A run of boulders that fall onto a plane, thrown down at a speed [m/s]."""
    cell, rows, columns, above = 2.5, 92, 60, 8
    z = 500 + np.tan(np.radians(slope)) * cell * np.mgrid[rows - 1 : -1 : -1, 0:columns][0]
    top, width = (rows - above) * cell, columns * cell
    at = top - MARK * np.cos(np.radians(slope))
    usual = {"volume": "fixed", "volume_mean": 4 / 3 * np.pi * RADIUS**3, "density": DENSITY}
    case = rockfall.Case(
        folder=Path(),
        case={"boulders": boulders, "seed": 7},
        impact={"form": "table", "table": table} | groups.get("impact", {}),
        surface={"uniform_mean_radius": RADIUS / RATIO},
        boulder=usual | groups.get("boulder", {}),
        release={
            "x": [width / 2], "y": [top], "drop_height": drop, "velocity": [0.0, 0.0, -speed],
        },
        line=[{"name": "line", "x": [0.0, width], "y": [at, at]}],
    )  # fmt: skip
    return rockfall.run(case, dem=z, transform=scenes.grid(z, cell))


def passing(result):
    return np.isfinite(result["line_speed"].values[0]).mean()


def thrown(ground, slope, drop):
    """Fraction of the laboratory's blocks that pass."""
    speed = np.sqrt(2 * GRAVITY * drop)
    throw = {"slope": [slope] * 2, "speed": [speed] * 3, "angle": [90 - slope] * 3}
    lab = {"ground": ground, "throws": BLOCKS, "contacts": 60, "seed": 7}
    case = BlockCase(lab=lab, throw=throw | {"spin": [0.0] * 3}).at_radius(RADIUS)
    data = run_throws(case)
    ends = data["advance"].values * np.cos(np.radians(data["heading"].values))
    place = (data["downhill"].values + np.maximum(0, ends)) * RADIUS
    return len(np.unique(data["sequence"].values[place >= MARK])) / BLOCKS


def error(*fractions_and_numbers):
    """Standard error of a difference of fractions."""
    return np.sqrt(sum(max(p * (1 - p), 0.02) / n for p, n in fractions_and_numbers))


def fastest(name, slope, radius=RADIUS, density=DENSITY):
    """Speeds [m/s] of the fastest records, of each part of a table next to the boulder's size, hit
    as a boulder that falls vertically without spin."""
    data = open_table(shipped_tables()[name])
    own = RATIO if name == "rocky-slope" else radius
    parts = np.flatnonzero(np.isclose(data.size, own, rtol=1e-6))
    if not parts.size:
        parts = [(data.size < own).sum() - 1, (data.size < own).sum()]
    return [_fastest_of_part(data, part, slope, radius, density) for part in parts]


def _fastest_of_part(data, part, slope, radius, density):
    sine2, no_spin = np.cos(np.radians(slope)) ** 2, 0.0
    i = int((data.edges["flight_edge_1"][part] < sine2).sum())
    j = int((data.edges["flight_edge_2"][part, i] < no_spin).sum())
    _, second, third = data.bins["flight"]
    bins = (len(data.first) - 1) // len(data.size)
    bin_ = part * bins + (i * second + j) * third
    records = data.record[data.first[bin_] : data.first[bin_ + third], 3].astype(float)
    if data.speed2[part] > 0:  # the ground yields to rho V^2
        return records.max() * np.sqrt(data.speed2[part] * data.density / density)
    return records.max() * np.sqrt(GRAVITY * radius)


def beyond(name, speed, slope, radius=RADIUS, density=DENSITY):
    """Number of boulders, of 50, whose first rebound is beyond the records."""
    table, _, shape = name.rpartition("-")
    by_shape = {"block_shape": shape} if shape in SHAPES else {}
    result = fall(
        table if by_shape else name, slope, 0.001, boulders=50, speed=speed,
        impact={"impact_limit": 1},
        boulder=by_shape | {"volume_mean": 4 / 3 * np.pi * radius**3, "density": density},
    )  # fmt: skip
    return int(result["rebounds_out_of_speed"])


@pytest.mark.parametrize("name", sorted(name for name in shipped_tables() if ENSEMBLE not in name))
def test_rebounds_beyond_the_records_are_counted(name):
    slope = (STEADY | YIELDING)[name if name in STEADY else name.rpartition("-")[0]]
    (limit,) = fastest(name, slope)
    counts = [beyond(name, factor * limit, slope) for factor in (0.5, 0.99, 1.01, 1.5)]
    assert counts == [0, 0, 50, 50]


@pytest.mark.parametrize("radius, density", [(0.45, 2700.0), (0.6, 1900.0), (0.3, 3300.0)])
@pytest.mark.parametrize("name", ["talus-compact", "soft-soil-platy", "rock-elongated"])
def test_sizes_and_densities_have_limits_of_their_own(name, radius, density):
    limits = fastest(name, 25.0, radius, density)
    slow, fast = 0.99 * min(limits), 1.01 * max(limits)
    assert beyond(name, slow, 25.0, radius, density) == 0
    assert beyond(name, fast, 25.0, radius, density) == 50
    if len(limits) > 1:
        between = beyond(name, np.mean(limits), 25.0, radius, density)
        assert 0 < between < 50 or np.ptp(limits) < 0.02 * max(limits)


def test_boulders_that_fall_too_fast_are_warned_of():
    result = fall("talus", 28.0, 100.0)
    assert result["rebounds_out_of_speed"] >= BOULDERS  # at least their first
    said = [
        remark
        for remark in model_remarks(result, case_of(result))
        if "faster than all records of their table" in remark.text
    ]
    assert [remark.is_warning for remark in said] == [True]
    low = fall("talus", 28.0, 2.0)
    assert low["rebounds_out_of_speed"] < 0.001 * low["rebounds"]


def test_every_table_has_a_slope():
    assert sorted(STEADY | YIELDING) == sorted(table_names())


@pytest.mark.parametrize("table", STEADY)
def test_reach_does_not_fall_with_the_height(table):
    low, high = (passing(fall(table, STEADY[table], drop)) for drop in (2.0, 20.0))
    assert high >= low - 4.5 * error((low, BOULDERS), (high, BOULDERS)) - SPREAD


@pytest.mark.parametrize("ground", YIELDING)
def test_reach_falls_no_more_than_that_of_the_laboratorys_blocks(ground):
    """A steep fast hit digs in."""
    slope = YIELDING[ground]
    blocks = [thrown(ground, slope, drop) for drop in (2.0, 20.0)]
    assert blocks[0] - blocks[1] > 3 * error(*((part, BLOCKS) for part in blocks))
    for drop, part in zip((2.0, 20.0), blocks, strict=True):
        boulders = passing(fall(ground, slope, drop))
        assert boulders >= part - 4.5 * error((boulders, BOULDERS), (part, BLOCKS)) - SPREAD
