# SPDX-License-Identifier: BSD-3-Clause
"""Classical rebounds in slow arithmetic, written from the papers alone; velocities are V_t, V_n, W
[m/s].

The module shares no code with the program. It only takes random words in the same order as the
kernel (rockfall_classical_rebound)."""

from __future__ import annotations

import functools
from collections.abc import Callable
from decimal import Decimal
from typing import NamedTuple

PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494")
FOOT = Decimal("0.3048")  # [m]
Triple = tuple[Decimal, Decimal, Decimal]


class Scatter(NamedTuple):
    """Normal random number between two limits, drawn at each rebound."""

    mean: float
    std: float = 0.0
    low: float = 0.0
    high: float = 1.0


class Ground(NamedTuple):
    """Rebound model and its parameters; parameters of other models keep their defaults."""

    model: str
    normal: Scatter = Scatter(0.0)  # R_n, or half speed [m/s]
    tangential: Scatter = Scatter(0.0)
    friction_angle: float = 0.0  # [degree]
    soil_density: float = 1800.0
    obstacle_spread: float = 0.1
    roughness_angle: float = 0.0  # [degree]
    min_hop: float = 0.0  # over the boulder's radius


class Numbers(NamedTuple):
    """Functions that convert random words to numbers."""

    normal: Callable[[int], Decimal]
    uniform: Callable[[int], Decimal]
    cosine_sine: Callable[[Decimal], tuple[Decimal, Decimal]]


def exact(number: float) -> Decimal:
    return Decimal(float(number))


@functools.cache
def words_within(scatter: Scatter, normal: Callable[[int], Decimal]) -> tuple[int, int]:
    """First random word whose normal number is within the limits, and the first word above them."""
    mean, std = exact(scatter.mean), exact(scatter.std)

    def first(rule: Callable[[Decimal], bool]) -> int:
        low, high = 0, 2**32
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if rule(normal(middle)) else (middle + 1, high)
        return low

    least, most = (exact(scatter.low) - mean) / std, (exact(scatter.high) - mean) / std
    return first(lambda z: z >= least), first(lambda z: z > most)


def drawn(scatter: Scatter, word: int, numbers: Numbers) -> Decimal:
    """Number between the limits for a word; all words are spread over those whose numbers are
    within."""
    mean = exact(scatter.mean)
    if not scatter.std:
        return mean
    first, beyond = words_within(scatter, numbers.normal)
    if first == beyond:
        return mean
    place = int(first + numbers.uniform(word) * (beyond - first))
    return mean + exact(scatter.std) * numbers.normal(place)


def outgoing(
    ground: Ground, words: list[int], tilt: Decimal, radius: Decimal, mass: Decimal,
    rocks: Decimal, v: Triple, numbers: Numbers,
) -> Triple:  # fmt: skip
    """Velocity after a rebound on ground that is tilted against the motion: computed along the axes
    of the tilted ground."""
    degrees = exact(ground.roughness_angle) * tilt
    c, s = numbers.cosine_sine(degrees * PI / 180)
    t, n = (c, s), (-s, c)  # along V_t and V_n
    along, off = (axis[0] * v[0] + axis[1] * v[1] for axis in (t, n))
    way = -1 if along < 0 else 1
    met = way * along, off, way * v[2]
    a, b, w = on_even_ground(ground, words, radius, mass, rocks, met, numbers)
    return way * a * t[0] + b * n[0], way * a * t[1] + b * n[1], way * w


def on_even_ground(
    ground: Ground, words: list[int], radius: Decimal, mass: Decimal, rocks: Decimal, v: Triple,
    numbers: Numbers,
) -> Triple:  # fmt: skip
    """Velocity after a rebound among obstacles of height `rocks`, before limits."""
    a = drawn(ground.normal, words[0], numbers)
    b = drawn(ground.tangential, words[1], numbers)
    if ground.model == "constant":
        return b * v[0], -a * v[1], b * v[2]
    if ground.model == "bourrier_hungr":
        return _bourrier_hungr(a, b, _tangent(ground.friction_angle, numbers), v)
    if ground.model == "pfeiffer_bowen":
        slid = (v[0] - v[2]) / (20 * FOOT)
        friction = b + (1 - b) / (slid**2 + Decimal("1.2"))
        share = friction * b / ((v[1] / (250 * FOOT * a)) ** 2 + 1)
    else:
        spread = exact(ground.obstacle_spread) * (2 * numbers.uniform(words[2]) - 1)
        depth = _penetration(radius, mass, exact(ground.soil_density), a, v)
        share = 1 / (1 + (rocks * (1 + spread) + depth) / radius)
    inertia = Decimal("0.4") * mass * radius**2
    spin = v[2] / radius
    energy = radius**2 * (inertia * spin**2 + mass * v[0] ** 2) * share
    along = (energy / (inertia + mass * radius**2)).sqrt()
    return along, -v[1] * a / (1 + (v[1] / (30 * FOOT)) ** 2), along


def thrown(ground: Ground, radius: Decimal, pull: Decimal, v: Triple) -> Triple:
    """Velocity of a boulder that hops from obstacle to obstacle with unchanged energy: V_t V_n =
    pull length/2, with V_t >= V_n. The velocity is unchanged if this is impossible, or if V_n is
    larger already."""
    product = pull * exact(ground.min_hop) * radius / 2
    square = v[0] ** 2 + v[1] ** 2
    if not product or square <= 2 * product:
        return v
    plus, minus = (square + 2 * product).sqrt(), (square - 2 * product).sqrt()
    along, off = (plus + minus) / 2, (plus - minus) / 2
    return v if v[1] >= off else (along.copy_sign(v[0]), off, v[2])


def _penetration(
    radius: Decimal, mass: Decimal, density: Decimal, r_n: Decimal, v: Triple
) -> Decimal:
    """Penetration depth [m] by Pichler et al. (2005), both branches, limited to the radius."""
    d, nose = 2 * radius, Decimal("0.707")
    speed2 = v[0] ** 2 + v[1] ** 2
    impact = mass * speed2 / (Decimal(55) * 10**9 * r_n**7 * d**3)
    geometry = mass / (density * Decimal("1.2") * d**3)
    ratio = (1 + nose * PI / (4 * geometry)) / (1 + impact / geometry)
    depth = (ratio * 4 * nose / PI * impact).sqrt()
    if depth > nose:
        depth = 2 / PI * geometry * (1 / ratio).ln() + nose
    return min(depth * d, radius)


def _bourrier_hungr(half: Decimal, r_t: Decimal, friction: Decimal, v: Triple) -> Triple:
    """Rebound by impulses: friction acts against sliding, up to the impulse that stops it, or up to
    its limit."""
    r_n = half / (abs(v[1]) + half)
    forward, rolling = r_t * v[0], r_t * v[2]
    largest = friction * (1 + r_n) * abs(v[1])  # impulse over mass
    if abs(forward - rolling) * 2 / 7 < largest:
        both = (5 * forward + 2 * rolling) / 7
        return both, -r_n * v[1], both
    push = largest if forward > rolling else -largest
    return forward - push, -r_n * v[1], rolling + Decimal("2.5") * push


def _tangent(degrees: float, numbers: Numbers) -> Decimal:
    c, s = numbers.cosine_sine(exact(degrees) * PI / 180)
    return s / c
