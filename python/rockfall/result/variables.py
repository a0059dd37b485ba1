# SPDX-License-Identifier: BSD-3-Clause
"""Every variable of a result: name -> CF attributes, by groups, from the kernel's table."""

from rockfall._core import rockfall_f2py as _core


def _read_table() -> dict[str, dict[str, dict[str, str]]]:
    """Group -> name -> attributes, in the order of the table."""
    table: dict[str, dict[str, dict[str, str]]] = {}
    k = 1
    while text := _core.variable(k).decode().strip():
        group, name, _, units, long_name, comment = text.split("|")
        about = {"units": units, "long_name": long_name, "comment": comment}
        table.setdefault(group, {})[name] = {key: value for key, value in about.items() if value}
        k += 1
    return table


_TABLE = _read_table()

BOULDER = _TABLE["boulder"]
COUNT = _TABLE["count"]  # over all boulders
GROUND = _TABLE["ground"]  # the same, on each ground
ENERGY = _TABLE["energy"]  # of each boulder, on request
LINE = _TABLE["line"]  # in files line_x, ...
LINE_VERTEX = _TABLE["line_vertex"]
BARRIER = _TABLE["barrier"]  # in files barrier_height, ...
MAP = _TABLE["map"]
HISTOGRAM = _TABLE["histogram"]  # in the kernel's order; units of the bins
VERTEX = _TABLE["vertex"]  # in files trajectory_x, ...
STATUS = {name: number for number, name in enumerate(_TABLE["status"], start=1)}
OUTCOME = {name: number for number, name in enumerate(_TABLE["outcome"], start=1)}


def fields(what: int) -> list[str]:
    """Names of the kernel's columns: 1 boulder, 2 counts, 3 crossing, 4 vertex, 5 energy."""
    return _core.fields(what).decode().split()
