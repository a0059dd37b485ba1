"""Make `dem.asc`: a plane of 30 degrees that falls eastwards, 400 x 40 cells of 1 m.

The gradient is the multiple of 2^-40 nearest to tan 30 degrees (the angle is off by 1e-11 degrees).
Every elevation then has at most 50 binary digits, so it is exact in double precision, differences
of neighbours are exact too, and each patch of four cell centres is exactly plane.
"""

from pathlib import Path

import numpy as np

NX, NY = 400, 40
GRADIENT = round(np.tan(np.radians(30)) * 2**40) / 2**40
TOP = 240.0  # elevation of the west edge [m]


def elevation(x: np.ndarray) -> np.ndarray:
    """Elevation of the plane [m] at distance `x` [m] from its western edge."""
    return TOP - GRADIENT * x


if __name__ == "__main__":
    header = f"ncols {NX}\nnrows {NY}\nxllcorner 0\nyllcorner 0\ncellsize 1\nNODATA_value -9999\n"
    row = " ".join(map(repr, elevation(np.arange(NX) + 0.5).tolist())) + "\n"
    Path(__file__).with_name("dem.asc").write_text(header + NY * row)
