"""Makes the stand-in for the experimental slope: `dem.tif` (m) and `zones.tif` (ids of zones.csv).

The terrain model of the site was never published; this one is built from what the paper says of the
slope (README.md). It is the same on every run. With another NumPy or another libm its last bits may
differ, which is why the two files are kept beside this script.
"""

from pathlib import Path

import numpy as np
import rasterio

HERE = Path(__file__).parent
CELL, NX, NY = 2.5, 80, 240  # [m]: 200 m across the slope, 600 m down it
WEST, NORTH = 0.0, 600.0  # [m]: outer edges of the upper left cell

ANGLE = ([0, 20, 330, 400, 460, 520, 600], [38, 38, 38, 30, 18, 2, 0])  # plan distance [m], degrees
CHANNEL = ([0, 30, 250, 330], [0.5, 2, 2, 0])  # plan distance [m], depth [m]
ROADS = {14: (90, 4.0), 4: (295, 4.5), 10: (450, 5.0)}  # zone: plan distance, width [m]
RELIEF, SMOOTHING, SEED = 0.3, 1.5, 20090601  # standard deviation [m], Gaussian filter [cells], key


def natural(s: np.ndarray) -> np.ndarray:
    """Elevation [m] along the slope at plan distance `s` [m] from its top, before the roads."""
    step = 0.01
    middle = np.arange(0, 600, step) + step / 2
    fall = np.cumsum(step * np.tan(np.radians(np.interp(middle, *ANGLE))))
    return 1400 - np.interp(s, np.append(0, middle + step / 2), np.append(0, fall))


def profile(s: np.ndarray) -> np.ndarray:
    """The same with roads: benches, cut into the slope above their axis and filled up below it."""
    z = natural(s)
    for axis, width in ROADS.values():
        bench = natural(np.array(axis)) + 0.1 * (z - natural(np.array(axis)))  # a tenth of the fall
        z = np.where(np.abs(s - axis) < width / 2, bench, z)
    return z


def relief() -> np.ndarray:
    """White noise through a Gaussian filter, shape (NY, NX), standard deviation RELIEF [m]."""
    margin = 8  # more than five standard deviations of the filter: no edge effects
    shape = NY + 2 * margin, NX + 2 * margin
    raw = np.random.Philox(key=SEED).random_raw(shape[0] * shape[1])  # the same in every NumPy
    noise = raw.reshape(shape) / 2.0**64 - 0.5
    weight = np.exp(-0.5 * (np.arange(-margin, margin + 1) / SMOOTHING) ** 2)
    for axis in 0, 1:
        noise = np.apply_along_axis(np.convolve, axis, noise, weight, mode="valid")
    return RELIEF * (noise - noise.mean()) / noise.std()


def slope() -> tuple[np.ndarray, np.ndarray]:
    """Elevations (float32, m) and zone ids (uint8), both (NY, NX), north first."""
    s = (CELL * (np.arange(NY) + 0.5))[:, None]  # plan distance of the rows from the top edge
    x = CELL * (np.arange(NX) + 0.5)[None, :]
    off_axis = x - (100 + 8 * np.sin(s / 90))
    channel = np.interp(s, *CHANNEL) * np.exp(-((off_axis / 4) ** 2))
    elevation = profile(s) - channel + relief()

    zones = np.full((NY, NX), 3)  # talus
    zones[np.abs(off_axis) <= 5] = 1  # the channel
    for begin, zone in (300, 5), (470, 11), (540, 12):  # rougher talus, soils, fine soils
        zones[s[:, 0] > begin] = zone
    for zone, (axis, width) in ROADS.items():
        zones[np.abs(s[:, 0] - axis) < width / 2] = zone
    zones[np.abs(s - (568 + 5 * np.sin(x / 25))) < 4] = 2  # the river, 8 m wide
    return elevation.astype("f4"), zones.astype("u1")


def write(name: str, raster: np.ndarray) -> None:
    """A GeoTIFF beside this script, without a coordinate system: the place is made up."""
    transform = rasterio.Affine(CELL, 0, WEST, 0, -CELL, NORTH)
    about = {"height": NY, "width": NX, "count": 1, "dtype": raster.dtype, "transform": transform}
    with rasterio.open(HERE / name, "w", driver="GTiff", compress="deflate", **about) as file:
        file.write(raster, 1)


if __name__ == "__main__":
    elevation, zones = slope()
    write("dem.tif", elevation)
    write("zones.tif", zones)
