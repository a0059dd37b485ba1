# SPDX-License-Identifier: BSD-3-Clause
"""Measured convergence: errors and slopes against theory, terrains, files, and rejected input."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import rockfall
from programs import refuses
from rockfall.cli import main
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import Grid
from rockfall.scene.read import read_scene
from rockfall.studies import convergence
from rockfall.studies.convergence import (
    KEYS,
    NUMBERS,
    _costs,
    _errors,
    _numbers,
    converge,
    larger_cells,
    other_digits,
)
from rockfall.tables.convergence import convergence_text
from scenes import cut_below, make_case, rough, sets

pytest.importorskip("matplotlib", reason="the report extra is not installed").use("Agg")

LINES = [
    {"name": "L", "x": [0.0, 300.0], "y": [290.0, 290.0]},
    {"name": "never", "x": [0.0, 10.0], "y": [395.0, 395.0]},
]


def case_file(folder, x=(150.0,), **groups):
    """Case read from files, on a slope that ends below the line, so that boulders take little
    time."""
    write_geotiff(folder / "dem.tif", *cut_below(rough(dtype="f4"), 270.0))
    release = {"x": list(x), "y": [320.0] * len(x)}
    case = make_case(
        folder, *sets(), line=groups.pop("line", LINES), terrain={"dem": "dem.tif"},
        release=release, **groups,
    )  # fmt: skip
    (folder / "case.nml").write_text(case.text())
    return rockfall.read_case(folder / "case.nml")


@pytest.fixture(scope="module")
def found(gallery):
    def make(folder):
        case = case_file(folder)
        return case, converge(case, boulders=[50, 1000, 200], reference=20_000)

    return gallery.value("convergence", make)


@pytest.mark.all
def test_errors_of_independent_normal_values_are_those_of_theory():
    """Relative standard errors are sigma/(mu sqrt(n)) for a mean, 1/sqrt(2 n) for a standard
    deviation, and sqrt((1 - p)/(p n)) for a fraction p."""
    random = np.random.default_rng(1)
    values = np.repeat(random.normal(10, 2, (1, 1, 400_000)), 3, axis=1)
    values[:, :, random.random(400_000) < 0.3] = np.nan
    exact = np.array([[0.7, *3 * [10, 2, 10 + 1.644854 * 2]]])
    error = _errors(values, exact, 1, 1e-5, rockfall.Case(line=LINES[:1], **MINIMAL))
    cost = _costs(error, 1e-5, {"L": 0.7}).set_index(KEYS)
    assert np.abs(cost["slope"] + 0.5).max() < 0.05
    assert (np.abs(cost["slope"] + 0.5) < 3 * cost["slope_error"]).all()
    for key, theory in (
        (("L", "boulders", "fraction"), np.sqrt(0.3 / 0.7 / 10_000)),
        (("L", "speed", "mean"), 0.2 / np.sqrt(7_000)),
        (("L", "speed", "std"), 1 / np.sqrt(2 * 7_000)),
    ):
        row = cost.loc[key]
        assert row["error_10000"] == pytest.approx(theory, rel=0.06)
        # n = 10,000 (error / 1 %)^2, at 10 microseconds each
        seconds = 0.1 * (row["error_10000"] / 0.01) ** 2
        assert row["cpu_seconds_1_percent"] == pytest.approx(seconds, rel=1e-9)
        crossed = 0.0 if key[2] == "fraction" else 500 / 0.7  # enough boulders must pass the line
        boulders = max(1e4 * (1.959964 * row["error_10000"] / 0.02) ** 2, crossed)
        assert row["boulders_2_percent"] == pytest.approx(boulders, rel=1e-9)
        assert row["cpu_seconds_0.1_percent"] == pytest.approx(100 * seconds, rel=1e-9)


MINIMAL = {
    "case": {"boulders": 1}, "surface": {"uniform_mean_radius": 0.25}, "release": {"x": 1, "y": 1},
    "boulder": {"volume_mean": 1.0},
}  # fmt: skip


def test_numbers_are_those_of_numpy_and_nobody_is_no_number():
    values = np.random.default_rng(2).normal(10, 2, (1, 3, 4, 50))
    values[0, :, :, :20] = np.nan
    values[0, :, 3] = np.nan
    share, *rest = _numbers(values)[0]
    assert share.tolist() == [0.6, 0.6, 0.6, 0.0]
    v = values[0, 2, 1, 20:]
    expected = [v.mean(), v.std(ddof=1), np.quantile(v, 0.95)]
    assert [row[1] for row in rest[6:]] == pytest.approx(expected, rel=1e-12)
    assert np.isnan([row[3] for row in rest]).all()


def test_the_study_has_the_numbers_of_runs_with_as_many_boulders(found):
    case, measured = found
    for size in (50, 200, 1000):
        table = rockfall.line_statistics(rockfall.run(case.replace(case={"boulders": size})))
        expected = table.set_index(["line", "quantity"]).loc["L"]
        part = measured.study.query("line == 'L' and boulders == @size").set_index(KEYS[1:])
        assert part.loc[("boulders", "fraction"), "value"] == expected["fraction"].iloc[0]
        for quantity in convergence.AT_LINES:
            for name in ("mean", "std", "q95", "max"):
                row = part.loc[(quantity, name)]
                assert row["value"] == expected.loc[quantity, name]
                if name != "max" and np.isfinite(row["high"]):
                    assert row["high"] == expected.loc[quantity, f"{name}_high"]
    one = measured.study.query("line == 'L' and quantity == 'speed' and statistic == 'mean'")
    assert one["boulders"].tolist() == [50, 200, 1000]
    values = one["value"].values
    assert one["change"].values[1:] == pytest.approx(values[1:] / values[:-1] - 1, rel=1e-12)


def test_statistical_errors_agree_with_the_intervals_of_a_run(found):
    _, measured = found
    study = measured.study.query("boulders == 1000").set_index(KEYS)
    for row in measured.cost.itertuples():
        about = study.loc[(row.line, row.quantity, row.statistic)]
        half = (about["high"] - about["low"]) / 2 / about["value"]
        assert row.error_10000 * np.sqrt(10) == pytest.approx(half / 1.96, rel=0.35)
        assert abs(row.slope + 0.5) < 4 * row.slope_error or np.isnan(row.slope)


def test_terrains_are_compared_with_the_same_boulders(found):
    _, measured = found
    table = measured.numerical
    assert list(table["variant"].unique()) == ["as given", "float64", "cells x2", "cells x4"]
    known = table[(table["line"] == "L") & (table["variant"] != "as given")]
    assert len(known) == 3 * len(NUMBERS) and known.notna().all(axis=None)
    fine = known[known["variant"] == "float64"]
    assert (fine["change"].abs() <= 5 * fine["change_error"] + 1e-3).all()
    coarse = known[known["variant"] == "cells x4"]
    assert (coarse["change"].abs() > 3 * coarse["change_error"]).any()
    assert table[table["line"] == "never"]["change"].isna().any()
    assert not measured.refused


def test_the_same_terrain_changes_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(convergence, "other_digits", lambda scene: ("float32", scene))
    monkeypatch.setattr(convergence, "MIN_REFERENCE", 4_000)
    case = case_file(tmp_path, (140.0, 150.0, 160.0), line=LINES[:1])
    measured = converge(case, boulders=[20, 40], reference=1_334)
    same = measured.numerical.query("variant == 'float32'")
    assert (same["change"] == 0).all() and (same["change_error"] == 0).all()
    assert measured.sources == 3 and measured.reference == 4_002
    assert (measured.error["boulders"] % 3 == 0).all()
    assert "differences between sources" in convergence_text(measured)


def test_other_digits_round_or_give_back_what_rounding_took(tmp_path):
    scene = read_scene(case_file(tmp_path))
    name, double = other_digits(scene)
    assert name == "float64" and double.rasters.z.dtype == np.float64
    assert np.array_equal(double.rasters.z.astype("f4"), scene.rasters.z)
    assert not np.array_equal(double.rasters.z, scene.rasters.z)
    name, single = other_digits(double)
    assert name == "float32" and np.array_equal(single.rasters.z, scene.rasters.z)


def test_larger_cells_are_means_and_majorities(tmp_path):
    scene = read_scene(case_file(tmp_path))
    z = np.arange(15.0).reshape(3, 5)
    z[0, 0] = z[2, 4] = np.nan
    scene = scene.replace(
        grid=Grid(100.0, 50.0, 5.0, 5, 3), z=z,
        zone=np.array([[0, 3, 1, 2, 2], [3, 1, 2, 1, 1], [4, 5, 5, 5, 0]], "i2"),
        values=np.array([[[1, 2, 3, 4, 5], [6, 7, 8, np.inf, 5], [1, 1, 1, 1, 1]]], "f4"),
    )  # fmt: skip
    large = larger_cells(scene, 2).rasters
    assert (large.grid.cell, large.grid.nx, large.grid.ny) == (10.0, 3, 2)
    assert (large.grid.west, large.grid.north) == (100.0, 50.0)
    np.testing.assert_array_equal(large.z, [[4, 5, 6.5], [10.5, 12.5, np.nan]])
    assert large.zone.tolist() == [[3, 1, 1], [4, 5, 0]] and large.zone.dtype == np.int16
    np.testing.assert_array_equal(large.values, [[[4, 6, 5], [1, 1, 1]]])


def test_a_source_at_the_edge_is_told_where_larger_cells_do_not_reach(tmp_path, monkeypatch):
    monkeypatch.setattr(convergence, "MIN_REFERENCE", 4_000)
    case = case_file(tmp_path, line=LINES[:1]).replace(release={"x": [150.0], "y": [396.0]})
    measured = converge(case, boulders=[10], reference=4_000)
    assert set(measured.refused) == {"cells x2", "cells x4"}
    assert "cells x4: not run: " in convergence_text(measured)


def test_the_text_claims_nothing_of_what_is_not_known(found):
    """No boulder crosses one of the lines: the text has neither NaN nor infinity, and no errors
    there."""
    said = convergence_text(found[1])
    assert not re.search(r"\b(nan|inf)\b", said) and "the widest interval" in said
    assert re.search(r"^  never: speed \[m/s\], mean( +-){4}$", said, re.M)
    study = found[1].study.assign(change=np.inf)
    assert "still changed from 0." in convergence_text(replace(found[1], study=study))


def test_too_few_turns_of_many_sources_are_refused(tmp_path, monkeypatch):
    """Every block needs boulders from all 20 sources: 319 boulders are rejected as reference, 320
    are not."""
    monkeypatch.setattr(convergence, "MIN_REFERENCE", 4_000)
    case = case_file(tmp_path, np.linspace(130, 170, 20), line=LINES[:1])
    with pytest.raises(rockfall.RockfallError, match="319: must be at least 320 boulders from "):
        converge(case, boulders=[2], reference=319)
    assert converge(case, boulders=[2], reference=320).numerical["change_error"].notna().all()


@pytest.mark.all
@pytest.mark.filterwarnings("error")
def test_the_command_writes_tables_and_figures(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    case_file(tmp_path)
    arguments = ["convergence", "case.nml", "--boulders", "20", "100", "--reference", "20000"]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "s of CPU, one more digit" in said and "The paper reports" in said
    names = ["convergence.pdf", "convergence.png"]
    names += ["cost.csv", "error.csv", "numerical.csv", "study.csv"]
    assert sorted(path.name for path in (tmp_path / "case_convergence").iterdir()) == names
    for name in names[2:]:
        assert list(pd.read_csv(tmp_path / "case_convergence" / name).columns[:3]) == KEYS
    first = (tmp_path / "case_convergence" / "convergence.pdf").read_bytes()
    assert b"/Type /Page" in first and b"CreationDate" not in first


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--boulders", "1", "50"], "boulders = 1: must be at least 2"),
        (["--reference", "100"], "reference = 100: must be at least 20000"),
        (["--reference", "1" + 30 * "0"], "boulders do not fit in memory"),
        (["-o", "case.nml"], "is a file: give a folder"),
    ],
)
def test_wrong_arguments_are_refused(tmp_path, monkeypatch, capsys, arguments, says):
    monkeypatch.chdir(tmp_path)
    case_file(tmp_path)
    refuses(["convergence", "case.nml", *arguments], f".*{says}.*", capsys)


def test_a_case_without_lines_is_refused(tmp_path):
    with pytest.raises(rockfall.RockfallError, match="requires a &line"):
        converge(case_file(tmp_path, line=[]))
