# SPDX-License-Identifier: BSD-3-Clause
"""Maps of passing heights: vertical, and of the centre, as at lines."""

import numpy as np
import pytest

import rockfall
from rockfall.result.crossings import at_lines
from scenes import grid, make_case, sets

GRADIENT = 0.75  # 1/cos(slope) is 1.25
RADIUS = 0.6


def test_on_a_plane_the_centre_is_r_over_cos_above_the_boulders_point(tmp_path):
    z = 1000 + GRADIENT * 5.0 * np.arange(40)[::-1, None] + np.zeros(30)
    names = [f"{name}_{of}" for name in ("jump_height", "passing_height") for of in ("mean", "std")]
    names += ["passages", "jump_height_max_map", "passing_height_max"]
    case = make_case(
        tmp_path, *sets(), terrain={}, case={"boulders": 200}, output={"maps": names},
        boulder={"volume_mean": 4 / 3 * np.pi * RADIUS**3},
        release={"x": [75.0], "y": [180.0]}, line=[{"name": "L", "x": [0, 150], "y": [95, 95]}],
    )  # fmt: skip
    result = rockfall.run(case, dem=z, transform=grid(z))
    above = 1.25 * RADIUS
    for of, jump in (("max", "max_map"), ("mean", "mean")):
        higher = (result[f"passing_height_{of}"] - result[f"jump_height_{jump}"]).values
        assert higher[np.isfinite(higher)] == pytest.approx(above, abs=2e-3)  # in integer mm
    spread = (result["passing_height_std"] - result["jump_height_std"]).values
    assert abs(spread[np.isfinite(spread)]).max() < 2e-3 and np.isfinite(spread).any()
    at_line = (
        at_lines(result)["line_passing_height"] - at_lines(result)["line_jump_height"]
    ).values
    assert at_line[np.isfinite(at_line)] == pytest.approx(above, abs=2e-6)
