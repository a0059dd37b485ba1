# SPDX-License-Identifier: BSD-3-Clause
"""A scale that may already convert a unit, next to the name of the unit: the elevations are
ambiguous and refused, without a command that might convert them twice."""

import numpy as np
import pytest
import rasterio

from made import PLACE, UTM, hill
from rockfall.errors import RockfallError
from rockfall.io.rasters.dem import read_dem

FOOT, SURVEY = 0.3048, 1200 / 3937


@pytest.fixture(autouse=True)
def in_tmp_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def write(scale, offset=0.0, unit=None, description=None, **tags):
    z = hill(20, 30)
    profile = {"driver": "GTiff", "width": 30, "height": 20, "count": 1, "dtype": "float64"}
    with rasterio.open("dem.tif", "w", **profile, crs=UTM, transform=PLACE) as file:
        file.scales, file.offsets = [scale], [offset]
        file.write((z - offset) / scale, 1)
        if unit:
            file.units = [unit]
        if description:
            file.set_band_description(1, description)
        file.update_tags(**tags)
    return z


@pytest.mark.parametrize("scale, told, words", [
    (FOOT, {"description": "elevation in feet"}, "foot (band description)"),
    (FOOT, {"unit": "ft"}, "foot (band unit)"),
    (0.305, {"unit": "feet"}, "foot (band unit)"),  # rounded
    (SURVEY, {"unit": "US survey foot"}, "US survey foot (band unit)"),
    (0.3048006, {"description": "height [ft]"}, "foot (band description)"),
    (0.01, {"unit": "cm"}, "centimetre (band unit)"),
    (0.1, {"description": "Höhe in dm"}, "decimetre (band description)"),
    (0.001, {"unit": "mm"}, "millimetre (band unit)"),
    (1000.0, {"unit": "km"}, "kilometre (band unit)"),
    (FOOT, {"vertical_unit": "feet"}, "foot (vertical_unit)"),
])  # fmt: skip
def test_which_is_right_is_asked(scale, told, words):
    write(scale, **told)
    with pytest.raises(RockfallError) as caught:
        read_dem("dem.tif")
    assert str(caught.value) == (
        f"dem.tif: elevations are declared in {words}, but scale factor {scale:g} already converts "
        "them to metres: correct the unit or the scale"
    )


@pytest.mark.parametrize("scale, told", [
    (0.1, {"unit": "ft"}), (0.01, {"description": "elevation in feet"}), (2.0, {"unit": "ft"}),
])  # fmt: skip
def test_another_scale_keeps_the_command_that_converts(scale, told):
    write(scale, **told)
    with pytest.raises(RockfallError, match=f"convert with: rio calc .*{scale * FOOT!r} .read 1"):
        read_dem("dem.tif")


@pytest.mark.parametrize("scale", [FOOT, 0.01, 0.1])
def test_a_scale_alone_is_read(scale):
    z = write(scale, 100.0)
    np.testing.assert_allclose(read_dem("dem.tif")[0], z, rtol=1e-12)
    write(scale, unit="m")
    np.testing.assert_allclose(read_dem("dem.tif")[0], z, rtol=1e-12)
