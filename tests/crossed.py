# SPDX-License-Identifier: BSD-3-Clause
"""Crossings of lines in artificial results."""

import numpy as np

SINGLE = 2.0**-23  # maximum relative error of single-precision values is half of this
#: Columns that a result stores for each crossing.
STORED = ("time", "distance", "velocity_x", "velocity_y", "velocity_z", "omega", "jump_height",
          "passing_height")  # fmt: skip
OF_SOME = {"volume": "f4", "fragments": "i4", "outcome": "i1"}  # optional columns


def crossed(number, names=("L",), **dense):
    """Variables of a result in which boulders, numbered in ascending order, cross the named lines.
    `dense` has values (lines, boulders) of columns of STORED, or of speed (towards north), volume,
    fragments or outcome; NaN is for no crossing. Missing columns are 0."""
    number, shape = np.asarray(number, "i8"), (len(names), np.size(number))
    if "speed" in dense:
        dense["velocity_y"] = dense.pop("speed")
    dense = {name: np.broadcast_to(values, shape) for name, values in dense.items()}
    there = ~np.isnan([*dense.values()]).any(axis=0) if dense else np.zeros(shape, bool)
    line, boulder = np.nonzero(there)
    kinds = dict.fromkeys(STORED, "f4")
    kinds |= {name: kind for name, kind in OF_SOME.items() if name in dense}
    columns = {name: dense[name][there].astype(kind) if name in dense else np.zeros(line.size, kind)
               for name, kind in kinds.items()}  # fmt: skip
    return {
        "line": ("line", np.arange(len(names), dtype="i4")),
        "line_name": ("line", np.array(names, object)),
        "row_size": ("line", there.sum(axis=1, dtype="i4")),
        "crossing_boulder": ("crossing", number[boulder]),
        "crossing_line": ("crossing", line.astype("i4")),
        **{f"crossing_{name}": ("crossing", values) for name, values in columns.items()},
    }
