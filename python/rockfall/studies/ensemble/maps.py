# SPDX-License-Identifier: BSD-3-Clause
"""Maps over runs with uncertain inputs: mean, standard deviation and quantiles."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from rockfall.result.contents import Held
from rockfall.scene.scene import Scene

REACHED = 0.01  # a cell counts as reached if more than this fraction of a run's boulders pass
RANGED = ("energy_mean", "energy_max")  # maps for which quantiles over the runs are stored
LEVELS = {"q05": 0.05, "q95": 0.95}
AT_ONCE = 2**22  # map values in memory


class MemberMaps:
    """Maps of the members, stored only for cells that boulders reached."""

    def __init__(self, scene: Scene) -> None:
        self.shape, self.boulders = scene.grid.shape, scene.boulders
        self.names = scene.case.output["maps"]
        self.cells: list[np.ndarray] = []  # reached cells of each member
        self.values: dict[str, list[np.ndarray]] = {name: [] for name in self.names}
        self.attrs: dict[str, Any] = {}

    def add(self, result: Held) -> None:
        cells = np.flatnonzero(result["passages"].values > 0)
        self.cells.append(cells)
        for name in self.names:
            self.attrs[name] = result[name].attrs
            self.values[name].append(result[name].values.ravel()[cells])

    def variables(self) -> dict[str, Any]:
        """Map variables (y, x) by name."""
        cells = np.unique(np.concatenate(self.cells))
        size = max(1, AT_ONCE // len(self.cells))
        parts = [cells[k : k + size] for k in range(0, cells.size, size)]
        variables: dict[str, Any] = {}
        for name in self.names:
            for part in parts or [cells]:
                for label, (values, long_name, units) in self._maps(name, part).items():
                    attrs = {"units": units, "long_name": long_name, "grid_mapping": "crs"}
                    empty = np.zeros(self.shape, "f4")
                    variable = variables.setdefault(label, (("y", "x"), empty, attrs))
                    variable[1].ravel()[part] = values
        return variables

    def _maps(self, name: str, part: np.ndarray) -> dict[str, tuple[np.ndarray, str, str]]:
        """Maps derived from a map, in some cells: values, meaning and units."""
        members = self._dense(name, part)
        if name != "passages":
            attrs = self.attrs[name]
            return dict(self._quantiles(name, members, attrs["long_name"], attrs["units"]))
        members /= self.boulders
        what = "reach probability"
        spread = "standard deviation over the runs, including the Monte Carlo error"
        reached = f"fraction of the runs in which more than {REACHED:.0%} of the boulders passed"
        return {
            "reach_probability_mean": (members.mean(axis=0), f"{what}: mean over the runs", "1"),
            "reach_probability_std": (members.std(axis=0, ddof=1), f"{what}: {spread}", "1"),
            "reached_runs": ((members > REACHED).mean(axis=0), reached, "1"),
            **dict(self._quantiles("reach_probability", members, what, "1")),
        }

    def _quantiles(
        self, name: str, members: np.ndarray, long_name: str, units: str
    ) -> Iterator[tuple[str, tuple[np.ndarray, str, str]]]:
        """Quantiles over the members; energies are 0 where no boulder passes."""
        for label, level in LEVELS.items():
            text = f"{long_name}: {level:.0%} quantile over the runs"
            yield f"{name}_{label}", (np.quantile(members, level, axis=0), text, units)

    def _dense(self, name: str, part: np.ndarray) -> np.ndarray:
        """Map values of all members in some cells (members, cells), 0 where no boulder passes."""
        dense = np.zeros((len(self.cells), part.size))
        for row, cells, values in zip(dense, self.cells, self.values[name], strict=True):
            place = np.searchsorted(part, cells)
            inside = place < part.size
            inside[inside] = part[place[inside]] == cells[inside]
            row[place[inside]] = np.nan_to_num(values[inside])
        return dense
