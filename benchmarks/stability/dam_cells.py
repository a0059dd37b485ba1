# SPDX-License-Identifier: BSD-3-Clause
"""Boulders that pass a dam, by the cell size of the terrain in which it is built.

    python -m benchmarks.stability.dam_cells [--boulders 20000] [--cells 5 2.5 1 0.5 0.25]

The slope of cases/protected-road without its relief, so that the cell size affects only the dam: a
cliff, a talus slope of 38 to 29 degrees, a road. The dam is 5 m high, 20 m above the road, and not
exactly along the rows of cells. It is compared with the same boulders on the same cells without a
dam.
"""

import argparse
import importlib.util
import warnings
from pathlib import Path

import numpy as np
from affine import Affine

import rockfall
from rockfall.protection.recorded import dams_of
from rockfall.result.crossings import at_lines

CASE = Path(__file__).parents[2] / "cases" / "protected-road"
SURFACE = {"ground": None, "uniform_mean_radius": 0.25}  # ground on which boulders jump
IMPACT = {"sets": "laboratory-spheres", "ratio": "nearest"}
SLOPES = (35.0, 60.0)  # slopes of the faces [degrees]
WIDE = 240.0  # width of the terrain [m]
ORIGIN = (0.0, 360.0)


def profile(south: np.ndarray) -> np.ndarray:
    """Elevation at distances from the northern edge, as in the case."""
    spec = importlib.util.spec_from_file_location("terrain", CASE / "make_terrain.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.profile(south)


def reached(cell: float, boulders: int, dam: list[dict]) -> tuple[float, list]:
    """Fraction of boulders that reach the road, and the resulting dams."""
    ny, nx = round(ORIGIN[1] / cell), round(WIDE / cell)
    z = np.repeat(profile((np.arange(ny) + 0.5) * cell)[:, None], nx, axis=1)
    transform = Affine(cell, 0.0, ORIGIN[0], 0.0, -cell, ORIGIN[1])
    case = rockfall.read_case(CASE / "road.nml").replace(surface=SURFACE, impact=IMPACT)
    road = [case.line[0] | {"x": [5.0, 235.0]}]
    result = rockfall.run(
        case.replace(case={"boulders": boulders // 8}, line=road, dam=dam, output={"maps": None}),
        dem=z, transform=transform,
    )  # fmt: skip
    return float(np.isfinite(at_lines(result)["line_speed"].values[0]).mean()), dams_of(result)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--boulders", type=int, default=20_000)
    parser.add_argument("--cells", type=float, nargs="+", default=[5.0, 2.5, 1.0, 0.5, 0.25])
    given = parser.parse_args()
    warnings.simplefilter("ignore", UserWarning)  # warnings about cells that are too coarse
    print("faces  cell    face  height (lowest)  slope    bare    dam   fewer")
    for slope in SLOPES:
        for cell in given.cells:
            bare, _ = reached(cell, given.boulders, [])
            dam = {
                "x": [10.0, 230.0], "y": [113.0, 123.0], "height": 5.0, "crest_width": 2.0,
                "slope": slope, "allow_coarse": True,
            }  # fmt: skip
            left, (shape,) = reached(cell, given.boulders, [dam])
            print(
                f"{slope:3.0f} deg {cell:5.2f} m {shape.face_cells:4.1f} c {shape.height:5.1f} m "
                f"({shape.height_min:4.1f}) m {shape.slope:5.0f} deg {bare:6.2%} {left:6.2%} "
                f"{1 - left / bare:6.1%}",
                flush=True,
            )


if __name__ == "__main__":
    main()
