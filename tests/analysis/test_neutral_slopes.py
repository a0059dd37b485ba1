# SPDX-License-Identifier: BSD-3-Clause
"""Neutral slopes of a scene compared with hand calculations, and the cells that are steeper.

Without scatter, V_t_out = a V_t_in and V_n_out = b V_t_in: on a plane with tangent t, a bounce and
the following flight multiply the speed by a + 2 b t.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from rockfall.analysis.planes.neutral_slopes import NeutralSlopes, rocks_of
from rockfall.scene.read import read_scene
from rockfall.text.preview import preview
from scenes import grid, make_case

KEPT = np.array([0.5, 0.55, 0.6, 0.65, 0.7])  # a for each ratio
RISE = np.array([0.25, 0.28, 0.3, 0.29, 0.26])  # b for each ratio
NEUTRAL = np.degrees(np.arctan((1 - KEPT) / (2 * RISE)))  # 45, 38.8, 33.7, 31.1, 30.0
RADIUS = np.cbrt(0.75 / np.pi * 0.8)  # radius of a sphere of 0.8 m3
UPPER, LOWER = 40.0, 32.0  # slopes of the two halves of the ground [degree]


def ground(ny=80, nx=40, cell=5.0):
    """Ground with slope UPPER in the upper half and LOWER in the lower half."""
    tangents = np.where(np.arange(ny - 1) < ny // 2, *np.tan(np.radians([UPPER, LOWER])))
    z = 2000.0 - cell * np.concatenate([[0.0], np.cumsum(tangents)])
    return np.repeat(z[:, None], nx, axis=1)


def scene(folder, surface=None, arrays=None, **groups):
    mean = np.zeros((5, 9))
    mean[:, 0], mean[:, 3] = KEPT, RISE
    release = {"x": 100.0, "y": 380.0, "drop_height": 5.0}
    groups = {"terrain": {}, "release": release, "surface": surface or {}} | groups
    case = make_case(folder, mean, np.zeros((5, 9, 9)), **groups)
    z = ground()
    return read_scene(case, dem=z, transform=grid(z), **(arrays or {}))


@pytest.mark.parametrize("ratio", [0.3, 1.0, 2.4, 2.6, 4.0, 5.2, 30.0])
def test_the_nearest_set_has_its_neutral_slope(tmp_path, ratio):
    nearest = scene(tmp_path, impact={"ratio": "nearest"})
    found = NeutralSlopes(nearest).of(RADIUS, np.array([RADIUS / ratio]))
    want = NEUTRAL[int(np.clip(np.floor(ratio + 0.5), 1, 5)) - 1]
    assert found == pytest.approx(want, abs=0.06)  # accuracy of the bisection


@pytest.mark.parametrize("ratio", [1.5, 2.25, 4.9])
def test_between_two_sets_their_logarithms_balance(tmp_path, ratio):
    found = NeutralSlopes(scene(tmp_path, impact={"ratio": "between"}))
    slope = found.of(RADIUS, np.array([RADIUS / ratio]))
    k, share = int(ratio) - 1, ratio % 1
    factor = KEPT + 2 * RISE * np.tan(np.radians(slope))
    assert (1 - share) * np.log(factor[k]) + share * np.log(factor[k + 1]) == pytest.approx(
        0.0, abs=3e-3
    )


def test_method_a_balances_its_three_sizes(tmp_path):
    surface = {"uniform_rg": [0.6, 0.3, 0.2], "method": "A", "rg_reading": "radius"}
    here = scene(tmp_path, surface, impact={"ratio": "nearest"})
    (rocks,) = rocks_of(here)
    assert rocks.radii.tolist() == [0.6, 0.3, 0.2] and rocks.name == ""
    found = NeutralSlopes(here)  # ratios 0.96, 1.92, 2.88
    assert found.weights(RADIUS, rocks.radii) == pytest.approx([0.7, 0.2, 0.1, 0, 0])
    factor = KEPT + 2 * RISE * np.tan(np.radians(found.of(RADIUS, rocks.radii)))
    assert [0.7, 0.2, 0.1, 0, 0] @ np.log(factor) == pytest.approx(0.0, abs=3e-3)
    absorbs = np.array([0.6, np.inf, 0.2])
    assert found.weights(RADIUS, absorbs) == pytest.approx([7 / 8, 0, 1 / 8, 0, 0])


@pytest.fixture
def zoned(tmp_path):
    """Function that makes a scene: zone 1 is steep, zone 2 flatter, zone 9 absorbs, zone 4 does not
    occur."""
    zones = np.full(ground().shape, 2)
    zones[:40], zones[-5:] = 1, 9
    table = f"zone,mean_radius\n1,{RADIUS / 2:.6f}\n4,1\n2,{RADIUS / 2:.6f}\n9,Inf\n"
    (tmp_path / "zones.csv").write_text(table)
    surface = {"zones": "given", "table": "zones.csv"}

    def make(**groups):
        groups = {"impact": {"ratio": "nearest"}} | groups
        return scene(tmp_path, surface, {"zones": zones}, **groups)

    return make


def lines(scene_):
    page = preview(scene_).splitlines()
    return [line.strip() for line in page if "neutral" in line or "absorbs" in line]


def test_check_tells_of_each_zone_how_much_is_steeper(zoned):
    """The neutral slope for R_b/R_m = 2, 38.8 degrees, is between the slopes of the two halves."""
    assert lines(zoned()) == [
        "zone 1: R_m 0.288 m, R_b/R_m 2; neutral slope 39 degrees, 100% of cells steeper",
        "zone 2: R_m 0.288 m, R_b/R_m 2; neutral slope 39 degrees, 0% of cells steeper",
        "zone 9: absorbs",
    ]


def test_check_tells_both_ends_where_volumes_are_served_by_several_sets(zoned):
    narrow, wide = ({"volume": "normal", "volume_std": std} for std in (0.03, 0.5))
    assert " (" not in lines(zoned(boulder=narrow, case={"boulders": 600}))[0]
    first = lines(zoned(boulder=wide, case={"boulders": 600}))[0]
    ratio = r"R_b/R_m 2\.[0-9]+ \(1\.[0-9]+ to 2\.[0-9]+\); neutral slope 39 \(45 to 34\) degrees, "
    ratio += r"100% \(0% to 100%\) of cells steeper"
    assert re.search(ratio, first), first


def test_sizes_in_rasters_are_told_by_fifths(tmp_path):
    rocks = np.full(ground().shape, RADIUS / 3, "f4")
    rocks[:, :6] = RADIUS  # in 5 of the 38 sampled columns
    rocks[:30, 10:] = RADIUS / 5  # in 29 of 78 rows
    rocks[:, -9:] = np.inf
    here = scene(tmp_path, {"mean_radius": "given"}, {"mean_radius": rocks})
    found = {one.name: one for one in rocks_of(here)}
    assert list(found) == ["smallest fifth", "middle", "largest fifth"]
    sizes = [float(one.radii[0]) for one in found.values()]
    assert sizes == pytest.approx([RADIUS / 5, RADIUS / 3, RADIUS], rel=1e-6)
    kept = 78 * 30
    counts = [one.tangents.size for one in found.values()]
    assert sum(counts) == kept and counts[0] == pytest.approx(0.2 * kept, abs=1)
    assert [one.split(":")[0] for one in lines(here)] == list(found)
    assert found["smallest fifth"].steeper(39.0) == 1.0


def test_what_is_told_does_not_depend_on_windows(zoned):
    """Rows read in bands, as for terrain that does not fit in memory, give the same lines."""
    from rockfall.io.rasters.grid import Box
    from rockfall.scene.ground import Ground

    whole = zoned()
    parts = Ground()
    for first in (0, 23, 50):
        last = {0: 23, 23: 50, 50: 80}[first]
        rows = slice(max(0, first - 3), min(80, last + 3))
        z, zone = whole.rasters.z[rows], whole.rasters.zone[rows]
        band = replace(whole.rasters, z=z, zone=zone, at=(rows.start, 0))
        box = Box(first, 0, last, whole.grid.nx)
        parts.take(band, box)
        parts = parts.with_sources(band, box, whole.x, whole.y)
    told = lines(whole)
    whole.__dict__["ground"] = parts
    assert lines(whole) == told
