# SPDX-License-Identifier: BSD-3-Clause
"""Maps with additional dimensions, such as a threshold, as single maps for files and figures."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

PLAN = ("y", "x")
BEYOND = {"threshold": (1000.0, "kJ"), "return_period": (1.0, "years")}  # factor and display unit


def flat_maps(data: xr.Dataset) -> xr.Dataset:
    """Dataset with a plan map for each position along the additional dimensions of a map."""
    import xarray as xr

    by_variable = {str(name): layers(variable) for name, variable in data.data_vars.items()}
    if all(len(several) == 1 for several in by_variable.values()):
        return data
    flat = {name: layer for several in by_variable.values() for name, layer in several.items()}
    return xr.Dataset(flat, data.coords, data.attrs)


def layers(variable: xr.DataArray) -> dict[str, xr.DataArray]:
    """Single maps by name, from a map with additional dimensions; any other variable unchanged."""
    name, beyond = str(variable.name), [dim for dim in variable.dims if dim not in PLAN]
    if variable.dims[-2:] != PLAN or not beyond or not {*beyond} <= {*BEYOND}:
        return {name: variable}
    named = {}
    for index in product(*(range(variable.sizes[dim]) for dim in beyond)):
        layer = variable.isel(dict(zip(beyond, index, strict=True)))
        places = [(str(dim), float(layer[dim])) for dim in beyond]
        long_name = ", ".join([layer.attrs["long_name"], *(shown(*place, " ") for place in places)])
        layer = layer.drop_vars(beyond).assign_attrs(long_name=long_name)
        named["_".join([name, *(shown(*place) for place in places)])] = layer
    return named


def shown(dim: str, value: float, between: str = "") -> str:
    """Label for a position along a dimension: 30kJ, 100years."""
    unit, name = BEYOND[dim]
    return f"{value / unit:.10g}{between}{name}"
