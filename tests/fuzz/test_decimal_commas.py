# SPDX-License-Identifier: BSD-3-Clause
"""Decimal commas in lists of numbers are refused by both programs, with the corrected number."""

from pathlib import Path

import pytest

import rockfall
from made import every_third
from programs import refused_in_one_line, refuses
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible
from slope_case import CASE, write_slope

RELEASE = "x = 600060.0, y = 4999980.0"
VOLUME = "volume = 'fixed', volume_mean = 0.8"
LINE = "x = 600000.0, 600120.0, y = 4999930.0, 4999930.0"
LIST = "volume = 'list', volumes ="
BARRIER = "&barrier name = 'net', height = 3, class = 2,"
#: Replacements in a case: new text, old text, location, the pair of numbers and the number meant.
COMMAS = {
    "line": (LINE, "x = 600000,5 600120,5 y = 4999930,5 4999930,5", "line x", "600000,5"),
    "one": (LINE, "x = 600000,5 600120 y = 4999930 4999930", "line x", "600000,5"),
    "odd": (LINE, "x = 600000,600120,5 y = 4999930.0, 4999930.0", "line x", "600120,5"),
    "y": (LINE, "x = 600000, 600120, y = 4999930,5, 4999930", "line y", "4999930,5"),
    "no blanks": (LINE, "x = 600000,5,600120,25 y = 1,2,3,4", "line x", "600000,5"),
    "lines": (LINE, "x = 600000,5\n600120,5 y = 1 2", "line x", "600000,5"),
    "barrier": ("&line", f"{BARRIER} x = 600000,5 600120,5 y = 1 2 3 4 /\n&line",
                "barrier x", "600000,5"),
    "dam": ("&line", "&dam height = 4, x = 1 2, y = 4999930,5 4999930,5 /\n&line",
            "dam y", "4999930,5"),
    "points": (RELEASE, "x = 600060,5 600061,5 y = 4999980,5 4999981,5", "release x", "600060,5"),
    "point": (RELEASE, "x = 600060,5 y = 4999980,5", "release x", "600060,5"),
    "half": (RELEASE, "x = 600060,5 y = 4999980.5", "release x", "600060,5"),
    "volumes": (VOLUME, f"{LIST} 0,5 1,5", "boulder volumes", "0,5"),
    "volume": (VOLUME, f"{LIST} 1,5", "boulder volumes", "1,5"),
    "mean": (VOLUME, "volume_mean = 0,8", "boulder volume_mean", "0,8"),
    "shares": (VOLUME, f"{VOLUME}, block_shape_share = 0,5 0,5",
               "boulder block_shape_share", "0,5"),
    "axes": (VOLUME, f"{LIST} 1.5, block_axes = 1,2 0,9 0,8", "boulder block_axes", "1,2"),
    "density": ("density = 2800.0", "density = 2800,5", "boulder density", "2800,5"),
    "velocity": ("drop_height = 2.0", "velocity = 1,5 0", "release velocity", "1,5"),
    "rocks": ("zones = 'zones.tif', table = 'zones.csv'",
              "method = 'A', uniform_rg = 0,1, 0,05, 0,02", "surface uniform_rg", "0,1"),
    "stems": ("&line", "&forest uniform_stems = 1, turn_frontal = 22,5 45 8,5 /\n&line",
              "forest turn_frontal", "22,5"),
    "thresholds": ("&line", "&hazard thresholds = 30,5, 300,5 /\n&line",
                   "hazard thresholds", "30,5"),
    "falling": ("&line", "&hazard thresholds = 30,5 /\n&line", "hazard thresholds", "30,5"),
    "periods": ("&line", "&hazard return_periods = 10,5 30,5 /\n&line",
                "hazard return_periods", "10,5"),
    "factor": ("&line", "&hazard frequency_factor = 0,5 /\n&line",
               "hazard frequency_factor", "0,5"),
    "factors": ("&line", "&hazard frequency_factor = 0,5 2 /\n&line",
                "hazard frequency_factor", "0,5"),
    "variant": ("&line", "&variant name = 'v', boulder_volumes = 1,5 /\n&line",
                "variant boulder_volumes", "1,5"),
    "scenario": ("&line", "&scenario name = 's', frequency = 1, volumes = 1,5 2,5 /\n&line",
                 "scenario volumes", "1,5"),
}  # fmt: skip


@pytest.mark.parametrize("what", every_third(COMMAS))
def test_a_decimal_comma_is_refused_with_the_point(what, batch, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_slope()
    old, new, key, pair = COMMAS[what]
    assert old in CASE
    Path("case.nml").write_text(CASE.replace(old, new, 1))
    point = pair.replace(",", ".")
    words = (
        f"case.nml: &{key}: {pair} is two numbers: write {point}, or put a blank after each comma "
        "of a list"
    )
    both = r"(\nrockfall: .* is two numbers: .*)?"  # also for y, if x and y have commas
    refuses(["run", "case.nml", "-o", "r.nc"], words.replace(".", r"\.") + both, capsys)
    done = batch("case.nml", cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.splitlines()[0] == f"rockfall-batch: {words}"


def test_lists_without_blanks_stay_lists(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_slope()
    text = CASE.replace(LINE, "x=600000,600060,600120,y=4999930,4999940,4999930")
    text = text.replace(VOLUME, f"{LIST} 1,2,3")
    Path("case.nml").write_text(text.replace("&output", "&hazard thresholds = 30,300 /\n&output"))
    case = rockfall.read_case("case.nml")
    assert case.line[0]["x"] == [600000.0, 600060.0, 600120.0]
    assert case.line[0]["y"] == [4999930.0, 4999940.0, 4999930.0]
    assert case.boulder["volumes"] == [1.0, 2.0, 3.0]
    assert case.hazard["thresholds"] == [30.0, 300.0]


@pytest.mark.parametrize(
    ("far", "off"), [(600120.0, ""), (600500.0, ""), (601000.0, "0.88"), (650120.0, "50")]
)
def test_a_vertex_off_the_terrain_is_remarked(far, off, tmp_path, monkeypatch):
    """The terrain is 120 m by 150 m: vertices may be up to 450 m beyond its edge without a
    remark."""
    monkeypatch.chdir(tmp_path)
    write_slope()
    Path("case.nml").write_text(CASE.replace("600120.0", str(far)))
    found = implausible(read_scene(rockfall.read_case("case.nml")))
    said = (
        f"case.nml: &line name = 'L': vertex 2 lies {off} km off the terrain: check its coordinates"
    )
    assert [line for line in found if "vertex" in line] == ([said] if off else [])


def test_a_vertex_far_off_the_terrain_is_refused(batch, tmp_path, monkeypatch, capsys):
    """Blanks after decimal commas split the numbers, so that a vertex is more than 100 km off."""
    monkeypatch.chdir(tmp_path)
    write_slope()
    prepare(rockfall.read_case("case.nml"), tmp_path / "ready")
    text = CASE.replace(LINE, "x = 600000, 5, 600120, 5 y = 4999930, 5, 4999930, 5")
    words = (
        "case.nml: &line name = 'L': vertex 2 is more than 100 km from the terrain: use decimal "
        "points, and coordinates in the CRS of the terrain"
    )
    Path("case.nml").write_text(text)
    Path("ready/case.nml").write_text(text)
    refuses(["run", "case.nml", "-o", "r.nc"], words, capsys)
    refused_in_one_line(batch("ready/case.nml", cwd=tmp_path), f"ready/{words}")
