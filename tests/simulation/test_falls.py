# SPDX-License-Identifier: BSD-3-Clause
"""Boulders by tables of impacts that fall from a height: rebounds beyond the records of a table are
counted, and how far boulders come depends on the height as in the laboratory."""

import itertools

import numpy as np
import pytest

import rockfall
import scenes
from rockfall.analysis.model_limits import model_remarks
from rockfall.case import case_of
from rockfall.grounds.impact_tables import (
    BLOCK_SHAPES,
    YieldingGround,
    open_table,
    plane_table,
    shipped_tables,
)
from rockfall.lab.blocks.case import BlockCase, ground_values
from rockfall.lab.blocks.contacts import run_throws

RADIUS, RATIO = 0.6, 4.0  # R_b [m]; R_b/R_m, one of the parts
GRAVITY, DENSITY = 9.81, 2700.0  # [m/s2], [kg/m3]
MARK = 60.0  # down the plane [m]
BOULDERS, BLOCKS = 300, 60
SPREAD = 0.06  # between tables of the same ground (docs/impact_tables.md)

#: Slopes on which some boulders stop [degree].
STEADY = {"firm": 19.0, "hard": 18.0, "rocky-slope": 32.0}
#: Grounds that yield: the laboratory's own blocks come less far from a greater height.
YIELDS = {"scree": 28.0, "soil": 23.0}
GROUNDS = {
    "firm": ("ploughed", YieldingGround(27.0, 2e6, relief=12.6)),
    "hard": ("hard", YieldingGround(31.0, 3e7, relief=15.0)),
    "scree": ("ploughed", YieldingGround(38.0, 2e5, strength_radius=0.6, relief=16.5)),
    "soil": ("ploughed", YieldingGround(24.0, 3e5, relief=14.0)),
}


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory):
    """A folder with a table of these grounds."""
    place = tmp_path_factory.mktemp("grounds")
    rows = [f"{name},{model},{','.join(map(repr, ground))},test\n"
            for name, (model, ground) in GROUNDS.items()]  # fmt: skip
    head = f"name,model,{','.join(YieldingGround._fields)},source\n"
    (place / "grounds.csv").write_text(head + "".join(rows))
    return place


def fall(folder, ground, slope, drop, *, boulders=BOULDERS, speed=0.0, **groups):
    """A run of boulders that fall onto a plane, thrown down at a speed [m/s]."""
    cell, rows, columns, above = 2.5, 92, 60, 8
    z = 500 + np.tan(np.radians(slope)) * cell * np.mgrid[rows - 1 : -1 : -1, 0:columns][0]
    top, width = (rows - above) * cell, columns * cell
    at = top - MARK * np.cos(np.radians(slope))
    usual = {"volume": "fixed", "volume_mean": 4 / 3 * np.pi * RADIUS**3, "density": DENSITY}
    case = rockfall.Case(
        folder=folder,
        case={"boulders": boulders, "seed": 7},
        impact={"form": "table"} | groups.get("impact", {}),
        surface={
            "uniform_mean_radius": RADIUS / RATIO, "ground": ground, "ground_table": "grounds.csv",
        },
        boulder=usual | groups.get("boulder", {}),
        release={
            "x": [width / 2], "y": [top], "drop_height": drop, "velocity": [0.0, 0.0, -speed],
        },
        line=[{"name": "line", "x": [0.0, width], "y": [at, at]}],
    )  # fmt: skip
    return rockfall.run(case, dem=z, transform=scenes.grid(z, cell))


def passing(result):
    return np.isfinite(result["line_speed"].values[0]).mean()


def thrown(name, slope, drop):
    """Fraction of the laboratory's blocks that pass."""
    speed = np.sqrt(2 * GRAVITY * drop)
    throw = {"slope": [slope] * 2, "speed": [speed] * 3, "angle": [90 - slope] * 3}
    lab = {"ground": "meadow", "throws": BLOCKS, "contacts": 60, "seed": 7}
    model, ground = GROUNDS[name]
    case = BlockCase(
        lab=lab, throw=throw | {"spin": [0.0] * 3}, block={"density": DENSITY},
        ground=ground_values(model, ground),
    ).at_radius(RADIUS)  # fmt: skip
    data = run_throws(case.replace(ground={"hurst": 0.8}))  # of the waves of its relief
    ends = data["advance"].values * np.cos(np.radians(data["heading"].values))
    place = (data["downhill"].values + np.maximum(0, ends)) * RADIUS
    return len(np.unique(data["sequence"].values[place >= MARK])) / BLOCKS


def error(*fractions_and_numbers):
    """Standard error of a difference of fractions."""
    return np.sqrt(sum(max(p * (1 - p), 0.02) / n for p, n in fractions_and_numbers))


def fastest(name, shape, slope, radius=RADIUS, density=DENSITY):
    """Speeds [m/s] of the fastest records, of each part of a table that the boulders meet, hit as a
    boulder that falls vertically without spin."""
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
        unit * np.sqrt(data.size[column] / own)  # the ground yields to rho V^2
        * _fastest_of_part(data, row * len(data.size) + column, slope)
        for row, column in parts
    ]  # fmt: skip


def _fastest_of_part(data, part, slope):
    """Scaled with its own R_b."""
    sine2, no_spin = np.cos(np.radians(slope)) ** 2, 0.0
    i = int((data.edges["flight_edge_1"][part] < sine2).sum())
    j = int((data.edges["flight_edge_2"][part, i] < no_spin).sum())
    _, second, third = data.bins["flight"]
    bins = (len(data.first) - 1) // (len(data.size) * len(data.relief))
    bin_ = part * bins + (i * second + j) * third
    records = data.record[data.first[bin_] : data.first[bin_ + third], 3].astype(float)
    return records.max()


def beyond(folder, name, shape, speed, slope, radius=RADIUS, density=DENSITY):
    """Number of boulders, of 50, whose first rebound is beyond the records."""
    result = fall(
        folder, name, slope, 0.001, boulders=50, speed=speed, impact={"impact_limit": 1},
        boulder={"volume_mean": 4 / 3 * np.pi * radius**3, "density": density,
                 "block_shape": shape},
    )  # fmt: skip
    return int(result["rebounds_out_of_speed"])


TABLES = [*itertools.product(GROUNDS, BLOCK_SHAPES), ("rocky-slope", "compact")]


@pytest.mark.parametrize("size", [(RADIUS, DENSITY), (0.45, 2700.0), (0.6, 1900.0), (0.3, 3300.0)])
@pytest.mark.parametrize(("name", "shape"), TABLES)
def test_rebounds_beyond_the_records_are_counted(folder, name, shape, size):
    """Sizes and densities have limits of their own."""
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
    assert result["rebounds_out_of_speed"] >= BOULDERS  # at least their first
    said = [
        remark
        for remark in model_remarks(result, case_of(result))
        if "faster than all records of their table" in remark.text
    ]
    assert [remark.is_warning for remark in said] == [True]
    low = fall(folder, "scree", 28.0, 2.0)
    assert low["rebounds_out_of_speed"] < 0.001 * low["rebounds"]


@pytest.mark.parametrize("ground", STEADY)
def test_reach_does_not_fall_with_the_height(folder, ground):
    low, high = (passing(fall(folder, ground, STEADY[ground], drop)) for drop in (2.0, 20.0))
    assert 0.02 < low < 0.98
    assert high >= low - 4.5 * error((low, BOULDERS), (high, BOULDERS)) - SPREAD


@pytest.mark.parametrize("ground", YIELDS)
def test_reach_falls_no_more_than_that_of_the_laboratorys_blocks(folder, ground):
    """A steep fast hit digs in."""
    slope = YIELDS[ground]
    blocks = [thrown(ground, slope, drop) for drop in (2.0, 20.0)]
    assert blocks[0] - blocks[1] > 3 * error(*((part, BLOCKS) for part in blocks))
    for drop, part in zip((2.0, 20.0), blocks, strict=True):
        boulders = passing(fall(folder, ground, slope, drop))
        assert boulders >= part - 4.5 * error((boulders, BOULDERS), (part, BLOCKS)) - SPREAD
