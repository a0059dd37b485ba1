# SPDX-License-Identifier: BSD-3-Clause
"""Random properties of boulders in a result: shape and ground strength."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import case_of
from rockfall.result.variables import BLOCK_SHAPE

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike

    from rockfall.result.contents import Held


def ground_strength(result: xr.Dataset) -> xr.DataArray:
    """Ground strength for each boulder, (boulder,), as a standard normal variable z. With impact
    tables, the strength of a ground is its median times exp(strength_sigma z) (theory, eq. 5.25a);
    the rocks on it have the radius R_m exp(-mean_radius_sigma z) (eq. 7.3a). z depends only on the
    seed and the boulder number.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml").replace(case={"boulders": 5})
    >>> rockfall.ground_strength(rockfall.run(case)).dims
    ('boulder',)
    """
    numbers = result["boulder"].astype("i8")
    if "boulder" not in result.coords:  # the result is a part of a run
        numbers = numbers + int(result.attrs["boulder_first"])
    deviates = _core.strength_deviates(case_of(result).case["seed"], np.asarray(numbers))
    return (
        numbers.copy(data=deviates)
        .rename("ground_strength")
        .assign_attrs(
            long_name="strength of the ground under the boulder, standard normal", units="1"
        )
    )


def boulders_by_shape(values: Held | Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
    """Mask (boulders,) for each block shape, by name; {} if the run has a single shape."""
    if "block_shape" not in values:
        return {}
    shape = np.asarray(values["block_shape"])
    masks = {name: shape == number for name, number in BLOCK_SHAPE.items()}
    return {name: mask for name, mask in masks.items() if mask.any()}
