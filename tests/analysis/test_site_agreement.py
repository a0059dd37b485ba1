# SPDX-License-Identifier: BSD-3-Clause
"""`&observed`: a run reports whether it agrees with its site."""

import html
from pathlib import Path

import numpy as np
import pytest

import rockfall
from rockfall.analysis.observed.compare import compare, disagreement
from rockfall.analysis.validity.site import angle_remarks
from rockfall.cli import main
from rockfall.html_report.summary import angle
from rockfall.result.variables import STATUS


@pytest.fixture
def seen(place):
    case = rockfall.read_case("case.nml").replace(case={"boulders": 1000})
    return case, rockfall.run(case)


def angles_of(result):
    fall = result["start_z"] - result["stop_z"]
    return np.degrees(np.arctan2(fall.values, result["plan_distance"].values))


def remark_on(result, case, observed):
    return list(angle_remarks(result, case.replace(observed={"energy_line_angle": observed})))


def test_the_angle_of_one_percent_is_set_beside_the_lowest_observed(seen):
    case, result = seen
    angle = float(np.quantile(angles_of(result), 0.01))
    for observed, key, is_warning in (
        (angle + 6, "model.angle_flatter", True),
        (angle, "model.angle_as_observed", False),
        (angle - 6, "model.angle_steeper", True),
    ):
        (remark,) = remark_on(result, case, observed)
        assert (remark.text.key, remark.is_warning) == (key, is_warning)
        assert f"{angle:.1f}°" in remark.text
    assert not list(angle_remarks(result, case))
    few = result.isel(boulder=slice(0, 999))
    assert not remark_on(few, case, angle)


def of_angles(angles, moving=0, sources=1):
    """Values of boulders with given energy-line angles, divided equally among the sources; the
    first `moving` left the terrain."""
    n = len(angles)
    status = np.where(np.arange(n) < moving, STATUS["left_domain"], STATUS["stopped"])
    at = np.arange(n) * sources // n
    fall = 100 * np.tan(np.radians(angles))
    values = {"start_z": fall, "stop_z": np.zeros(n), "plan_distance": np.full(n, 100.0)}
    return values | {"status": status, "source": at + 1, "start_x": at * 10.0, "start_y": at * 0.0}


def test_sources_that_are_a_sample_make_the_angle_less_certain(place):
    """Twenty sources have angles of 30 to 49 degrees: the angle is certain if they are all sources,
    but not if they are a sample."""
    case = rockfall.read_case("case.nml")
    values = of_angles(np.repeat(30.0 + np.arange(20), 100), sources=20)
    for sources, key in (("all", "model.angle_flatter"), ("sample", "model.angle_as_observed")):
        (remark,) = remark_on(values, case.replace(release={"sources": sources}), 30.5)
        assert remark.text.key == key and "30.0°" in remark.text


def test_boulders_that_left_the_terrain_come_at_least_so_far(place):
    case = rockfall.read_case("case.nml")
    angles = np.r_[np.full(40, 33.0), np.full(1960, 40.0)]
    (remark,) = remark_on(of_angles(angles), case, 31.0)
    assert remark.text.key == "model.angle_steeper"
    few = remark_on(of_angles(angles, moving=5), case, 31.0)
    assert [remark.text.key for remark in few] == ["model.angle_steeper", "model.angle_left"]
    assert "5 of 2,000 boulders" in few[1].text and few[1].is_warning
    (unknown,) = remark_on(of_angles(angles, moving=40), case, 31.0)
    assert unknown.text.key == "model.angle_open" and unknown.is_warning
    assert "40 of 2,000 boulders" in unknown.text
    flatter, _ = remark_on(of_angles(angles, moving=40), case, 34.0)
    assert flatter.text.key == "model.angle_flatter"


def test_a_run_agrees_with_its_own_boulders_and_not_with_others(seen):
    _, result = seen
    distances = result["plan_distance"].values
    for factor, key in ((1.0, "compare.agrees"), (1.5, "compare.disagrees")):
        rows = "\n".join(f"{factor * value:.3f}" for value in distances[::7])
        Path("seen.csv").write_text(f"distance\n{rows}\n")
        text = disagreement(compare(result, "seen.csv"))
        assert text.key == key and text.values["tested"] > 1


@pytest.mark.all
def test_commands_take_the_files_of_the_case(seen, capsys):
    _, result = seen
    rows = "\n".join(f"{2 * value:.3f}" for value in result["plan_distance"].values[:200])
    Path("seen.csv").write_text(f"distance\n{rows}\n")
    text = Path("case.nml").read_text() + "\n&observed files = 'seen.csv' /\n"
    Path("seen.nml").write_text(text)
    assert main(["run", "seen.nml", "-o", "out.nc"]) == 0
    assert "differ from &observed" in capsys.readouterr().out
    assert main(["compare", "out.nc"]) == 0
    named = capsys.readouterr().out
    assert main(["compare", "out.nc", "seen.csv"]) == 0
    assert capsys.readouterr().out == named
    Path("seen.csv").unlink()
    assert main(["compare", "out.nc"]) == 2
    assert main(["run", "seen.nml", "-o", "other.nc"]) == 2
    assert "seen.nml: &observed files = 'seen.csv': no such file" in capsys.readouterr().err
    assert not Path("other.nc").exists()
    assert main(["back", "case.nml"]) == 2
    assert "or &observed files in the case" in capsys.readouterr().err


CASE = "\n&observed files = 'seen.csv' /\n"


@pytest.fixture
def left(place):
    """File of a result in the current folder; tests then remove or damage the files of its case."""
    Path("seen.csv").write_text("distance\n12.0\n30.0\n41.0\n")
    by_sets = Path("case.nml").read_text().replace("&impact", "&impact form = 'matrix',")
    Path("seen.nml").write_text(by_sets + CASE)
    assert main(["run", "seen.nml", "-o", "out.nc", "--quiet"]) == 0
    return Path("out.nc")


def front_of(page):
    text = Path(page).read_text(encoding="utf-8")
    return html.unescape(text[text.index("<main>") : text.index('id="signature"')])


def test_what_cannot_be_compared_is_refused_before_the_run(place, capsys):
    for text, fault in (
        ("distance\nfar\n", "seen.csv: line 2: distance"),
        (
            "line,quantity,unit,value\nnowhere,speed,m/s,3\n",
            "line nowhere: is not in the case (lines: L)",
        ),
    ):
        Path("seen.csv").write_text(text)
        Path("seen.nml").write_text(Path("case.nml").read_text() + CASE)
        for command in (["check", "seen.nml"], ["run", "seen.nml", "-o", "out.nc"]):
            assert main(command) == 2
            assert fault in capsys.readouterr().err
        assert not Path("out.nc").exists()


def test_a_run_that_keeps_nothing_to_compare_gives_the_reason(place, capsys):
    Path("seen.csv").write_text("line,quantity,unit,method,mean\nL,speed,m/s,A,3\n")
    Path("seen.nml").write_text(Path("case.nml").read_text() + CASE)
    assert main(["run", "seen.nml", "-o", "out.nc"]) == 0
    assert ": nothing to compare: row of method A" in capsys.readouterr().out


@pytest.mark.all
@pytest.mark.parametrize("broken", ["seen.csv", "zones.csv"])
@pytest.mark.parametrize("fault", ["missing", "unreadable"])
def test_files_of_the_case_that_cannot_be_read_are_listed(
    left, blank_figures, capsys, broken, fault
):
    part = {
        "seen.csv": "the comparison with &observed",
        "zones.csv": "the map and table of the grounds",
    }[broken]
    assert main(["report", "out.nc"]) == 0
    assert part not in capsys.readouterr().err + front_of("out.html")
    if fault == "missing":
        Path(broken).unlink()
    else:
        Path(broken).write_text("nothing of this kind\n")
    assert main(["report", "out.nc", "-o", "less.html"]) == 0
    (line,) = [line for line in capsys.readouterr().err.splitlines() if part in line]
    assert line.startswith("rockfall: warning: not shown: ") and broken in line
    assert part in front_of("less.html") and broken in front_of("less.html")


@pytest.mark.all
def test_figures_say_what_they_lack(left, blank_figures, capsys):
    Path("sets.nml").unlink()
    Path("seen.csv").unlink()
    assert main(["figures", "out.nc", "drawn"]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if "not shown: " in line]
    assert ["sets.nml" in line for line in lines] == [False, True]
    assert not Path("drawn/impact_set.png").exists()


def test_pages_of_a_hazard_say_that_the_terrain_is_missing(place, capsys):
    case = rockfall.read_case("case.nml").replace(scenario=[{"name": "one", "return_period": 10.0}])
    rockfall.hazard(case).to_netcdf("hazard.nc")
    Path("dem.tif").unlink()
    assert main(["report", "hazard.nc", "-o", "page.html"]) == 0
    assert "Figures have no relief: give the DEM of the run" in capsys.readouterr().err


def test_pages_say_that_angles_of_boulders_in_motion_are_upper_limits(seen):
    _, result = seen
    fall, distance = np.full(4, 100.0), np.array([100.0, 200.0, 300.0, 400.0])
    own = result.isel(boulder=slice(4)).assign(
        start_z=("boulder", fall), stop_z=("boulder", 0 * fall), plan_distance=("boulder", distance)
    )
    for status, said in (("stopped", []), ("hit_nodata", ["4 of 4 boulders (100 %) were still"])):
        flags = own["status"].copy(data=np.full(4, STATUS[status]))
        first, *others = angle(own.assign(status=flags))
        assert "minimum 14" in first
        assert [text[: len(start)] for text, start in zip(others, said, strict=True)] == said
