# SPDX-License-Identifier: BSD-3-Clause
"""The kernel against the reference, contact by contact, until chaos takes over.

A rounding error grows by a factor of about three a contact, so the kernel and a right reference
part after some thirty; a wrong rule parts them at the first contact that uses it.
"""

from pathlib import Path

import numpy as np
import pytest

import reference
import rockfall
import scenes
from rockfall.rasters import read_dem

BOULDERS, COMPARED = 50, 15
TOLERANCE, CHAOS = 1e-9, 3.0  # relative, at the release; its growth a contact
REAL = Path(__file__).parents[2] / "shared" / "data" / "terrain"
FIELDS = ("x", "y", "z", "time", "in_t", "in_n", "in_w", "out_t", "out_n", "out_w",
          "velocity_x", "velocity_y", "velocity_z", "ratio")  # fmt: skip


def kernel_contacts(result, number):
    """Rows of FIELDS of a boulder's rebounds."""
    mine = (result["trajectory_boulder"] == number).values
    rows = np.stack([result[f"trajectory_{name}"].values[mine] for name in FIELDS], axis=1)
    return rows[rows[:, -1] > 0]


def compare(result, world, west, south):
    """Check the first contacts of every boulder; returns how many there were in all."""
    contacts = 0
    for number in range(1, BOULDERS + 1):
        rows, judged = kernel_contacts(result, number), 0
        for k, one in zip(range(COMPARED), reference.follow(world, number), strict=False):
            wanted = [one.x + west, one.y + south, one.z, one.time, *one.incoming, *one.outgoing]
            wanted = np.array([*wanted, *one.velocity, one.ratio])
            assert k < len(rows), f"boulder {number} ended before contact {k + 1}"
            error = np.abs(rows[k] - wanted) / np.maximum(1.0, np.abs(wanted))
            worst = int(error.argmax())
            assert error[worst] < TOLERANCE * CHAOS ** (k + 1), (
                f"boulder {number}, contact {k + 1}, {FIELDS[worst]}: "
                f"kernel {rows[k, worst]!r}, reference {wanted[worst]!r}"
            )
            judged += 1
        assert judged == min(COMPARED, len(rows)), f"boulder {number} went on after its end"
        contacts += judged
    return contacts


def both(folder, z, cell, start, *, scatter=1.0, rocks=None, **world):
    """Run the kernel and compare; `start` from the south-western cell centre.

    `rocks`: R_m, or (3, ny, nx) obstacle sizes, of each cell.
    """
    mean, covariance = scenes.sets(scatter)
    grid = scenes.grid(z, cell)
    arrays, surface = {}, {"uniform_mean_radius": 0.25}
    if rocks is None:
        rocks = np.full(z.shape, 0.25)
    else:
        names = ["mean_radius"] if rocks.ndim == 2 else ["rg70", "rg20", "rg10"]
        arrays = dict(zip(names, rocks.reshape(-1, *z.shape), strict=True))
        surface = {name: "given" for name in names} | {"method": "B" if rocks.ndim == 2 else "A"}
    usual = {"seed": 2**40 + 77, "drop": 5.0, "velocity": (0.0, 0.0, 0.0), "volume": (0.8, 0.15)}
    world = usual | world
    mean_volume, deviation = world["volume"]
    case = scenes.make_case(
        folder, mean, covariance,
        case={"boulders": BOULDERS, "seed": world["seed"]},
        surface=surface,
        boulder={"volume": "normal", "volume_mean": mean_volume, "volume_std": deviation},
        release={"x": [start[0] + cell / 2], "y": [start[1] + cell / 2],
                 "drop_height": world["drop"], "velocity": list(world["velocity"])},
        output={"trajectories": BOULDERS},
    )  # fmt: skip
    result = rockfall.run(case, dem=z, transform=grid, **arrays)
    judge = reference.World(z, cell, mean, covariance, rocks, start, **world)
    return result, compare(result, judge, cell / 2, cell / 2)


def valley():
    """Walls that steepen on both sides of a bumpy floor."""
    rows = np.abs(np.arange(80) - 40.0)[:, None]
    return scenes.rough(gradient=0.0, relief=6.0) + 0.02 * rows**2


def test_down_a_rough_slope(tmp_path):
    _, contacts = both(tmp_path, scenes.rough(), 5.0, (149.8, 382.6))
    assert contacts > 500


def test_across_a_valley_where_boulders_turn_back(tmp_path):
    result, contacts = both(tmp_path, valley(), 5.0, (149.8, 382.6), scatter=4.0)
    assert contacts > 500
    assert (result.trajectory_out_t < 0).sum() > 20
    assert result.rebounds_redrawn > 20


@pytest.mark.parametrize("climb", [3.0, 12.0, 18.0])
def test_released_uphill_into_the_slope_and_falling_back(tmp_path, climb):
    """Flights that come down against their own way: the boulder rolls backwards."""
    z = scenes.rough(gradient=1.5)
    both(tmp_path, z, 5.0, (149.8, 150.3), velocity=(1.0, 6.0, climb), drop=0.0)


def test_obstacles_of_method_a_single_precision_nodata_and_a_river(tmp_path):
    z = scenes.rough(dtype="f4")
    z[50:53, 20:24] = np.nan
    random = np.random.default_rng(3)
    rocks = random.uniform(0.2, 2.0, (3, *z.shape)).astype("f4")
    rocks[:, 60:62] = np.inf
    result, _ = both(tmp_path, z, 5.0, (130.2, 382.6), rocks=rocks)
    assert {"absorbed", "left_domain"} <= set(scenes.status(result))
    assert result.rebounds_out_of_range > 0


def test_mean_radius_that_changes_from_cell_to_cell(tmp_path):
    z = scenes.rough(seed=5)
    rocks = np.random.default_rng(4).uniform(0.08, 0.6, z.shape).astype("f4")
    both(tmp_path, z, 5.0, (149.8, 382.6), rocks=rocks)


@pytest.mark.parametrize(
    ("file", "cut"),
    [("stubai_10m/stubai_demo.asc", np.s_[:, :]), ("kot_5m/avaKot.asc", np.s_[154:389, 32:266])],
)
def test_on_real_terrain(tmp_path, file, cut):
    if not (REAL / file).is_file():
        pytest.skip(f"{REAL / file} is not there")
    z, grid = read_dem(REAL / file)
    z = np.ascontiguousarray(z[cut])
    rise = np.hypot(*np.gradient(z, grid.cell))
    rise[:10], rise[-10:], rise[:, :10], rise[:, -10:] = 0, 0, 0, 0
    row, column = np.unravel_index(rise.argmax(), z.shape)
    start = ((column + 0.1) * grid.cell, (z.shape[0] - 1 - row + 0.2) * grid.cell)
    both(tmp_path, z, grid.cell, start)
