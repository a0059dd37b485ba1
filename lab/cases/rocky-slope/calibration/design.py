# SPDX-License-Identifier: BSD-3-Clause
"""Laboratory runs at many settings of the physical parameters: training data of the emulator.

    python design.py WORK            # fire; continues an interrupted run
    python design.py WORK --fit      # sets of all settings that are done, into design.nc

The settings are in settings.csv: a first wave from a Sobol sequence over the prior, later waves
from the posterior of the earlier ones (`posterior.py --wave`). All settings have the same seed, and
so the same radii, positions, angles and speeds (common random numbers).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.stats import qmc

import rockfall
from rockfall_lab.case import LabCase, read_lab_case
from rockfall_lab.sets.fit import as_rebounds, fit_set, impacts_of
from rockfall_lab.spheres.experiment import STATES, open_impacts, run_impacts

HERE = Path(__file__).parent
#: Each parameter: group and key of the laboratory case, ends of its range, and whether its
#: logarithm is uniform.
PARAMETERS = {
    "friction": ("material", "friction", 0.35, 0.7, False),
    "rolling": ("material", "rolling", 0.0, 0.4, False),
    "boulder_rolling": ("material", "boulder_rolling", 0.0, 0.3, False),
    "settling_friction": ("packing", "friction", 0.1, 0.7, True),
    "grading": ("packing", "grading", 2.0, 6.0, False),
    "base_speed": ("packing", "base_speed", 100.0, 3000.0, True),
}
FIRST_WAVE = 13
SETTINGS = HERE / "settings.csv"
EFFORT = {"ratios": [5, 1, 2, 3], "layers": 12, "points": 5, "impacts": 6}


def settings() -> np.ndarray:
    """Settings (settings, parameters) in the units of the laboratory case."""
    return np.loadtxt(SETTINGS, delimiter=",", skiprows=1, ndmin=2)


def add_settings(values: np.ndarray) -> None:
    """Append rows of settings to the file `SETTINGS`, which is created if missing."""
    if not SETTINGS.exists():
        SETTINGS.write_text(",".join(PARAMETERS) + "\n", encoding="utf-8")
    with SETTINGS.open("a", encoding="utf-8") as file:
        np.savetxt(file, values, "%.6g", ",")


def first_wave() -> np.ndarray:
    sobol = qmc.Sobol(len(PARAMETERS), scramble=True, rng=np.random.default_rng(2009))
    return physical(sobol.random(64)[:FIRST_WAVE])


def physical(unit: np.ndarray) -> np.ndarray:
    """Parameters from numbers in 0 to 1."""
    columns = []
    for u, (_, _, low, high, by_log) in zip(unit.T, PARAMETERS.values(), strict=True):
        columns.append(low * (high / low) ** u if by_log else low + u * (high - low))
    return np.stack(columns, axis=1)


def to_unit(values: np.ndarray) -> np.ndarray:
    """Numbers in 0 to 1 from parameters."""
    columns = []
    for v, (_, _, low, high, by_log) in zip(values.T, PARAMETERS.values(), strict=True):
        columns.append(np.log(v / low) / np.log(high / low) if by_log else (v - low) / (high - low))
    return np.stack(columns, axis=1)


def lab_case(values: np.ndarray) -> LabCase:
    """Laboratory case of a setting."""
    case = read_lab_case(HERE.parent / "lab.nml").replace(lab=EFFORT)
    for value, (group, key, *_) in zip(values, PARAMETERS.values(), strict=True):
        case = case.replace(**{group: {key: float(value)}})
    return case


def impacts_file(work: Path, number: int) -> Path:
    return work / f"setting-{number:02d}.nc"


def fire(work: Path) -> None:
    work.mkdir(parents=True, exist_ok=True)
    if not SETTINGS.exists():
        add_settings(first_wave())
    for number, values in enumerate(settings()):
        run_impacts(lab_case(values), path=impacts_file(work, number), resume=True)
        print(number, dict(zip(PARAMETERS, np.round(values, 3), strict=True)), flush=True)


def fit(work: Path, path: Path) -> None:
    """Write means, covariances and standard errors over (setting, ratio, state) to `path`."""
    rows = []
    for number in range(len(settings())):
        if not impacts_file(work, number).exists():
            break
        data = open_impacts(impacts_file(work, number))
        if not (data["status"].values > 0).all():
            break
        rows.append(one_setting(data).expand_dims(setting=[number]))
    table = xr.concat(rows, "setting")
    for column, name in enumerate(PARAMETERS):
        table[name] = "setting", settings()[table["setting"].values, column]
    table.attrs["version"] = rockfall.__version__
    table.to_netcdf(path, encoding={name: {"zlib": True, "dtype": "f4"} for name in table})


def one_setting(data: xr.Dataset) -> xr.Dataset:
    ratios = sorted(data["ratio"].values)
    sizes = len(ratios), len(STATES)
    out = {"mean": np.empty((*sizes, 9)), "covariance": np.empty((*sizes, 9, 9))}
    for i, ratio in enumerate(ratios):
        for j, state in enumerate(STATES):
            found = fit_set(as_rebounds(impacts_of(data, ratio, state)), groups=0)
            for name, values in out.items():
                values[i, j] = getattr(found, name)
    dims = {3: ("a",), 4: ("a", "b")}
    table = xr.Dataset(
        {name: (("ratio", "state", *dims.get(v.ndim, ())), v) for name, v in out.items()},
        {"ratio": ratios, "state": list(STATES)},
    )
    table["solid"] = data["solid"].mean("layer").sel(ratio=ratios)
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--fit", action="store_true")
    chosen = parser.parse_args()
    if chosen.fit:
        fit(chosen.work, HERE / "design.nc")
    else:
        fire(chosen.work)
