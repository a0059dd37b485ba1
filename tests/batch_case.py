# SPDX-License-Identifier: BSD-3-Clause
"""A rough slope as files that both programs read, and cases on it with every kind of surface."""

from pathlib import Path

import numpy as np

import rockfall
from made import write_ascii
from rockfall.io.grid import NO_ID, Grid
from rockfall.result import variables

GRID = Grid(west=600000.5, north=5200000.25, cell=2.5, nx=60, ny=50)
MAPS = list(variables.MAP)
TABLE = """zone,mean_radius,rg70,rg20,rg10
1,0.35,0.6,0.2,0.9
7,0.1,0.2,0.1,0.3
-3,Inf,Inf,Inf,Inf
"""
WHERE = f"x = {GRID.west + 40.3}, {GRID.west + 95}, y = {GRID.north - 12.7}, {GRID.north - 8}"
BOULDERS = 1000  # from each of 8 sources


def elevations():
    """A rough slope, steep and then nearly flat, with holes; the sources are not near them."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[: GRID.ny, : GRID.nx] * GRID.cell
    z = 1000 - 0.8 * np.minimum(y, 70) - 0.1 * y + 3 * np.sin(x / 9) + rng.normal(0, 0.2, x.shape)
    z[-5:, :7] = np.nan
    z[30:33, 40:42] = np.nan
    return z


def zones():
    ids = np.full(GRID.shape, 1, "i4")
    ids[20:35] = 7
    ids[-8:] = -3
    ids[10:14, 5:30] = NO_ID  # default_zone
    return ids


def sources():
    cells = np.zeros(GRID.shape, "i4")
    cells[3, 10:50:6] = 1
    cells[5, 12] = 4
    cells[0, 0] = NO_ID
    return cells


SURFACES = {
    "zones_b": "zones = 'zones.asc', table = 'zones.csv', default_zone = 7",
    "zones_a": "zones = 'zones.asc', table = 'zones.csv', default_zone = 1, method = 'A'",
    "radius": "mean_radius = 'rm.asc'",
    "sizes": "rg70 = 'rg70.asc', rg20 = 'rg20.asc', rg10 = 'rg10.asc', "
    "method = 'A', rg_reading = 'radius'",
    "uniform_b": "uniform_mean_radius = 0.3",
    "uniform_a": "uniform_rg = 0.5, 0.2, 0.9, method = 'A'",
}
LAWS = {
    "zones_b": "volume = 'normal', volume_mean = 0.8, volume_std = 0.15",
    "zones_a": "volume = 'lognormal', volume_mean = 0.8, volume_std = 0.5",
    "radius": "volume = 'uniform', volume_min = 0.1, volume_max = 2.0",
    "sizes": "volume = 'list', volumes = 0.1, 0.5, 2.5",
    "uniform_b": "volume_mean = 0.3, density = 2650.0",
    "uniform_a": "volume_mean = 1.5",
}


CELLS = "cells = 'cells.asc', drop_height = 3.0"


def case_text(surface="zones_b", release=CELLS, dem="dem.asc", more=""):
    x = f"{GRID.west}, {GRID.west + 70}, {GRID.west + 150}"
    y = f"{GRID.north - 60}, {GRID.north - 69}, {GRID.north - 60}"
    sampling = ", sampling = 'sobol'" if surface in ("zones_a", "radius") else ""
    return f"""&case title = 'made, "rough"', seed = 12345678901, boulders = 40{sampling} /
&terrain dem = '{dem}' /
&surface {SURFACES[surface]} /
&impact sets = 'rocky-slope', stop_speed = 0.4 /
&boulder {LAWS[surface]} /
&release {release} /
&line name = 'EL 1/ö' x = {x} y = {y} /
&line name = 'el_1_ö' x = {x} y = 3*{GRID.north - 80} /
&output maps = {", ".join(map(repr, MAPS))}, rebounds = .true., trajectories = 4 /
{more}"""


def write_rasters(folder):
    """Every raster that the cases name."""
    z = elevations()
    write_ascii(folder / "dem.asc", z, GRID)
    write_ascii(folder / "zones.asc", zones(), GRID)
    write_ascii(folder / "cells.asc", sources(), GRID)
    (folder / "zones.csv").write_text(TABLE)
    rng = np.random.default_rng(6)
    for name in ("rm", "rg70", "rg20", "rg10"):
        sizes = rng.uniform(0.05, 0.6, GRID.shape)
        sizes[-4:] = np.inf
        sizes[np.isnan(z)] = np.nan
        write_ascii(folder / f"{name}.asc", sizes, GRID)


def write_case(folder, **about):
    path = folder / "case.nml"
    path.write_text(case_text(**about))
    return path


def write_long_case(folder):
    """A case of its own sets with more boulders, that lasts for some saves."""
    shipped = Path(rockfall.__file__).parent / "data/impact_sets/rocky-slope.nml"
    (folder / "sets.nml").write_bytes(shipped.read_bytes())
    text = case_text().replace("boulders = 40", f"boulders = {BOULDERS}")
    (folder / "case.nml").write_text(text.replace("rocky-slope", "sets.nml"))
    return folder / "case.nml"


def done(folder, output):
    """Boulders in a checkpoint."""
    return int((folder / f"{output}.checkpoint/state.txt").read_text().splitlines()[-2].split()[0])
