# SPDX-License-Identifier: BSD-3-Clause
"""Numbers at the lines: their values, and whether their intervals hold what they say."""

import numpy as np
import pytest
import xarray as xr

import rockfall
from rockfall.statistics import QUANTITIES, _error_of_mean, _wilson
from scenes import grid, make_case, rough, sets


@pytest.fixture(scope="module")
def long_run(tmp_path_factory):
    """100,000 boulders of one source past a line."""
    folder = tmp_path_factory.mktemp("case")
    line = [{"name": "L", "x": [0.0, 300.0], "y": [280.0, 280.0]}]
    case = make_case(
        folder, *sets(), line=line, case={"boulders": 100_000, "threads": 0},
        terrain={}, release={"x": 150.0, "y": 380.0},
    )  # fmt: skip
    return rockfall.run(case, dem=rough(), transform=grid(rough()))


def of_speed(result):
    table = rockfall.line_statistics(result).set_index("quantity")
    return table.loc["speed"]


def test_95_percent_intervals_hold_the_long_runs_value_95_times_in_100(long_run):
    truth = of_speed(long_run)
    parts = [
        of_speed(long_run.isel(boulder=slice(k, k + 200))) for k in range(0, 100_000, 200)
    ]  # 500 repetitions with boulders of their own
    for name in ("mean", "q50", "q95", "share", "std"):
        held = [part[f"{name}_low"] <= truth[name] <= part[f"{name}_high"] for part in parts]
        assert 0.93 <= np.mean(held) <= 0.97, name


def test_intervals_enclose_their_number_and_shrink_with_n(long_run):
    few, many = of_speed(long_run.isel(boulder=slice(0, 1000))), of_speed(long_run)
    for name in ("share", "mean", "std", "q50", "q90"):
        width = [row[f"{name}_high"] - row[f"{name}_low"] for row in (few, many)]
        assert few[f"{name}_low"] <= few[name] <= few[f"{name}_high"]
        assert width[1] == pytest.approx(width[0] / 10, rel=0.5)


def test_the_numbers_are_those_of_the_crossing_boulders(long_run):
    table = rockfall.line_statistics(long_run).set_index("quantity")
    assert set(table.index) == set(QUANTITIES)
    speed = long_run["line_speed"].values[0]
    speed = speed[np.isfinite(speed)]
    row = table.loc["speed"]
    assert row["n"] == speed.size and row["share"] == speed.size / 100_000
    assert row["mean"] == speed.mean() and row["std"] == speed.std(ddof=1)
    assert row["max"] == speed.max() and row["q98"] == np.quantile(speed, 0.98)
    energy = (long_run["line_energy_translational"] + long_run["line_energy_rotational"]).values[0]
    assert table.loc["energy_total", "mean"] == np.nanmean(energy)
    share = long_run["line_energy_rotational"].values[0] / energy
    assert table.loc["rotational_share", "mean"] == pytest.approx(np.nanmean(share), rel=1e-12)


def test_wilson_as_printed():
    """Newcombe (1998), table 1: 81 of 263, 15 of 148, 0 of 20, 1 of 29."""
    for passed, n, low, high in (
        (81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0000, 0.1611), (1, 29, 0.0061, 0.1718),
    ):  # fmt: skip
        assert _wilson(passed / n, n) == pytest.approx((low, high), abs=5e-5)


def test_boulders_of_a_source_count_as_one_where_they_do_the_same():
    """Each value 50 times over: the error is that of the sources, not of the boulders."""
    value = np.random.default_rng(1).normal(size=40)
    found = _error_of_mean(np.repeat(value, 50), np.repeat(np.arange(40), 50))
    assert found == pytest.approx(value.std(ddof=1) / np.sqrt(40), rel=1e-12)


def test_a_quantile_beyond_the_sample_has_no_upper_limit():
    speed = np.arange(1.0, 21.0)
    names = {f"line_{name}": (("line", "boulder"), speed[None]) for name in QUANTITIES[:6]}
    start = {"start_x": ("boulder", np.zeros(20)), "start_y": ("boulder", np.zeros(20))}
    row = of_speed(xr.Dataset({**names, **start}, {"line": ["L"]}))
    assert row["q99"] > 19 and np.isnan(row["q99_high"]) and row["q99_low"] > 10
    assert row["share_high"] == 1 and 0.8 < row["share_low"] < 0.9
