# SPDX-License-Identifier: BSD-3-Clause
"""A header of classic netCDF that claims more than its file holds is found before the netCDF
library, which would end the process, reads it."""

import netCDF4
import numpy as np
import pytest

from rockfall.errors import RockfallError
from rockfall.io.classic_header import overstates
from rockfall.io.files import check_netcdf

FORMATS = {"NETCDF3_CLASSIC": 4, "NETCDF3_64BIT_OFFSET": 4, "NETCDF3_64BIT_DATA": 8}


@pytest.fixture(params=FORMATS)
def classic(request, tmp_path):
    """(a small sound file, the bytes of a count in it)."""
    path = tmp_path / "dem.nc"
    with netCDF4.Dataset(path, "w", format=request.param) as file:
        file.title, file.numbers = "five", np.arange(3.0)
        file.createDimension("x", 5)
        file.createDimension("time", None)
        file.createVariable("x", "f8", ("x",)).units = "m"
        file.createVariable("z", "i2", ("time", "x"))[:] = np.ones((2, 5))
    return path, FORMATS[request.param]


def test_what_the_library_writes_does_not_overstate(classic, tmp_path):
    path, _ = classic
    assert not overstates(path)
    check_netcdf(path)
    netCDF4.Dataset(tmp_path / "new.nc", "w").close()
    (tmp_path / "text.nc").write_text("CDF")
    for other in ("new.nc", "text.nc", "none.nc", "."):
        assert not overstates(tmp_path / other)


def test_a_header_cut_anywhere_overstates(classic):
    path, _ = classic
    content = path.read_bytes()
    end = content.index(b"\0\0\0\x0b")  # the list of variables: its tag
    for size in range(4, end + 8):
        path.write_bytes(content[:size])
        assert overstates(path), size


@pytest.mark.parametrize(
    "tag", [b"\x0a", b"\x0b", b"\x0c"], ids=["dims", "variables", "attributes"]
)
def test_a_list_longer_than_the_file_overstates(classic, tag):
    """Counts of 67 million and, where the format has it, of 2^58 and of a negative number."""
    path, width = classic
    content = path.read_bytes()
    at = content.index(b"\0\0\0" + tag) + 4
    for place, byte in ((width - 4, 0x04), (0, 0x04), (0, 0x84)):
        path.write_bytes(content[: at + place] + bytes([byte]) + content[at + place + 1 :])
        with pytest.raises(RockfallError, match="its header claims more than the file holds$"):
            check_netcdf(path)


def test_lengths_of_names_and_values_and_unknown_types_overstate(classic):
    path, width = classic
    content = path.read_bytes()
    name = content.index(b"numbers\0")
    kind = name + 8
    for at, byte in ((name - 4, 0x7F), (kind + 3, 12), (kind + 3, 0)):
        path.write_bytes(content[:at] + bytes([byte]) + content[at + 1 :])
        assert overstates(path)
    at = kind + 4 + width - 3  # 65,539 values of 8 bytes
    path.write_bytes(content[:at] + b"\x01" + content[at + 1 :])
    assert overstates(path)
