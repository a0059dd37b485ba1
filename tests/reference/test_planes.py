# SPDX-License-Identifier: BSD-3-Clause
"""Measurements of benchmarks/accuracy/planes.py on exact planes, for every shipped set that is not
an ensemble."""

import re
import sys

import numpy as np
import pytest

import scenes

pytest.importorskip("matplotlib", reason="the report extra is not installed")
from benchmarks.accuracy import planes  # noqa: E402 - draws


@pytest.mark.parametrize("slope", [24, 38, 46])
def test_a_plane_is_one_to_the_last_bit(slope):
    z, grid = planes.plane(slope)
    steps = np.diff(z, axis=0)
    assert (steps == steps[0, 0]).all() and (z == z[:, :1]).all()
    assert np.degrees(np.arctan(-steps[0, 0] / grid.cell)) == pytest.approx(slope, abs=1e-9)


def test_without_scatter_boulders_stop_or_run_away(tmp_path):
    """With V_t_out = 0.6 V_t_in and V_n_out = 0.3 V_t_in the neutral slope is 33.7 degrees: all
    boulders stop at 30 degrees, and none at 46."""
    mean = np.zeros((5, 9))
    mean[:, 0], mean[:, 3] = 0.6, 0.3
    path = scenes.write_sets(tmp_path / "sets.nml", mean, np.zeros((5, 9, 9)))
    flat, steep = (planes.measure(path, slope, 3, 50) for slope in (30, 46))
    assert flat["fraction"] == (0.0, 0.0) and np.isnan([*flat["speed"], *flat["height"]]).all()
    assert steep["fraction"] == (1.0, 0.0) and steep["speed"].value > 15
    assert 0 < steep["speed"].error < 0.2 * steep["speed"].value
    found = planes.neutral(planes.read_sets(path)[0], 3)
    want = np.degrees(np.arctan(0.4 / 0.6))
    assert found.value == pytest.approx(want, abs=0.06) and found.error < 0.01  # by bisection


@pytest.mark.all
def test_the_page_has_every_number_of_every_set_and_table_but_ensembles(tmp_path, monkeypatch):
    name = "one"
    path = scenes.write_sets(tmp_path / f"{name}.nml", *scenes.sets())
    groups = path.read_text().replace("&impact_set", "&impact_set draw = 2,")
    (tmp_path / "many.nml").write_text(path.read_text() + groups)
    shipped = {name: path, "many": tmp_path / "many.nml"}
    monkeypatch.setattr(planes, "shipped_sets", lambda: shipped)
    monkeypatch.setattr(planes, "FULL", (name,))
    monkeypatch.setattr(planes, "table_names", lambda: ["talus"])
    monkeypatch.setattr(planes, "SLOPES", (34, 40, 44))
    monkeypatch.setattr(planes, "PRINTED", (34, 44))
    monkeypatch.setattr(planes, "SEEDS", (1, 2))
    monkeypatch.setattr(planes, "FLOWN", 100)
    monkeypatch.setattr(sys, "argv", ["planes.py", "--boulders", "30", "-o", str(tmp_path)])
    planes.main()
    text = (tmp_path / "validation" / "planes.md").read_text(encoding="utf-8")
    assert f"## `{name}`\n" in text and "`many`" not in text
    rows = [line for line in text.splitlines() if re.match(r"\| \d+ degrees", line)]
    assert len(rows) == 2 * 2 * len(planes.ON_PAGE)  # rows of the set, rows of the table
    assert (tmp_path / "figures" / "planes.png").read_bytes().startswith(b"\x89PNG")
