# SPDX-License-Identifier: BSD-3-Clause
"""Pilot run with some boulders of a case, which gives estimates for the complete run."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rockfall.kernel_rules import SAMPLE_BINS, SAMPLE_COARSE
from rockfall.limits import CORES
from rockfall.scene.scene import Scene
from rockfall.simulation.map_plan import HITS, plan_of
from rockfall.simulation.memory import BYTES_AT_LINE, BYTES_IN_FILE
from rockfall.simulation.simulate import CHUNK_CROSSINGS, check_team, run_chunks, start
from rockfall.simulation.spilled_crossings import BLOCK, PIECE
from rockfall.simulation.tally import Tally
from rockfall.simulation.tally_dataset import MAXIMA, line_variables

PROBE_BOULDERS = 100  # boulders used to estimate the number of rebounds
PILOT_REBOUNDS = 200_000  # approximate; takes some hundredths of a second
PILOT_BOULDERS = 20_000  # maximum boulders; cells of larger runs are extrapolated
PROGRAM = 85e6  # memory of the program and its packages in a simulation [bytes]
PACKAGES = 20e6  # additional memory of packages that write results [bytes]
READING = 80e6  # additional memory to read a window [bytes]
START = 0.4  # CPU time to start and end [s]
CALL_BYTES = 170  # bytes for a crossing during a kernel call
ROW = 1.0e-6  # CPU time to write a boulder row [s]
VALUE = 20e-9  # CPU time to write a cell value [s]


@dataclass
class Pilot:
    """Results of a pilot run, and estimates for the complete run."""

    tally: Tally
    seconds: float  # CPU time per boulder [s]
    reading: float  # CPU time to read terrain windows [s]
    cells: float  # number of cells that all boulders of the run would reach
    density: np.ndarray  # densities [kg/m3] of the pilot boulders, or (1,) of all
    blocks: float  # bin blocks that all boulders of the run would fill, unless all rows are kept

    def values(self) -> dict[str, Any]:
        """Variables of the pilot boulders, as in a result without line names."""
        tally, scene = self.tally, self.tally.scene
        values: dict[str, Any] = tally.columns()
        if scene.grounds:
            values |= {
                "ground": [ground.name for ground in scene.grounds],
                "ground_model": [ground.model for ground in scene.grounds],
                "ground_block_radius": [ground.block_radius for ground in scene.grounds],
                "rebounds_by_ground": tally.array("rebounds_by_ground"),
            }
        values |= {a.file_name: a.values for a in tally.arrays("shape", "shadow", "breakage")}
        if scene.case.lines:
            at_lines = {name: data for name, (_, data, _) in line_variables(tally).items()}
            del at_lines["line_name"]
            values |= at_lines | {"boulder": tally.numbers()}
        return values


def pilot_run(scene: Scene, most: int = PILOT_REBOUNDS) -> Pilot:
    """Simulate some boulders of a scene, with about `most` rebounds. Their number does not depend
    on the time they take, so that `check` always prints the same values for a case."""
    check_team(scene.case.case["threads"])
    probe = _follow(scene, min(scene.boulders, PROBE_BOULDERS))
    rebounds = max(1.0, float(probe.tally.columns()["impacts"].mean()))
    number = min(scene.boulders, PILOT_BOULDERS, int(most / rebounds))
    return _follow(scene, number) if number > PROBE_BOULDERS else probe


def _follow(scene: Scene, number: int) -> Pilot:
    """Simulate boulders from random sources twice; the second pass, which allocates no memory, is
    timed."""
    maps = scene.case.output.get("maps", [])
    output = {"maps": list(dict.fromkeys([*maps, "passages"])) if maps else None}
    drawn = np.sort(np.random.default_rng(0).integers(scene.x.size, size=number))
    if scene.weight is not None:  # sources release different numbers
        boulders = 1 + (scene.boulders * (drawn + 0.5) / scene.x.size).astype("i8")
        drawn = scene.sources_of(boulders)
    case = scene.case.replace(
        case={"boulders": 1, "boulders_total": None},
        release={"by_area": False},
        output=output | {"kept": "all"},
    )
    sample = replace(scene.select(drawn), case=case, area=None, frequency=None)
    few = start(sample, threads=1)
    run_chunks(few, None, lambda: False, lambda _: None)
    cells, few.done, few.cpu = _all_cells(few, scene.boulders), 0, 0.0
    for array in few.arrays("count", "ground"):  # reset sums before the second pass
        array.values[...] = 0
    few.run.forget_crossings()
    before = sample.windows.reading if sample.windows else 0.0
    run_chunks(few, None, lambda: False, lambda _: None)
    reading = sample.windows.reading - before if sample.windows else 0.0
    seconds, blocks = (few.cpu - reading) / few.done, 0.0
    if scene.case.output["kept"] != "all":
        seconds, blocks = _counted(sample, scene.boulders)
    return Pilot(few, seconds, reading, cells, sample.release_values[:, 0], blocks)


def _all_cells(few: Tally, boulders: int) -> float:
    """Number of cells that the full run would reach."""
    place = plan_of(few.scene.case).counts["passages"] - 1
    if place < 0:
        return 0.0
    passages = few.array("tally_counts")[place]
    return min(_all_reached(passages, boulders / max(1, few.done)), float(passages.size))


def _counted(sample: Scene, boulders: int) -> tuple[float, float]:
    """CPU time per boulder [s] of a pilot that keeps no rows, and the number of bin blocks that the
    full run would fill."""
    counted = replace(sample, case=sample.case.replace(output={"kept": "none"}))
    few = start(counted, threads=1)
    before = sample.windows.reading if sample.windows else 0.0
    run_chunks(few, None, lambda: False, lambda _: None)
    reading = sample.windows.reading - before if sample.windows else 0.0
    filled = few.array("blocks").sum(axis=1)
    room = few.array("sample_sums").shape  # places, parts, quantities, words
    most = float(math.prod(room[:3]) * SAMPLE_COARSE)
    blocks = min(_all_reached(filled, boulders / few.done), most)
    return (few.cpu - reading) / few.done, blocks


def _all_reached(passages: np.ndarray, more: float) -> float:
    """Number of cells that `more` times as many boulders would reach, if the passage rates of
    cells follow a gamma distribution (negative binomial counts; Fisher, Corbet & Williams 1943).
    Mean and shape are fitted to the numbers of cells passed at least once, and exactly once, in
    the pilot run."""
    total, cells, once = passages.sum(dtype="i8"), (passages > 0).sum(), (passages == 1).sum()
    if more <= 1 or not 0 < once < total:
        return float(cells * max(1.0, more))
    shape = np.geomspace(1e-4, 50.0, 2000)  # shape parameter of the gamma distribution
    spread = (once / total) ** (-1 / (shape + 1))  # 1 + (passages of a cell) / shape
    limit = total / (shape * (spread - 1))  # number of cells that can be reached
    best = np.argmin(abs(limit * (1 - spread**-shape) - cells))
    expected = limit[best] * (1 - (1 + (spread[best] - 1) * more) ** -shape[best])
    return float(max(expected, cells))


def memory(scene: Scene, pilot: Pilot) -> dict[str, float]:
    """Memory of a run [bytes] by use: rasters, map tallies, their class counts, trees, result rows,
    crossings, samples, program; outputs that are created after the rasters are freed (`made`), and
    rows in the result file (`file`)."""
    names = set(scene.case.output.get("maps", []))
    tally = start(scene, threads=1)
    plan, held = (
        plan_of(scene.case),
        {"maps": 0.0, "results": 0.0 + scene.x.nbytes + scene.y.nbytes},
    )
    for array in tally.run.arrays():
        is_map = "y" in array.dims
        if array.file_name not in ("tally_bin_counts", "sample_largest"):
            held["maps" if is_map else "results"] += array.values.nbytes
    sorting = 3 * 8  # [bytes] two orders and a copy of a crossing column
    more = scene.boulders / max(1, pilot.tally.rows)
    rows = tally.run.array("status").size / scene.boulders
    crossings = round(more * rows * pilot.tally.crossed())
    in_call = min(CHUNK_CROSSINGS, more * pilot.tally.crossed()) * CALL_BYTES
    block = min(BLOCK, crossings)
    held["crossings"] = block * BYTES_AT_LINE + max(block * sorting, in_call)
    if pilot.blocks:
        held["samples"] = _sample_bytes(tally, pilot)
    made = len(names - {*plan.counts, *MAXIMA, HITS}) * 4 * math.prod(tally.box.shape)
    piece = 8 * min(PIECE, crossings)  # bytes of boulder numbers that are written together
    made += piece + piece * block // max(1, crossings)  # and of their part from one block
    if scene.windows:
        rasters = scene.windows.bytes + READING
    else:
        cells = scene.rasters
        layers_ = cells.z, cells.zone, cells.values, cells.cell_ground
        rasters = sum(a.nbytes for a in layers_ if a is not None)
    return {
        "rasters": rasters,
        "classes": 4 * plan.bins * pilot.cells,
        "trees": 0 if scene.trees is None else scene.trees.bytes,
        **held,
        "program": PROGRAM,
        "made": PACKAGES + made,
        "file": tally.row_bytes + BYTES_IN_FILE * crossings,
    }


def _sample_bytes(tally: Tally, pilot: Pilot) -> float:
    """Memory [bytes] of bin counts, of their positions, and of the largest values at lines. The
    largest values take full huge pages, the same memory for each line."""
    tails = 4 * math.prod(tally.run.array("sample_largest").shape)
    places = math.prod(tally.run.array("sample_sums").shape[:3]) * SAMPLE_COARSE
    each = 4 * SAMPLE_BINS / SAMPLE_COARSE
    return float(tails + 4 * places + each * pilot.blocks)


def cpu_seconds(scene: Scene, pilot: Pilot) -> tuple[float, float]:
    """CPU time of a run [s], and its wall time [s] with the threads of the case."""
    flight, maps = pilot.seconds * scene.boulders, len(scene.case.output.get("maps", []))
    cells = maps * math.prod(pilot.tally.box.shape) if maps else 0
    rest = START + ROW * scene.boulders + VALUE * cells + pilot.reading
    return flight + rest, flight / (scene.case.case["threads"] or CORES) + rest
