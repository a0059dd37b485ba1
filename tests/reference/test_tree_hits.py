# SPDX-License-Identifier: BSD-3-Clause
"""Trees compared with 50-digit arithmetic: hits and contacts, each from the kernel's previous
state."""

from decimal import Decimal

import numpy as np
import pytest

import reference
import replay
import scenes
import tree_hits
from reference import Doubt, State, exact
from replay import IN, OUT, RATIO, SPEED, UNDECIDED, U
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene

STAND = {
    "uniform_stems": 400.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 12.0,
    "uniform_conifers": 50.0,
}  # fmt: skip


def forest_of(scene):
    """Stems of a scene with its south-western cell centre at 0, 0."""
    given = scene.case.forest
    turns = [given[f"turn_{name}"] for name in ("frontal", "lateral", "scratch")]
    return tree_hits.Forest(
        *scene.trees,
        density=scene.case.boulder["density"],
        stem_height=given.get("stem_height", np.inf),
        limits=(given["lateral_from"], given["scratch_from"]),
        weights=turns,
    )


class Boulder:
    """Boulder whose hits and contacts are repeated by the reference."""

    def __init__(self, world, forest, number):
        self.world, self.forest, self.number = world, forest, number
        self.state = reference.release(world, number)
        self.contacts = self.trees = self.undecided = 0
        self.taken, self.broken, self.status = Decimal(0), set(), ""

    def follow(self, rows, end):
        """Compare the kernel's rows after the release with the reference; `end` is the kernel's
        status."""
        for k, row in enumerate(rows[1:], 1):
            doubt = Doubt()
            landing = reference.fly(self.world, self.state, doubt)
            hit = tree_hits.first_hit(
                self.world, self.forest, self.number, self.state, landing, self.broken, doubt
            )
            if hit is None:
                right = self._contact(rows[k - 1], row, end if k == len(rows) - 1 else "", doubt)
            else:
                right = self._tree(hit, rows[k - 1], row, doubt)
            if not right:
                assert doubt.least < UNDECIDED, (self.number, k, hit)
                self.undecided = 1
                return
        assert self.status == end

    def _contact(self, before, row, status, doubt):
        contact = reference.step(self.world, self.number, self.contacts + 1, self.state)
        doubt.least = min(doubt.least, contact.doubt)
        if replay._differs(contact, row, status):
            return False
        flight = replay._flight(self.world, self.state, contact.landing, contact.landing.patch)
        errors = replay._judge(self.world, contact, flight, before, row, 1e-14)
        self.contacts += contact.landing.contact
        self.status = contact.status
        if contact.rebound and not contact.status:
            self.state = replay._kernel_state(contact, row)
        return all(error.share <= 1 for error in errors)

    def _tree(self, hit, before, row, doubt):
        """Compare a hit with the reference. Its position has rounding errors of coordinates, and
        more along the path if the path enters the disc obliquely. The absorbed energy depends on
        the position (by a factor of at most five) and on a power of the diameter."""
        self.trees += 1
        out = tree_hits.collide(
            self.world, self.forest, self.number, self.trees, hit, self.state, doubt
        )
        speed = float(reference.length(hit.v))
        plan = float(reference.length(hit.v[:2]))
        far = float(max(abs(hit.x), abs(hit.y))) + float(hit.time) * speed
        d_way = 20 * U * far * hit.steepness
        d_time = d_way / plan + 4 * U * float(hit.time)
        d_place = d_way + 8 * U * far
        stem = self.forest.dbh[hit.stem] / 200
        d_taken = float(out.taken) * 100 * U + 5 * float(out.energy) * d_place / stem
        remains = max(float(out.remains), 1e-9)
        d_remains = d_taken / float(out.energy) / remains + 4 * U
        d_v = speed * (d_remains + 40 * U) + self.world.gravity * d_time
        x, y, z, t = (exact(value) for value in row[:4])
        apart = (
            (reference.length((x - hit.x, y - hit.y)), d_place),
            (z - hit.z, speed * d_time + 20 * U * (abs(float(hit.z)) + speed)),
            (t - exact(before[3]) - hit.time, d_time + 2 * U * row[3]),
            (replay._apart(row[SPEED], out.state.v), d_v),
        )
        if row[RATIO] or row[IN].any() or row[OUT].any():
            return False
        if out.breaks:
            self.broken.add(hit.stem)
        self.taken += out.taken
        slow = reference.length(out.state.v) < exact(self.world.stop_speed)
        self.status = "stopped_by_tree" if slow and out.taken else ""
        above = max(Decimal(0), z - reference.surface(self.world, x, y))
        if not out.state.above:
            above = Decimal(0)
        v = tuple(map(exact, row[SPEED]))
        self.state = State(x, y, above, v, out.state.spin, out.state.heading)
        return all(abs(float(size)) <= bound for size, bound in apart)


def flown(folder, forest, impact=None):
    """Result of boulders that fly through a forest, its world, and its trees."""
    z = scenes.rough()
    impact = {"rest_angle": 90.0} | (impact or {})  # only flights
    case = scenes.make_case(
        folder, *scenes.sets(), case={"boulders": 24, "seed": 2**40 + 7}, impact=impact,
        boulder={"volume": "normal", "volume_mean": 0.8, "volume_std": 0.15}, forest=forest,
        release={"x": [149.8], "y": [382.6], "drop_height": 5.0},
        output={"trajectories": 24, "energy_balance": True},
    )  # fmt: skip
    scene = read_scene(case, dem=z, transform=scenes.grid(z, 5.0, -2.5, -2.5))
    return run_scene(scene), replay.world_of(scene), forest_of(scene)


@pytest.mark.all
@pytest.mark.parametrize(
    ("forest", "impact"),
    [
        (STAND, {}),
        (STAND | {"stem_height": 1.0}, {"turning": "lab"}),
        (STAND | {"uniform_stems": 1500.0, "turn_frontal": [3.0, 1.0, 0.0],
                  "turn_scratch": [0.0, 0.0, 1.0]}, {}),
        (STAND | {"uniform_stems": 900.0, "uniform_dbh_mean": 8.0, "uniform_dbh_std": 3.0}, {}),
    ],
    ids=["a stand", "low", "dense", "thin"],
)  # fmt: skip
def test_down_a_slope_through_trees(tmp_path, forest, impact):
    result, world, trees = flown(tmp_path, forest, impact)
    judged = undecided = 0
    for number, rows in enumerate(replay.tracks(result), 1):
        boulder = Boulder(world, trees, number)
        boulder.follow(rows, replay.status_of(result, number))
        undecided += boulder.undecided
        if boulder.undecided:
            continue
        one = result.isel(boulder=number - 1)
        assert (boulder.trees, boulder.contacts) == (int(one.trees_hit), int(one.impacts))
        assert abs(float(boulder.taken) - float(one.energy_trees)) < 1e-9 * float(
            one.energy_released
        )
        judged += boulder.trees
    assert judged > 30 and undecided <= 1


@pytest.mark.family(2)
@pytest.mark.parametrize(("column", "off"), [(0, 1e-10), (3, 1e-11), (4, 1e-8), (6, 1e-8)])
def test_an_error_that_is_hardly_there_is_seen(tmp_path, column, off):
    """An error of 1e-11 to 1e-8 in position, time or velocity of the first hit is noticed."""
    result, world, trees = flown(tmp_path, STAND)
    tracks = replay.tracks(result)
    number = 1 + next(k for k, rows in enumerate(tracks) if (rows[1:-1, RATIO] == 0).any())
    rows, end = tracks[number - 1], replay.status_of(result, number)
    Boulder(world, trees, number).follow(rows, end)
    rows[1 + np.flatnonzero(rows[1:-1, RATIO] == 0)[0], column] += off
    with pytest.raises(AssertionError):
        Boulder(world, trees, number).follow(rows, end)
