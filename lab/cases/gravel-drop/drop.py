# SPDX-License-Identifier: BSD-3-Clause
"""Drop a sphere on gravel, and print R_n by classes of the incident speed.

python lab/cases/gravel-drop/drop.py
"""

from pathlib import Path

import numpy as np

from rockfall_lab.case import read_lab_case
from rockfall_lab.sets.fit import as_rebounds, impacts_of
from rockfall_lab.spheres.experiment import run_impacts

CASE = Path(__file__).parent / "lab.nml"
CLASSES = 2.0, 3.0, 4.0, 5.0, 6.5  # class limits of the speed [m/s]


def main() -> None:
    data = run_impacts(read_lab_case(CASE), progress=True)
    print(f"solid fraction {float(data['solid'].mean()):.3f}")
    print(f"{'V [m/s]':>10}{'drops':>7}{'R_n':>8}{'s.e.':>8}{'deviation':>11}")
    for state in "peak", "loss":
        drops = as_rebounds(impacts_of(data, data["ratio"].values[0], state))
        speed, r_n = -drops.v_in[:, 1], -drops.v_out[:, 1] / drops.v_in[:, 1]
        for low, high in zip(CLASSES, CLASSES[1:], strict=False):
            one = r_n[(speed >= low) & (speed < high)]
            error = one.std(ddof=1) / np.sqrt(one.size)
            numbers = f"{one.size:7d}{one.mean():8.3f}{error:8.3f}{one.std():11.3f}"
            print(f"{low:5g}-{high:<4g}{numbers}  {state}")


if __name__ == "__main__":
    main()
