# SPDX-License-Identifier: BSD-3-Clause
"""Scars left by blocks of the laboratory."""

import numpy as np
import pytest

import rockfall
from rockfall.grounds.impact_tables import CONSTANTS
from rockfall_lab.blocks.case import BlockCase
from rockfall_lab.blocks.contacts import run_throws


@pytest.mark.parametrize("model", ["ploughed", "hard"])
@pytest.mark.parametrize("strength", [2e5, 1e6, 3e6])
@pytest.mark.parametrize(("radius", "speed"), [(0.3, 8.0), (0.8, 12.0)])
def test_the_scar_of_the_laboratory_gives_its_strength(
    tmp_path, monkeypatch, model, strength, radius, speed
):
    """Flat ground has the strength given by the scar of a falling sphere, within 6 %."""
    monkeypatch.chdir(tmp_path)
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(300)
    z = (2 * np.arange(300) + 1) / 300 - 1
    side = np.sqrt(1 - z**2)
    points = np.column_stack([side * np.cos(turn), side * np.sin(turn), z])
    np.savetxt("sphere.csv", points, delimiter=",", header="x,y,z", comments="")
    case = BlockCase(
        lab={"ground": "meadow", "shape": "points", "throws": 2, "contacts": 1},
        block={"points": "sphere.csv", "edge": 0.2, "radius": radius, "density": 2700},
        ground={**CONSTANTS[model], "yield_pressure": strength, "restitution": 0.03, "relief": 0},
        throw={"slope": [0, 0], "speed": [speed] * 3, "angle": [90] * 3, "spin": [0] * 3},
    )
    depth = -float(run_throws(case)["rise"].mean()) * radius
    scar = {"depth": depth, "volume": 4 / 3 * np.pi * radius**3, "speed": speed}
    found = rockfall.measure_ground([scar], model=model, shape="sphere")
    assert found.strength == pytest.approx(strength, rel=0.06)
