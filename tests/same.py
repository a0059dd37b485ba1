# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of two results."""

import numpy as np
import xarray as xr

#: Attributes specific to a run or to functions in Python.
OWN = ("date_created", "wall_seconds", "cpu_seconds", "threads", "model_warnings")


def same_bits(a, b):
    """Return True if type, shape and bits are equal; -0 differs from 0, and all NaN are equal."""
    a, b = np.asarray(a), np.asarray(b)
    if a.dtype.kind == "f":
        a, b = (np.where(np.isnan(x), x.dtype.type(np.nan), x) for x in (a, b))
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def same_numbers(a, b, names=None):
    """Check that two results are equal in all common variables, or in `names`; NaN equals NaN."""
    names = names or sorted(set(a.variables) & set(b.variables))
    assert {"status", "stop_z", "path_length", "rebounds"} <= set(names)
    for name in names:
        one, other = a.variables[name].values, b.variables[name].values
        assert one.dtype == other.dtype, name
        if one.dtype.kind == "f":
            assert np.array_equal(one, other, equal_nan=True), name
        else:
            assert np.array_equal(one, other), name


def same(one, other):
    """Check that variables and attributes are identical, except attributes such as run times and
    threads."""
    xr.testing.assert_identical(
        one.assign_attrs(dict.fromkeys(OWN, 0)), other.assign_attrs(dict.fromkeys(OWN, 0))
    )
    for name, variable in other.variables.items():
        assert one.variables[name].dtype == variable.dtype, name
