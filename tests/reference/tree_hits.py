# SPDX-License-Identifier: BSD-3-Clause
"""Trees in 50-digit arithmetic: which stem is hit first, the energy that it absorbs, and the new
direction of the boulder.

The code is written from docs/forest.md alone and is simple: every stem near a flight is tested."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from decimal import Decimal
from typing import NamedTuple

import numpy as np

import reference
from reference import ONE, ZERO, Doubt, Landing, State, World, exact

TREE = 12  # purpose of random words
EDGE = Decimal("1e-6")  # fraction of a disc's squared radius: a start this near counts as inside
MIDDLE = Decimal("1e-9")  # fraction of the radius: a hit this near to the centre has no side
CLASSES = [Decimal(degrees) for degrees in ("0", "22.5", "67.5", "76")]


@dataclass
class Forest:
    """Stems (local coordinates [m], diameters [cm], species factors), parameters of the case's tree
    model, and density of the boulders [kg/m3]."""

    x: np.ndarray
    y: np.ndarray
    dbh: np.ndarray
    factor: np.ndarray
    density: float
    stem_height: float = math.inf
    limits: tuple[float, float] = (0.58, 0.75)
    weights: list[list[float]] = field(default_factory=lambda: [[22.5, 45.0, 8.5]] * 3)


class Hit(NamedTuple):
    stem: int
    time: Decimal
    offset: Decimal  # offset of the axis from the path, > 0 to the left
    radius: Decimal  # radius of the disc
    x: Decimal
    y: Decimal
    z: Decimal
    v: tuple[Decimal, Decimal, Decimal]
    steepness: float  # error of the hit position over that of the path: 1 + offset / root


class Outcome(NamedTuple):
    taken: Decimal
    energy: Decimal  # energy before the hit
    remains: Decimal  # speed after over speed before
    state: State
    breaks: bool


def first_hit(
    world: World, forest: Forest, number: int, state: State, landing: Landing, broken, doubt: Doubt
) -> Hit | None:
    """First stem that a flight hits before its landing; None if there is none."""
    speed = reference.length(state.v[:2])
    if not speed:
        return None
    east, north = (v / speed for v in state.v[:2])
    own, far = reference.radius(world, number), speed * landing.time
    found: list[tuple[Decimal, int, Decimal, Decimal, Decimal]] = []
    for k in _near(forest, state, landing, float(own)):
        dx, dy = exact(forest.x[k]) - state.x, exact(forest.y[k]) - state.y
        disc = own + exact(forest.dbh[k]) / 200
        along, offset = dx * east + dy * north, east * dy - north * dx
        outside = doubt.above(dx * dx + dy * dy - disc * disc * (1 + EDGE), disc * disc)
        if k in broken or along <= 0 or not outside:
            continue
        if not doubt.above(disc - abs(offset), disc):
            continue
        root = (disc * disc - offset * offset).sqrt()
        if doubt.above(far - (along - root), far + ONE):
            found.append((along - root, k, offset, disc, root))
    gravity, ground = exact(world.gravity), reference.surface(world, state.x, state.y)
    for way, k, offset, disc, root in sorted(found):
        t = way / speed
        x, y = state.x + state.v[0] * t, state.y + state.v[1] * t
        z = ground + state.above + t * (state.v[2] - gravity * t / 2)
        height = z - reference.surface(world, x, y)
        if math.isfinite(forest.stem_height):
            if not doubt.above(exact(forest.stem_height) - height, abs(z) + 1):
                continue
        later = [one[0] for one in found if one[1] != k and one[0] > way]
        if later:
            doubt.above(min(later) - way, disc)
        v = (*state.v[:2], state.v[2] - gravity * t)
        return Hit(k, t, offset, disc, x, y, z, v, 1 + float(abs(offset) / root))
    return None


def _near(forest: Forest, state: State, landing: Landing, own: float) -> list[int]:
    """Indices of the stems near enough to be hit; all others are metres away."""
    reach = own + forest.dbh.max() / 200 + 1
    ends = [(float(p.x), float(p.y)) for p in (state, landing)]
    keep = np.ones(forest.x.size, bool)
    for places, pair in ((forest.x, 0), (forest.y, 1)):
        low, high = sorted(end[pair] for end in ends)
        keep &= (places > low - reach) & (places < high + reach)
    return np.flatnonzero(keep).tolist()


def energy_share(x: Decimal) -> Decimal:
    """Fraction of E_max absorbed if the path passes at x stem radii from the axis."""
    power = Decimal(10) ** ((Decimal("0.58") - x) * Decimal("-8.007"))
    return max(ZERO, Decimal("-0.046") + Decimal("1.026") / (1 + power))


def collide(
    world: World, forest: Forest, number: int, count: int, hit: Hit, state: State, doubt: Doubt
) -> Outcome:
    """Effect of a hit on its boulder; `count` is the number of the hit."""
    mass = exact(forest.density) * reference.volume(world, number)
    speed2 = sum(v * v for v in hit.v)
    energy = mass / 2 * (speed2 + reference.INERTIA * state.spin**2)
    strongest = exact(forest.factor[hit.stem]) * Decimal("38.7")
    strongest *= exact(forest.dbh[hit.stem]) ** Decimal("2.31")
    x = min(ONE, abs(hit.offset) / (exact(forest.dbh[hit.stem]) / 200))
    most = energy_share(x) * strongest
    goes_on = doubt.above(energy - most, energy)
    taken = most if goes_on else energy
    remains = ((energy - taken) / energy).sqrt()
    kind = sum(doubt.above(x - exact(limit), ONE) or x == exact(limit) for limit in forest.limits)
    word = reference.philox([number & reference.LOW, number >> 32, count, TREE << 24], world.seed)
    degrees = _turn([exact(w) for w in forest.weights[kind]], *map(reference.uniform, word[:2]))
    side = -1 if hit.offset > 0 else 1
    if not doubt.above(x - MIDDLE, ONE):
        side = 1 if word[1] & 1 else -1
    plan = reference.rotated(hit.v[:2], side * degrees)
    heading = reference.rotated(state.heading, side * degrees)
    v = tuple(remains * one for one in (*plan, hit.v[2]))
    above = hit.z - reference.surface(world, hit.x, hit.y)
    after = State(hit.x, hit.y, max(ZERO, above), v, remains * state.spin, heading)
    return Outcome(taken, energy, remains, after, kind == 0 and goes_on)


def _turn(weights: list[Decimal], class_: Decimal, within: Decimal) -> Decimal:
    drawn, k = class_ * sum(weights), 0
    while k < 2 and drawn >= sum(weights[: k + 1]):
        k += 1
    return CLASSES[k] + within * (CLASSES[k + 1] - CLASSES[k])
