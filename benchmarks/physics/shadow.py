# SPDX-License-Identifier: BSD-3-Clause
"""Shadow angles of boulders that fall from a rock face onto talus, compared with observed shadow
angles of at least 27.5 degrees (Evans and Hungr 1993; docs/archive/field_protocol.md):

    python -m benchmarks.physics.shadow [--talus TABLE ...] [--plain TABLE ...] [--boulders 500]
        [--radii 0.35 0.6 1.05 1.8] [--slopes 35 5] [--write]

The shadow angle is the angle below the horizontal of the line from the top of the talus to a
boulder. Prints for each talus ground (an impact table; the matrix with rocks of 0.2 m and
`rocky-slope` are always run), each ground of the plain below and each R_b [m]: the fractions of
boulders that leave the talus and that pass 27.5 degrees, and the angles passed by 50, 5 and 1 % of
the boulders. The talus falls by 200 m. --slopes are the slopes of talus and plain [degree]. --write
stores the results in the table of evidence.
"""

import argparse
import tempfile
from collections.abc import Sequence
from math import nan
from pathlib import Path

import numpy as np

import rockfall
from benchmarks.evidence import record, with_origin
from benchmarks.machine import machine
from rockfall.io.rasters.grid import Grid

ANGLE = 27.5  # minimum shadow angle observed [degree]
FACE, TALUS = (100.0, 70.0), 200.0  # face: height [m], slope [degree]; talus: height [m]
SLOPES = 35.0, 5.0  # slopes of the talus and the plain [degree]
BEYOND, WIDTH, CELL = 700.0, 400.0, 2.5  # [m]
ROCKS, SEED = 0.2, 7


def profile(slopes: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Elevation [m] and zone of each row, north first."""
    lengths = [height / np.tan(np.radians(slope)) for height, slope in (FACE, (TALUS, slopes[0]))]
    ends = np.cumsum([20.0, *lengths, BEYOND])  # flat top
    falls = np.tan(np.radians([0.0, FACE[1], *slopes]))
    s = CELL * (np.arange(int(ends[-1] / CELL)) + 0.5)
    z = np.interp(s, [0.0, *ends], 1000 - np.cumsum([0.0, *(falls * np.diff([0.0, *ends]))]))
    return z, 1 + np.searchsorted(ends[1:3], s)


def stops(
    talus: str, plain: str, slopes: Sequence[float], radius: float, boulders: int, folder: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Shadow angles [degree] of the stopping places, 90 for places above the foot of the talus; and
    a mask of the places below the foot."""
    z, zone = profile(slopes)
    rows, columns = len(z), int(WIDTH / CELL)
    groups = {
        "case": {"title": "shadow", "seed": SEED, "boulders": boulders},
        "boulder": {"volume": "fixed", "volume_mean": 4 / 3 * np.pi * radius**3, "density": 2700.0},
        "surface": {"uniform_mean_radius": ROCKS},
        "release": {
            "x": [WIDTH / 2], "y": [rows * CELL - 18.0], "drop_height": 1.0,
            "velocity": [0.0, -3.0, 0.0],
        },
        "output": {"trajectories": 0, "maps": None},
    }  # fmt: skip
    rasters = {"dem": np.repeat(z[:, None], columns, 1)}
    if talus:
        grounds = "rock" if talus != "rocky-slope" else talus, talus, plain
        lines = [f"{k},{ROCKS},0,0,0,{ground}" for k, ground in enumerate(grounds, start=1)]
        (folder / "zones.csv").write_text(
            "\n".join(["zone,mean_radius,rg70,rg20,rg10,ground", *lines])
        )
        groups["impact"] = {"form": "table"}
        groups["surface"] = {"zones": "given", "table": "zones.csv"}
        rasters["zones"] = np.repeat(zone[:, None], columns, 1).astype("i4")
    result = rockfall.run(
        rockfall.Case(folder=folder, **groups),
        transform=Grid(0.0, rows * CELL, CELL, columns, rows),
        **rasters,
    )
    top, foot = (CELL * (rows - np.searchsorted(zone, one)) for one in (2, 3))
    top_z = np.interp(rows * CELL - top, CELL * (np.arange(rows) + 0.5), z)
    x, y, stop_z = (result[f"stop_{one}"].values for one in "xyz")
    away = np.hypot(x - result.start_x.values, top - y)
    return np.where(y < foot, np.degrees(np.arctan2(top_z - stop_z, away)), 90.0), y < foot


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--talus", nargs="+", default=["talus"])
    parser.add_argument("--plain", nargs="+", default=["talus", "meadow"])
    parser.add_argument("--slopes", type=float, nargs=2, default=SLOPES)
    parser.add_argument("--boulders", type=int, default=500)
    parser.add_argument("--radii", type=float, nargs="+", default=[0.35, 0.6, 1.05, 1.8])
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args(words)
    print(machine())
    print("| talus | plain | R_b [m] | leave the talus | pass 27.5 degrees | 50 % | 5 % | 1 % |")
    print("|---" * 8 + "|")
    pairs = [("", ""), ("rocky-slope", "rocky-slope")]
    pairs += [(one, other) for one in given.talus for other in given.plain]
    rows = []
    for talus, plain in pairs:
        model = talus if talus == plain else f"{talus} above {plain}"
        for radius in given.radii:
            with tempfile.TemporaryDirectory() as folder:
                angles, gone = stops(
                    talus, plain, given.slopes, radius, given.boulders, Path(folder)
                )
            parts = [f"{part.mean():.3f}" for part in (gone, angles < ANGLE)]
            passed = [f"{np.quantile(angles, q):.1f}" for q in (0.5, 0.05, 0.01)]
            names = [talus or "matrix, R_m 0.2 m", plain or "the same", f"{radius:g}"]
            print(f"| {' | '.join([*names, *parts, *passed])} |", flush=True)
            place = f"{given.slopes[0]:g} on {given.slopes[1]:g} degrees, R_b {radius:g} m"
            part = (angles < ANGLE).mean()
            spread = np.sqrt(part * (1 - part) / given.boulders)
            for quantity, unit, number, error in (
                (f"passing_{ANGLE:g}_degrees", "", part, spread),
                ("angle_passed_by_1_percent", "degree", np.quantile(angles, 0.01), nan),
            ):
                key = "talus-shadow", place, quantity, model or f"vaujany-observed, R_m {ROCKS:g} m"
                rows.append(with_origin(key, unit, nan, number, error))
    if given.write:
        record(rows)


if __name__ == "__main__":
    main()
