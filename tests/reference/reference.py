# SPDX-License-Identifier: BSD-3-Clause
"""Single boulders in slow 50-digit arithmetic, only from the model: a reference for the kernel.

The module shares no code with the program and treats the doubles of a scene as exact numbers, so
that differences are errors of the kernel. It is simple where the kernel is fast: each patch has a
quadratic in the time since the start of the flight, solved by the textbook formula. Only random
numbers are defined as in the kernel: the layout of random words and the quintic pieces of the
normal quantile (rockfall_random, rockfall_impact, rockfall_draws).
"""

from __future__ import annotations

import decimal
import functools
import heapq
import math
import operator
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from itertools import count
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

import classical

decimal.getcontext().prec = 50  # precision of all calculations in this module
RELEASE, IMPACT, GROUND = 1, 2, 5  # purposes of random words
INERTIA = Decimal("0.4")  # I/(m R**2) of a sphere
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494")
LOW = 2**32 - 1
DRAWS = 32  # draws by method A before a rebound is forced
ALONG = Decimal("1e-9")  # a heading this close to the aspect counts as along it
PERCENT = (0, 10, 20, 30, 40, 50, 60, 70, 80, 90, 95, 99, 100)  # probabilities for `lateral`
ZERO, ONE, HALF = Decimal(0), Decimal(1), Decimal("0.5")
SMALLEST = Decimal("1e-52")  # smallest term of a series
Pair = tuple[Decimal, Decimal]
Triple = tuple[Decimal, Decimal, Decimal]


@dataclass(eq=False)  # usable as a key for results computed once
class World:
    """Scene of boulders. Lengths are in m; x is east and y north of the south-western cell
    centre."""

    z: np.ndarray  # (ny, nx) elevations, row 0 the northernmost, NaN = no data
    cell: float
    mean: np.ndarray  # (5, 9) means of a1..a9 for R_b/R_m = 1..5
    covariance: np.ndarray  # (5, 9, 9) covariances; with the noise positive definite or zero
    sizes: np.ndarray  # (1, ny, nx) R_m, or (3, ny, nx) Rg70, Rg20, Rg10; Inf absorbs
    sources: list[tuple[float, float]]
    between: bool = False  # between ratios; False: the nearest
    turning: str = "past_aspect"  # or to_aspect, or lab (with `incidence` and `lateral`)
    incidence: np.ndarray | None = None  # (5, 8) limits between the classes of `lateral` [degree]
    lateral: np.ndarray | None = None  # (5, 9, 13) quantiles of the lateral deviation [degree]
    noise: np.ndarray | None = None  # (5, 3, 3) covariances of the noise of an impact
    boulders: int = 1  # from each source; by area from each level source
    by_area: bool = False
    reading: float = 0.5  # method A: R_m over Rg
    seed: int = 1
    drop: float = 0.0
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    law: str = "normal"
    volume: tuple[float, ...] = (1.0, 0.0)  # mean and std; or minimum and maximum; or the list
    gravity: float = 9.81
    stop_speed: float = 0.5
    impact_limit: int = 100_000
    lines: list[list[tuple[float, float]]] = field(default_factory=list)  # vertices of each line
    grounds: list[classical.Ground | None] = field(default_factory=list)  # None: impact sets
    ground: np.ndarray | None = None  # (ny, nx) index of the ground, if there are several
    density: float = 2800.0
    folded: np.ndarray = field(init=False)  # (5, 9, 9) covariances including the noise
    covariances: list[list[list[Decimal]]] = field(init=False)  # same, as decimals
    means: list[list[Decimal]] = field(init=False)
    last: list[int] = field(init=False)  # last boulder of each source

    def __post_init__(self) -> None:
        noise = np.zeros((5, 3, 3)) if self.noise is None else self.noise
        self.folded = self.covariance + [np.kron(s, np.eye(3)) for s in noise]
        self.covariances = [[list(map(exact, row)) for row in c] for c in self.folded]
        self.means = [list(map(exact, mean)) for mean in self.mean]
        self.last = last_boulders(self)


class Doubt:
    """Smallest relative margin of all decisions so far; rounding errors may reverse a decision with
    a small margin."""

    def __init__(self) -> None:
        self.least = math.inf

    def above(self, value: Decimal, scale: Decimal) -> bool:
        """Return True if a value is above zero; record its margin relative to `scale`."""
        if scale:
            self.least = min(self.least, float(abs(value) / scale))
        return value > 0


class Patch(NamedTuple):
    """Patch z = z00 + a u + b w + c u w, u and w in 0..1; node (i, j), from 0, south-western."""

    i: int
    j: int
    z00: Decimal
    a: Decimal
    b: Decimal
    c: Decimal

    def height(self, u: Decimal, w: Decimal) -> Decimal:
        return self.z00 + self.a * u + self.b * w + self.c * u * w

    def slope(self, cell: Decimal, u: Decimal, w: Decimal) -> Pair:
        return (self.a + self.c * w) / cell, (self.b + self.c * u) / cell

    def steepest(self, cell: float) -> float:
        """Upper bound of |dz/dx| + |dz/dy|."""
        return float(abs(self.a) + abs(self.b) + 2 * abs(self.c)) / cell


class State(NamedTuple):
    """State of a boulder as it leaves its release or a contact."""

    x: Decimal
    y: Decimal
    above: Decimal  # height above the surface; 0 after a contact
    v: Triple
    spin: Decimal = ZERO  # W with respect to the heading
    heading: Pair = (ZERO, ZERO)  # direction of the tangential velocity after the last rebound
    patch: Patch | None = None  # patch below the boulder, if several meet; None: from `place`


class Landing(NamedTuple):
    """End of a flight: the first contact, or the place where it leaves the known terrain."""

    contact: bool
    time: Decimal  # flight time
    x: Decimal
    y: Decimal
    z: Decimal
    v: Triple
    patch: Patch  # last patch below the flight
    highest: Decimal  # maximum height above the surface
    steepest: float  # bound over the patches below, as in Patch
    beyond: str  # status of a boulder without a contact


class Rebound(NamedTuple):
    """Result of a contact; `incoming` and `outgoing` are (V_t, V_n, W)."""

    incoming: Triple
    outgoing: Triple
    velocity: Triple
    spin: Decimal  # W with respect to the heading
    heading: Pair
    ratio: Decimal
    weight: float  # maximum sensitivity of outgoing to incoming: scale of rounding errors


class Contact(NamedTuple):
    """Flight and its end; `status` is empty if the boulder continues."""

    landing: Landing
    rebound: Rebound | None
    status: str
    doubt: float


class Crossing(NamedTuple):
    """State of a boulder at an evaluation line."""

    time: Decimal  # time since the start of the flight
    x: Decimal
    y: Decimal
    v: Triple
    jump: Decimal
    passing: Decimal
    omega: Decimal


# ---- numbers


def exact(number) -> Decimal:
    return Decimal(float(number))


def dot(a, b) -> Decimal:
    assert len(a) == len(b)
    return sum(map(operator.mul, a, b), ZERO)


def length(v) -> Decimal:
    return dot(v, v).sqrt()


def cosine_sine(angle: Decimal) -> Pair:
    """Cosine and sine, by their series."""
    total, term, n = [ONE, ZERO], ONE, 0
    while abs(term) > SMALLEST or n < 2:
        n += 1
        term *= angle / n
        total[n % 2] += -term if n % 4 in (2, 3) else term
    return total[0], total[1]


def quantile(tail: Decimal) -> Decimal:
    """Standard normal number exceeded with probability `tail` <= 1/2, by Newton's method."""
    x = exact(-NormalDist().inv_cdf(float(tail)))
    for _ in range(3):
        density = (-x * x / 2).exp() / (2 * PI).sqrt()
        term, middle, n = x, x, 1
        while term > Decimal("1e-55"):  # series of Phi(x) - 1/2 over the density
            n += 2
            term *= x * x / n
            middle += term
        x += (HALF - density * middle - tail) / density
    return x


@functools.cache
def piece(octave: int, eighth: int) -> tuple[list[Decimal], list[Decimal]]:
    """Chebyshev points in an eighth of an octave, and divided differences of the quantile at these
    points."""
    middle = 1 + (eighth + HALF) / 8
    nodes = [middle + cosine_sine((2 * k + 1) * PI / 12)[0] / 16 for k in range(6)]
    found = [quantile(node * Decimal(2) ** (octave - 33)) for node in nodes]
    for j in range(1, 6):
        for k in range(5, j - 1, -1):
            found[k] = (found[k] - found[k - 1]) / (nodes[k] - nodes[k - j])
    return nodes, found


def normal(word: int) -> Decimal:
    """Standard normal number of a word, by a quintic through the quantile at six points."""
    side = 2 * word + 1 - 2**32
    tail = 2**32 - abs(side)  # tail times 2**33
    octave = tail.bit_length() - 1
    nodes, differences = piece(octave, (8 * tail >> octave) % 8)
    share = tail / Decimal(2**octave)
    value = ZERO
    for node, difference in zip(reversed(nodes), reversed(differences), strict=True):
        value = value * (share - node) + difference
    return value if side > 0 else -value


def cholesky(c: list[list[Decimal]]) -> list[list[Decimal]]:
    """Lower triangular L with L L^T = c, definite or zero; only the lower half of c is used."""
    root = [[ZERO] * len(c) for _ in c]
    if not any(map(any, c)):
        return root
    for i in range(len(c)):
        for j in range(i + 1):
            left = c[i][j] - dot(root[i][:j], root[j][:j])
            root[i][j] = left.sqrt() if i == j else left / root[j][j]
    return root


# ---- random words


def philox(counter: list[int], seed: int) -> list[int]:
    """Philox4x32-10 (Salmon et al. 2011), with integers of any size."""
    key = [seed & LOW, seed >> 32]
    for _ in range(10):
        a, b = 0xD2511F53 * counter[0], 0xCD9E8D57 * counter[2]
        counter = [b >> 32 ^ counter[1] ^ key[0], b & LOW, a >> 32 ^ counter[3] ^ key[1], a & LOW]
        key = [key[0] + 0x9E3779B9 & LOW, key[1] + 0xBB67AE85 & LOW]
    return counter


def words(world: World, purpose: int, boulder: int, impact: int, draw: int) -> list[int]:
    """Four random words of a draw."""
    return philox([boulder & LOW, boulder >> 32, impact, purpose << 24 | draw], world.seed)


def uniform(word: int) -> Decimal:
    return (word + HALF) / 2**32


NUMBERS = classical.Numbers(normal, uniform, cosine_sine)
#: Maximum amplification of velocity errors in a classical rebound: energy fractions fall with speed
#: and W - V_t, by less than their own size per doubling.
CLASSICAL_WEIGHT = 4.0


# ---- terrain


def node(world: World, i: int, j: int) -> float:
    """Elevation of column i from the west, row j from the south, counted from 0; NaN outside."""
    ny, nx = world.z.shape
    return float(world.z[ny - 1 - j, i]) if 0 <= i < nx and 0 <= j < ny else math.nan


def on_raster(world: World, i: int, j: int) -> bool:
    """Return True if a patch lies between the outermost cell centres."""
    ny, nx = world.z.shape
    return 0 <= i < nx - 1 and 0 <= j < ny - 1


@functools.cache
def patch(world: World, i: int, j: int) -> Patch | None:
    """Patch (i, j); None next to nodata and beyond the edge of the raster."""
    corners = [node(world, i + k % 2, j + k // 2) for k in range(4)]
    if any(map(math.isnan, corners)):
        return None
    sw, se, nw, ne = map(Decimal, corners)
    return Patch(i, j, sw, se - sw, nw - sw, ne - nw - se + sw)


def place(world: World, x: Decimal, y: Decimal) -> tuple[Patch, Decimal, Decimal]:
    """Known patch at a point, and the position in it; of several patches, the north-eastern."""
    u, w = x / exact(world.cell), y / exact(world.cell)
    i, j = math.floor(u), math.floor(w)
    for near in ((i, j), (i - (u == i), j), (i, j - (w == j)), (i - (u == i), j - (w == j))):
        if found := patch(world, *near):
            return found, u - near[0], w - near[1]
    raise ValueError(f"no terrain at {x}, {y}")


def meeting(world: World, x: Decimal, y: Decimal, near: Decimal) -> list[Patch]:
    """Known patches at a point: more than one if it is within `near` [cells] of a side."""
    u, w = x / exact(world.cell), y / exact(world.cell)
    columns, rows = ({math.floor(p - near), math.floor(p + near)} for p in (u, w))
    found = [patch(world, i, j) for i in sorted(columns) for j in sorted(rows)]
    return [one for one in found if one]


def surface(world: World, x: Decimal, y: Decimal) -> Decimal:
    found, u, w = place(world, x, y)
    return found.height(u, w)


@functools.cache
def horn(world: World, column: int, row: int) -> tuple[Pair, bool] | None:
    """Downhill vector of a raster cell (Horn 1981), and whether the cell is a pit; None if one of
    its neighbours is missing. Rows count from the north."""
    ny, nx = world.z.shape
    if not (0 < column < nx - 1 and 0 < row < ny - 1):
        return None
    near = world.z[row - 1 : row + 2, column - 1 : column + 2].astype(float)
    if np.isnan(np.delete(near, 4)).any():
        return None
    z, across = [[exact(value) for value in row] for row in near], 8 * exact(world.cell)
    east = sum(weight * (z[k][2] - z[k][0]) for k, weight in enumerate((1, 2, 1)))
    north = sum(weight * (z[0][k] - z[2][k]) for k, weight in enumerate((1, 2, 1)))
    return (-east / across, -north / across), bool((near >= near[1, 1]).all())


def nearest_cell(world: World, at: Patch, u: Decimal, w: Decimal, doubt: Doubt) -> tuple[int, int]:
    """Column and row, counted from the north, of the cell whose centre is nearest to a position in
    a patch."""
    column = at.i + (doubt.above(u - HALF, ONE) or u == HALF)
    return column, world.z.shape[0] - 1 - at.j - (doubt.above(w - HALF, ONE) or w == HALF)


# ---- release


def last_boulders(world: World) -> list[int]:
    if not world.by_area:
        return [world.boulders * (k + 1) for k in range(len(world.sources))]
    total, last = ZERO, []
    for x, y in world.sources:
        at, u, w = place(world, exact(x), exact(y))
        found = horn(world, *nearest_cell(world, at, u, w, Doubt()))
        downhill = found[0] if found else at.slope(exact(world.cell), u, w)
        total += (1 + dot(downhill, downhill)).sqrt()
        last.append(math.floor(world.boulders * total))
    return last


def source_of(world: World, number: int) -> tuple[int, int]:
    """Source of a boulder, and the boulder's index within the source, both from 0."""
    source = next(k for k, last in enumerate(world.last) if number <= last)
    return source, number - 1 - (world.last[source - 1] if source else 0)


def volume(world: World, number: int) -> Decimal:
    """Volume from its distribution; a normal volume is redrawn until positive."""
    first = words(world, RELEASE, number, 0, 0)[0]
    values = [exact(value) for value in world.volume]
    if world.law == "list":
        return values[math.floor(uniform(first) * len(values))]
    if world.law == "pareto":
        low, high, exponent = values
        ends = low**-exponent, high**-exponent
        return (ends[0] - uniform(first) * (ends[0] - ends[1])) ** (-1 / exponent)
    if world.law == "uniform":
        return values[0] + (values[1] - values[0]) * uniform(first)
    mean, deviation = values
    if world.law == "lognormal":
        variance = (1 + (deviation / mean) ** 2).ln()
        return mean * (variance.sqrt() * normal(first) - variance / 2).exp()
    for draw in count():
        drawn = mean + deviation * normal(words(world, RELEASE, number, 0, draw)[0])
        if drawn > 0:
            return drawn


@functools.cache
def radius(world: World, number: int) -> Decimal:
    return (3 * volume(world, number) / (4 * PI)) ** (ONE / 3)


def release(world: World, number: int) -> State:
    """State at the release: above the source, at rest or with the release velocity."""
    x, y = world.sources[source_of(world, number)[0]]
    return State(exact(x), exact(y), exact(world.drop), tuple(map(exact, world.velocity)))


# ---- flight


def sides(start: Decimal, speed: Decimal) -> Iterator[Decimal]:
    """Times at which a coordinate [cells] reaches the sides of patches, in order."""
    if not speed:
        return
    step = 1 if speed > 0 else -1
    first = math.floor(start) + 1 if speed > 0 else math.ceil(start) - 1
    for k in count(first, step):
        yield (k - start) / speed


def fly(world: World, state: State, doubt: Doubt) -> Landing:
    """First contact of a flight, or the place where it leaves the known terrain."""
    cell, gravity = exact(world.cell), exact(world.gravity)
    u, w = state.x / cell, state.y / cell
    p, q, rise = state.v[0] / cell, state.v[1] / cell, state.v[2]
    z = surface(world, state.x, state.y) + state.above
    begin, highest, found, beyond = ZERO, state.above, None, ""
    at = state.patch or place(world, state.x, state.y)[0]
    steepest = at.steepest(world.cell)
    if not p and not q:  # it falls onto the patch below, whose sides may be near
        doubt.least = float(min(abs(c - round(c)) for c in (u, w)))
    for end in heapq.merge(sides(u, p), sides(w, q), [Decimal("Infinity")]):
        if end == begin:
            continue
        middle = (begin + end) / 2
        if p or q:
            here = math.floor(u + p * middle), math.floor(w + q * middle)
            below = patch(world, *here)
            if below is None:
                beyond = "hit_nodata" if on_raster(world, *here) else "left_domain"
                break
            at, steepest = below, max(steepest, below.steepest(world.cell))
        du, dw = u - at.i, w - at.j
        above = (
            z - at.height(du, dw) if begin or state.above else ZERO,
            rise - at.a * p - at.b * q - at.c * (du * q + dw * p),
            -gravity / 2 - at.c * p * q,
        )
        found = first_root(above, begin, end, begin == 0 and not state.above, abs(z) + 1, doubt)
        highest = max(highest, top(above, begin, end if found is None else found))
        if found is not None:
            break
        begin = end
    time = begin if found is None else found
    x, y = state.x + state.v[0] * time, state.y + state.v[1] * time
    v = (*state.v[:2], rise - gravity * time)
    height = z + time * (rise - gravity * time / 2)
    return Landing(found is not None, time, x, y, height, v, at, highest, steepest, beyond)


def value(above: Triple, t: Decimal) -> Decimal:
    return above[0] + t * (above[1] + t * above[2])


def first_root(
    above: Triple, begin: Decimal, end: Decimal, grounded: bool, scale: Decimal, doubt: Doubt
) -> Decimal | None:
    """First time at which the height over a patch, quadratic in time, becomes negative."""
    _, rate, bend = above
    finite = end.is_finite()
    vertex = -rate / (2 * bend) if bend else None
    dips = bend > 0 and begin < vertex and (not finite or vertex < end)
    if grounded:
        if rate < 0 or (rate == 0 and bend < 0):
            return ZERO
        found = -rate / bend if bend < 0 else None
    else:
        found = _falling_root(above, begin)
    if found is None or found > end:
        if finite:
            doubt.above(value(above, end), scale)
        if dips and not grounded:
            doubt.above(value(above, vertex), scale)
        return None
    depths = [value(above, end)] if finite else []
    depths += [value(above, vertex)] if dips and not grounded else []
    if depths:
        doubt.above(min(depths), scale)
    return found


def _falling_root(above: Triple, begin: Decimal) -> Decimal | None:
    """First time from `begin` on at which the quadratic falls through zero; `begin` if it is not
    positive and falls there; None if there is no such time."""
    base, rate, bend = above
    if value(above, begin) <= 0 and rate + 2 * bend * begin < 0:
        return begin
    if not bend:
        return max(begin, -base / rate) if rate < 0 else None
    under = rate * rate - 4 * bend * base
    if under < 0:
        return None
    found = (-rate - under.sqrt()) / (2 * bend)  # the slope there is minus the square root
    return found if found >= begin else None


def top(above: Triple, begin: Decimal, end: Decimal) -> Decimal:
    """Maximum of a quadratic between two times."""
    found = max(value(above, begin), value(above, end))
    if above[2] < 0 and begin < (vertex := -above[1] / (2 * above[2])) < end:
        found = max(found, value(above, vertex))
    return found


def arc_length(v: Triple, gravity: Decimal, time: Decimal) -> Decimal:
    """Path length of a flight [m]."""
    plan = length(v[:2])
    ends = [v[2], v[2] - gravity * time]
    if not plan:
        return abs(ends[0] * abs(ends[0]) - ends[1] * abs(ends[1])) / (2 * gravity)
    parts = [s * length((plan, s)) + plan**2 * _area_sinh(s / plan) for s in ends]
    return (parts[0] - parts[1]) / (2 * gravity)


def _area_sinh(s: Decimal) -> Decimal:
    found = (abs(s) + (1 + s * s).sqrt()).ln()
    return found if s >= 0 else -found


# ---- rebound


def rock_radius(world: World, column: int, row: int, word: int) -> Decimal:
    """R_m [m] at a contact; Infinity for ground that absorbs."""
    if len(world.sizes) == 1:
        return exact(world.sizes[0, row, column])
    share = uniform(word)
    drawn = 0 if share < Decimal("0.7") else 1 if share < Decimal("0.9") else 2
    return exact(world.sizes[drawn, row, column]) * exact(world.reading)


def energy(v: Triple) -> Decimal:
    """Twice the kinetic energy per mass [m2/s2] for (V_t, V_n, W)."""
    return v[0] ** 2 + v[1] ** 2 + INERTIA * v[2] ** 2


@functools.lru_cache(maxsize=1)  # cache for the draws of an impact and their sensitivity
def law_of_outgoing(world: World, k: int, v: Triple) -> tuple[list[Decimal], list[list[Decimal]]]:
    """Mean of A V for a normal A, and the Cholesky root of its covariance."""
    c = world.covariances[k]
    mean = [dot(world.means[k][i : i + 3], v) for i in (0, 3, 6)]
    return mean, cholesky(
        [
            [dot(v, [dot(row[j : j + 3], v) for row in c[i : i + 3]]) for j in range(0, i + 1, 3)]
            for i in (0, 3, 6)
        ]
    )


def draw_outgoing(world: World, k: int, v: Triple, z: list[Decimal]) -> Triple:
    """A V, from three standard normal numbers."""
    mean, root = law_of_outgoing(world, k, v)
    return tuple(m + dot(row, z) for m, row in zip(mean, root, strict=True))


def growth(world: World, k: int, v: Triple, z: list[Decimal]) -> float:
    """Maximum, over the components of A V, of their relative size and sensitivity to V."""
    mean, root = law_of_outgoing(world, k, v)
    scale = max(map(abs, v)) or ONE
    small = scale * Decimal("1e-20")
    out = draw_outgoing(world, k, v, z)
    rows = [
        (abs(m) + sum(abs(a) * (1 + abs(b)) for a, b in zip(row, z, strict=True))) / scale
        for m, row in zip(mean, root, strict=True)
    ]
    for i in range(3):
        moved = draw_outgoing(world, k, (*v[:i], v[i] + small, *v[i + 1 :]), z)
        rows = [row + abs(a - b) / small for row, a, b in zip(rows, moved, out, strict=True)]
    return float(max(rows))


def set_of(world: World, number: int, hit: int, ratio: Decimal, doubt: Doubt) -> int:
    """Index, from 0, of the impact set for a ratio R_b/R_m."""
    if world.between:
        word = words(world, GROUND, number, hit, 0)[1]
        lower = min(Decimal(5), max(ONE, ratio)) // 1
        upper = doubt.above(min(Decimal(5), ratio) - lower - uniform(word), ONE)
        return int(lower) - 1 + upper
    doubt.above(ratio % 1 - HALF, ONE)
    return min(5, max(1, math.floor(ratio + HALF))) - 1


def impact(
    world: World, number: int, hit: int, k: int, v_in: Triple, doubt: Doubt
) -> tuple[Triple, float]:
    """Velocities (V_t, V_n, W) after the impact by set k, and their sensitivity to the incoming
    velocities."""
    before = energy(v_in)
    for draw in range(DRAWS):
        z = [normal(word) for word in words(world, IMPACT, number, hit, draw)[:3]]
        v = draw_outgoing(world, k, v_in, z)
        leaves = doubt.above(v[1], before.sqrt())
        gains = doubt.above(energy(v) - before, before)
        if leaves and not gains:
            return v, growth(world, k, v_in, z)
    return limited(v_in, v), growth(world, k, v_in, z)


def limited(v_in: Triple, v: Triple) -> Triple:
    """Last draw changed so that it leaves the ground without a gain of energy."""
    if v[1] <= 0:
        v = v[0], length(v_in[:2]) / 100, v[2]
    if energy(v) > energy(v_in):
        v = tuple(one * (energy(v_in) / energy(v)).sqrt() for one in v)
    return v


def turn(u: Decimal) -> Decimal:
    """Angle of a turn [degree] in the printed classes, uniform in each class."""
    for below, above, low, high in (("0.96", 1, 45, 50), ("0.72", "0.96", "22.5", 45)):
        if u >= Decimal(below):
            within = (u - Decimal(below)) / (Decimal(above) - Decimal(below))
            return Decimal(low) + (Decimal(high) - Decimal(low)) * within
    return Decimal("22.5") * u / Decimal("0.72")


def lateral_deviation(world: World, k: int, v_in: Triple, u: Decimal, doubt: Doubt) -> Decimal:
    """Angle of a turn [degree] as in the laboratory, for the class of incidence of `v_in`."""
    class_ = 0
    for degrees in world.incidence[k]:
        c, s = cosine_sine(exact(degrees) * PI / 180)
        steeper = -v_in[1] * c - v_in[0] * s
        class_ += doubt.above(steeper, length(v_in[:2])) or steeper == 0
    quantiles = [exact(degrees) for degrees in world.lateral[k, class_]]
    i = max(j for j, percent in enumerate(PERCENT[:-1]) if 100 * u >= percent)
    share = (100 * u - PERCENT[i]) / (PERCENT[i + 1] - PERCENT[i])
    return (1 - share) * quantiles[i] + share * quantiles[i + 1]


def left_of(heading: Pair, downhill: Pair, doubt: Doubt) -> int:
    """Side of the aspect relative to the heading: left (1), right (-1), or along it (0)."""
    across = heading[0] * downhill[1] - heading[1] * downhill[0]
    sine = across / length(downhill) if any(downhill) else ZERO
    if not doubt.above(abs(sine) - ALONG, ONE):
        return 0
    return 1 if sine > 0 else -1


def rotated(heading: Pair, degrees: Decimal) -> Pair:
    """Rotate a vector anticlockwise."""
    c, s = cosine_sine(degrees * PI / 180)
    return c * heading[0] - s * heading[1], s * heading[0] + c * heading[1]


def wandered(heading: Pair, downhill: Pair, within: Decimal, doubt: Doubt) -> Pair:
    """New heading upslope, within 22.5 degrees of the old one; positive angles are towards the
    descent."""
    across = heading[0] * downhill[1] - heading[1] * downhill[0]
    right = not doubt.above(across, length(downhill)) and across < 0
    degrees = Decimal("22.5") * (2 * within - 1)
    return rotated(heading, -degrees if right else degrees)


def turned(
    heading: Pair, downhill: Pair, degrees: Decimal, past: bool, odd: int, doubt: Doubt
) -> Pair:
    """Heading turned towards the aspect: past it, or at most to it. A heading along the aspect
    turns to either side."""
    if not past:
        aspect = tuple(d / length(downhill) for d in downhill)
        cosine = cosine_sine(degrees * PI / 180)[0]
        if not doubt.above(cosine - dot(heading, aspect), ONE):
            return aspect
    side = left_of(heading, downhill, doubt) or (1 if odd else -1)
    return rotated(heading, side * degrees)


def deviated(
    heading: Pair, downhill: Pair, up: Triple, degrees: Decimal, odd: int, doubt: Doubt
) -> Pair:
    """Heading turned to either side about the normal of the patch, by Rodrigues' formula."""
    side = (1 if odd else -1) * (left_of(heading, downhill, doubt) or 1)
    c, s = cosine_sine(side * degrees * PI / 180)
    ahead = (*heading, -(up[0] * heading[0] + up[1] * heading[1]) / up[2])
    left = (up[1] * ahead[2] - up[2] * ahead[1], up[2] * ahead[0] - up[0] * ahead[2])
    after = [c * a + s * b for a, b in zip(ahead[:2], left, strict=True)]
    return after[0] / length(after), after[1] / length(after)


def any_heading(within: Decimal) -> Pair:
    """Any heading, for a vertical impact on ground without descent; `within` = 0 is the
    south-east."""
    quarter = math.floor(4 * within)
    c, s = cosine_sine((4 * within - quarter - HALF) * PI / 2)
    for _ in range(quarter):
        c, s = -s, c
    return c, s


def bounce(
    world: World, number: int, hit: int, state: State, landing: Landing, doubt: Doubt
) -> Rebound | None:
    """Result of a contact; None if the boulder is absorbed."""
    cell, at = exact(world.cell), landing.patch
    u, w = landing.x / cell - at.i, landing.y / cell - at.j
    column, row = nearest_cell(world, at, u, w, doubt)
    word = words(world, IMPACT, number, hit, 0)
    rock = rock_radius(world, column, row, words(world, GROUND, number, hit, 0)[0])
    if rock.is_infinite():
        return None
    ground = None if world.ground is None else world.grounds[world.ground[row, column]]
    obstacle = rock / exact(world.reading)
    if ground is not None and (
        ground.model == "absorbs" or (ground.model == "rockyfor3d" and obstacle >= 100)
    ):
        return None
    g = at.slope(cell, u, w)
    steep = (1 + dot(g, g)).sqrt()
    up = (-g[0] / steep, -g[1] / steep, 1 / steep)
    normal_speed = dot(landing.v, up)
    along = [v - normal_speed * n for v, n in zip(landing.v, up, strict=True)]
    heading = (ZERO, ZERO)
    if any(along[:2]):
        heading = tuple(a / length(along[:2]) for a in along[:2])
    spin = state.spin
    if any(state.heading) and any(heading) and doubt.above(-dot(heading, state.heading), ONE):
        spin = -spin  # relative to the new heading, it rolls backwards
    v_in = (length(along), min(ZERO, normal_speed), spin)
    ratio = radius(world, number) / rock if rock else Decimal(10**9)
    k = set_of(world, number, hit, ratio, doubt)
    if ground is None:
        v_out, weight = impact(world, number, hit, k, v_in, doubt)
    else:
        mass = exact(world.density) * volume(world, number)
        own = radius(world, number), mass, obstacle
        tilt = uniform(words(world, GROUND, number, hit, 0)[2])
        v_out = classical.outgoing(ground, word, tilt, *own, v_in, NUMBERS)
        leaves = doubt.above(v_out[1], energy(v_in).sqrt())
        gains = energy(v_out) > energy(v_in)
        v_out = v_out if leaves and not gains else limited(v_in, v_out)
        before = v_out
        v_out = classical.thrown(ground, own[0], exact(world.gravity) / steep, v_out)
        doubt.above(v_out[1] - before[1] or ONE, v_out[1])
        weight, ratio = CLASSICAL_WEIGHT, Decimal(-1)

    downhill, pit = horn(world, column, row) or ((-g[0], -g[1]), False)
    if not any(heading):
        heading = any_heading(uniform(word[3]))
        if any(downhill):
            heading = tuple(d / length(downhill) for d in downhill)
    spin = v_out[2]
    if v_out[0] < 0:
        heading, spin = (-heading[0], -heading[1]), -spin
    rising = doubt.above(dot(g, heading), steep) if any(g) else False
    if rising and not pit:
        heading = wandered(heading, downhill, uniform(word[3]), doubt)
    elif world.turning == "lab" and not pit:
        degrees = lateral_deviation(world, k, v_in, uniform(word[3]), doubt)
        heading = deviated(heading, downhill, up, degrees, word[3] & 1, doubt)
    elif any(downhill) and not pit:
        degrees = turn(uniform(word[3]))
        past = world.turning == "past_aspect"
        heading = turned(heading, downhill, degrees, past, word[3] & 1, doubt)
    climb = dot(g, heading)
    ahead = abs(v_out[0]) / (1 + climb**2).sqrt()
    forward = (*heading, climb)
    velocity = tuple(ahead * f + v_out[1] * n for f, n in zip(forward, up, strict=True))
    return Rebound(v_in, v_out, velocity, spin, heading, ratio, weight)


def step(world: World, number: int, hit: int, state: State) -> Contact:
    """Flight from a state to contact number `hit`, and result of that contact."""
    doubt = Doubt()
    landing = fly(world, state, doubt)
    if not landing.contact:
        return Contact(landing, None, landing.beyond, doubt.least)
    found = bounce(world, number, hit, state, landing, doubt)
    if found is None:
        return Contact(landing, None, "absorbed", doubt.least)
    speed, stop = length(found.velocity), exact(world.stop_speed)
    status = "" if hit < world.impact_limit else "impact_limit"
    if doubt.above(stop - speed, stop):
        status = "stopped"
    return Contact(landing, found, status, doubt.least)


def leave(contact: Contact) -> State:
    hit = contact.rebound
    return State(contact.landing.x, contact.landing.y, ZERO, hit.velocity, hit.spin, hit.heading)


def follow(world: World, number: int) -> Iterator[Contact]:
    """Yield the contacts of a boulder, up to its end."""
    state = release(world, number)
    for hit in count(1):
        contact = step(world, number, hit, state)
        yield contact
        if contact.status:
            return
        state = leave(contact)


# ---- evaluation lines


def _cross(o, a, b) -> Decimal:
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def crossing(
    world: World, number: int, state: State, landing: Landing, line: int, doubt: Doubt
) -> Crossing | None:
    """First crossing of an evaluation line by a flight; a point on the line counts as left of
    it."""
    a, b = (state.x, state.y), (landing.x, landing.y)
    vertices = [tuple(map(exact, vertex)) for vertex in world.lines[line]]
    shares = []
    for p, q in zip(vertices[:-1], vertices[1:], strict=True):
        scale = length((q[0] - p[0], q[1] - p[1])) * exact(world.cell)
        from_, to = _cross(p, q, a), _cross(p, q, b)
        doubt.above(to, scale)
        if (from_ >= 0) != (to >= 0) and (_cross(a, b, p) >= 0) != (_cross(a, b, q) >= 0):
            shares.append(from_ / (from_ - to))
    if not shares:
        return None
    t = min(shares) * landing.time
    gravity = exact(world.gravity)
    x, y = state.x + state.v[0] * t, state.y + state.v[1] * t
    at, u, w = place(world, x, y)
    g = at.slope(exact(world.cell), u, w)
    rise = t * (state.v[2] - gravity * t / 2)
    jump = max(ZERO, surface(world, state.x, state.y) + state.above + rise - at.height(u, w))
    own = radius(world, number)
    passing = jump + own * (1 + dot(g, g)).sqrt()
    return Crossing(
        t, x, y, (*state.v[:2], state.v[2] - gravity * t), jump, passing, state.spin / own
    )
