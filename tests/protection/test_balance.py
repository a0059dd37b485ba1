# SPDX-License-Identifier: BSD-3-Clause
"""Energy balance of each boulder, whatever obstacles it meets: the energy released is that absorbed
by ground, trees and barriers, and that left at the end."""

import numpy as np
import pytest

import rockfall
from programs import make_full_case, run_program, same_results
from rockfall.scene.prepare import prepare
from scenes import status

PARTS = ("ground", "trees", "barriers", "left")
STAND = {
    "uniform_stems": 120.0, "uniform_dbh_mean": 25.0, "uniform_dbh_std": 8.0,
    "uniform_conifers": 60.0,
}  # fmt: skip
ZONES = "zone,mean_radius,ground\n4,0.25,\n-2,0.5,{ground}\n77,inf,\n"
GROUNDS = ("", "soil_4", "rock_face")  # "": impact set of the case


#: A line of the case is outside the terrain.
pytestmark = pytest.mark.filterwarnings("ignore:.*lies entirely outside the terrain")


def everything(folder, ground=""):
    """Case with zones, trees, and two nets one below the other; `ground` is the ground of a
    zone."""
    case = make_full_case(
        folder, forest=STAND, output={"energy_balance": True}, impact={"ratio": "nearest"}
    )
    (folder / "zones.csv").write_text(ZONES.format(ground=ground))
    x, north = case.line[0]["x"], case.line[0]["y"][0] + 130.0
    nets = [
        {"name": "high", "x": x, "y": [north - 80.0] * 2, "height": 2.0, "capacity": 100.0},
        {"name": "low", "x": x, "y": [north - 110.0] * 2, "height": 3.0, "class": 1},
    ]
    return case.replace(barrier=nets)


def relative_errors(result):
    released = result.energy_released.values
    found = sum(result[f"energy_{name}"].values for name in PARTS)
    return np.abs(found - released) / released


@pytest.mark.parametrize("ground", GROUNDS)
def test_the_balance_closes_for_every_boulder(tmp_path, ground):
    result = rockfall.run(everything(tmp_path, ground))
    assert relative_errors(result).max() < 1e-11
    assert all((result[f"energy_{name}"].values >= 0).all() for name in PARTS)
    assert all(result[f"energy_{name}"].values.any() for name in PARTS[:3])
    assert {"stopped_by_tree", "stopped_by_barrier"} < {*status(result)}


@pytest.mark.all
def test_in_the_standalone_program_too(tmp_path):
    case = everything(tmp_path, "soil_4")
    prepare(case, tmp_path / "ready")
    done = run_program("ready/case.nml", "-o", "out.nc", "--quiet", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    theirs = rockfall.merge([tmp_path / "out.nc"])
    assert relative_errors(theirs).max() < 1e-11
    same_results(theirs, rockfall.run(case))
