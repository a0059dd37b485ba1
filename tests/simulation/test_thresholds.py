# SPDX-License-Identifier: BSD-3-Clause
"""Maps of thresholds, energy lines and times agree with runs of single boulders."""

import numpy as np
import pytest

import rockfall
import scenes
from made import refused
from rockfall.result.crossings import at_lines
from rockfall.result.maps.flat_maps import flat_maps

MAPS = ["passages", "energy_max", "energy_exceeded"]
WAYS = ["energy_line_angle_max", "energy_line_angle_min", "travel_time_min"]
THRESHOLDS = [0.0, 5.0, 40.0, 200.0]  # [kJ]
BOULDERS = 60


def make_case(folder, maps, **groups):
    groups["output"] = {"maps": maps} | groups.get("output", {})
    if "energy_exceeded" in maps:
        groups["hazard"] = {"thresholds": THRESHOLDS} | groups.get("hazard", {})
    release = {"x": [120.0, 180.0], "y": [380.0, 385.0]} | groups.pop("release", {})
    case = {"boulders": BOULDERS // 2} | groups.pop("case", {})
    boulder = {"volume": "normal", "volume_mean": 0.8, "volume_std": 0.3}
    make = dict(release=release, case=case, boulder=boulder, **groups)
    return scenes.make_case(folder, *scenes.sets(2.0), **make)


def run(case, **how):
    z = scenes.rough()
    return rockfall.run(case, dem=z, transform=scenes.grid(z), **how)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return run(make_case(tmp_path_factory.mktemp("one"), MAPS + WAYS))


def test_counts_are_those_of_the_boulders_one_by_one(tmp_path, result):
    """Counts above each threshold are those from the maxima of single boulders, each run as a
    shard."""
    counts = np.zeros(result.energy_exceeded.shape, int)
    case = make_case(tmp_path, ["energy_max"])
    for number in range(1, BOULDERS + 1):
        part = run(case, shard=(number, BOULDERS))
        energy = np.zeros(counts[0].size)
        energy[part["tally_cell"].values] = part["tally_maxima"].values[0]
        counts += energy.reshape(counts[0].shape) > 1000 * np.array(THRESHOLDS)[:, None, None]
    assert (result.energy_exceeded.values == counts).all()
    assert counts[-1].max() > 3  # boulders above the highest threshold


def test_every_boulder_that_passes_exceeds_nothing(result):
    assert (result.energy_exceeded.sel(threshold=0.0).values == result.passages.values).all()
    assert (np.diff(result.energy_exceeded.values, axis=0) <= 0).all()
    above = result.energy_exceeded.sel(threshold=200e3).values > 0
    assert (above == (result.energy_max.values > 200e3)).all()


def test_the_thresholds_are_a_coordinate_in_joule(result, tmp_path):
    assert result.energy_exceeded.dims == ("threshold", "y", "x")
    assert result.threshold.attrs["units"] == "J"
    assert result.threshold.values.tolist() == [0.0, 5e3, 40e3, 200e3]
    rockfall.write_result(result, tmp_path / "a.nc")
    again = rockfall.read_result(tmp_path / "a.nc")
    result = result.copy()
    del result.attrs["model_warnings"]  # not stored in files
    assert again.identical(result)


def test_each_threshold_is_a_map_in_plan_for_files_and_figures(result):
    flat = flat_maps(result)
    names = [f"energy_exceeded_{one}kJ" for one in (0, 5, 40, 200)]
    assert [name for name in flat.data_vars if "exceeded" in name] == names
    for name, layer in zip(names, result.energy_exceeded, strict=True):
        assert flat[name].dims == ("y", "x") and (flat[name].values == layer.values).all()
    assert list(flat.data_vars)[-3:] == list(result.data_vars)[-3:]  # the order is unchanged


def test_a_map_that_is_not_asked_for_changes_no_other(tmp_path, result):
    one = run(make_case(tmp_path, ["energy_max"]))
    assert one.energy_max.identical(result.energy_max)
    assert one.stop_x.identical(result.stop_x)
    for name in WAYS:
        alone = run(make_case(tmp_path, [name]))
        assert alone[name].identical(result[name])


def test_energy_lines_are_between_those_of_sources_and_cells(result):
    """With one source a cell has one energy line; with two the maps have the steeper and the
    flatter of them."""
    z = scenes.rough()
    angles = []
    for k in range(2):
        x, y, start = (result[f"start_{axis}"].values[k * BOULDERS // 2] for axis in "xyz")
        away = np.hypot(result.x.values[None, :] - x, result.y.values[:, None] - y)
        rows = np.round((400 - 2.5 - result.y.values) / 5).astype(int)
        columns = np.round((result.x.values - 2.5) / 5).astype(int)
        angles.append(np.degrees(np.arctan2(start - z[np.ix_(rows, columns)], away)))
    steep, flat = (result[name].values for name in WAYS[:2])
    passed = np.isfinite(steep)
    low, high = np.minimum(*angles)[passed], np.maximum(*angles)[passed]
    near = 1e-4
    assert (steep[passed] <= high + near).all() and (flat[passed] >= low - near).all()
    assert (flat[passed] <= steep[passed]).all()
    of_one = [np.minimum(abs(one - low), abs(one - high)) for one in (steep[passed], flat[passed])]
    assert max(np.max(one) for one in of_one) < near
    assert (steep[passed] > flat[passed]).any()
    cells = (result.passages.values > 0) & ~passed  # cells of the releases
    assert 1 <= cells.sum() <= 2


def test_times_grow_from_the_release_to_the_last_stop(result):
    time = result.travel_time_min.values
    assert (np.isfinite(time) == (result.passages.values > 0)).all()
    assert np.nanmin(time) == 0 and np.nanmax(time) <= result.travel_time.values.max() + 1e-5
    first = result.travel_time.values.min()
    row, column = np.unravel_index(np.nanargmax(time), time.shape)
    assert time[row, column] > first


def test_time_at_a_line_is_that_of_its_cells(tmp_path):
    """Boulders that cross a line along the sides of cells reach the cells below at the same
    time."""
    line = [{"name": "L", "x": [0.0, 300.0], "y": [300.0, 300.0]}]
    case = make_case(tmp_path, ["travel_time_min", "passages"], line=line)
    result = run(case)
    below = result.travel_time_min.sel(y=297.5).values
    crossed = at_lines(result)["line_time"].values[0]
    first = np.nanmin(crossed)
    column = int(at_lines(result)["line_x"].values[0][np.nanargmin(crossed)] // 5)
    assert below[column] == pytest.approx(first, abs=1e-4)


@pytest.mark.parametrize(
    ("thresholds", "message"),
    [
        ([30.0, 30.0], "&hazard thresholds = 30.0, 30.0: must increase"),
        ([300.0, 30.0], "&hazard thresholds = 300.0, 30.0: must increase"),
        ([-1.0], "&hazard thresholds = -1.0: must be 0 to 100000 [kJ]"),
        (list(map(float, range(1, 10))),
         "&hazard thresholds = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0: must have at most 8 "
         "values"),
    ],
)  # fmt: skip
def test_thresholds_that_make_no_sense_are_refused(tmp_path, thresholds, message):
    with refused(f"case: {message}"):
        make_case(tmp_path, MAPS, hazard={"thresholds": thresholds})
