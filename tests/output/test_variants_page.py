# SPDX-License-Identifier: BSD-3-Clause
"""Page of variants: a column for each variant with the values of the comparison, maps, and no
English in other languages."""

import re

import numpy as np
import pandas as pd
import pytest

import rockfall
import scenes
from made import every_third, refused
from rockfall.case import case_of
from rockfall.cli import main
from rockfall.quantities import number
from rockfall.studies.variants import COLUMNS

pytest.importorskip("matplotlib", reason="the report extra is not installed")
pytest.importorskip("jinja2", reason="the report extra is not installed")

Z = scenes.rough()
GRID = scenes.grid(Z)
LINE = [{"name": "road", "x": [0.0, 300.0], "y": [250.0, 250.0]}]
NET = {"name": "net", "x": [60.0, 240.0], "y": [300.0, 300.0], "height": 4.0, "class": 3}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("variants")
    release = {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0}
    case = scenes.make_case(
        folder, *scenes.sets(2.0), release=release, line=LINE, case={"boulders": 100},
        output={"maps": ["passages"]},
    )  # fmt: skip
    variants = {"bare": case, "with net": case.replace(barrier=[NET])}
    return {name: rockfall.run(one, dem=Z, transform=GRID) for name, one in variants.items()}


def cells_of(page):
    rows = re.findall(r"<tr><th scope=.row.[^>]*>(.*?)</th>(.*?)</tr>", page, re.S)
    found = {}
    for label, cells in rows:  # the first table is for the road
        found.setdefault(label, re.findall(r"<td>(.*?)</td>", cells, re.S))
    return found


@pytest.mark.filterwarnings("ignore:.*figures have no relief")
def test_the_page_has_the_numbers_of_the_comparison(results, tmp_path):
    costs = {"with net": 120000.0}
    numbers = dict.fromkeys(COLUMNS, np.nan) | {"line": "road", "statistic": "all"}
    rates = [
        numbers | {"variant": name, "quantity": "frequency", "value": rate, "value_high": 1.0}
        for name, rate in {"bare": 0.4, "with net": 0.1}.items()
    ]
    given = {"frequencies": pd.DataFrame(rates), "costs": costs}
    path = rockfall.report_variants(results, tmp_path / "a.html", **given)
    page = path.read_text()
    table = rockfall.compare_variants(results)
    at_road = table[(table["line"] == "road") & (table["statistic"] == "fraction")]
    bare, net = at_road["value"]
    rows = cells_of(page)
    passing = rows["passing boulders [% of all]"]
    assert passing[0] == number(100 * bare) and passing[1].startswith(f"{number(100 * net)}\n-")
    assert rows["arriving boulders per year"] == ["0.400", "0.100"]
    assert rows["cost"] == ["-", "120,000"]
    assert rows["nets and walls"] == ["-", "net: 4 m, EAD 3"]
    assert page.count("<img ") == 1 and "With net: passing fraction" in page
    population = "boulders of the case: volume = &#39;fixed&#39;, volume_mean = 0.8."
    assert population in page and "another population" not in page


@pytest.mark.filterwarnings("ignore:.*figures have no relief")
@pytest.mark.parametrize("language", every_third(["de", "fr", "it"]))
def test_no_text_is_left_in_english(results, tmp_path, language):
    path = tmp_path / "a.html"
    rockfall.report_variants(results, path, language=language)
    hidden = re.compile(r"<style>.*?</style>|<script>.*?</script>|<[^>]*>", re.S)
    shown = hidden.sub(" ", path.read_text())
    assert not re.search(r"\b(boulders|those|pass|which|the)\b", shown)


@pytest.mark.filterwarnings("ignore:.*figures have no relief")
def test_without_maps_there_is_no_figure(results, tmp_path):
    bare = {name: one.drop_vars("passages") for name, one in results.items()}
    path = rockfall.report_variants(bare, tmp_path / "a.html")
    assert "<img " not in path.read_text()


@pytest.mark.filterwarnings("ignore:.*figures have no relief")
def test_what_cannot_be_is_one_line(results, tmp_path):
    path = tmp_path / "a.html"
    with refused("cost of dam: no such variant (variants: bare, with net)"):
        rockfall.report_variants(results, path, costs={"dam": 1.0})
    with refused("cost of bare = nan: must be >= 0"):
        rockfall.report_variants(results, path, costs={"bare": np.nan})
    assert not path.exists()


@pytest.mark.all
def test_the_command_writes_the_page(results, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, result in results.items():
        rockfall.write_result(result, name.replace("with ", "") + ".nc")
    words = ["compare", "bare.nc", "net.nc", "--report", "page.html"]
    assert main([*words, "--costs", "net=5"]) == 0
    assert "<th" in (tmp_path / "page.html").read_text()
    assert main([*words, "--costs", "net"]) == 2
    assert "--costs net: must be NAME=AMOUNT" in capsys.readouterr().err


def test_a_page_with_scenarios_calls_frequencies_of_hazard_another_population(results, tmp_path):
    scenario = [{"name": "one", "frequency": 0.5}]
    others = {
        name: one.assign_attrs(case=case_of(one).replace(scenario=scenario).text())
        for name, one in results.items()
    }
    page = rockfall.report_variants(others, tmp_path / "a.html").read_text()
    assert "refer to the boulders of &amp;boulder, not of the scenarios" in page


def test_what_only_a_page_shows_needs_one(results, tmp_path, monkeypatch, capsys):
    words = ["--costs", "net=5"]
    monkeypatch.chdir(tmp_path)
    for name, result in results.items():
        rockfall.write_result(result, name.replace("with ", "") + ".nc")
    assert main(["compare", "bare.nc", "net.nc", *words]) == 2
    assert f"{words[0]} requires --report" in capsys.readouterr().err
