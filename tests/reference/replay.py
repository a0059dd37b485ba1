# SPDX-License-Identifier: BSD-3-Clause
"""The kernel's trajectories compared with the reference: each contact by itself, and from the
release.

Each contact is repeated from the kernel's state after the previous contact, so that the error is
that of one flight and one rebound. Its bound is from a first-order rounding analysis (Higham 2002,
Accuracy and Stability of Numerical Algorithms, chapters 1, 3 and 10): backward errors in units of U
times the condition numbers of subsequent steps. Decisions with a margin below `UNDECIDED` in the
reference may differ; such contacts are counted but not judged."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import classical
import reference
from reference import Contact, Doubt, Landing, Patch, State, World, exact
from rockfall.case.text import read_groups
from rockfall.io.rasters.grid import Grid
from rockfall.result.crossings import at_lines, has_crossed

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.grounds import GroundRule
    from rockfall.scene.scene import Scene

U = 2.0**-53  # unit roundoff
UNDECIDED = 1e-12  # relative margin of a decision: several thousand roundings
FIELDS = ("x", "y", "z", "time", "velocity_x", "velocity_y", "velocity_z", "in_t", "in_n", "in_w",
          "out_t", "out_n", "out_w", "ratio")  # fmt: skip
SPEED, IN, OUT, RATIO = slice(4, 7), slice(7, 10), slice(10, 13), 13
#: quantities compared at a contact, their units, and the reference of ulps
QUANTITIES = {"place": "m", "height over the patch": "m", "time": "s", "V_in": "m/s",
              "V_out": "m/s", "velocity": "m/s", "heading": "rad", "R_b/R_m": "1"}  # fmt: skip
SINGLE = 2.0**-24  # relative rounding of crossings stored in results
CROSSED = {"line_x": "m", "line_y": "m", "line_time": "s", "line_speed": "m/s",
           "line_jump_height": "m", "line_passing_height": "m", "line_omega": "rad/s"}  # fmt: skip
TOTALS = ("path_length", "travel_time", "speed_max", "jump_height_max", "volume")


class Error(NamedTuple):
    """Difference between the kernel and the reference."""

    size: float
    bound: float
    ulp: float  # unit in the last place of the quantity

    @classmethod
    def of(cls, size, bound: float, scale) -> Error:
        return cls(abs(float(size)), bound, float(np.spacing(abs(float(scale)))))

    @property
    def share(self) -> float:
        """Error over its bound; above 1, the kernel or the analysis is wrong."""
        if not math.isfinite(self.size):
            return math.inf
        return self.size / self.bound if self.size else 0.0


class Flight(NamedTuple):
    """Error bounds of a landing, and the quantities that enter them."""

    place: float  # position [m]
    height: float  # height of the recorded position over the surface [m]
    time: float  # time [s]
    slope: float  # maximum of the patch, |dz/dx| + |dz/dy|
    twist: float  # second derivative of the patch [1/m]


@dataclass
class Replay:
    """Errors of a boulder's contacts, each computed from the kernel's previous state."""

    contacts: list[list[Error]] = field(default_factory=list)  # errors in the order of QUANTITIES
    crossings: list[list[Error]] = field(default_factory=list)  # in the order of CROSSED
    totals: list[Error] = field(default_factory=list)  # in the order of TOTALS
    undecided: int = 0  # number of undecided contacts: 0 or 1, because judging stops there
    faults: list[str] = field(default_factory=list)  # ends or paths that differ


@dataclass
class Sums:
    """Sums and extremes over the flights of a boulder, with error bounds."""

    fastest: float  # maximum speed [m/s]
    highest: float = 0.0  # maximum height above the surface [m]
    length: float = 0.0  # path length [m]
    d_fastest: float = 0.0
    d_highest: float = 0.0
    d_length: float = 0.0

    def add(self, world: World, state: State, contact: Contact, flight: Flight) -> None:
        """Add a flight. The error of its length is that of a difference of squared speeds over
        gravity."""
        gravity, landing = world.gravity, contact.landing
        after = contact.rebound.velocity if contact.rebound else landing.v
        speeds = [float(reference.length(v)) for v in (state.v, landing.v, after)]
        length = float(reference.arc_length(state.v, exact(gravity), landing.time))
        self.fastest = max(self.fastest, *speeds)
        self.highest = max(self.highest, float(landing.highest))
        self.length += length
        roundings = U * (20 * max(speeds) ** 2 / gravity + 2 * self.length)
        self.d_length += max(speeds) * flight.time + roundings
        self.d_fastest = max(self.d_fastest, gravity * flight.time + 4 * U * max(speeds))
        far = float(max(abs(p) for p in (state.x, state.y, landing.x, landing.y)))
        steep = 6 * U * far * max(0.0, landing.steepest - flight.slope)
        rise = 20 * U * max(speeds) ** 2 / gravity
        self.d_highest = max(self.d_highest, flight.height + steep + rise)

    def bounded(self, time: float) -> list[tuple[float, float]]:
        """Values and bounds in the order of TOTALS; `time` is the kernel's time at the end."""
        return [(self.length, self.d_length), (time, U * time),
                (self.fastest, self.d_fastest), (self.highest, self.d_highest)]  # fmt: skip


def volume(world: World, number: int) -> tuple[float, float]:
    """Volume of a boulder and its error bound: roundings of the terms of its distribution, up to
    seven standard deviations from the mean; for a lognormal volume they are in an exponent."""
    value, scale = reference.volume(world, number), max(world.volume)
    if world.law == "normal":
        scale = world.volume[0] + 7 * world.volume[1]
    if world.law == "lognormal":
        deviation = math.sqrt(math.log1p((world.volume[1] / world.volume[0]) ** 2))
        scale = float(value) * (1 + 7 * deviation)
    if world.law == "pareto":
        low, high, exponent = world.volume
        scale = float(value) * (1 + (high / low) ** exponent / exponent)
    return value, 100 * U * scale


class Retrace(NamedTuple):
    """Path of a boulder followed from its release by the reference."""

    apart: list[float]  # plan distance from the kernel's contact with the same number [m]
    status: str
    impacts: int
    stop: tuple[float, float]
    speeds: list[float]  # speed at each line; NaN if not crossed


def at_origin(scene: Scene) -> Scene:
    """Scene with its south-western cell centre at 0, 0, so that no digits are lost to map
    coordinates."""
    grid, case = scene.grid, scene.case
    west, south = grid.west + grid.cell / 2, grid.south + grid.cell / 2
    lines = [
        {"name": line["name"], "x": [x - west for x in line["x"]],
         "y": [y - south for y in line["y"]]}
        for line in case.line
    ]  # fmt: skip
    moved = Grid(-grid.cell / 2, (grid.ny - 0.5) * grid.cell, grid.cell, grid.nx, grid.ny)
    return scene.replace(
        case=case.replace(line=lines), grid=moved, x=scene.x - west, y=scene.y - south
    )


def world_of(scene: Scene) -> World:
    """World of a scene. Raises a ValueError if the south-western cell centre is not at 0, 0."""
    case, boulder, cell = scene.case, scene.case.boulder, scene.grid.cell
    if (scene.grid.west, scene.grid.north) != (-cell / 2, (scene.grid.ny - 0.5) * cell):
        raise ValueError("the south-western cell centre must be at 0, 0")
    law = boulder["volume"]
    keys = {"uniform": ("min", "max"), "pareto": ("min", "max", "exponent")}.get(
        law, ("mean", "std")
    )
    volume = tuple(boulder.get(f"volume_{key}", 0.0) for key in keys)
    return World(
        z=scene.rasters.z,
        cell=cell,
        mean=scene.coefficients.mean.T,
        covariance=scene.coefficients.covariance.T,
        incidence=scene.coefficients.incidence.T,
        lateral=scene.coefficients.lateral.T,
        turning=case.impact["turning"],
        between=case.impact["ratio"] == "between",
        sizes=_sizes(scene),
        sources=list(zip(scene.x.tolist(), scene.y.tolist(), strict=True)),
        boulders=case.case["boulders"],
        by_area=case.release["by_area"],
        reading={"diameter": 0.5, "radius": 1.0}[case.surface["rg_reading"]],
        seed=case.case["seed"],
        drop=case.release["drop_height"],
        velocity=tuple(case.release["velocity"]),
        law={"fixed": "normal"}.get(law, law),
        volume=tuple(boulder["volumes"]) if law == "list" else volume,
        gravity=case.flight["gravity"],
        stop_speed=case.impact["stop_speed"],
        impact_limit=case.impact["impact_limit"],
        lines=[list(zip(line["x"], line["y"], strict=True)) for line in case.line],
        density=boulder["density"],
        grounds=[_ground(one) for one in scene.grounds],
        ground=_ground_of_cells(scene),
    )


def _ground(given: GroundRule) -> classical.Ground | None:
    """Ground from the text of its rule; None for impact sets of the case."""
    if not given.text:
        return None
    values = read_groups(given.text.decode(), given.name)["ground"]

    def scatter(name: str, least: float = 0.0, most: float = 1.0) -> classical.Scatter:
        ends = values.get(f"{name}_min", 0.0), values.get(f"{name}_max", most)
        std = values.get(f"{name}_std", 0.0)
        return classical.Scatter(values.get(name, 0.0), std, max(least, ends[0]), ends[1])

    normal = scatter("r_n", 0.0 if given.model == "constant" else 0.01)
    if given.model == "bourrier_hungr":
        normal = scatter("half_speed", 0.01, 1e300)
    names = "friction_angle", "soil_density", "obstacle_spread", "roughness_angle", "min_hop"
    rest = {name: values[name] for name in names if name in values}
    return classical.Ground(given.model, normal, scatter("r_t"), **rest)


def _ground_of_cells(scene: Scene) -> np.ndarray | None:
    """Index (ny, nx) of the ground of each cell, from 0; None without grounds."""
    if not scene.grounds:
        return None
    cells = scene.rasters
    if cells.cell_ground is not None:
        return cells.cell_ground.astype(int) - 1
    if cells.material_ground is None:
        return np.zeros(cells.z.shape, int)
    zone = np.ones(cells.z.shape, int) if cells.zone is None else cells.zone
    return cells.material_ground.astype(int)[np.maximum(zone, 1) - 1] - 1


def _sizes(scene: Scene) -> np.ndarray:
    """Rock sizes (1 or 3, ny, nx) of each cell."""
    cells = scene.rasters
    if cells.values is not None:
        return cells.values
    zone = np.ones(cells.z.shape, int) if cells.zone is None else cells.zone
    return np.moveaxis(cells.sizes[np.maximum(zone, 1) - 1], -1, 0)


def tracks(result: xr.Dataset) -> list[np.ndarray]:
    """Rows of FIELDS for each recorded boulder: release, contacts and end."""
    rows = np.stack([result[f"trajectory_{name}"].values for name in FIELDS], axis=1)
    starts = np.flatnonzero(np.diff(result["trajectory_boulder"].values)) + 1
    return np.split(rows, starts)


def status_of(result: xr.Dataset, number: int) -> str:
    names = result["status"].attrs["flag_meanings"].split()
    return names[int(result["status"].values[number - 1]) - 1]


# ---- contact by contact


@functools.cache
def condition(world: World) -> float:
    """Maximum condition number of the correlations in the impact sets, by which errors grow in a
    Cholesky root (Higham 2002, theorem 10.8, scaled as in Demmel 1989)."""
    found = [1.0]
    for covariance in world.folded:
        deviation = np.sqrt(np.diag(covariance))
        if deviation.all():
            found.append(np.linalg.cond(covariance / np.outer(deviation, deviation)))
    return float(max(found))


def replay(world: World, number: int, rows: np.ndarray, result: xr.Dataset) -> Replay:
    """Compare each contact of a boulder with the reference."""
    found, state, crossed = Replay(), reference.release(world, number), set()
    sums, own = Sums(float(reference.length(state.v))), volume(world, number)
    d_ratio = own[1] / (3 * float(own[0])) + 12 * U  # relative error
    for hit, row in enumerate(rows[1:], 1):
        status = status_of(result, number) if hit == len(rows) - 1 else ""
        for one in _alternatives(world, state):
            contact = reference.step(world, number, hit, one)
            flight = _flight(world, one, contact.landing, contact.landing.patch)
            wrong, errors = _differs(contact, row, status), []
            if not wrong:
                errors = _judge(world, contact, flight, rows[hit - 1], row, d_ratio)
            right = not wrong and all(error.share <= 1 for error in errors)
            if right or contact.doubt >= UNDECIDED:
                break
        if not right and contact.doubt < UNDECIDED:
            found.undecided += 1
            return found
        if wrong:
            found.faults.append(f"boulder {number}, contact {hit}: {wrong}")
            return found
        found.contacts.append(errors)
        found.crossings += _lines(world, number, rows[hit - 1], state, contact, result, crossed)
        sums.add(world, state, contact, flight)
        if not contact.status:
            state = _kernel_state(contact, row)
    totals = zip(TOTALS, [*sums.bounded(rows[-1, 3]), own], strict=True)
    found.totals = [
        Error.of(exact(result[name].values[number - 1]) - Decimal(wanted), bound, wanted)
        for name, (wanted, bound) in totals
    ]
    found.faults += _ends(world, number, rows, result, hit - (not contact.landing.contact), crossed)
    return found


def _kernel_state(contact: Contact, row: np.ndarray) -> State:
    """State of the kernel after a contact. Its heading is not recorded; that of the reference only
    determines the sign of the rotation."""
    spin = math.copysign(1.0, row[OUT][0]) * row[OUT][2]
    velocity = tuple(map(exact, row[SPEED]))
    heading = contact.rebound.heading
    return State(exact(row[0]), exact(row[1]), exact(0), velocity, exact(spin), heading)


def _ends(world: World, number: int, rows, result, impacts: int, crossed: set[int]) -> list[str]:
    """Differences between result and trajectory: start, stop, contacts, lines."""
    one = result.isel(boulder=number - 1)
    x, y = map(exact, world.sources[reference.source_of(world, number)[0]])
    start = [float(x), float(y), float(reference.surface(world, x, y)) + world.drop]
    faults = []
    if not np.allclose(rows[0, :3], start, rtol=1e-14, atol=1e-12):
        faults.append(f"starts at {rows[0, :3]}, not at {start}")
    if [float(one[f"stop_{axis}"]) for axis in "xyz"] != rows[-1, :3].tolist():
        faults.append("stops elsewhere than its trajectory")
    if int(one["impacts"]) != impacts:
        faults.append(f"has {int(one['impacts'])} contacts, not {impacts}")
    for line in range(len(world.lines)):
        if has_crossed(result, line)[number - 1] != (line in crossed):
            faults.append(f"line {line}: crossed by one alone")
    return [f"boulder {number}: {fault}" for fault in faults]


def _alternatives(world: World, state: State) -> list[State]:
    """The state on each patch that meets at its place, because a contact is right on any of them.
    Several patches meet at the centres of source cells, from where boulders fall."""
    if any(state.v[:2]):
        return [state]
    near = reference.meeting(world, state.x, state.y, Decimal(UNDECIDED))
    return [state] + [state._replace(patch=patch) for patch in near]


def _differs(contact: Contact, row: np.ndarray, status: str) -> str:
    """Difference between kernel and reference in a status or a rebound, as text; empty without one.
    `status` is the kernel's."""
    if contact.status != status:
        return f"kernel {status or 'goes on'}, reference {contact.status or 'goes on'}"
    if (contact.rebound is None) != (row[RATIO] == 0):
        return "a rebound on one side alone"
    return ""


def _judge(world: World, contact: Contact, flight: Flight, before, row, d_ratio) -> list[Error]:
    """Errors of a contact, in the order of QUANTITIES, with their bounds."""
    landing, hit = contact.landing, contact.rebound
    x, y = exact(row[0]), exact(row[1])
    place = reference.length((x - landing.x, y - landing.y))
    time = exact(before[3]) + landing.time
    over = reference.surface(world, x, y) if landing.contact else landing.z
    far = max(abs(row[0]), abs(row[1]))
    errors = [
        Error.of(place, flight.place, far),
        Error.of(exact(row[2]) - over, flight.height, row[2]),
        Error.of(exact(row[3]) - time, flight.time + 2 * U * row[3], row[3]),
    ]
    if hit is None:
        return errors
    twist, slope = flight.twist, flight.slope
    speed = float(reference.length(landing.v))
    d_slope = twist * flight.place + U * (4 * slope + 4 * twist * world.cell * far)
    d_vector = speed * (2 * d_slope + 10 * U) + world.gravity * flight.time
    v_in, v_out = (float(reference.length(v)) for v in (hit.incoming, hit.outgoing))
    # 64 for normal numbers (quintic coefficients from divided differences), 36 for sums
    d_out = hit.weight * (d_vector + U * (100 + condition(world)) * v_in)
    along = float(hit.incoming[0]) / math.sqrt(1 + slope**2)
    d_turn = 8 * U + (d_vector / along if along else 0.0)
    d_v = d_out + v_out * (d_turn * (1 + slope) + 3 * d_slope + 10 * U)
    plan = float(reference.length(hit.velocity[:2]))
    velocity = [exact(v) for v in row[SPEED]]
    across = velocity[0] * hit.velocity[1] - velocity[1] * hit.velocity[0]
    return errors + [
        Error.of(_apart(row[IN], hit.incoming), d_vector, v_in),
        Error.of(_apart(row[OUT], hit.outgoing), d_out, v_out),
        Error.of(_apart(row[SPEED], hit.velocity), d_v, v_out),
        Error.of(across / exact(plan) ** 2 if plan else 0, 2 * d_v / plan if plan else 1.0, 1.0),
        Error.of(exact(row[RATIO]) - hit.ratio, abs(float(hit.ratio)) * d_ratio, hit.ratio),
    ]


def _apart(kernel: np.ndarray, wanted) -> Any:
    return reference.length([exact(k) - w for k, w in zip(kernel, wanted, strict=True)])


def _flight(world: World, state: State, landing: Landing, at: Patch) -> Flight:
    """Error bounds of a flight. Heights above a patch are differences of elevations, with rounding
    errors of the elevations, of position times slope, and of the rise. Over the descent rate they
    are an error of time, and times the speed an error of position."""
    cell = world.cell
    slope, twist = at.steepest(cell), abs(float(at.c)) / cell**2
    time = float(landing.time)
    far = float(max(abs(p) for p in (state.x, state.y, landing.x, landing.y)))
    fast = float(max(reference.length(state.v), reference.length(landing.v)))
    z = abs(float(landing.z)) + float(landing.highest)
    roundings = 6 * z + 6 * far * slope + 8 * fast * (1 + slope) * time
    vx, vy, vz = map(float, landing.v)
    if not landing.contact:  # it leaves through a side: time error = position error over speed
        sideways = [abs(v) for v in (vx, vy) if v]
        d_time = 6 * U * far / min(sideways) + 4 * U * time if sideways else 0.0
        d_height = U * roundings + (abs(vz) + slope * math.hypot(vx, vy)) * d_time
        return Flight(math.hypot(vx, vy) * d_time + 6 * U * far, d_height, d_time, slope, twist)
    u, w = landing.x / exact(cell) - at.i, landing.y / exact(cell) - at.j
    gx, gy = map(float, at.slope(exact(cell), u, w))
    closing = gx * vx + gy * vy - vz
    d_time = (2 * U * roundings / closing if closing > 0 else 0.0) + 4 * U * time
    d_place = math.hypot(vx, vy) * d_time + 6 * U * far
    return Flight(d_place, U * (6 * z + 6 * far * slope), d_time, slope, twist)


def _lines(world, number, before, state, contact, result, crossed) -> list[list[Error]]:
    """Compare the lines that a flight is the first to cross; add them to `crossed`."""
    found = []
    for line in set(range(len(world.lines))) - crossed:
        doubt = Doubt()
        met = reference.crossing(world, number, state, contact.landing, line, doubt)
        if met is None:
            continue
        crossed.add(line)
        if doubt.least < UNDECIDED:
            continue
        at_line = at_lines(result)
        row = [float(at_line[name].values[line, number - 1]) for name in CROSSED]
        speed = reference.length(met.v)
        time = exact(before[3]) + met.time
        wanted = [met.x, met.y, time, speed, met.jump, met.passing, met.omega]
        bounds = _line_bounds(world, state, contact, line, met, float(time))
        length = float(np.hypot(*np.ptp(np.array(world.lines[line], float), axis=0)))
        sizes = [length, length, *map(float, wanted[2:])]  # positions are measured along the line
        bounds = [float(b) + 2 * SINGLE * abs(size) for b, size in zip(bounds, sizes, strict=True)]
        pairs = zip(row, wanted, bounds, strict=True)
        found.append([Error.of(exact(k) - w, bound, w or 1) for k, w, bound in pairs])
    return found


def _line_bounds(world, state, contact, line, met, time) -> list[float]:
    """Error bounds in the order of CROSSED. The crossing divides the path by a quotient of
    distances from the line, which have errors of rounded positions and of the landing."""
    at = reference.place(world, met.x, met.y)[0]
    flight = _flight(world, state, contact.landing, at)
    end = _flight(world, state, contact.landing, contact.landing.patch)
    a, b = (np.array([float(p.x), float(p.y)]) for p in (state, contact.landing))
    lines = np.array(world.lines[line], float)
    far = max(np.abs([a, b]).max(), np.abs(lines).max())
    reach = float(np.hypot(*np.diff(lines, axis=0).T).max())
    normals = np.diff(lines, axis=0)[:, ::-1] * [1, -1] / reach
    across = float(np.abs(normals @ (b - a)).max()) or 1.0
    d_time = float(contact.landing.time) * (12 * U * far + 2 * end.place) / across + end.time
    plan, speed = float(reference.length(met.v[:2])), float(reference.length(met.v))
    d_place = plan * d_time + 4 * U * far
    d_jump = 2 * flight.height + (speed * (1 + flight.slope)) * d_time + 4 * U * speed * time
    d_slope = flight.twist * d_place + U * (4 * flight.slope + 4 * flight.twist * world.cell * far)
    own = float(met.passing - met.jump)  # R_b over the cosine of the slope
    d_passing = d_jump + own * (d_slope + 8 * U)
    d_speed = world.gravity * d_time + 4 * U * speed
    return [d_place, d_place, d_time + 2 * U * time, d_speed, d_jump, d_passing,
            20 * U * abs(float(met.omega))]  # fmt: skip


# ---- from the release


def retrace(world: World, number: int, rows: np.ndarray) -> Retrace:
    """Follow a boulder from its release by the reference, and compare it with the kernel's rows."""
    state, apart = reference.release(world, number), []
    speeds = [math.nan] * len(world.lines)
    for hit, contact in enumerate(reference.follow(world, number), 1):
        landing = contact.landing
        if hit < len(rows):
            apart.append(math.dist(rows[hit, :2], (float(landing.x), float(landing.y))))
        for line, speed in enumerate(speeds):
            if math.isnan(speed):
                met = reference.crossing(world, number, state, landing, line, Doubt())
                speeds[line] = float(reference.length(met.v)) if met else math.nan
        state = reference.leave(contact) if contact.rebound else state
    stop = float(landing.x), float(landing.y)
    return Retrace(apart, contact.status, hit - (not landing.contact), stop, speeds)
