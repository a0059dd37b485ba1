# SPDX-License-Identifier: BSD-3-Clause
"""Opening and writing of netCDF-4 files, with names that Windows accepts."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rockfall.accessor import add_accessor
from rockfall.errors import RockfallError
from rockfall.io.files import CLASSIC, check_regular, start_of
from rockfall.system import NETCDF_NAMES, has_locks

if TYPE_CHECKING:
    import netCDF4
    import xarray as xr

Mode = Literal["r", "w", "x"]
_LOCKING = "HDF5_USE_FILE_LOCKING"

CACHE = 2**20  # cache of a variable [bytes]; the default in netCDF is 16 MB or more

# HDF5 locks its files and fails on file systems without locks. Locks are unnecessary here, because
# files are written under temporary names. HDF5 reads this variable when it opens its first file.
os.environ.setdefault(_LOCKING, "FALSE")


def open_netcdf(path: str | Path, mode: Mode = "r") -> netCDF4.Dataset:
    """Open a netCDF-4 file. Raises a RockfallError for a file that is not regular, a name that
    netCDF cannot open, a file system without locks, or classic netCDF, whose header could make the
    library abort the process; an OSError for other failures."""
    import netCDF4

    check_regular(path)
    if os.path.isfile(path) and start_of(path).startswith(CLASSIC):
        new = Path(path).with_name(f"{Path(path).stem}_nc4.nc")
        command = shlex.join(["nccopy", "-k", "nc4", str(path), str(new)])
        raise RockfallError(f"{path}: is classic netCDF: convert it to netCDF-4 by {command}")
    check_letters(path)
    # absolute, because netCDF may read another name as a URL
    name = os.path.abspath(path)

    class Named(netCDF4.Dataset):
        """A file whose name is decoded for xarray as netCDF encodes it."""

        def filepath(self, encoding: str | None = None) -> str:
            return super().filepath(encoding or NETCDF_NAMES)

    try:
        if NETCDF_NAMES is None or name.isascii():
            file = netCDF4.Dataset(name, mode)
        else:
            file = Named(name, mode, encoding=NETCDF_NAMES)
    except OSError as error:
        if has_locks(name if os.path.exists(name) else os.path.dirname(name)):
            raise
        raise RockfallError(
            f"{path}: HDF5 cannot lock files on this file system: set {_LOCKING}=FALSE"
        ) from error
    for variable in file.variables.values():
        if variable.dimensions == ("crossing",):
            variable.set_var_chunk_cache(CACHE)
    return file


def check_letters(path: str | Path) -> None:
    """Refuse a path with letters that netCDF cannot open on this Windows system."""
    if NETCDF_NAMES is None:
        return
    try:
        os.path.abspath(path).encode(NETCDF_NAMES)
    except UnicodeEncodeError as error:
        raise RockfallError(
            f"{path}: netCDF cannot open paths with letters outside the code page of this Windows: "
            "rename the file or its folder"
        ) from error


def open_dataset(path: str | Path, **decoding: Any) -> xr.Dataset:
    """Open a netCDF-4 file with xarray; `decoding` goes to `open_dataset`."""
    import xarray as xr

    add_accessor()
    store = xr.backends.NetCDF4DataStore(open_netcdf(path))
    return xr.open_dataset(store, **decoding)


def load_dataset(path: str | Path, **decoding: Any) -> xr.Dataset:
    """Load a netCDF-4 file into memory and close it; arguments as in `open_dataset`."""
    with open_dataset(path, **decoding) as data:
        return data.load()


def load_exact(path: str | Path, what: str) -> xr.Dataset:
    """Load a file with its values as stored; `what` describes the expected file in messages. Raises
    a RockfallError for damaged files."""
    try:
        return load_dataset(path, mask_and_scale=False, decode_times=False)
    except OSError as error:
        reason = error.strerror or error
        raise RockfallError(f"{path}: cannot be read as {what}: {reason}") from error


def write_compressed(data: xr.Dataset, path: str | Path, level: int) -> None:
    """Write a dataset as netCDF-4, compressed with zlib at this level (1 to 9)."""
    import xarray as xr

    packed = {name: {"zlib": True, "complevel": level} for name in data}
    with open_netcdf(path, "w") as file:
        store = xr.backends.NetCDF4DataStore(file, mode="w")
        data.dump_to_store(store, encoding=packed)
