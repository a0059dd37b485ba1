# SPDX-License-Identifier: BSD-3-Clause
"""Contents of a result for netCDF files and xarray.Datasets. Writing a file does not need xarray,
which takes longer to import than a small run.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from rockfall.accessor import add_accessor

if TYPE_CHECKING:
    import xarray as xr

Held: TypeAlias = "xr.Dataset | Contents"  # both forms are read with the same names
HeldVariable: TypeAlias = "xr.Variable | xr.DataArray | Variable"


class Variable:
    """Values along named dimensions, with attributes."""

    def __init__(self, dims: str | tuple[str, ...], values: Any, attrs: Mapping[str, Any]) -> None:
        """`values` may also be a column that is read from a file on demand."""
        self.dims = (dims,) if isinstance(dims, str) else dims
        self.held = values if hasattr(values, "pieces") else np.asarray(values)
        self.attrs = dict(attrs)
        self.dtype, self.shape, self.ndim = self.held.dtype, self.held.shape, self.held.ndim

    @property
    def values(self) -> np.ndarray:
        return np.asarray(self.held)

    def __getitem__(self, rows: Any) -> np.ndarray:
        return self.held[rows]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        array = np.asarray(self.values, dtype)  # NumPy 1 lacks "copy only if needed"
        return array.copy() if copy and array is self.values else array


class Contents:
    """Variables and coordinates by name; they are read like an xarray.Dataset."""

    def __init__(
        self, data: Mapping[str, tuple], attrs: Mapping[str, Any], coords: Iterable[str] = ()
    ) -> None:
        """`data` is (dimensions, values, attributes) by name; `coords` may include other names."""
        self.variables = {name: Variable(*variable) for name, variable in data.items()}
        self.attrs, named = dict(attrs), {*coords}
        self.coords = {name: variable for name, variable in self.variables.items() if name in named}
        self.sizes: dict[str, int] = {}  # length of each dimension
        for variable in self.variables.values():
            self.sizes |= zip(variable.dims, variable.shape, strict=True)

    def __contains__(self, name: object) -> bool:
        return name in self.variables

    def __getitem__(self, name: str) -> Variable:
        return self.variables[name]

    def dataset(self) -> xr.Dataset:
        """Convert to an xarray.Dataset. Variables are created explicitly, because xarray would
        otherwise load Dask, if installed, to check their type (0.5 s)."""
        import xarray as xr

        add_accessor()
        data = {
            name: xr.Variable(variable.dims, variable.values, variable.attrs, fastpath=True)
            for name, variable in self.variables.items()
        }
        return xr.Dataset(data, attrs=self.attrs).set_coords([*self.coords])
