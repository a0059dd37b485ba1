# SPDX-License-Identifier: BSD-3-Clause
"""Contacts from impact tables last as long as in the laboratory, on any slope and for any size of
boulder."""

import numpy as np
import pytest

import rockfall
from made import every_third
from rockfall.grounds import shipped_rows, yielding_ground
from rockfall.grounds.impact_tables import FIELDS, open_table, plane_table, shipped_tables
from rockfall.result.motion import motion_of
from scenes import grid

G = 9.81
#: Ground, gradient and R_b [m]: flatter than the rest angle, so that all stopping boulders rest.
CONTACTS = [
    ("talus", 0.0, 0.57), ("talus", 0.3, 0.57), ("talus", 0.3, 0.05), ("talus", 0.55, 3.0),
    ("talus", 0.7, 0.27), ("meadow", 0.2, 0.4), ("meadow", 0.45, 1.8), ("meadow platy", 0.3, 0.8),
    ("soft-soil", 0.3, 0.27), ("vegetated-soil", 0.4, 5.0), ("compact", 0.35, 1.05),
    ("compact elongated", 0.1, 0.1), ("rock", 0.25, 0.35), ("rocky-slope", 0.3, 0.57),
    ("rocky-slope", 0.75, 2.0),
]  # fmt: skip


def thrown(table, gradient, radius):
    """Result of boulders thrown at 8 m/s down a plane, all recorded."""
    name, _, shape = table.partition(" ")
    y = np.mgrid[99:-1:-1, 0:40][0] * 2.5
    z = 500 + gradient * y
    case = rockfall.Case(
        case={"boulders": 60, "seed": 5}, impact={"form": "table", "table": name},
        boulder={"volume": "fixed", "volume_mean": 4 / 3 * np.pi * radius**3, "density": 2700.0,
                 "block_shape": shape or None, "ground_strength_sigma": 0.0},
        surface={"uniform_mean_radius": radius / 3}, output={"trajectories": 60},
        release={"x": [50.0], "y": [230.0], "drop_height": 0.5, "velocity": [0.0, -8.0, 0.0]},
    )  # fmt: skip
    return rockfall.run(case, dem=z, transform=grid(z, 2.5))


def table_met(table, radius):
    """Table that boulders of this radius [m] use."""
    name, _, shape = table.partition(" ")
    if name in shipped_tables():
        return open_table(shipped_tables()[name])
    model, ground = yielding_ground(shipped_rows().rows[name])
    return plane_table(model, shape or "compact", ground, np.array([radius, radius]))


def durations(table, radius):
    """Durations [s] of all records of a table, for boulders of this radius [m]."""
    table = table_met(table, radius)
    duration = table.record[:, FIELDS.index("duration")].astype(float)
    unit = np.sqrt(radius / G)
    parts = len(table.size) * len(table.relief)
    bins = (len(table.first) - 1) // parts
    flights = int(np.prod(table.bins["flight"]))
    known = [duration * unit]  # records of rolling or copied contacts
    if table.ground.strength:  # records after flights, at equal speed over the yield speed
        size = table.ground.sizes(np.array(radius))
        for part in range(parts):
            own = slice(table.first[part * bins], table.first[part * bins + flights])
            stretch = np.sqrt(size / table.size[part % len(table.size)])
            known.append(duration[own] * unit * stretch)
    return np.unique(np.concatenate(known))


@pytest.mark.parametrize(("table", "gradient", "radius"), every_third(CONTACTS))
def test_a_contact_lasts_as_long_as_one_of_the_laboratory(table, gradient, radius):
    """Durations are exactly those of records; sliding and waiting are included."""
    result = thrown(table, gradient, radius)
    motion = motion_of(result)
    last = motion.vertex[np.diff(motion.boulder, append=-1) != 0]  # it may leave the terrain
    motion = motion.take((motion.gravity == 0) & ~np.isin(motion.vertex, last))
    contact, piece = np.unique(motion.vertex, return_inverse=True)
    lasts = np.bincount(piece, motion.end[3] - motion.start[3])
    assert contact.size > 100
    known = durations(table, radius)
    place = np.clip(np.searchsorted(known, lasts), 1, known.size - 1)
    apart = np.minimum(np.abs(known[place] - lasts), np.abs(known[place - 1] - lasts))
    assert apart.max() < 1e-10 * result["travel_time"].values.max()
