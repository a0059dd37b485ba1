# SPDX-License-Identifier: BSD-3-Clause
"""Make the shipped sets, from the posterior and from the impacts of ../lab.nml.

    python ship.py IMPACTS.nc

`laboratory-spheres` is fitted to the case ../lab.nml, whose parameters are near the centre of the
posterior, with the most likely boulder state. `laboratory-spheres-ensemble` has one draw, from the
emulator, for each row of posterior.csv except the first (the centre). All draws share the lateral
deviations and fitted ranges of `laboratory-spheres`.
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
from posterior import NAMES, log_likelihood, numbers

import rockfall
from rockfall.scene.rebounds.sets import Sets
from rockfall_lab.sets.fit import as_rebounds, fit_impacts, fit_set, impacts_of
from rockfall_lab.sets.setfile import provenance, write_sets
from rockfall_lab.spheres.experiment import STATES, open_impacts

SHIPPED = HERE.parents[2] / "python" / "rockfall" / "data" / "impact_sets"


def likeliest_state(data: xr.Dataset) -> str:
    """Boulder state whose sets the evidence favours, on slopes with median values of the unknown
    parameters."""
    values = {}
    for state in STATES:
        fits = [
            fit_set(as_rebounds(impacts_of(data, ratio, state)), groups=0)
            for ratio in data["ratio"].values
        ]
        sets = Sets(state, *(np.array([getattr(one, name) for one in fits])
                             for name in ("mean", "covariance")))  # fmt: skip
        values[state] = log_likelihood(numbers(sets, np.full(len(NAMES), 0.5)), {})
        print(f"{state}: log likelihood {values[state]:.1f}", flush=True)
    return max(values, key=values.get)


def ship(path: Path) -> None:
    data = open_impacts(path)
    state = likeliest_state(data)
    sets = fit_impacts(data, state)
    write_sets(SHIPPED / "laboratory-spheres.nml", sets, provenance(data, state))
    rows, table = pd.read_csv(HERE / "posterior.csv"), xr.load_dataset(HERE / "design.nc")
    emulators = {name: Emulator(table, name) for name in STATES}
    draws = []
    for _, row in rows[1:].iterrows():
        unit = to_unit(row[list(PARAMETERS)].values.astype(float)[None])[0]
        found = emulators[row["counts"]].predict(unit)
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
        f"Made by rockfall {rockfall.__version__}: lab/cases/rocky-slope/calibration.",
    ]
    write_sets(SHIPPED / "laboratory-spheres-ensemble.nml", draws[0], about, *draws[1:])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("impacts", type=Path)
    ship(parser.parse_args().impacts)
