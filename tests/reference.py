# SPDX-License-Identifier: BSD-3-Clause
"""One boulder in plain, slow Python, from the model alone: a judge for the kernel.

It shares no code with the program. Where the program is quick it is naive: patches are polynomials
that numpy multiplies and solves, directions are angles, normals come from SciPy. Only the layout
of the random words is the kernel's (rockfall_random, rockfall_impact, rockfall_trajectory).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from scipy.stats import norm

RELEASE, IMPACT = 1, 2  # purposes of random words
INERTIA = 0.4  # of a sphere, over m R**2
LOW = 2**32 - 1


@dataclass
class World:
    """What a boulder meets. Lengths in m; x east, y north from the south-western cell centre."""

    z: np.ndarray  # (ny, nx), row 0 the northernmost, NaN = no data
    cell: float
    mean: np.ndarray  # (5, 9): of a1..a9 for R_b/R_m = 1..5
    covariance: np.ndarray  # (5, 9, 9), positive definite or zero
    sizes: np.ndarray  # (ny, nx) R_m, or (3, ny, nx) obstacle diameters for method A; Inf absorbs
    start: tuple[float, float]
    seed: int = 1
    drop: float = 0.0
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    volume: tuple[float, float] = (1.0, 0.0)  # mean and deviation of a normal law
    gravity: float = 9.81
    stop_speed: float = 0.5


class Contact(NamedTuple):
    """A contact and what came of it: incoming and outgoing are (V_t, V_n, W)."""

    x: float
    y: float
    z: float
    time: float
    incoming: np.ndarray
    outgoing: np.ndarray
    velocity: np.ndarray  # after it
    ratio: float


def philox(counter: list[int], key: list[int]) -> list[int]:
    """Philox4x32-10 (Salmon et al. 2011), with whole numbers of any size."""
    for _ in range(10):
        a, b = 0xD2511F53 * counter[0], 0xCD9E8D57 * counter[2]
        counter = [b >> 32 ^ counter[1] ^ key[0], b & LOW, a >> 32 ^ counter[3] ^ key[1], a & LOW]
        key = [key[0] + 0x9E3779B9 & LOW, key[1] + 0xBB67AE85 & LOW]
    return counter


def words(seed: int, purpose: int, boulder: int, impact: int, draw: int) -> list[int]:
    """The twelve random words of a draw."""
    found = []
    for block in range(3):
        counter = [boulder & LOW, boulder >> 32, impact, purpose << 24 | 3 * draw + block]
        found += philox(counter, [seed & LOW, seed >> 32])
    return found


def uniform(word: int) -> float:
    """In (0, 1)."""
    return (word + 0.5) / 2**32


def normal(word: int) -> float:
    """Standard normal by inversion, from the nearer tail so that no digit is lost."""
    tail = min(word, LOW - word)
    return math.copysign(norm.ppf(uniform(tail)), word - 2**31 + 0.5)


def node(world: World, i: int, j: int) -> float:
    """Elevation of column i from the west, row j from the south, from 0; NaN outside."""
    ny, nx = world.z.shape
    return float(world.z[ny - 1 - j, i]) if 0 <= i < nx and 0 <= j < ny else math.nan


def corners(world: World, i: int, j: int) -> np.ndarray:
    """Elevations of a patch's corners: [[sw, se], [nw, ne]]."""
    return np.array([[node(world, i + a, j + b) for a in (0, 1)] for b in (0, 1)])


def patch_of(world: World, x: float, y: float) -> tuple[int, int]:
    """The patch at a point: its south-western node."""
    ny, nx = world.z.shape
    column, row = math.floor(x / world.cell), math.floor(y / world.cell)
    return min(max(column, 0), nx - 2), min(max(row, 0), ny - 2)


def surface(z: np.ndarray, u, w) -> np.ndarray:
    """Bilinear height over a patch as a polynomial, for places u, w in it that are polynomials."""
    u, w = [polynomial.polysub([1], u), u], [polynomial.polysub([1], w), w]
    total = np.zeros(1)
    for a in (0, 1):
        for b in (0, 1):
            total = polynomial.polyadd(total, z[b, a] * polynomial.polymul(u[a], w[b]))
    return total


def slope(world: World, z: np.ndarray, u: float, w: float) -> np.ndarray:
    """dz/dx, dz/dy of a patch."""
    dx = (1 - w) * (z[0, 1] - z[0, 0]) + w * (z[1, 1] - z[1, 0])
    dy = (1 - u) * (z[1, 0] - z[0, 0]) + u * (z[1, 1] - z[0, 1])
    return np.array([dx, dy]) / world.cell


def crossings(start: float, speed: float, cell: float, intervals: int) -> list[float]:
    """Times after the start at which a coordinate comes to the side of a patch."""
    if speed == 0:
        return []
    times = [(k * cell - start) / speed for k in range(intervals + 1)]
    return [t for t in times if t > 0]


def fly(world: World, p: np.ndarray, v: np.ndarray, patch: tuple[int, int], on_ground: bool):
    """(time, patch) of the first contact of a flight from p with velocity v; None: it left."""
    ny, nx = world.z.shape
    times = [0.0]
    times += crossings(p[0], v[0], world.cell, nx - 1)
    times += crossings(p[1], v[1], world.cell, ny - 1)
    times = sorted(times) if v[0] or v[1] else [0.0, 1e9]
    for k, (t0, t1) in enumerate(zip(times[:-1], times[1:], strict=True)):
        middle = p + v * (0.5 * (t0 + t1))
        east, north = middle[:2] / world.cell
        if not (0 <= east <= nx - 1 and 0 <= north <= ny - 1):
            return None
        if k > 0:
            patch = patch_of(world, middle[0], middle[1])
        z = corners(world, *patch)
        if np.isnan(z).any():
            return None
        u = [(p[0] + v[0] * t0) / world.cell - patch[0], v[0] / world.cell]
        w = [(p[1] + v[1] * t0) / world.cell - patch[1], v[1] / world.cell]
        flight = [p[2] + (v[2] - world.gravity * t0 / 2) * t0, v[2] - world.gravity * t0]
        flight.append(-world.gravity / 2)
        above = polynomial.polysub(flight, surface(z, u, w))
        above = np.pad(above, (0, 3 - above.size))
        if k == 0 and on_ground:
            roots = [max(0.0, -above[1] / above[2])]  # the other is the start
            if above[1] > 0 and above[2] >= 0:
                roots = []
        elif above[0] <= 0 and above[1] < 0:
            roots = [0.0]  # met between two patches, within a rounding error
        else:
            roots = [s.real for s in polynomial.polyroots(above) if s.imag == 0 and s.real > 0]
        roots = [s for s in roots if s <= t1 - t0]
        if roots:
            return t0 + min(roots), patch
    return None


def cell_descent(world: World, column: int, row: int, g: np.ndarray) -> tuple[np.ndarray, bool]:
    """Downhill vector of a raster cell (Horn 1981), and whether it is a pit; row from the north."""
    ny, nx = world.z.shape
    if not (0 < column < nx - 1 and 0 < row < ny - 1):
        return -g, False
    near = world.z[row - 1 : row + 2, column - 1 : column + 2].astype(float)
    if np.isnan(near).any():
        return -g, False
    weight = np.array([1, 2, 1]) / (8 * world.cell)
    east, north = weight @ (near[:, 2] - near[:, 0]), (near[0] - near[2]) @ weight
    return -np.array([east, north]), bool((near >= near[1, 1]).all())


def turned(heading: float, descent: np.ndarray, pit: bool, g, word_class, word_within) -> float:
    """The heading [rad] after a rebound; angles count towards the descent."""
    within = uniform(word_within)
    if pit:
        return heading
    aspect = math.atan2(descent[1], descent[0]) if descent.any() else heading
    apart = math.remainder(aspect - heading, math.tau)
    if g @ [math.cos(heading), math.sin(heading)] > 0:
        return heading + math.copysign(math.radians(22.5), apart) * (2 * within - 1)
    if not descent.any():
        return heading
    low, high = 0.0, 22.5
    if uniform(word_class) >= 0.96:
        low, high = 45.0, 50.0
    elif uniform(word_class) >= 0.72:
        low, high = 22.5, 45.0
    turn = math.radians(low + (high - low) * within)
    return aspect if abs(apart) <= turn else heading + math.copysign(turn, apart)


def energy(v: np.ndarray) -> float:
    """Twice the kinetic energy per mass of (V_t, V_n, W)."""
    return v[0] ** 2 + v[1] ** 2 + INERTIA * v[2] ** 2


def rebound(world: World, number: int, impact: int, ratio: float, v_in: np.ndarray) -> np.ndarray:
    """(V_t, V_n, W) after the stochastic impact."""
    k = min(5, max(1, math.floor(ratio + 0.5))) - 1
    root = np.zeros((9, 9))
    if world.covariance[k].any():
        root = np.linalg.cholesky(world.covariance[k])
    for draw in range(32):
        z = [normal(word) for word in words(world.seed, IMPACT, number, impact, draw)[:9]]
        v = (world.mean[k] + root @ z).reshape(3, 3) @ v_in
        if v[1] > 0 and energy(v) <= energy(v_in):
            return v
    if v[1] <= 0:
        v[1] = 0.01 * math.hypot(v_in[0], v_in[1])
    return v * min(1.0, math.sqrt(energy(v_in) / energy(v)))


def volume(world: World, number: int) -> float:
    """Normal, and above zero."""
    mean, deviation = world.volume
    draw = 0
    while True:
        drawn = mean + deviation * normal(words(world.seed, RELEASE, number, 0, draw)[0])
        if drawn > 0:
            return drawn
        draw += 1


def rock_radius(world: World, column: int, row: int, word: int) -> float:
    """R_m under a contact."""
    if world.sizes.ndim == 2:
        return float(world.sizes[row, column])
    drawn = 0 if uniform(word) < 0.7 else 1 if uniform(word) < 0.9 else 2
    return float(world.sizes[drawn, row, column]) / 2


def follow(world: World, number: int) -> Iterator[Contact]:
    """The rebounds of a boulder, one by one, until it ends."""
    radius = (3 * volume(world, number) / (4 * math.pi)) ** (1 / 3)
    patch = patch_of(world, *world.start)
    u, w = (c / world.cell - k for c, k in zip(world.start, patch, strict=True))
    height = surface(corners(world, *patch), [u], [w])[0]
    p, v = np.array([*world.start, height + world.drop]), np.array(world.velocity)
    time, impact, spin = 0.0, 0, 0.0
    ahead = np.zeros(2)  # the heading in which the spin counts as forward
    while True:
        met = fly(world, p, v, patch, on_ground=impact > 0 or world.drop == 0)
        if met is None:
            return
        flown, patch = met
        impact, time = impact + 1, time + flown
        p = p + v * flown - np.array([0, 0, world.gravity * flown**2 / 2])
        v = v - np.array([0, 0, world.gravity * flown])
        u, w = (p[k] / world.cell - patch[k] for k in (0, 1))
        z = corners(world, *patch)
        p[2] = surface(z, [u], [w])[0]
        g = slope(world, z, u, w)

        column = patch[0] + (u >= 0.5)
        row = world.z.shape[0] - 1 - patch[1] - (w >= 0.5)
        word = words(world.seed, IMPACT, number, impact, 0)
        rock = rock_radius(world, column, row, word[11])
        if math.isinf(rock):
            return

        up = np.array([-g[0], -g[1], 1.0])
        up /= np.linalg.norm(up)
        along = v - (v @ up) * up
        if along[:2].any():
            heading = math.atan2(along[1], along[0])
        else:
            descent = cell_descent(world, column, row, g)[0]
            heading = math.atan2(descent[1], descent[0])
            if not descent.any():
                return  # level ground, a vertical fall: any heading; not for this judge
        if along[:2] @ ahead < 0:  # it rolls backwards as seen from where it goes now
            spin = -spin
        v_in = np.array([np.linalg.norm(along), min(0.0, v @ up), spin])
        v_out = rebound(world, number, impact, radius / rock, v_in)
        spin = v_out[2]
        if v_out[0] < 0:
            heading, spin = heading + math.pi, -spin
        heading = turned(heading, *cell_descent(world, column, row, g), g, word[9], word[10])
        ahead = np.array([math.cos(heading), math.sin(heading)])
        forward = np.array([*ahead, g @ ahead])
        v = abs(v_out[0]) * forward / np.linalg.norm(forward) + v_out[1] * up
        yield Contact(*p, time, v_in, v_out, v, radius / rock)
        if np.linalg.norm(v) < world.stop_speed:
            return
