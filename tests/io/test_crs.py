# SPDX-License-Identifier: BSD-3-Clause
"""CRS: CF parameters mean the same as the WKT, scales are those on the ground."""

import math

import numpy as np
import pyproj
import pytest
from rasterio.crs import CRS

from rockfall.io.crs import grid_mapping, length_scale
from rockfall.io.grid import Grid

WKT = "crs_wkt", "spatial_ref"


@pytest.mark.parametrize("code", [32733, 2154, 31254, 3035, 5070, 3395, 3031])
def test_the_parameters_of_a_projection_give_the_coordinates_of_its_wkt(code):
    """By the parameters alone, as a program reads them that knows no WKT."""
    attributes = grid_mapping(CRS.from_epsg(code))
    alone = {key: value for key, value in attributes.items() if key not in WKT}
    whole = pyproj.CRS.from_wkt(attributes["crs_wkt"])
    area = pyproj.CRS.from_epsg(code).area_of_use
    place = np.linspace(area.west, area.east, 5)[1:4], np.linspace(area.south, area.north, 5)[1:4]
    x, y = (
        pyproj.Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True).transform(*place)
        for crs in (whole, pyproj.CRS.from_cf(alone))
    )
    np.testing.assert_allclose(y, x, atol=1e-3)


@pytest.mark.parametrize("code", [27572, 2056, 3375, 3857, 28992])
def test_a_projection_that_cf_cannot_describe_has_its_wkt_alone(code):
    """Grads and a scale on a cone, oblique axes, web maps, an oblique stereographic."""
    attributes = grid_mapping(CRS.from_epsg(code))
    assert "grid_mapping_name" not in attributes
    assert CRS.from_wkt(attributes["crs_wkt"]) == CRS.from_epsg(code)


@pytest.mark.parametrize(
    ("code", "x", "y", "scale"),
    [
        (32632, 500000, 5.0e6, 0.9996),
        (32632, 166021, 0, 0.9996 * (1 + 0.5 * (333979 / 0.9996) ** 2 / (6335439.3 * 6378137))),
        (32661, 2000000, 2000000, 0.994),  # the pole
        (3857, 0, 0, math.sqrt(6378137 / 6335439.3)),  # a sphere laid on an ellipsoid
        (4326, 9, 47, 1.0),
        (32632, 1e12, 1e12, 1.0),
    ],
)
def test_lengths_of_a_crs_are_those_on_the_ground(code, x, y, scale):
    grid = Grid(x - 10.0, y + 10.0, 1.0, 20, 20, CRS.from_epsg(code))
    assert length_scale(grid) == pytest.approx(scale, abs=2e-5)
