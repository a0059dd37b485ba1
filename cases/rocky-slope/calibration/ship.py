# SPDX-License-Identifier: BSD-3-Clause
"""The sets that are shipped, from the posterior and from the impacts of ../lab.nml.

    python ship.py IMPACTS.nc

`rocky-slope` is the state at the centre of the posterior, the first row of posterior.csv, whose
parameters stand in ../lab.nml. `rocky-slope-ensemble` has a draw for each row: the emulator's sets
there, with a draw of what it does not know; lateral deviations are those of `rocky-slope` in all.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from design import HERE, PARAMETERS, to_unit
from emulator import Emulator

import rockfall
from rockfall.lab.experiment import open_impacts
from rockfall.lab.fit import fit_impacts
from rockfall.lab.setfile import provenance, write_draws, write_sets

SHIPPED = HERE.parents[2] / "python" / "rockfall" / "data" / "impact_sets"


def ship(path: Path) -> None:
    rows, data = pd.read_csv(HERE / "posterior.csv"), open_impacts(path)
    sets = fit_impacts(data, rows["counts"][0])
    write_sets(SHIPPED / "rocky-slope.nml", sets, provenance(data, rows["counts"][0]))
    table = xr.load_dataset(HERE / "design.nc")
    generator = np.random.default_rng(2009)
    draws = []
    for _, row in rows.iterrows():
        unit = to_unit(row[list(PARAMETERS)].values.astype(float)[None])[0]
        emulator = Emulator(table, row["counts"])
        found = emulator.predict(unit, generator.standard_normal(len(emulator.processes)))
        draws.append(
            {
                k + 1: replace(
                    sets[k + 1], mean=mean, covariance=covariance, impacts=0, error_covariance=None
                )
                for k, (mean, covariance) in enumerate(zip(*found, strict=True))
            }
        )
    about = [
        f"{len(draws)} draws of the sets of a rocky slope, equally likely: what the calibration",
        "leaves open of the laboratory's parameters, for `&ensemble sets`.",
        "",
        f"Made by rockfall {rockfall.__version__}: cases/rocky-slope/calibration.",
    ]
    write_draws(SHIPPED / "rocky-slope-ensemble.nml", draws, about)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("impacts", type=Path)
    ship(parser.parse_args().impacts)
