# SPDX-License-Identifier: BSD-3-Clause
"""Package functions as methods of a result: `result.rockfall.exceedance("road")`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

OF_RESULTS = (
    "at_lines", "barrier_statistics", "crossings", "exceedance", "export", "ground_strength",
    "layers", "line_profile", "line_statistics", "report", "return_levels", "return_period",
    "section", "show", "trajectories", "write_hazard", "write_result",
)  # fmt: skip


class Accessor:
    """Methods of a result: the functions in `OF_RESULTS`, with the Dataset as first argument."""

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in OF_RESULTS:
            raise AttributeError(f"rockfall has no function {name!r} for results")
        return partial(getattr(import_module("rockfall"), name), self._dataset)

    def __dir__(self) -> list[str]:
        return [*OF_RESULTS]


def add_accessor() -> None:
    """Register the accessor `rockfall` on xarray.Dataset; called where results are made or read."""
    import xarray as xr

    if not hasattr(xr.Dataset, "rockfall"):
        xr.register_dataset_accessor("rockfall")(Accessor)
