# SPDX-License-Identifier: BSD-3-Clause
"""Shadow angles: from the apex of the talus at the foot of the cliff to the end of each boulder."""

import numpy as np
import pytest

import rockfall
from made import every_third, make_raster
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.case import case_of
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from same import same
from scenes import grid, make_case, sets

SIDE = 640.0  # side of the terrain [m]
CLIFF, TALUS = 60.0, 35.0  # slopes [degree]
EDGE, FOOT, TOE = 60.0, 120.0, 330.0  # distances along the fall line [m]
OBSERVED = {"shadow_angle": 30.0}


def profile(s, *slopes):
    """Elevations [m] at distances `s` along the fall line [m]; slopes [degree] change at EDGE, FOOT
    and TOE."""
    falls = np.diff([EDGE, FOOT, TOE, 2 * SIDE]) * np.tan(np.radians(slopes))
    return np.interp(s, [-SIDE, EDGE, FOOT, TOE, 2 * SIDE], 900 - np.cumsum([0, 0, *falls]))


def along(x, y, azimuth=180.0):
    """Distance [m] of a point along the fall line through the middle of the terrain."""
    across, up = x - SIDE / 2, y - SIDE / 2
    east, north = np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth))
    return SIDE / 2 + across * east + up * north


def place(s, azimuth=180.0):
    """Coordinates of the point at distance `s` on the fall line through the middle of the
    terrain."""
    away = s - SIDE / 2
    return (SIDE / 2 + away * np.sin(np.radians(azimuth)),
            SIDE / 2 + away * np.cos(np.radians(azimuth)))  # fmt: skip


def slope(cell=5.0, azimuth=180.0, slopes=(CLIFF, TALUS, 0.0)):
    centres = cell * (np.arange(int(SIDE / cell)) + 0.5)
    x, y = np.meshgrid(centres, centres[::-1])
    return profile(along(x, y, azimuth), *slopes)


def run(folder, z, at, cell=5.0, observed=OBSERVED, boulders=60, **how):
    case = make_case(
        folder, *sets(2.0), case={"boulders": boulders}, observed=observed,
        release={"x": [at[0]], "y": [at[1]], "drop_height": 3.0},
    )  # fmt: skip
    return rockfall.run(case, dem=z, transform=grid(z, cell), **how)


def by_hand(result, apex, source):
    """Shadow angles [degree] from an apex (x, y, z); 90 for boulders that end within 20 m of it or
    above it."""
    x, y, z = (result[f"stop_{axis}"].values for axis in "xyz")
    away = np.hypot(x - source[0], y - source[1])
    away -= np.hypot(apex[0] - source[0], apex[1] - source[1])
    fall = apex[2] - z
    return np.where((fall > 0) & (away >= 20.0), np.degrees(np.arctan2(fall, away)), 90.0)


@pytest.mark.parametrize("cell", [2.0, 5.0])
@pytest.mark.parametrize("azimuth", [180.0, 205.0, 90.0])
def test_the_apex_is_the_foot_of_the_cliff(tmp_path, cell, azimuth):
    source = place(EDGE + 10.0, azimuth)
    result = run(tmp_path, slope(cell, azimuth), source, cell)
    angles, bounds = result["shadow_angle"].values, []
    for foot in (FOOT - cell, FOOT + cell):
        apex = (*place(foot, azimuth), profile(foot, CLIFF, TALUS, 0.0))
        bounds.append(by_hand(result, apex, source))
    beyond = along(result["stop_x"], result["stop_y"], azimuth).values > TOE
    assert beyond.sum() > 30
    low, high = np.sort(bounds, axis=0)[:, beyond]
    assert (low <= angles[beyond]).all() and (angles[beyond] <= high).all()
    assert (high - low).max() < 1.5 * cell  # the bounds must be narrow


def test_a_node_at_the_break_is_the_apex(tmp_path):
    """With the centre of a cell at the break, the angle is exactly that of the line."""
    source, z = place(EDGE + 12.5), slope()
    rows = SIDE - 5.0 * (np.arange(len(z)) + 0.5)
    z = np.repeat(profile(SIDE - rows + 2.5, CLIFF, TALUS, 0.0)[:, None], len(z), 1)
    foot = FOOT - 2.5  # the profile is half a cell higher up: the break is at a cell centre
    result = run(tmp_path, z, source)
    apex = (*place(foot), profile(FOOT, CLIFF, TALUS, 0.0))
    np.testing.assert_allclose(result["shadow_angle"], by_hand(result, apex, source), rtol=1e-9)
    assert result["shadow_angle"].min() < TALUS


def descent(z, cell, source, length=400.0):
    """Points (n, 3) of the steepest descent from a source, one per metre, by gradients over 20
    m."""
    at, points = np.array(source), []

    def height(x, y):
        column, row = x / cell - 0.5, len(z) - 0.5 - y / cell
        i, j = int(column), int(row)
        u, v = column - i, row - j
        rows = (1 - u) * z[j : j + 2, i] + u * z[j : j + 2, i + 1]
        return (1 - v) * rows[0] + v * rows[1]

    while len(points) < length:
        points.append((*at, height(*at)))
        west, east, south, north = (height(*(at + step)) for step in
                                    ((-10, 0), (10, 0), (0, -10), (0, 10)))  # fmt: skip
        down = np.array([west - east, south - north])
        at = at + down / np.hypot(*down)
    return np.array(points)


@pytest.mark.family(3)
@pytest.mark.parametrize("cell", every_third([1.0, 2.0, 5.0, 10.0]))
@pytest.mark.parametrize(
    ("s", "slopes", "foot"),
    [
        ((60, 90, 130, 190, 330), (60, 25, 65, 35), 190),  # a ledge in the face
        ((60, 120, 270, 276, 330), (60, 35, 70, 20), 120),  # a road cut in the talus
        ((60, 80, 140, 190, 330), (65, 42, 65, 36), 190),  # steep ground between two bands of rock
    ],
)
def test_the_apex_is_the_foot_of_the_whole_face_on_any_cells(tmp_path, cell, s, slopes, foot):
    """On rough ground with cells of 1 to 10 m, the apex is within 5 m and half a cell of the
    foot."""
    falls = np.diff(s) * np.tan(np.radians(slopes))

    def elevation(along):
        return np.interp(along, [-SIDE, *s, 2 * SIDE], 900 - np.cumsum([0, 0, *falls, 0]))

    centres = np.arange(SIDE) + 0.5
    x, y = np.meshgrid(centres, centres[::-1])
    z = elevation(along(x, y, 190.0)) + np.random.default_rng(59).normal(0, 0.5, x.shape)
    n, m = int(SIDE / cell), int(cell)
    z = z.reshape(n, m, n, m).mean(axis=(1, 3))
    source = place(s[0] + 10.0, 190.0)
    result = run(tmp_path, z, source, cell)
    path = descent(z, cell, source)
    apex = path[np.argmin(path[:, 2] + np.arange(len(path)))]
    assert along(*apex[:2], 190.0) == pytest.approx(foot, abs=5.0 + cell / 2)
    close = np.isclose(result["shadow_angle"], by_hand(result, apex, source), atol=0.5 + cell / 5)
    assert (result["shadow_angle"] < 90).sum() > 30 and close.mean() > 0.9


def test_a_source_below_the_cliff_is_its_own_apex(tmp_path):
    source = place(FOOT + 42.5)
    result = run(tmp_path, slope(), source)
    apex = (*source, float(result["start_z"][0]) - 3.0)  # without the drop height
    np.testing.assert_allclose(result["shadow_angle"], by_hand(result, apex, source), rtol=1e-9)


@pytest.mark.parametrize("slopes", [(CLIFF, -CLIFF, 0.0), (CLIFF, CLIFF, CLIFF)])
def test_a_pit_or_the_end_of_the_terrain_gives_no_number(tmp_path, slopes):
    """No angle is given for a cliff above a pit, nor for one that continues to the edge of the
    terrain."""
    result = run(tmp_path, slope(slopes=slopes), place(EDGE + 12.5), boulders=20)
    assert np.isnan(result["shadow_angle"]).all()
    (text,) = [r.text for r in model_remarks(result, case_of(result))
               if r.text.key.startswith("model.angle")]  # fmt: skip
    assert text.key == "model.angle_unknown" and "20 of 20 boulders" in text
    rockfall.write_result(result, tmp_path / "a.nc")
    same(rockfall.read_result(tmp_path / "a.nc"), result)


def test_without_the_key_nothing_changes(tmp_path):
    source = place(EDGE + 12.5)
    result, usual = (run(tmp_path, slope(), source, observed=one) for one in (OBSERVED, {}))
    assert "shadow_angle" not in usual
    for name in usual.data_vars:
        if usual[name].dtype.kind in "if":
            np.testing.assert_array_equal(usual[name], result[name])


@pytest.mark.all
def test_parts_and_windows_find_the_same_apex(tmp_path):
    z = slope()
    make_raster(tmp_path / "dem.tif", z.astype("f4"), transform=(5.0, 0, 0, 0, -5.0, SIDE),
                crs=None, tiled=True, blockxsize=32, blockysize=32)  # fmt: skip
    at = [place(s) for s in (EDGE + 2.5, EDGE + 32.5, FOOT + 22.5)]
    case = make_case(
        tmp_path, *sets(2.0), case={"boulders": 10}, observed=OBSERVED, terrain={"dem": "dem.tif"},
        release={"x": [x for x, _ in at], "y": [y for _, y in at], "drop_height": 3.0},
    )  # fmt: skip
    whole, scene = rockfall.run(case), read_scene(case, memory=3_000)
    assert scene.windows and len(np.unique(whole["shadow_angle"])) > 10
    same(run_scene(scene), whole)
    same(rockfall.merge([rockfall.run(case, shard=(k, 2)) for k in (1, 2)]), whole)


def test_a_run_agrees_with_shadow_angles_or_not(tmp_path):
    source = place(EDGE + 12.5)
    z = slope(slopes=(CLIFF, TALUS, -20.0))  # counter-slope: all boulders stay on the terrain
    result = run(tmp_path, z, source, boulders=1000)
    case, angles = case_of(result), result["shadow_angle"].values
    lowest = float(np.quantile(angles, 0.01))
    for off, key in ((6, "flatter"), (0, "as_observed"), (-6, "steeper")):
        other = case.replace(observed={"shadow_angle": lowest + off})
        remarks = model_remarks(result.copy(), other)
        texts = {r.text.key: r.text for r in remarks if r.text.key.startswith("model.angle_")}
        assert texts.keys() == {f"model.angle_{key}"}
        assert texts[f"model.angle_{key}"].startswith("Shadow angle: ")
        assert f"{lowest:.1f}°" in texts[f"model.angle_{key}"]
