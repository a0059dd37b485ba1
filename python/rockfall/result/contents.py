# SPDX-License-Identifier: BSD-3-Clause
"""What a file of ours holds, before there is a file: the netCDF file and the xarray.Dataset are both
made of it. xarray with pandas takes longer to import than a small case to run, so commands go
without."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

    Held = xr.Dataset | Contents  # what is read of either by the same names
    HeldVariable = xr.Variable | xr.DataArray | Variable


class Variable:
    """Values along named dimensions, with attributes."""

    def __init__(self, dims: str | tuple[str, ...], values: Any, attrs: Mapping[str, Any]) -> None:
        self.dims = (dims,) if isinstance(dims, str) else dims
        self.values, self.attrs = np.asarray(values), dict(attrs)
        self.dtype, self.shape, self.ndim = self.values.dtype, self.values.shape, self.values.ndim

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.values, dtype, copy=copy)


class Contents:
    """Variables by name, some of them coordinates of the others; read like an xarray.Dataset."""

    def __init__(
        self, data: Mapping[str, tuple], attrs: Mapping[str, Any], coords: Iterable[str] = ()
    ) -> None:
        """`data` is (dimensions, values, attributes) by name; `coords` may name more than it."""
        self.variables = {name: Variable(*one) for name, one in data.items()}
        self.attrs, named = dict(attrs), {*coords}
        self.coords = {name: one for name, one in self.variables.items() if name in named}

    @property
    def sizes(self) -> dict[str, int]:
        """The length of each dimension."""
        found: dict[str, int] = {}
        for one in self.variables.values():
            found |= zip(one.dims, one.shape, strict=True)
        return found

    def __contains__(self, name: object) -> bool:
        return name in self.variables

    def __getitem__(self, name: str) -> Variable:
        return self.variables[name]

    def dataset(self) -> xr.Dataset:
        """The same values as xarray has them. Were variables left to xarray, it would load Dask,
        wherever that is installed, to see whether the values are of Dask: half a second."""
        import xarray as xr

        data = {
            name: xr.Variable(one.dims, one.values, one.attrs, fastpath=True)
            for name, one in self.variables.items()
        }
        return xr.Dataset(data, attrs=self.attrs).set_coords([*self.coords])
