"""Make `dem.asc`, a talus slope below a cliff, with a gully, and a road at its foot; and
`dem_fine.asc`, the same surface with cells fine enough for the faces of a dam.

120 x 180 cells of 2 m. From the north: 20 m of cliff at 60 degrees, a slope that flattens from 38
to 29 degrees, the road (a level bench 8 m wide), and a meadow of 12 degrees. The gully is up to 3 m
deep and ends above the road. The relief has a standard deviation of 0.2 m and is correlated over
about 5 m; its seed is fixed. The slope is synthetic. The fine cells are 0.4 m wide; their
elevations are bilinear between the centres of the larger cells.
"""

from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

NX, NY, CELL = 120, 180, 2.0
CLIFF, FOOT, ROAD, END = 20.0, 260.0, 268.0, 360.0  # distances from the northern edge [m]
BOTTOM = 500.0  # elevation of the southern edge [m]
GULLY, DEPTH, WIDE = 130.0, 3.0, 12.0  # x of the axis, depth and half width [m]
FINE = 5  # fine cells per cell side
RELIEF, SMOOTH, SEED = 0.20, 1.5, 11  # random relief: [m], [cells], seed


def profile(south: np.ndarray) -> np.ndarray:
    """Elevation [m] relative to the northern edge, at distances from that edge [m]."""
    step = np.linspace(0.0, END, 3601)
    angle = np.select(
        [step < CLIFF, step < FOOT, step < ROAD],
        [60.0, 38.0 - 9.0 * (step - CLIFF) / (FOOT - CLIFF), 0.0],
        12.0,
    )
    fall = np.concatenate([[0.0], np.cumsum(np.tan(np.radians(angle[:-1])) * np.diff(step))])
    return BOTTOM + fall[-1] - np.interp(south, step, fall)


def elevation() -> np.ndarray:
    """Elevations (NY, NX), northern row first."""
    south = (np.arange(NY)[:, None] + 0.5) * CELL
    east = (np.arange(NX) + 0.5) * CELL
    along = np.clip((south - CLIFF) / 40.0, 0.0, 1.0) * np.clip(
        (FOOT - 20.0 - south) / 60.0, 0.0, 1.0
    )
    gully = -DEPTH * along * np.maximum(0.0, 1.0 - ((east - GULLY) / WIDE) ** 2)
    rough = gaussian_filter(np.random.default_rng(SEED).normal(size=(NY, NX)), SMOOTH)
    rough *= RELIEF / rough.std()
    on_slope = (south > CLIFF) & (south < FOOT - 4.0)
    return profile(south) + gully + np.where(on_slope, rough, 0.0)


def refined(z: np.ndarray) -> np.ndarray:
    """Bilinear surface between cell centres, on fine cells; level beyond the outer centres."""
    for axis, n in enumerate((NY, NX)):
        place = (np.arange(n * FINE) + 0.5) / FINE - 0.5
        low = np.clip(np.floor(place).astype(int), 0, n - 2)
        part = np.expand_dims(np.clip(place - low, 0.0, 1.0), 1 - axis)
        z = (1 - part) * np.take(z, low, axis) + part * np.take(z, low + 1, axis)
    return z


def write(path: Path, fine: bool = False) -> None:
    """Write an ESRI ASCII grid, rounded to centimetres."""
    z, cell = (refined(elevation()), CELL / FINE) if fine else (elevation(), CELL)
    size = f"ncols {z.shape[1]}\nnrows {z.shape[0]}\nxllcorner 0\nyllcorner 0\ncellsize {cell:g}\n"
    rows = (" ".join(f"{one:.2f}" for one in row) + "\n" for row in z)
    path.write_text(f"{size}NODATA_value -9999\n{''.join(rows)}")


if __name__ == "__main__":
    write(Path(__file__).with_name("dem.asc"))
    write(Path(__file__).with_name("dem_fine.asc"), fine=True)
