# SPDX-License-Identifier: BSD-3-Clause
"""Report: its sentences and tables agree with the result, and a browser can display it."""

import hashlib
import re
import shutil
import sys
import zlib
from base64 import b64decode, b64encode
from dataclasses import replace
from html import unescape
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rockfall
from browser import open_browser, resize
from made import leave_pictures_blank
from rockfall.analysis.observed.observations import read_observed
from rockfall.analysis.precision.intervals import (
    Sources,
    boulders_needed,
    fraction_interval,
    rounded_up,
    sources,
)
from rockfall.app.server import PAGE
from rockfall.case import case_of
from rockfall.cli import main
from rockfall.result.crossings import at_lines, line_names
from rockfall.studies.run_until import Rule, Verdict, verdicts_of
from scenes import grid, make_case, rough, sets

pytest.importorskip("matplotlib", reason="the report extra is not installed")
from rockfall.analysis.precision.history import history, known_of, mixed, sizes  # noqa: E402
from rockfall.html_report.inputs import Parties, input_table  # noqa: E402
from rockfall.html_report.maps import (  # noqa: E402
    MAX_CELLS,
    Window,
    blocks_max,
    maps,
    window_of,
)
from rockfall.html_report.page import Picture, ReportInputs, report, write_report  # noqa: E402
from rockfall.html_report.summary import (  # noqa: E402
    answers,
    certainty,
    requested,
    technical,
)
from rockfall.html_report.validity import SHIPPED, cautions, warnings  # noqa: E402
from rockfall.language import LANGUAGES, speaking  # noqa: E402
from rockfall.plots.figures import figures  # noqa: E402
from rockfall.plots.history_figure import history_figure  # noqa: E402
from rockfall.quantities import (  # noqa: E402
    number,
    percent,
)
from rockfall.result.variables import STATUS  # noqa: E402
from rockfall.tables.lines import (  # noqa: E402
    estimate,
    headline,
    line_tables,
    precision_table,
    rows_of,
)
from rockfall.tables.run import ends_table  # noqa: E402

EVIL = "<script>document.title = 'run'</script> & \"x\" <img src=x onerror=alert(1)>"
LINES = [
    {"name": "road <b>", "x": [0.0, 300.0], "y": [330.0, 330.0]},
    {"name": "cliff", "x": [0.0, 300.0], "y": [398.0, 398.0]},  # above the release
]
MAPS = ["passages", "deposits", "energy_max", "reach_probability"]
#: English words that no page in another language contains, except in names.
ENGLISH = {"the", "of", "boulders", "with", "is", "are", "not", "height", "energy"}
SOURCES = {"x": [100.0, 150.0, 200.0], "y": [380.0, 380.0, 380.0]}


def run(folder, boulders=300, line=LINES, title=EVIL, **groups):
    """Result on rough terrain, with maps, rebounds and trajectories."""
    groups = {
        "case": {"boulders": boulders, "threads": 0, "title": title},
        "release": {"x": 150.0, "y": 380.0},
        "output": {"maps": MAPS, "rebounds": True, "trajectories": 5},
    } | groups
    nets = {"barrier": groups.pop("barrier", [])}
    case = make_case(folder, *sets(), line=line, terrain={}, **groups).replace(**nets)
    return rockfall.run(case, dem=rough(), transform=grid(rough()))


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return run(tmp_path_factory.mktemp("case"))


def no_levels(result, **_):
    """Return levels of the form that `rockfall.analysis.return_levels` gives; the level of 1 in
    10,000 is refused."""
    lines = line_names(result)
    rows = {"line": lines, "quantity": "speed", "n": 100, "max": 31.0, "level_1000": 30.0,
            "level_1000_low": 28.0, "level_1000_high": 33.0, "level_10000": np.nan,
            "threshold": 20.0, "exceedances": 60.0, "shape": -0.1,
            "refused": "1 in 10,000: may be 3 times as high"}  # fmt: skip
    return pd.DataFrame(rows)


def words(result):
    rows = rows_of(result)
    said = [*answers(result, rows), *certainty(result, rows, True), *technical(result)]
    return "\n".join([*said, *requested(result)])


def warned(result):
    return cautions(result, rows_of(result), no_levels(result))


def interrupted(result, done):
    """Copy of a result, as if stopped after `done` boulders."""
    part = result.isel(boulder=slice(done))
    return part.assign_attrs(complete=0, boulder_last=done)


# ---- words


def test_page_1_says_the_numbers_of_the_line_table(result):
    """The numbers of page 1 are those of the line statistics, with no more digits than their
    intervals support."""
    rows = rows_of(result)
    road, cliff = ([str(cell).split("\n") for cell in row] for row in headline(rows).rows)
    table = rockfall.line_statistics(result).set_index(["line", "quantity"]).loc["road <b>"]
    speed, energy = table.loc["speed"], table.loc["energy_total"]
    for shown, row, name, factor in (
        (road[1], speed, "fraction", 100),
        (road[2], energy, "q95", 1e-3),
        (road[4], speed, "q95", 1),
    ):  # fmt: skip
        value, low, high = (factor * row[name + end] for end in ("", "_low", "_high"))
        numbers = [float(one) for one in re.findall(r"[0-9.]+", " ".join(shown))]
        half = max(high - value, value - low)
        assert numbers == pytest.approx([value, low, high], abs=half / 4)
        assert len(shown[0].strip("0.").replace(".", "")) <= 3
    assert cliff[1:] == [["0.0", f"(0.0–{100 * rows['cliff']['speed']['fraction_high']:.1f})"],
                         *[["-"]] * 3]  # fmt: skip
    text = words(result)
    assert f"road <b>: {road[1][0]} % of the boulders pass, 5 % of them with" in text
    assert f"more than {road[2][0]} kJ, 5 % more than {road[3][0]} m above ground" in text
    assert "cliff: no boulder passes. The fraction is below" in text
    ended = {row[0]: int(row[1]) for row in ends_table(result).rows}
    assert sum(ended.values()) == 300
    assert ended["came to rest on the slope"] == np.count_nonzero(result.status == 1)


def test_what_too_few_boulders_know_is_marked_and_not_a_number(result):
    """12 boulders pass: the mean or standard deviation has a dash in brackets in place of an
    interval, and the table explains the dash."""
    few = result.isel(crossing=slice(12)).assign(row_size=("line", [12, 0]))
    rows = rows_of(few)
    assert "std, q90" in rows["road <b>"]["speed"]["withheld"]
    (table,) = line_tables(rows)
    about, cells = table.caption, dict(zip(table.head, next(table.texts()), strict=True))
    assert cells["standard deviation"].endswith("\n(–)") and "–" in cells["mean"]
    assert about.endswith(". Dash: too few boulders for a valid interval")
    assert "dash" not in next(line_tables(rows_of(result))).caption
    row = {"q95": 3.0, "q95_low": np.nan, "q95_high": np.nan}
    assert str(estimate(row, "q95", "speed")) == "3.00\n(–)"
    width = {row[0]: row[2] for row in precision_table("road <b>", rows["road <b>"], 300).rows}
    assert width["speed, standard deviation"] == "-"


def test_a_dash_on_page_1_is_explained(result):
    none = {name: np.nan for name in ("q95_low", "q95_high")}
    rows = {line: {q: {**row, **none} for q, row in numbers.items()}
            for line, numbers in rows_of(result).items()}  # fmt: skip
    text = "A dash in brackets: too few boulders pass for a valid interval."
    assert text in list(certainty(result, rows, True))
    assert text not in words(result)


def test_one_boulder_is_spoken_of_as_one(tmp_path):
    one = run(tmp_path, boulders=1)
    text = words(one)
    assert "One boulder is only an example" in text and "nan" not in text.lower()
    assert "The run-out of the boulder in plan is" in text
    assert any(caution.startswith("1 boulder is an example") for caution in warned(one))


def test_sentences_count_right():
    assert [percent(s) for s in (0, 1e-6, 0.5, 0.99999, 1)] == [
        "0 %", "< 0.1 %", "50.0 %", "> 99.9 %", "100 %",
    ]  # fmt: skip
    assert [number(x) for x in (0, 9.996, 0.0123, 1234.5, -2.5, np.nan, 3e-7, 2e-17)] == [
        "0", "10.0", "0.0123", "1,230", "-2.50", "-", "3.0e-7", "0",
    ]  # fmt: skip


# ---- limits of validity


def test_intervals_that_are_not_those_of_random_boulders_say_so(tmp_path, result):
    asked = result.assign_attrs(until="share@road <b><50%")
    (verdict,) = verdicts_of(asked)
    assert str(verdict) in words(asked) and str(verdict) not in words(result)


def test_each_caution_has_its_number_in_the_order_of_a_decision(result):
    changed = result.copy(deep=True)
    changed["rebounds"][...], changed["rebounds_out_of_range"][...] = 1000, 131
    changed["speed_max"][:] = 1.0
    changed["rebounds_out_of_speed"][...], changed["rebounds_out_of_angle"][...] = 450, 0
    changed["rebounds_forced"][...], changed["rebounds_redrawn"][...] = 1, 20
    changed["status"][:] = 1
    changed["status"][:30], changed["status"][30:36] = 3, 4
    changed["passages"][:] = 0
    changed["passages"][0, :10] = [100, 1, 2, 29, 30, 31, 5, 5, 5, 5]
    text = warned(changed)
    order = [
        "cliff: 0 boulders passed, fewer than 100",
        "30 of 300 boulders (10.0 %) left the terrain",
        "6 of 300 boulders (2.0 %) reached the impact limit",
        "131 of 1,000 rebounds (13.1 %) had R_b/R_m outside 0.5 to 5.5",
        "Terrain, ground, sources and volumes are taken as given",
        "The impact set is the user's own",
        "no trees", "no nets or walls", "no dams",
        "Boulders are spheres", "do not slide", "do not break", "do not collide",
        "Maxima grow",
        "2 of 4 return levels are given",
        "7 of 10 reached cells (70.0 %) were passed by fewer than 30",
    ]  # fmt: skip
    found = [next(k for k, one in enumerate(text) if part in one) for part in order]
    assert found == sorted(found) and len(text) == len(order)
    assert [one[:40] for one in warnings(changed)] == [
        "Stop: 6 of 300 boulders (2.0 %) left the",  # 24 of the 30 had crossed a line
        "Stop: 6 of 300 boulders (2.0 %) were sti",
        "Caution: 450 of 1,000 rebounds (45.0 %) ",
    ]
    drawn = list(technical(changed))
    assert drawn[0].startswith("20 of 1,000 rebounds (2.0 %) needed more than one draw")
    assert drawn[1].startswith("1 of 1,000 rebounds (0.1 %) were limited")


def test_what_lies_outside_the_model_is_a_box_at_the_top(tmp_path, monkeypatch):
    """The box comes before the answers of page 1, and is absent if there is nothing to report."""
    monkeypatch.setattr("rockfall.html_report.page.figures", lambda *_: [])
    leave_pictures_blank(monkeypatch)
    result = run(tmp_path, line=[], output={})
    clean, changed = result.copy(deep=True), result.copy(deep=True)
    for name in ("range", "speed", "angle"):
        clean[f"rebounds_out_of_{name}"][...] = 0
        changed[f"rebounds_out_of_{name}"][...] = int(result.rebounds)
    for one in clean, changed:
        one["speed_max"][:], one["status"][:] = 1.0, STATUS["absorbed"]
    changed["speed_max"][:16] = 999.0  # of 300
    page = report(ReportInputs(changed))
    box = re.search('class="question".*?<aside class="warning">.*?</aside>', page, re.DOTALL)[0]
    assert 'class="answers"' not in box
    said = [unescape(one).replace("\u00a0", " ") for one in re.findall("<li>(.*?)</li>", box)]
    assert said == warnings(changed) and len(said) == 4
    assert "16 of 300 boulders (5.3 %) exceeded 0.8 m/s per degree" in said[3]
    assert warnings(clean) == [] and "<aside" not in report(ReportInputs(clean))


def test_the_origin_of_every_shipped_set_is_known():
    from rockfall.scene.rebounds.sets import read_sets

    folder = Path(rockfall.__file__).parent / "data" / "impact_sets"
    single = {path.stem for path in folder.glob("*.nml") if len(read_sets(path)) == 1}
    assert set(SHIPPED) == single


def test_an_interrupted_run_says_so_first(tmp_path):
    part = interrupted(run(tmp_path, release=SOURCES, boulders=100), 120)
    first, second, *_ = warnings(part)
    assert "stopped after 120 of 300 boulders (60.0 % missing)" in first
    assert "the last ones are missing" in second


# ---- convergence


def test_the_first_boulders_are_a_sample_of_all_sources():
    """Any number of first boulders has sources in random order, each in proportion to its
    boulders."""
    source = Sources.of(np.repeat(np.arange(50), 4))
    turns = source.number[mixed(source)].reshape(4, 50)
    assert (turns == turns[0]).all() and (np.sort(turns[0]) == np.arange(50)).all()
    assert 0.25 < np.mean(turns[0, :20] < 25) < 0.75  # not the western sources first
    apart = Sources.of(np.repeat(np.arange(100), np.arange(100) // 10 + 1))
    first = np.bincount(apart.number[mixed(apart)][:275], minlength=100)
    assert np.abs(first - apart.released / 2).max() <= 1
    assert mixed(Sources.alone(5)).tolist() == [0, 1, 2, 3, 4]
    assert known_of(source.number[mixed(source)][:30], source).released.tolist() == [30]
    assert known_of(source.number[mixed(source)][:100], source).released.tolist() == [2] * 50


def test_the_band_holds_the_final_number_along_its_way():
    """Intervals include the final fraction in 95 % of 300 repetitions, after one and three turns of
    400 sources and after all 4,000 boulders; after the first 100 boulders in more than 90 %."""
    random, held = np.random.default_rng(1), []
    passes = np.sin(np.arange(400) / 60) > 0.3  # a gully: neighbours behave alike
    source = Sources.of(np.repeat(np.arange(400), 10))
    order = mixed(source)
    for _ in range(300):
        chance = np.where(passes, 0.9, 0.1)[source.number]
        crossed = (random.random(4000) < chance)[order]
        number = source.number[order]
        limits = [
            fraction_interval(crossed[:n], known_of(number[:n], source))
            for n in (100, 400, 1200, 4000)
        ]
        held.append([low <= chance.mean() <= high for _, low, high in limits])
    assert (np.abs(np.mean(held, axis=0)[1:] - 0.95) < 0.035).all()
    # the order is fixed: its first boulders may be a better or a worse sample
    assert np.mean(held, axis=0)[0] > 0.9


def test_the_history_ends_with_the_numbers_of_all(tmp_path, result):
    for run_ in (result, run(tmp_path, release=SOURCES, boulders=50)):
        n = sizes(sources(run_))
        found, last = history(run_, 0, n), rows_of(run_)["road <b>"]
        assert n[-1] == run_.sizes["boulder"]
        for quantity, steps in found.items():
            for name in ("fraction", "mean", "std", "q95_low"):
                assert steps[-1][name] == pytest.approx(last[quantity][name], rel=1e-12), name
    (first,) = history(result, 0, [30])["speed"]
    assert first["mean"] == pytest.approx(
        np.nanmean(at_lines(result)["line_speed"].values[0, :30]), rel=1e-12
    )


def test_boulders_needed_follow_the_square_root_law():
    assert boulders_needed(10_000, 0.02, 0.01) == 40_000
    assert boulders_needed(10_000, 0.02, 0.1, crossed=100) == 50_000  # 500 pass the line
    assert boulders_needed(10_000, 0.02, 0.01, crossed=9000) == 40_000
    assert rounded_up(534_361.0) == 540_000 and rounded_up(0.4) == 1


# ---- maps


def maps_of(result):
    """Each map by name: its description for the script of the page, and its values as the script
    decodes them."""
    window = window_of(result)
    names = [name for name in result.data_vars if result[name].dims == ("y", "x")]
    return {
        name: (one, np.frombuffer(zlib.decompress(b64decode(one.values)), "<f4").reshape(
            -1, window.nx))
        for name, one in zip(names, maps(result, window), strict=True)
    }  # fmt: skip


def test_a_map_carries_the_numbers_of_the_result(result):
    window, found = window_of(result), maps_of(result)
    for name, scale in (("passages", 1), ("energy_max", 1e-3), ("reach_probability", 100)):
        _, shown = found[name]
        there = result[name].values[window.row :][: window.ny, window.column :][:, : window.nx]
        there = np.where(there > 0, there * scale, np.nan)
        np.testing.assert_allclose(shown, there, rtol=1e-5)
    assert window.west == result.x[window.column] - 2.5
    assert window.north == result.y[window.row] + 2.5
    assert found["energy_max"][0].unit == "kJ" and found["passages"][0].unit == "boulders"
    assert (result["passages"].values > 0).sum() == (found["passages"][1] > 0).sum()


def test_a_large_raster_is_shown_by_the_max_of_each_block():
    values = np.arange(35, dtype="i4").reshape(5, 7)
    shown = blocks_max(values, Window(0.0, 0.0, 2.0, 3, 2, step=2, row=1, column=1))
    assert shown.tolist() == [[16, 18, 20], [30, 32, 34]]
    values = np.array([[np.nan, 1.0, np.nan]])
    shown = blocks_max(values, Window(0.0, 0.0, 2.0, 2, 1, step=2, row=0, column=0))
    assert shown[0, 0] == 1 and np.isnan(shown[0, 1])


def test_the_picture_of_a_large_raster_is_bounded(result, monkeypatch):
    monkeypatch.setattr("rockfall.html_report.maps.MAX_CELLS", 100)
    window = window_of(result)
    assert window.step > 1 and window.nx * window.ny < 2 * 100 < MAX_CELLS
    more = {f"energy_q{k}": result["energy_max"] for k in range(40)}
    assert window_of(result.assign(more)).step > window.step  # the size of all maps is limited


def test_a_map_says_why_it_is_blank(tmp_path):
    some = run(tmp_path, output={"maps": ["reach_probability_high", "energy_q95"]})
    found = maps_of(some)
    assert "uncertain where fewer than 92 boulders passed" in found["energy_q95"][0].notes
    upper, shown = found["reach_probability_high"]
    none = 100 * fraction_interval(np.zeros(300, bool), Sources.alone(300))[2]
    assert f"blank where no boulder passed ({none:.2g} % there)" in upper.notes
    window = window_of(some)
    passed = run(tmp_path)["passages"].values[window.row :, window.column :]
    passed = passed[: window.ny, : window.nx]
    assert (np.isfinite(shown) == (passed > 0)).all()


# ---- the page


@pytest.fixture(scope="module")
def pages(tmp_path_factory, result):
    """Folder with the page in each language, with terrain. English and German pages have some
    figures, blank in German."""
    folder = tmp_path_factory.mktemp("page")
    kinds = ("trajectories", "line_speed", "restitution")
    people = Parties("P 17", "Gemeinde", "A. B.", "2024")
    with pytest.MonkeyPatch.context() as here:
        here.setattr("rockfall.html_report.page.return_levels", no_levels)
        for language in LANGUAGES:
            if language != "en":
                leave_pictures_blank(here)
            some = kinds if language in ("en", "de") else ()  # figures take long
            with speaking(language):
                shown = [one for one in figures(result) if one.name in some]
            here.setattr("rockfall.html_report.page.figures", lambda *_, shown=shown: shown)
            where = rough(), grid(rough())
            inputs = ReportInputs(result, where, parties=people)
            write_report(inputs, folder / f"{language}.html", language)
    return folder


@pytest.fixture(scope="module")
def page(pages):
    return pages / "en.html"


# ---- languages


@pytest.mark.all
def test_no_english_is_left_on_a_page(pages):
    page = (pages / "de.html").read_text().split('id="provenance"')[0].split("<main>")[1]
    text = re.sub(r"<(style|pre|script|svg).*?</\1>|<[^>]*>", " ", page,
                  flags=re.DOTALL)  # fmt: skip
    assert ENGLISH & set(re.findall(r"\w+", text.lower())) == set()
    whole = (pages / "de.html").read_text()
    assert "A. B." in whole and "Gemeinde" in whole and "P 17" in whole


@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_verdicts_are_in_the_language(language):
    verdict = Verdict(Rule("speed.mean@L<1%", 0, "speed", "mean", 0.01), False, 0.05, 100.0)
    for one in (verdict, verdict._replace(met=True), verdict._replace(width=np.nan, need=np.nan),
                verdict._replace(need=np.inf)):  # fmt: skip
        with speaking(language):
            said = str(one)
        assert said.startswith("speed.mean@L<1%: ") and not ENGLISH & {*said.split()}


# ---- the page


@pytest.mark.all
def test_text_of_the_case_is_text_on_the_page(page):
    text = page.read_text()
    assert text.count("<script>") == 1 and "<img src=x" not in text
    assert "road <b>" not in text and "road &lt;b&gt;" in text
    assert EVIL in unescape(re.search("<h1>(.*)</h1>", text)[1])


def test_nothing_is_taken_from_elsewhere(page):
    text = page.read_text()
    addresses = re.findall(r'(?:src|href|srcset|action)="([^"]*)"', text)
    assert addresses and all(one.startswith(("data:", "#")) for one in addresses)
    assert (
        "default-src 'none'" in text
        and not re.search(r"url\((?!#)", text)
        and "@import" not in text
    )


def test_the_same_result_gives_the_same_bytes(result, monkeypatch):
    monkeypatch.setattr("rockfall.html_report.page.figures", lambda *_: [])  # tested separately
    monkeypatch.setattr("rockfall.html_report.page.return_levels", no_levels)  # tested separately
    leave_pictures_blank(monkeypatch)
    terrain = (rough(), grid(rough()))
    pages = [report(ReportInputs(one, terrain)) for one in (result, result.copy(deep=True))]
    assert pages[0] == pages[1]


def test_the_case_and_its_origin_are_all_there(page, result):
    text = unescape(page.read_text())
    printed = re.search("<pre tabindex.*?>(.*?)</pre>", text, re.DOTALL)[1]
    assert case_of(result.assign_attrs(case=printed)) == case_of(result)
    groups = set(re.findall(r"^&(\w+)", printed, re.MULTILINE))
    assert {"boulder", "line", "output"} <= groups  # exactly the groups set in the case
    assert not groups & {"barrier", "ensemble", "forest", "hazard", "flight"}
    assert result.attrs["impact_set_checksum"] in text and "20090601" in text
    assert "Rasters were arrays in memory" in text


def test_how_to_run_it_again_promises_what_holds(tmp_path, monkeypatch):
    case = make_case(tmp_path, *sets(), terrain={"dem": "dem.tif"}, release={"x": 1.0, "y": 1.0})
    monkeypatch.setattr("rockfall.html_report.page.figures", lambda *_: [])
    leave_pictures_blank(monkeypatch)
    whole = run(tmp_path, boulders=10, line=[]).assign_attrs(
        case=case.text(), case_file="my case.nml"
    )
    again = "Reproduces bit-identical results"
    text = report(ReportInputs(whole))
    assert f"{again} in the run folder" in text and "rockfall run &#39;my case.nml&#39;" in text
    assert "the case is as below" in text  # the file may have changed since
    text = report(ReportInputs(interrupted(whole, 4)))
    assert f"{again} and adds the missing boulders, if the files" in text


NET = {"name": "net", "x": [0.0, 300.0], "y": [360.0, 360.0], "height": 3.0, "capacity": 9.0}
STEMS = {"uniform_stems": 2000.0, "uniform_dbh_mean": 30.0, "uniform_dbh_std": 1.0,
         "uniform_conifers": 60.0}  # fmt: skip
OBSERVED = {
    "numbers.csv": "line,quantity,unit,mean,std,max,n,method\n"
    "road <b>,speed,m/s,12.5,5,28,80,observed\nroad <b>,speed,m/s,11,5,28,,B\n",
    "samples.csv": "line,quantity,unit,value,film\nroad <b>,speed,m/s,11.8,3\n",
    "stops.csv": "x,y\n150,300\n140,200\n130,90\n900,900\n",
    "impacts.csv": "impact,x,y,speed,height\n1,150,300,10,1\n2,150,330,1000,50\n",
    "tests.csv": "line,method,quantity,p\nroad <b>,B,speed,0.0366\n",
}


def kinds_of_result(folder):
    """Yield results with fewer or more parts than usual."""
    some = run(folder, boulders=60, output={"maps": ["passages", "energy_q95"], "rebounds": True})
    bare = {"output": {}, "boulders": 1, "line": []}
    release = {"x": 150.0, "y": 380.0, "drop_height": 0.0}
    yield run(folder, **bare)
    yield run(folder, boulders=3, release=release)
    yield interrupted(run(folder, boulders=10), 2)
    yield run(folder, release=SOURCES, boulders=2, output={})
    yield run(folder, release=SOURCES | {"sources": "sample"}, boulders=9)
    statuses = some["status"].copy(data=np.arange(60) % 7 + 1)
    yield some.assign(status=statuses).assign_attrs(until="share@cliff<9%")
    yield some.assign(
        {name: some[name] + np.int64(10**6) for name in some.data_vars if "rebounds_" in name
         and not some[name].dims} | {"rebounds": some["rebounds"] + np.int64(10**6)}
    )  # fmt: skip
    yield run(folder, boulders=60, barrier=[NET, NET | {"name": "never", "y": [5.0, 5.0]}])
    yield run(folder, boulders=30, forest=STEMS)


@pytest.mark.all
def test_every_kind_of_result_has_a_page_in_every_language(tmp_path, monkeypatch):
    monkeypatch.setattr("rockfall.html_report.page.return_levels", no_levels)
    monkeypatch.setattr("rockfall.html_report.page.picture", only_said)  # drawing has its own tests
    monkeypatch.setattr("rockfall.html_report.page.history_figure", lambda *_: None)
    monkeypatch.setattr("rockfall.html_report.page.figures", undrawn)
    for name, text in OBSERVED.items():
        (tmp_path / name).write_text(text)
    for k, one in enumerate(kinds_of_result(tmp_path)):
        on_paper = k % 2 == 1
        seen = read_observed(*(tmp_path / name for name in OBSERVED)) if "line" in one else None
        with speaking("fr"):
            text = report(ReportInputs(one, observed=seen, on_paper=on_paper))
        shown = re.sub("<svg.*?</svg>|<img [^>]*>|<style>.*</script>", "", text, flags=re.S)
        assert "nan" not in shown.lower() and "inf " not in shown.lower()
        said = re.sub("<(pre|header)[ >].*?</\\1>|<dl .*?</dl>|<[^>]*>", " ", shown, flags=re.S)
        assert ENGLISH & set(re.findall(r"\w+", said.split("Provenance")[0].lower())) == set()
        assert on_paper or "le relief manque" in text
        assert not (on_paper and "<button" in text.split("<main>")[1].split("</main>")[0])


def undrawn(*given):
    return [replace(one, draw=lambda: None) for one in figures(*given)]


def only_said(figure, title, caption, on_paper=False):
    return Picture(title, caption, "data:,", 500, 300)


# ---- the command


@pytest.fixture(scope="module")
def file_of_result(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("stored") / "out.nc"
    rockfall.write_result(result, path)
    return path


@pytest.fixture
def stored(tmp_path, monkeypatch, file_of_result):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rockfall.html_report.page.return_levels", no_levels)
    monkeypatch.setattr("rockfall.html_report.page.figures", lambda *_: [])
    leave_pictures_blank(monkeypatch)
    shutil.copy(file_of_result, "out.nc")
    return tmp_path


def test_the_command_writes_beside_the_result(stored, capsys):
    assert main(["report", "out.nc"]) == 0
    said = capsys.readouterr()
    assert said.out == "out.html\n" and "relief" in said.err
    assert Path("out.html").read_text().startswith("<!DOCTYPE html>")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["out.nc", "-o", "out.nc"], "out.nc: output name must end in .html"),
        (["out.nc", "-o", "none/out.html"], f"{Path('none/out.html')}: folder none does not exist"),
        (["out.nc", "--dem", "none.tif"], "none.tif"),
    ],
)
def test_what_cannot_be_done_is_refused_in_one_line(stored, capsys, arguments, message):
    before = sorted(stored.iterdir())
    content = Path("out.nc").read_bytes()
    assert main(["report", *arguments]) == 2
    said = capsys.readouterr().err.splitlines()
    errors = [line for line in said if "warning" not in line]
    assert len(errors) == 1 and message in errors[0]
    assert sorted(stored.iterdir()) == before and Path("out.nc").read_bytes() == content


def test_without_the_extra_one_line_says_what_to_install(stored, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    assert main(["report", "out.nc"]) == 2
    said = capsys.readouterr().err
    assert said == "rockfall: a report needs the report extra: pip install 'rockfall[report]'\n"
    assert not Path("out.html").exists()


# ---- in a browser


@pytest.fixture(scope="module")
def browser():
    one = open_browser("--disable-gpu")
    one.execute_cdp_cmd("Network.enable", {})
    one.execute_cdp_cmd("Network.emulateNetworkConditions", {
        "offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0,
    })  # fmt: skip
    yield one
    one.quit()


def opened(browser, page, width):
    resize(browser, width)
    browser.get(page.as_uri())
    return browser


SHOWN = """
const done = arguments[0], MAPS = ".map image:not(mask *), .map use";
Promise.all([...document.images].map((one) => one.decode().catch(() => 0))).then(() => done(
  [...document.images, ...document.querySelectorAll(MAPS)].map((one) => {
    const box = one.getBoundingClientRect();
    return [one.naturalWidth ?? 1, box.width, box.height];
  })));
"""


TEXTS = """
const seen = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
for (let node = walker.nextNode(); node; node = walker.nextNode()) {
  const element = node.parentElement, range = document.createRange();
  const copies = element.closest("defs, use, dialog, script, pre");
  const hidden = getComputedStyle(element).visibility === "hidden";
  if (!node.data.trim() || copies || hidden) continue;
  range.selectNodeContents(node);
  for (const box of range.getClientRects()) if (box.width > 1) seen.push([box, node.data.trim()]);
}
const clashes = [];
seen.forEach(([a, one], i) => seen.slice(i + 1).forEach(([b, other]) => {
  const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
  const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
  if (wide > 2 && high > 4) clashes.push([one, other]);
}));
const { scrollWidth, clientWidth } = document.documentElement;
return [seen.length, clashes, scrollWidth, clientWidth];
"""


@pytest.mark.parametrize("width", [400, 1600])
def test_no_text_lies_on_another_in_any_language(browser, pages, width):
    for language in LANGUAGES:
        opened(browser, pages / f"{language}.html", width)
        texts, clashes, wide, room = browser.execute_script(TEXTS)
        assert texts > 100 and clashes == [] and wide <= room, language
        assert browser.get_log("browser") == []


@pytest.mark.parametrize("width", [400, 1600])
def test_a_browser_shows_all_of_it(browser, page, width):
    opened(browser, page, width)
    shown = browser.execute_async_script(SHOWN)
    assert len(shown) > 10 and np.all(np.array(shown) > 20, where=[False, True, True])
    assert all(natural > 0 for natural, _, _ in shown)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    requests = "return performance.getEntriesByType('resource').map((one) => one.name)"
    assert not [one for one in browser.execute_script(requests) if not one.startswith("data:")]
    assert browser.title == EVIL
    assert browser.get_log("browser") == []
    boxes = browser.execute_script(NAMES)
    assert len(boxes) > 4
    for (a, b, c, d), (e, f, g, h) in combinations(boxes, 2):
        assert c <= e or g <= a or d <= f or h <= b  # names must not overlap


NAMES = """
const map = document.querySelector("figure.map");
return [...map.querySelectorAll("#marks text, .north, .ruler")]
  .filter((one) => getComputedStyle(one).visibility === "visible")
  .map((one) => one.getBoundingClientRect())
  .map((box) => [box.left, box.top, box.right, box.bottom]);
"""
BOX = "return document.querySelectorAll('.map svg[tabindex]')[{}].getAttribute('viewBox')"


def box(browser, k):
    return [float(one) for one in browser.execute_script(BOX.format(k)).split()]


def test_maps_zoom_by_keys_wheel_and_buttons_all_together(browser, page):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    opened(browser, page, 1600)
    chart = browser.find_elements(By.CSS_SELECTOR, ".map svg[tabindex]")[1]
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", chart)
    whole = box(browser, 1)
    chart.send_keys("+")
    by_key = box(browser, 1)
    assert by_key[2] == pytest.approx(whole[2] / 1.5) and box(browser, 0) == by_key
    chart.send_keys(Keys.ARROW_DOWN)
    assert box(browser, 1)[1] > by_key[1]
    ActionChains(browser).scroll_from_origin(_origin(chart), 0, -200).perform()
    by_wheel = box(browser, 1)
    assert by_wheel[2] < 0.8 * by_key[2]
    ActionChains(browser).drag_and_drop_by_offset(chart, 40, 0).perform()
    assert box(browser, 1)[0] < by_wheel[0]
    chart.send_keys("0")
    assert box(browser, 1) == whole
    browser.find_element(By.CSS_SELECTOR, ".map [data-zoom='2']").click()
    assert box(browser, 2)[2] == pytest.approx(whole[2] / 2)
    assert browser.get_log("browser") == []


def test_two_fingers_zoom(browser, page):
    from selenium.webdriver.common.by import By

    opened(browser, page, 400)
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True})
    chart = browser.find_element(By.CSS_SELECTOR, ".map svg[tabindex]")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", chart)
    at = browser.execute_script(
        "const box = arguments[0].getBoundingClientRect();"
        "return [box.x + box.width / 2, box.y + box.height / 2]",
        chart,
    )
    whole = box(browser, 0)
    for kind, apart in (("touchStart", 20), ("touchMove", 30), ("touchMove", 40), ("touchEnd", 0)):
        points = [{"x": at[0] + side * apart, "y": at[1], "id": side} for side in (0, 1)]
        touches = {"type": kind, "touchPoints": points if apart else []}
        browser.execute_cdp_cmd("Input.dispatchTouchEvent", touches)
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    assert box(browser, 0)[2] == pytest.approx(whole[2] / 2, rel=0.05)


def _origin(element):
    from selenium.webdriver.common.actions.wheel_input import ScrollOrigin

    return ScrollOrigin.from_element(element)


def test_the_pointer_tells_place_and_value(browser, page, result):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import WebDriverWait

    opened(browser, page, 1600)
    row, column = np.unravel_index(result["passages"].values.argmax(), result["passages"].shape)
    window = window_of(result)
    at = {"k": 1, "x": float(column - window.column + 0.5), "y": float(row - window.row + 0.5)}
    browser.execute_script(
        "const map = document.querySelectorAll('.map svg[tabindex]')[arguments[0].k];"
        "map.scrollIntoView();"
        "const matrix = map.getScreenCTM();"
        "const p = new DOMPoint(arguments[0].x, arguments[0].y).matrixTransform(matrix);"
        "map.dispatchEvent(new PointerEvent('pointermove', {clientX: p.x, clientY: p.y}));",
        at,
    )
    output = browser.find_elements(By.CSS_SELECTOR, ".map output")[1]
    WebDriverWait(browser, 5).until(lambda _: output.text)
    x, y = float(result.x[column]), float(result.y[row])
    assert output.text == f"x {x:.1f} m, y {y:.1f} m: {int(result['passages'].max())} boulders"


def test_a_page_carries_the_view_that_it_is_given(result, monkeypatch):
    """The page contains the view, compressed, and the hash that permits the script of the view."""
    monkeypatch.setattr("rockfall.html_report.page.figures", lambda *_: [])
    leave_pictures_blank(monkeypatch)
    view = "<!doctype html><div id='app'></div><script>const a = '<\\/script>';</script>"
    page = report(ReportInputs(result, (rough(), grid(rough())), view=view))
    packed = re.search(r'id="terrain-page">([^<]+)<', page)[1]
    assert zlib.decompress(b64decode(packed)).decode() == view
    checksum = b64encode(hashlib.sha256(b"const a = '<\\/script>';").digest()).decode()
    assert f"'sha256-{checksum}'" in page
    assert 'id="terrain-page"' not in report(ReportInputs(result, (rough(), grid(rough()))))


def test_the_view_of_show_runs_within_the_page(browser, stored):
    """The content security policy of the page permits the script of the 3-D view."""
    from selenium.webdriver.common.by import By
    from selenium.webdriver.support.ui import WebDriverWait

    if not (PAGE / "app.js").is_file():
        pytest.skip("the page of the window is not built: ./run page")
    assert main(["report", "out.nc", "--3d"]) == 0
    opened(browser, stored / "out.html", 1280)
    button = browser.find_element(By.CSS_SELECTOR, "#terrain button")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", button)
    button.click()
    wait = WebDriverWait(browser, 120)
    wait.until(lambda _: browser.find_elements(By.CSS_SELECTOR, "#terrain iframe"))
    browser.switch_to.frame(browser.find_element(By.CSS_SELECTOR, "#terrain iframe"))
    wait.until(lambda _: browser.execute_script("return Boolean(window.rockfall?.batch)"))
    assert browser.find_elements(By.CSS_SELECTOR, "canvas")
    browser.switch_to.default_content()
    said = [entry for entry in browser.get_log("browser") if entry["source"] != "rendering"]
    assert said == []  # software WebGL prints warnings


@pytest.mark.all
def test_the_report_on_paper(result, monkeypatch, tmp_path):
    pytest.importorskip("weasyprint", reason="the pdf extra is not installed")
    monkeypatch.setattr("rockfall.html_report.page.figures", lambda *_: [])
    path = tmp_path / "report.pdf"
    path.write_bytes(b"of before")
    write_report(ReportInputs(result), path)
    assert path.read_bytes().startswith(b"%PDF")


@pytest.mark.family(2)
@pytest.mark.parametrize(
    ("arguments", "package", "message"),
    [
        (["--pdf"], "weasyprint", "a PDF needs the pdf extra"),
        (["--3d"], "shapely", "a view needs the app extra"),
        (["--3d", "--pdf"], "", "out.pdf: a PDF has no view in three dimensions"),
        (["--pdf", "-o", "a.html"], "", "a.html: output name must end in .pdf"),
        (["--limits", "kJ=3,1"], "", "--limits kJ=3,1: must be unit=limit"),
        (["--basemap", "o.tif"], "", "o.tif: a basemap needs a result whose terrain has a CRS"),
    ],
)
def test_what_a_report_lacks_is_said_in_one_line(stored, capsys, monkeypatch, arguments, package,
                                                 message):  # fmt: skip
    if package:
        monkeypatch.setitem(sys.modules, package, None)
    before = sorted(stored.iterdir())
    assert main(["report", "out.nc", *arguments]) == 2
    said = capsys.readouterr().err.splitlines()
    assert message in said[-1] and not said[-1].startswith("Traceback")
    assert sorted(stored.iterdir()) == before


def test_a_figure_opens_large_and_closes_by_key(browser, page):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    opened(browser, page, 400)
    button = browser.find_element(By.CSS_SELECTOR, ".picture button")
    small = button.find_element(By.TAG_NAME, "img").size["width"]
    button.send_keys(Keys.ENTER)
    large = browser.find_element(By.CSS_SELECTOR, "dialog[open] img")
    assert large.size["width"] > small
    browser.find_element(By.CSS_SELECTOR, "dialog button").send_keys(Keys.ESCAPE)
    assert not browser.find_elements(By.CSS_SELECTOR, "dialog[open]")


def test_figures_of_the_laboratory_are_an_appendix_of_runs_by_impact_sets(result, monkeypatch):
    """Figures of restitution and incidence are in the appendix, and absent from runs by other
    rebound models."""
    monkeypatch.setattr("rockfall.html_report.page.picture", only_said)
    monkeypatch.setattr("rockfall.html_report.page.figures", undrawn)
    monkeypatch.setattr("rockfall.html_report.page._convergence", lambda *_: iter(()))
    front, appendix = report(ReportInputs(result)).split('<section id="appendix">')
    assert "Tangential and normal restitution" in appendix and "Incidence angles" in appendix
    assert "Incidence angles" not in front
    monkeypatch.setattr("rockfall.html_report.page.sets_of", lambda *_: [])
    page = report(ReportInputs(result))
    assert 'id="appendix"' not in page and "Incidence angles" not in page


def test_the_bands_of_few_boulders_do_not_set_the_axes_of_convergence(result, monkeypatch):
    """The band of the first 30 boulders may be very wide; the axes end below 6 times the final
    quantile."""

    def wide(*given):
        found = history(*given)
        for rows in found.values():
            rows[0]["q95_high"] = 1e9
        return found

    monkeypatch.setattr("rockfall.plots.history_figure.history", wide)
    rows = rows_of(result)["road <b>"]
    figure = history_figure(result, 0)
    for axes, (quantity, factor) in zip(
        figure.axes[1:], (("speed", 1), ("passing_height", 1), ("energy_total", 1e-3)), strict=True
    ):
        top, last = axes.get_ylim()[1], factor * rows[quantity]["q95"]
        assert last < top < 6 * last


def test_only_obstacles_of_the_case_are_listed(result, tmp_path):
    """Barriers, dams and trees are listed only if there are any; a CRS without CF parameters is
    listed by name."""
    listed = {row[0]: row[1] for row in input_table(result, Parties()).rows}
    assert not {"barriers", "dams", "trees"} & listed.keys()
    lv95 = result.assign(crs=result["crs"].assign_attrs(
        crs_wkt='PROJCRS["CH1903+ / LV95",BASEGEOGCRS["CH1903+"],ID["EPSG",2056]]'
    ))  # fmt: skip
    listed = {row[0]: row[1] for row in input_table(lv95, Parties()).rows}
    assert listed["coordinate system"] == "CH1903+ / LV95, EPSG:2056"
    netted = run(tmp_path, boulders=2, barrier=[NET])
    assert dict(input_table(netted, Parties()).rows)["barriers"] == "net"


def test_everything_has_a_name_for_those_who_cannot_see(browser, page):
    opened(browser, page, 1600)
    nameless = """return [...document.querySelectorAll('img, svg[tabindex], button, table, [role]')]
      .filter((one) => !(one.alt || one.ariaLabel || one.textContent.trim())).length"""
    assert browser.execute_script(nameless) == 0
    headings = "return [...document.querySelectorAll('h1, h2, h3')].map((one) => +one.tagName[1])"
    levels = browser.execute_script(headings)
    assert levels[0] == 1 and levels.count(1) == 1 and max(np.diff(levels)) == 1
    unscoped = "return document.querySelectorAll('th:not([scope])').length"
    assert browser.execute_script(unscoped) == 0


def test_what_is_left_out_depends_on_the_case(result):
    """Only dams are reported as missing from a case with trees and a net."""
    stand = {"stems": "stems.tif", "uniform_dbh_mean": 30.0, "uniform_dbh_std": 9.0,
             "uniform_conifers": 60.0}  # fmt: skip
    net = {"name": "net", "x": [0.0, 9.0], "y": [5.0, 5.0], "height": 3.0, "class": 2}
    case = case_of(result)
    case = case.replace(forest=stand, line=case.line[:1], barrier=[net])
    text = " ".join(warned(result.assign_attrs(case=case.text())))
    assert "The case has no dams." in text and "no trees" not in text and "no nets" not in text
    assert "Stems are vertical" in text and "A barrier absorbs as much" in text
