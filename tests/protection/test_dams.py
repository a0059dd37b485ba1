# SPDX-License-Identifier: BSD-3-Clause
"""Dams are reported as built; cells too coarse for a dam cause a warning or a refusal."""

import json
import warnings

import numpy as np
import pytest
from affine import Affine

import rockfall
from made import make_raster, refused
from programs import run_program
from rockfall.cli import main
from rockfall.html_report.page import ReportInputs, report
from rockfall.language import speaking
from rockfall.protection.recorded import dams_of
from rockfall.result.crossings import at_lines
from rockfall.scene.prepare import prepare
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible
from rockfall.table import as_text
from rockfall.tables.run import dam_tables
from rockfall.terrain.dams import COARSE, FINE
from scenes import make_case, sets

GRADIENT = 0.5
WIDE, HIGH = 160.0, 240.0  # extents of the terrain in x and y [m]
DAM = {
    "x": [10.0, 150.0], "y": [63.0, 67.0], "height": 4.0, "crest_width": 2.0, "slope": 55.0,
}  # fmt: skip


def plane(folder, cell):
    """South-facing slope with a given cell size; source near the top, line near the foot."""
    ny, nx = round(HIGH / cell), round(WIDE / cell)
    z = 500.0 + GRADIENT * cell * (np.arange(ny)[::-1, None] + 0.5) + np.zeros((ny, nx))
    make_raster(folder / "dem.tif", z, Affine(cell, 0, 0, 0, -cell, HIGH), crs="EPSG:32632")
    return make_case(
        folder, *sets(), terrain={"dem": "dem.tif"}, case={"boulders": 600},
        release={"x": [80.0], "y": [200.0]},
        line=[{"name": "road", "x": [3.0, 157.0], "y": [40.0, 40.0]}],
    )  # fmt: skip


def shape_of(case):
    (shape,) = read_scene(case).dams
    return shape


def test_on_fine_cells_it_is_as_requested(tmp_path):
    shape = shape_of(plane(tmp_path, 0.5).replace(dam=[DAM]))
    assert shape.length == pytest.approx(140.06, abs=0.5)
    assert (shape.height, shape.height_min) == pytest.approx((4.0, 3.9), abs=0.15)
    assert shape.slope == pytest.approx(55.0, abs=2.0)
    assert 2.0 <= shape.crest_width < 2.6
    low, high = (500.0 + GRADIENT * y + 4.0 for y in DAM["y"])
    assert (shape.crest_min, shape.crest_max) == pytest.approx((low, high), abs=0.4)
    # uphill from the edge of the crest: 4 - tan(55) s = 0.5 (1 + s)
    assert shape.face == pytest.approx((4 - 0.5) / (np.tan(np.radians(55)) + 0.5), abs=0.1)
    assert shape.face_cells == shape.face / 0.5
    assert shape.requested == (4.0, 2.0, 55.0)


def test_on_coarse_cells_it_is_lower_and_flatter(tmp_path):
    coarse = plane(tmp_path, 5.0).replace(dam=[DAM | {"allow_coarse": True}])
    shape = shape_of(coarse)
    assert shape.height_min < 3.0 and shape.slope < 35.0 and shape.face_cells < 0.5


def test_more_boulders_pass_on_coarse_cells(tmp_path):
    """The plane is the same for all cell sizes, and only the dam differs."""
    passed = {}
    for cell in (5.0, 0.5):
        case = plane(tmp_path, cell)
        for dam in ([], [DAM | {"allow_coarse": True}]):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result = rockfall.run(case.replace(dam=dam))
            passed[cell, len(dam)] = np.isfinite(at_lines(result)["line_time"].values).mean()
    left = {cell: passed[cell, 1] / passed[cell, 0] for cell in (5.0, 0.5)}
    assert left[5.0] > 1.5 * left[0.5]


def test_too_coarse_is_refused_unless_allowed(tmp_path):
    case = plane(tmp_path, 2.0).replace(dam=[DAM])
    with refused(
        "case: &dam height = 4, slope = 55: its face is 0.91 cells wide: "
        "resample to 0.45 m, raise it to 9 m, or give allow_coarse = .true."
    ):
        read_scene(case)
    allowed = case.replace(dam=[DAM | {"allow_coarse": True}])
    low, high = (
        shape_of(case.replace(dam=[DAM | {"allow_coarse": True, "height": height}]))
        for height in (8.0, 9.0)
    )
    assert low.face_cells < COARSE <= high.face_cells
    assert shape_of(allowed).face_cells < COARSE
    assert (
        "its face is only 0.91 cells wide (1.8 m, cells of 2 m), fewer than 4"
        in implausible(read_scene(allowed))[0]
    )


@pytest.mark.parametrize(("keys", "message"), [
    ({"crest_width": 200.0}, "case: &dam crest_width = 200.0: must be 0 to 100 [m]"),
    ({"crest_width": 101.0}, "case: &dam crest_width = 101.0: must be 0 to 100 [m]"),
    ({"crest_width": 30.0}, "case: &dam crest_width = 30: the crest reaches into the slope above, "
     "with a face of 0 m: make it narrower"),
    ({"crest_width": 9.0, "slope": 70.0}, "case: &dam crest_width = 9: the crest reaches into the "
     "slope above, with a face of 0.54 m: make it narrower"),
])  # fmt: skip
def test_crests_too_wide_are_refused_as_such(tmp_path, keys, message):
    with refused(message):
        read_scene(plane(tmp_path, 2.0).replace(dam=[DAM | keys]))


def test_cells_of_the_size_that_is_named_give_no_warning(tmp_path):
    scene = read_scene(plane(tmp_path, 0.4).replace(dam=[DAM]))
    assert scene.dams[0].face_cells > FINE and implausible(scene) == []


@pytest.mark.all
def test_check_run_report_shards_and_the_program_tell_the_same(
    tmp_path, capsys, monkeypatch, blank_figures
):
    monkeypatch.chdir(tmp_path)
    case = plane(tmp_path, 0.8).replace(dam=[DAM], case={"boulders": 40, "threads": 1})
    (tmp_path / "case.nml").write_text(case.text())
    assert main(["check", "case.nml"]) == 0
    page, checked = capsys.readouterr()
    assert main(["run", "case.nml", "-o", "a.nc"]) == 0
    printed, warned = capsys.readouterr()
    (shown,) = dam_tables(dams_of(rockfall.read_result("a.nc")))
    assert as_text(shown) in printed and as_text(shown) in page
    assert [*shown.texts()] == [["1", "140", "4.0 (4.0)\n4 requested", "52\n55 requested", "2.3",
                                 "535.5 to 537.5", "2.0\n2 requested"]]  # fmt: skip
    assert warned.splitlines()[0] == checked.splitlines()[0]
    result = rockfall.read_result("a.nc")
    told = json.loads(result.attrs["input_warnings"])
    assert [
        f"rockfall: warning: case.nml: {where}: {text}" for where, text, _ in told
    ] == checked.splitlines()
    (shape,) = dams_of(result)
    assert shape.face_cells == pytest.approx(shape_of(case).face_cells, abs=1e-3)
    parts = [rockfall.run(rockfall.read_case("case.nml"), shard=(k, 2)) for k in (1, 2)]
    prepare(rockfall.read_case("case.nml"), "ready")
    assert run_program("case.nml", "--output", "b.nc", cwd="ready").returncode == 0
    for other in (rockfall.merge(parts), rockfall.merge([tmp_path / "ready" / "b.nc"])):
        for name in ("dams", "input_warnings", "lines_beyond"):
            assert other.attrs[name] == result.attrs[name] != "{}"
    html = report(ReportInputs(result))
    assert "&amp;dam 1, height = 4, slope = 55" in html
    assert "Inputs to check" in html and "fewer than 4, so more boulders may pass" in html
    assert "Dams on the raster" in html and "4 requested" in html
    (about,) = dam_tables(dams_of(result))
    for language in ("de", "fr", "it"):
        with speaking(language):
            (other,) = dam_tables(dams_of(result))
        assert other.caption != about.caption and not {*other.head} & {*about.head}
        assert "requested" not in other.rows[0][2]
