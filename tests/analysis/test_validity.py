# SPDX-License-Identifier: BSD-3-Clause
"""Limits of the model are reported before a run and after it: the rebound models used, forests that
are not validated, and conditions beyond the data of the model."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crossed import crossed
from rockfall.analysis.validity.ends import end_remarks
from rockfall.analysis.validity.extrapolation import extrapolations, faster_than_observed
from rockfall.analysis.validity.obstacles import forest_remarks, forest_text
from rockfall.analysis.validity.rebounds import set_remarks, table_remarks
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.analysis.validity.warnings import in_order, joined_warnings, joint_warnings
from rockfall.evidence import only
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.grounds.impact_tables import USUAL_WEIGHT, open_table, plane_files, save_table
from rockfall.html_report.validity import warnings
from rockfall.language import LANGUAGES, packed, say, speaking, translated, unpacked
from rockfall.quantities import part_of_boulders, part_of_rebounds
from rockfall.result.crossings import at_lines, has_crossed
from rockfall.result.variables import STATUS
from rockfall.scene.read import read_scene
from rockfall.simulation.simulate import run_scene
from rockfall.text.preview import preview
from rockfall.text.summary import summary
from scenes import grid, make_case, rough, sets

POINT = {"x": 1.0, "y": 1.0}


#: Values that make the text of each message long.
TYPICAL = {
    "mean": 2.345, "most": 20, "limit": 0.8, "bare": 95.0, "forest": 34.0, "bare_here": 98,
    "forest_here": 48, "model": "vaujany-observed", "speed": 13,
    "energy": 26, "run_out": 72, "mean_low": -7, "mean_high": 3, "std_low": -17, "std_high": 24,
    "radius": 2.25, "line": "road", "slow": 2.0, "distance": 10.0,
    "names": "vaujany-observed", "lines": "road (5, and 12 that might have)", "least": 0.01,
    "grounds": "talus, meadow, vegetated-soil", "fraction": "1.2 %",
}  # fmt: skip
WARNINGS = (
    "breakage", "broke", "cut_short", "faster", "forest", "impact_limit", "large_blocks", "logs",
    "lost", "max_fragments", "not_kept", "observed_set", "outside_angle", "outside_both",
    "outside_range", "outside_speed", "outside_speed_both", "outside_table", "outside_tables",
    "outside_thrown", "paper_set", "rolling", "spheres_set", "stayed", "tables", "fines",
)  # fmt: skip


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("name", WARNINGS)
def test_a_warning_has_at_most_25_words(name, language):
    with speaking(language):
        counts = {"part": part_of_boulders(8797, 20000)}
        counts |= dict.fromkeys(("followed", "drawn"), part_of_rebounds(8797, 20000))
        table = {"name": "rocky-slope", "low": 1.0, "high": 8.0}
        text = say(f"model.{name}", **TYPICAL | counts | table)
    numbers = re.sub(r"(?<=\d)[\u202f\xa0 ](?=\d{3})", "", text)
    words = [word for word in numbers.replace("\u202f", " ").split() if re.search(r"\w|%", word)]
    assert len(words) <= 25 and ";" not in text, (len(words), text)


def values(rebounds=1000, outside=(0, 0, 0), speed=(1.0,) * 100):
    """Values of boulders that descended 100 m over 100 m, with given maximum speeds [m/s] and
    numbers of rebounds outside the ranges."""
    names = ("range", "speed", "angle")
    counts = {f"rebounds_out_of_{name}": n for name, n in zip(names, outside, strict=True)}
    flat = np.full(len(speed), 100.0)
    return {
        "rebounds": rebounds, **counts, "start_z": 2 * flat, "stop_z": flat, "plan_distance": flat,
        "speed_max": np.array(speed),
    }  # fmt: skip


@pytest.mark.parametrize("what", [0, 1, 2])
def test_a_fifth_of_the_rebounds_is_no_warning_yet(what):
    for outside, said in ((0, []), (200, [False]), (201, [True])):
        counts = np.roll([outside, 0, 0], what)
        found = list(extrapolations(values(outside=counts)))
        assert [one.is_warning for one in found] == said
        assert all(one.text.startswith(f"{outside} of 1,000 rebounds") for one in found)
    words = ("R_b/R_m outside 0.5 to 5.5", "speed_range", "angle_range")
    assert words[what] in found[0].text


@pytest.mark.parametrize(
    ("grounds", "words"),
    [
        ({"rocks.nc": "ratio_table"}, "impact tables: the nearest ratio was used"),
        ({"rocky-slope": "ratio_table"}, "impact table (rocky-slope: 1 to "),
        ({"a": "impact_sets", "rocky-slope": "ratio_table"}, "impact set or impact table: "),
        ({"a": "impact_sets", "meadow": "impact_table"}, "outside 0.5 to 5.5"),
    ],
)
def test_ratios_are_said_of_what_made_the_rebounds(grounds, words):
    of_grounds = {
        "ground": list(grounds), "ground_model": [*grounds.values()],
        "rebounds_by_ground": [1000 // len(grounds)] * len(grounds),
    }  # fmt: skip
    (found,) = extrapolations(values(outside=(300, 0, 0)) | of_grounds)
    assert words in found.text and found.is_warning
    for language in "de", "fr", "it":
        with speaking(language):
            said = translated(found.text)
        assert "300" in said and "rebounds" not in said and "nearest" not in said


@pytest.mark.parametrize(("sets", "is_warning"), [("bourrier2009", False), ("own.nml", True)])
def test_ratios_that_a_set_was_fitted_with_are_no_warning(sets, is_warning):
    (found,) = extrapolations(values(outside=(300, 0, 0)), sets)
    assert found.is_warning == is_warning and "outside 0.5 to 5.5" in found.text
    assert ("as in their fit" in found.text) != is_warning


def test_counts_of_each_boulder_are_summed():
    each = values(rebounds=np.full(100, 10), outside=np.full((3, 100), 3))
    assert list(extrapolations(each)) == list(extrapolations(values(outside=(300,) * 3)))


def test_a_twentieth_of_the_boulders_may_be_faster_than_observed():
    slow, fast = 0.8 * 45 - 1e-9, 0.8 * 45 + 1e-9
    assert list(extrapolations(values(speed=[slow] * 95 + [fast] * 5))) == []
    (found,) = extrapolations(values(speed=[slow] * 94 + [fast] * 6))
    assert found.is_warning and found.fraction == 0.06
    assert "6 of 100 boulders (6.0 %) exceeded 0.8 m/s per degree" in found.text
    assert "speeds err high (safe side)" in found.text


def test_speeds_are_judged_by_the_slope_from_release_to_end():
    way = {
        "start_z": [100.0, 100.0, 100.0, 100.0, 100.0],
        "stop_z": [0.0, 0.0, 100.0, 110.0, 90.0],  # falls, slides, stays level, climbs, drops
        "plan_distance": [100 / np.tan(np.radians(30)), 1e4, 50.0, 50.0, 0.0],
        "speed_max": [24.1, 0.4, 30.0, 30.0, 71.0],
    }
    assert faster_than_observed(way).tolist() == [True, False, False, False, False]


def test_nothing_has_nothing_beyond():
    assert list(extrapolations(values(rebounds=0, speed=[]))) == []


# ---- ends without information on a slope

LINE = {"name": "road", "x": [0.0, 100.0], "y": [50.0, 50.0]}


def ends(status, count=2, has_crossed=False, stop=(50.0, 80.0), fall=50.0):
    """Values of 100 boulders from (50, 100): the first `count` have the given status, the others
    are absorbed below the line."""
    is_cut = np.arange(100) < count
    x, y = (np.where(is_cut, cut, other) for cut, other in zip(stop, (50.0, 10.0), strict=True))
    return {
        "status": np.where(is_cut, STATUS[status], STATUS["absorbed"]),
        "start_x": np.full(100, 50.0), "start_y": np.full(100, 100.0), "stop_x": x, "stop_y": y,
        "start_z": np.full(100, fall), "stop_z": np.zeros(100),
        "plan_distance": np.hypot(x - 50.0, y - 100.0),
    } | crossings(~is_cut | has_crossed)  # fmt: skip


def crossings(*crosses):
    number = np.arange(1, crosses[0].size + 1)
    made = crossed(number, [*map(str, range(len(crosses)))], speed=np.where(crosses, 1.0, np.nan))
    return {"boulder": number} | {name: of for name, (_, of) in made.items()}


def end_texts(folder, values, line=LINE):
    case = make_case(folder, *sets(), release=POINT, line=[line] if line else [])
    found = [*end_remarks(values, case)]
    assert all(one.is_warning for one in found)
    return [one.text for one in found]


@pytest.mark.parametrize("status", ["left_domain", "hit_nodata"])
@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({}, True),
        ({"count": 1}, False),  # 1 % is allowed
        ({"has_crossed": True, "stop": (50.0, 5.0)}, False),  # the boulder has passed the line
        ({"stop": (20.0, 90.0)}, True),  # over the side, above the line
    ],
)
def test_who_leaves_the_terrain_before_a_line_is_said_to_lower_fractions(
    tmp_path, status, how, said
):
    texts = end_texts(tmp_path, ends(status, **how))
    words = ["2 of 100 boulders (2.0 %) left the known terrain"]
    assert [text.partition(" before")[0] for text in texts] == words * said


def test_a_void_between_two_lines_is_said(tmp_path):
    """Boulders stopped by a void between two lines give a remark, unless they would have passed the
    lower line at its side, or end below it."""
    upper, held = {"name": "upper", "x": [0.0, 100.0], "y": [90.0, 90.0]}, ends("hit_nodata")
    for lower, said in (
        (LINE, True),
        (LINE | {"x": [100.0, 0.0]}, True),
        (LINE | {"x": [0.0, 40.0]}, False),
        (LINE | {"x": [60.0, 100.0]}, False),
        (LINE | {"y": [120.0, 120.0]}, False),
        (LINE | {"x": [50.0, 50.0], "y": [40.0, 60.0]}, False),  # along their path
    ):
        case = make_case(tmp_path, *sets(), release=POINT, line=[upper, lower])
        both = crossings(np.ones(100, bool), has_crossed(held, 0))
        assert bool([*end_remarks(held | both, case)]) == said


@pytest.mark.parametrize("status", ["left_domain", "hit_nodata", "impact_limit"])
@pytest.mark.parametrize(
    ("passed", "cut", "how", "said"),
    [
        (0, 4, {}, True),  # the upper limit for none in 1,000 is 3.8
        (0, 3, {}, False),
        (10, 9, {}, True),  # the upper limit for 10 is 18.3
        (10, 8, {}, False),
        (10, 9, {"stop": (20.0, 90.0)}, False),  # over the side
        (10, 9, {"has_crossed": True}, False),
    ],
)
def test_a_few_who_end_on_their_way_to_a_line_of_few_are_said(
    tmp_path, status, passed, cut, how, said
):
    """Less than 1 % of 1,000 boulders end early, but they are many compared with the 0 or 10 that
    cross the line."""
    rows = {name: np.resize(value, 1000) for name, value in ends(status, cut, **how).items()}
    cuts = np.arange(1000) < cut
    rows["status"] = np.where(cuts, STATUS[status], STATUS["absorbed"])
    for axis, below in ("x", 50.0), ("y", 10.0):
        rows[f"stop_{axis}"] = np.where(cuts, rows[f"stop_{axis}"], below)
    rows |= crossings((np.arange(1000) >= 1000 - passed) | (cuts & ("has_crossed" in how)))
    texts = end_texts(tmp_path, rows)
    words = (
        f"few boulders cross road ({passed}, and {cut} that might have), and others ended earlier"
    )
    assert [text.startswith(words) for text in texts] == [True] * said


def test_without_lines_all_who_leave_the_terrain_are_said(tmp_path):
    values = ends("left_domain", has_crossed=True)
    (text,) = end_texts(tmp_path, values, line=None)
    assert text.startswith(
        "2 of 100 boulders (2.0 %) left the known terrain before reaching a line or stopping"
    )
    for language in "de", "fr", "it":
        with speaking(language):
            assert "2" in translated(text) and "known" not in translated(text)


def test_who_reaches_the_limit_of_contacts_is_said(tmp_path):
    assert end_texts(tmp_path, ends("impact_limit", count=1)) == []
    (text,) = end_texts(tmp_path, ends("impact_limit", has_crossed=True))
    assert text.startswith("2 of 100 boulders (2.0 %) were still moving at the impact limit")


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"count": 21}, True),
        ({"count": 20}, False),
        ({"count": 21, "stop": (50.0, 89.0)}, False),
        ({"count": 21, "fall": 10.1}, False),  # down a wall
    ],
)
def test_who_stays_at_the_source_is_said_to_lower_fractions(tmp_path, how, said):
    how = {"stop": (50.0, 99.0), "fall": 5.0} | how
    texts = end_texts(tmp_path, ends("stopped", **how))
    words = ["21 of 100 boulders (21.0 %) rest within 10 m of their release"]
    assert [text.partition(",")[0] for text in texts] == words * said
    assert end_texts(tmp_path, ends("stopped_by_tree", **how)) == []


def test_of_runs_without_rows_it_is_said_that_no_end_can_be_told(tmp_path):
    none = {name: value[:0] for name, value in ends("hit_nodata").items()}
    none |= crossings(np.zeros(0, bool))
    (text,) = end_texts(tmp_path, none)
    assert "were not kept (kept = 'none'), so some warnings are missing" in text


@pytest.mark.parametrize("is_void", [True, False])
def test_check_and_run_say_that_a_void_ends_boulders(tmp_path, is_void):
    z = rough()
    z[30:34] = np.nan if is_void else z[30:34]  # from y = 230 to 250
    case = make_case(
        tmp_path, *sets(), terrain={}, case={"boulders": 100}, release={"x": 150.0, "y": 380.0},
        line=[{"name": f"at {y:g}", "x": [2.5, 297.5], "y": [y, y]} for y in (300.0, 200.0)],
    )  # fmt: skip
    scene = read_scene(case, dem=z, transform=grid(z))
    for text in preview(scene), summary(run_scene(scene)):
        assert ("left the known terrain before reaching a line or stopping" in text) == is_void


# ---- check, run, report


def test_remarks_are_in_the_order_of_their_grades_and_each_once(tmp_path):
    """Boulders stopped by a void make fractions wrong, and come before mere uncertainties."""
    case = make_case(tmp_path, *sets(), release=POINT, impact={"sets": "laboratory-spheres"})
    lost = ends("hit_nodata", 60)
    found = model_remarks(values(outside=(100, 300, 0)) | lost, case)
    grades = [remark.grade for remark in found]
    assert grades == sorted(grades, key=("stop", "caution", "note").index)
    assert {"stop", "caution", "note"} == {*grades} and len({*found}) == len(found)
    assert [remark.is_warning for remark in found] == [grade != "note" for grade in grades]


def narrow(ratio):
    return " speed_range = 100, 101\n angle_range = 2, 90\n"


@pytest.fixture
def case(tmp_path):
    release = {"x": 150.0, "y": 380.0}
    return make_case(
        tmp_path, *sets(), more=narrow, terrain={}, case={"boulders": 300}, release=release
    )


def scene_of(case):
    z = rough()
    return read_scene(case, dem=z, transform=grid(z))


def test_check_summary_and_report_say_the_same(case, monkeypatch):
    """The pilot run has all boulders of the run, so that all three list the same remarks."""
    monkeypatch.setattr("rockfall.simulation.pilot.PILOT_REBOUNDS", 10**9)
    page = preview(scene_of(case))
    result = run_scene(scene_of(case))
    texts = [text.removesuffix(".") for text in warnings(result)]
    n = int(result.rebounds)
    grades, texts = zip(*(text.split(": ", 1) for text in texts), strict=True)
    assert grades == ("Stop", "Caution", "Caution")
    assert "left the known terrain" in texts[0]
    assert texts[1].startswith(f"{n:,} of {n:,} rebounds (100 %) were slower or faster")
    assert "exceeded 0.8 m/s per degree" in texts[2]
    graded = [*zip(("stop", "caution", "caution"), texts, strict=True)]
    told = [line.strip() for line in page.splitlines()]
    assert [line for line in told if line.startswith(("stop", "caution"))] == [
        f"{grade:13}in a pilot run {text}" for grade, text in graded
    ]
    said = [line.strip() for line in summary(result).splitlines() if ": " in line]
    assert [line for line in said if line.startswith(("stop", "caution"))] == [
        f"{grade}: {text}" for grade, text in graded
    ]
    angle = int(result.rebounds_out_of_angle) / n
    assert 0 < angle < 0.2  # no warning
    assert f"0.0% by R_b/R_m, 100.0% by speed, {angle:.1%} by angle" in page
    assert "sets.nml, fitted on 100 to 101 m/s and 2 to 90 degrees\n" in page


@pytest.mark.parametrize(
    ("grounds", "said"),
    [
        ({}, ["1,000 of 1,000 rebounds (100 %)"]),
        (
            {"laboratory-spheres": "impact_sets", "meadow": "constant"},
            ["250 of 1,000 rebounds (25.0 %)"],
        ),
        ({"rocky-slope": "ratio_table", "meadow": "impact_table"}, []),
        ({"own.nml": "impact_sets", "meadow": "constant"}, []),
    ],
)
def test_sets_of_spheres_are_said_to_err_on_the_unsafe_side(tmp_path, grounds, said):
    counted = {
        "ground": [*grounds], "ground_model": [*grounds.values()],
        "rebounds_by_ground": [250, 750],
    }  # fmt: skip
    case = make_case(tmp_path, *sets(), release=POINT, impact={"sets": "laboratory-spheres"})
    found = [*set_remarks(values() | (counted if grounds else {}), case)]
    known = [
        only("vaujany", "EL2", "speed_mean", "laboratory-spheres"),
        only("vaujany", "EL2", "energy_translational_mean", "laboratory-spheres"),
        only("tschamut", "held-out", "run_out_mean", "laboratory-spheres"),
    ]
    speed, energy, run_out = (round(-row.error) for row in known)
    followed = (
        f" followed laboratory-spheres, from spheres: too low on talus (speeds {speed} %, "
        f"energies {energy} %) and pasture (run-out {run_out} %)"
    )
    assert [one.text for one in found] == [part + followed for part in said]
    assert all(one.is_warning for one in found)


def test_the_set_of_observed_boulders_has_a_remark_of_its_own(tmp_path):
    case = make_case(tmp_path, *sets(), release=POINT, impact={"sets": "vaujany-observed"})
    (found,) = set_remarks(values(), case)
    assert "fitted on talus: on soil" in found.text and found.is_warning
    grounds = {
        "ground": ["vaujany-observed", "laboratory-spheres"], "ground_model": ["impact_sets"] * 2,
        "rebounds_by_ground": [250, 750],
    }  # fmt: skip
    spheres, observed = set_remarks(values() | grounds, case)
    assert spheres.text.startswith("750 of 1,000") and observed.text.startswith("250 of 1,000")


@pytest.mark.parametrize("method", ["A", "B"])
def test_the_set_of_the_paper_is_judged_by_the_method_of_the_case(tmp_path, method):
    sizes = {"A": {"uniform_rg": [0.1, 0.2, 0.3]}, "B": {"uniform_mean_radius": 0.25}}
    case = make_case(
        tmp_path, *sets(), release=POINT, impact={"sets": "bourrier2009"},
        surface={"method": method} | sizes[method],
    )  # fmt: skip
    error = round(-only("vaujany", "EL2", "speed_mean", f"bourrier2009, {method}").error)
    (found,) = set_remarks(values(), case)
    assert found.text.endswith(f"up to {error} % too low")


@pytest.mark.parametrize(
    ("name", "line"), [("rocky-slope", "EL1"), ("talus", "EL2"), ("compact", "EL2"), ("*", "EL2")]
)
def test_tables_are_judged_by_the_worst_of_those_with_evidence(name, line):
    """The remark has the worst errors of the tables with evidence: of talus and meadow always, of
    `rocky-slope` if rebounds use it."""
    grounds = {
        "ground": [name], "ground_model": ["impact_table"], "rebounds_by_ground": [1000],
    }  # fmt: skip
    model = name if name == "rocky-slope" else "talus"
    mean = round(only("vaujany", "EL2", "passing_height_mean", "talus").error)
    quantity = "speed_std" if line == "EL1" else "passing_height_std"
    narrow = round(only("vaujany", line, quantity, model).error)
    wide = round(only("tschamut", "held-out", "run_out_std", "meadow").error)
    (found,) = table_remarks(values() | grounds)
    assert mean < 0 and narrow < 0 < wide  # a negative error is on the unsafe side
    assert f"means {mean} to +" in found.text
    assert found.text.endswith(f"deviations {narrow} to +{wide} %")


@pytest.mark.parametrize("name", [*shipped_sets()])
def test_of_every_shipped_set_is_warned_what_it_is_not_good_for(tmp_path, name):
    """Each set has one warning, because each gives values that are too low at some place."""
    case = make_case(tmp_path, *sets(), release=POINT, impact={"sets": name})
    assert [one.is_warning for one in set_remarks(values(), case)] == [True]


def test_nothing_is_said_of_sets_without_rebounds(tmp_path):
    case = make_case(tmp_path, *sets(), release=POINT, impact={"sets": "laboratory-spheres"})
    assert not [*set_remarks(values(rebounds=0), case)]


def test_of_own_sets_nothing_is_said(tmp_path):
    assert not [*set_remarks(values(), make_case(tmp_path, *sets(), release=POINT))]


@pytest.mark.parametrize(("angle", "said"), [(30.0, True), (90.0, False)])
def test_who_rolls_past_a_line_is_said_to_lower_its_quantiles(tmp_path, angle, said):
    """On a plane steeper than the rest angle no boulder stops, and a remark lists its line. There
    is no remark if boulders can rest anywhere, and none for a line on flat ground."""
    y = np.mgrid[79:-1:-1, 0:40][0] * 5.0
    z = np.maximum(0.65 * (y - 100.0), 0.0)  # 33 degrees, then level
    case = make_case(
        tmp_path, *sets(), terrain={}, case={"boulders": 100},
        impact={"rest_angle": angle, "ratio": "nearest"},
        release={"x": 100.0, "y": 380.0}, output={"rebounds": False},
        line=[{"name": name, "x": [2.5, 197.5], "y": [at, at]}
              for name, at in (("slope", 350.0), ("flat", 97.0))],
    )  # fmt: skip
    result = run_scene(read_scene(case, dem=z, transform=grid(z)))
    texts = [one.text for one in model_remarks(result, case)]
    rolling = [text for text in texts if "roll slower than" in text]
    assert np.isfinite(at_lines(result)["line_speed"].values).any(axis=1).all()
    assert [text.partition(":")[0] for text in rolling] == ["slope"] * said


def test_who_rolls_on_smooth_ground_is_said_to_lower_quantiles(tmp_path):
    """A meadow of 33 degrees is steeper than its rest angle, so that boulders roll on."""
    y = np.mgrid[79:-1:-1, 0:40][0] * 5.0
    case = make_case(
        tmp_path, *sets(), terrain={}, case={"boulders": 100},
        surface={"ground": "constant_meadow"},
        release={"x": 100.0, "y": 380.0, "drop_height": 0.001}, output={"rebounds": False},
        line=[{"name": "slope", "x": [2.5, 197.5], "y": [375.0, 375.0]}],
    )  # fmt: skip
    z = 0.65 * y
    result = run_scene(read_scene(case, dem=z, transform=grid(z)))
    assert np.isfinite(at_lines(result)["line_speed"].values).all()
    assert any("roll slower than" in one.text for one in model_remarks(result, case))


# ---- rebound models


def on_grounds(folder, surface, **groups):
    """Case and result on given grounds; the sets were fitted to nearly all conditions that
    occur."""
    fitted = " speed_range = 0, 1000\n angle_range = 0, 90\n"
    case = make_case(
        folder, *sets(), more=lambda _: fitted, terrain={}, case={"boulders": 60},
        release={"x": 150.0, "y": 380.0}, surface={"uniform_mean_radius": 0.25} | surface, **groups,
    )  # fmt: skip
    return case, run_scene(scene_of(case))


def remarks(case, result):
    return [one.text for one in model_remarks(result, case) if one.is_warning]


def test_classical_rebounds_are_named_with_what_they_are_worth(tmp_path):
    case, result = on_grounds(tmp_path, {"ground": "soil_4"})
    text, *more = remarks(case, result)
    n = int(result.rebounds)
    assert text.startswith(
        f"{n:,} of {n:,} rebounds (100 %) followed classical grounds (soil_4 (rockyfor3d) 100 %) "
        "with unconfirmed coefficients: without calibration at the site, speeds and energies may "
        "be too low"
    )
    assert more == []  # no rebound by impact sets that could be outside their range
    page = preview(scene_of(case))
    assert f"caution      in a pilot run {text}" in page
    assert "sets.nml, not used by any rebound of a pilot run" in page
    assert "\n  rebounds " not in page  # sets only: nothing to report
    assert f"  caution: {text}\n" in summary(result)


def test_grounds_of_the_users_own_are_not_called_quoted(tmp_path):
    rows = "name,model,r_n,r_t,source\nmine,constant,0.4,0.8,fitted in 2024\n"
    (tmp_path / "mine.csv").write_text(rows)
    text, *_ = remarks(*on_grounds(tmp_path, {"ground": "mine", "ground_table": "mine.csv"}))
    assert "(mine (constant) 100 %) with the user's coefficients: without calib" in text


def test_each_ground_has_its_fraction_and_what_absorbs_has_none(tmp_path):
    """Boulders pass ground with impact sets, then soil 4, and stop on a lake."""
    row = np.arange(80)[:, None] + np.zeros((1, 60), int)
    ids = np.ma.masked_less(np.select([row < 25, row < 60], [-1, 4], 0), 0)
    case = make_case(
        tmp_path, *sets(), terrain={}, case={"boulders": 200}, release={"x": 150.0, "y": 380.0},
        surface={"uniform_mean_radius": 0.25, "ground_map": "ids"},
    )  # fmt: skip
    z = rough()
    scene = read_scene(case, dem=z, transform=grid(z), ground_map=ids)
    result = run_scene(scene)
    text, *_ = remarks(scene.case, result)
    counts = dict(zip(result.ground.values, result.rebounds_by_ground.values, strict=True))
    n, total = counts["soil_4"], sum(counts.values())
    assert 0 < n < total and counts["sets.nml"] > 0
    assert text.startswith(f"{n:,} of {total:,} rebounds ({100 * n / total:.1f} %) followed")
    assert f"grounds (soil_4 (rockyfor3d) {100 * n / total:.1f} %) with" in text


def test_impact_sets_alone_have_nothing_said_of_grounds(tmp_path):
    assert not any("classical" in one for one in remarks(*on_grounds(tmp_path, {})))


# ---- forest


STAND = {"uniform_stems": 300.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 9.0,
         "uniform_conifers": 60.0}  # fmt: skip


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("table", "volume", "said"),
    [
        ("own.nc", 60.0, True), ("own.nc", 40.0, False), ("rocky-slope", 60.0, False),
        ("in-proportion.nc", 60.0, False),
    ],
)  # fmt: skip
def test_boulders_larger_than_the_blocks_thrown_are_said_to_err_low(
    tmp_path, tables, table, volume, said
):
    """There is no remark if strength is proportional to R_b, because impacts are then alike at all
    sizes."""
    shutil.copytree(tables, tmp_path, dirs_exist_ok=True)
    law = {"impact": {"form": "table", "table": table}, "boulder": {"volume_mean": volume}}
    texts = remarks(*on_grounds(tmp_path, {}, **law))
    assert any("larger than R_b = 2.25 m" in text for text in texts) == said, texts


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """Folder with two tables, both with blocks of up to R_b = 1.8 m: `own.nc` for ground of
    constant strength, `in-proportion.nc` for a strength proportional to R_b."""
    (row, *_) = plane_files("ploughed", "compact").values()
    table = open_table(row)
    strength = USUAL_WEIGHT * 1.8 / table.size[-1]
    folder = tmp_path_factory.mktemp("tables")
    for name, radius in ("own.nc", 0.0), ("in-proportion.nc", 1.8):
        ground = table.ground._replace(strength=strength, strength_radius=radius)
        save_table(replace(table, ground=ground), folder / name)
    return folder


def test_a_result_says_by_itself_how_large_the_blocks_of_its_table_are(tmp_path, tables):
    """The remark is given although the table is removed after the run."""
    own = Path(shutil.copy(tables / "own.nc", tmp_path))
    law = {"impact": {"form": "table", "table": "own.nc"}, "boulder": {"volume_mean": 60.0}}
    case, result = on_grounds(tmp_path, {}, **law)
    own.unlink()
    (_,) = [text for text in remarks(case, result) if "larger than R_b = 2.25 m" in text]


def test_warnings_of_several_results_are_given_once(tmp_path):
    """A warning starts with the name of a result if it does not concern all results."""
    folders = [tmp_path / name for name in ("bare", "forest")]
    for folder in folders:
        folder.mkdir()
    case, bare = on_grounds(folders[0], {"ground": "soil_4"})
    wooded, forest = on_grounds(folders[1], {"ground": "soil_4"}, forest=STAND)
    own, *others = remarks(case, bare)
    assert joint_warnings({"bare": bare}) == [own, *others]
    assert joint_warnings({"bare": bare, "again": bare}) == [own, *others]
    said = joint_warnings({"bare": bare, "forest": forest})
    assert said[0] == own and f"forest: {forest_text()}" in said
    assert len(said) == len({*said}) == len([own, *others]) + 1


def test_of_several_results_the_largest_fraction_is_given_and_what_is_wrong_comes_first():
    fast, gone = (
        [say(f"model.{key}", part=part_of_boulders(n, 1000), **more) for n in (20, 600, 300)]
        for key, more in (("faster", {"limit": 0.8}), ("cut_short", {"distance": 10.0}))
    )
    runs = {"small": fast[:1], "large": [fast[1], gone[0]], "largest": [fast[2], gone[1]]}
    beyond = say("join.colon", before="road", after=say("input.line_beyond", off=9, length=20))
    said = [*joined_warnings(runs), beyond]
    assert said == [f"large, largest: {gone[1]}", fast[1], beyond]
    assert in_order(said) == [said[0], beyond, fast[1]]
    with speaking("de"):  # also as stored
        own = {k: [unpacked(packed(text), "") for text in texts] for k, texts in runs.items()}
        assert joined_warnings(own)[1].startswith("600 von")


def test_a_forest_is_said_to_be_unvalidated_wherever_it_is(tmp_path):
    """Preview, summary and warnings have the passing fractions stored for the experiment at
    Vaujany."""
    case, result = on_grounds(tmp_path, {}, forest=STAND)
    text = forest_text()
    bare, known = (
        only("vaujany-forest", state, "passing", "vaujany-observed") for state in ("bare", "forest")
    )
    assert known.observed == 34 < known.simulated
    assert f"{known.simulated:.0f} % pass (vaujany-observed), 34 % in" in text
    assert f"(without forest {bare.simulated:.0f} and 95 %)" in text
    assert f"  caution      {text}" in preview(scene_of(case)).splitlines()
    assert f"  caution: {text}" in summary(result).splitlines()
    assert f"Caution: {text}." in warnings(result)
    bare, without = on_grounds(tmp_path, {})
    assert "forest" not in preview(scene_of(bare)) + summary(without)


def test_a_forest_by_tables_is_judged_by_a_run_by_tables(tmp_path):
    case = make_case(tmp_path, *sets(), release=POINT, forest=STAND)
    tables = case.replace(impact={"form": "table", "table": "talus"})
    known = only("vaujany-forest", "forest", "passing", "talus")
    (found,) = forest_remarks({}, tables)
    assert known.observed < known.simulated
    assert f"{known.simulated:.0f} % pass (talus), " in found.text
    assert [remark.text for remark in forest_remarks({}, case)] == [forest_text()]
    by_ground, result = on_grounds(tmp_path, {"ground": "talus"}, forest=STAND)
    assert [*forest_remarks(result, by_ground)] == [found]
