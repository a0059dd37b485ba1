"""The figures of docs/lab.md: `python cases/rocky-slope/figures.py IMPACTS.nc [FOLDER]`.

IMPACTS.nc is what `rockfall lab impact cases/rocky-slope/lab.nml` has made.
"""

import sys
from pathlib import Path

from rockfall.lab.case import lab_case_of
from rockfall.lab.experiment import film, open_impacts
from rockfall.lab.fit import fit_impacts, impacts_of, point_maps, uncorrected
from rockfall.lab.plots import coefficient_figure, impact_figure, restitution_figure
from rockfall.lab.scorecard import read_sets

SHOTS = [(2, 1, 15.0, 45.0), (5, 1, 15.0, 45.0), (5, 1, 15.0, 15.0)]  # ratio, point, speed, angle


def main(impacts: Path, folder: Path) -> None:
    data = uncorrected(open_impacts(impacts))
    case = lab_case_of(data.attrs["lab_case"], str(impacts))
    films = [
        film(case, *shot) | {"title": f"R_b/R_m = {shot[0]}, {shot[2]:g} m/s, {shot[3]:g} degrees"}
        for shot in SHOTS
    ]
    width = case.packing["width"] * case.packing["mean_radius"]
    impact_figure(films, width, folder / "lab_impacts.png")
    maps = {r: point_maps(*impacts_of(data, r)).a for r in (1, 2, 3, 4, 5)}
    coefficient_figure(maps, fit_impacts(data, 2), folder / "lab_coefficients.png")
    sets = [read_sets("rocky-slope"), read_sets("rocky-slope-lab")]
    restitution_figure(sets, folder / "lab_restitution.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]) if len(sys.argv) > 2 else Path("docs"))
