# SPDX-License-Identifier: BSD-3-Clause
"""Dossier: values on page 1 are in its tables and come from Python, a place has one frequency in
all products, and pages are few and have a signature in every language."""

import re
import shutil
import warnings
from dataclasses import replace
from html import unescape

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import rockfall
import scenes
from made import leave_pictures_blank, make_layer, refused
from rockfall.analysis.objects.at_risk import AtRisk
from rockfall.case import case_in
from rockfall.case.variants import variants
from rockfall.cli import main
from rockfall.files.hazard_files import read_hazard
from rockfall.io.rasters.arrays import grid_of
from rockfall.language import LANGUAGES, packed_texts, say, speaking
from rockfall.plots.cartography.sheet import Room
from rockfall.plots.hazard import close_map
from rockfall.plots.hazard.hazard_figures import places_extent
from rockfall.quantities import part_of_rebounds
from rockfall.result.crossings import line_names, line_values, outcomes_at
from rockfall.result.dataset import write_result
from rockfall.result.variables import ENDS, OUTCOME
from rockfall.simulation import simulate
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.studies.dossier import Designs, Dossier, Second, read_dossier, run_dossier
from rockfall.studies.hazard import run_study
from rockfall.studies.yearly_variants import yearly_table
from rockfall.table import Table
from rockfall.tables.dossier import (
    Section,
    answer_table,
    barrier_answers,
    remaining_tables,
    second_answer,
    second_demands,
    second_tables,
)
from rockfall.tables.hazard import period_tables, places_of

for package in ("shapely", "weasyprint", "openpyxl", "docx", "matplotlib", "jinja2"):
    pytest.importorskip(package, reason="an extra is not installed")
import docx  # noqa: E402
import openpyxl  # noqa: E402
import shapely  # noqa: E402

from rockfall.dossiers import designs_of  # noqa: E402
from rockfall.html_report import dossier_page  # noqa: E402

Z = scenes.rough()
PLACE = {"dem": Z, "transform": scenes.grid(Z)}
GROUPS = {
    "release": {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0},
    "case": {"boulders": 300, "title": "Valley", "question": "Is the house safe?"},
    "line": [{"name": "road", "x": [0.0, 300.0], "y": [200.0, 200.0]}],
    "barrier": [{"name": "net", "x": [60.0, 240.0], "y": [300.0] * 2, "height": 4.0, "class": 3}],
    "variant": [
        {"name": "today", "without": ["barrier"]},
        {"name": "with net", "cost": 120000.0},
    ],
    "scenario": [
        {"name": "often", "frequency": 1.0},
        {"name": "large", "frequency": 0.1, "volume_mean": 3.0},
    ],
}
HOUSES = [shapely.box(130.0, 150.0, 150.0, 170.0), shapely.box(20.0, 60.0, 40.0, 80.0)]
NUMBER = re.compile(r"\d[\d,\u202f]*(?:[.,]\d+)?")


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    make_layer(folder / "houses.gpkg", HOUSES, crs=None, name=["house 1", "house 2"],
               value=[6e5, 4e5], persons=[4.0, 2.0], presence=[0.6, 0.6])  # fmt: skip
    named = ("variant", "scenario", "barrier")
    groups = {name: own for name, own in GROUPS.items() if name not in named}
    made = scenes.make_case(folder, *scenes.sets(2.0), **groups)
    return made.replace(**{name: GROUPS[name] for name in named})


@pytest.fixture(scope="module")
def made(case):
    """Folder of the dossier, and the text of its pages."""
    folder = case.path("houses.gpkg").parent / "dossier"
    pages = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dossier_page, "write_page", lambda page, _: pages.append(page))
        leave_pictures_blank(patch)
        with pytest.warns(UserWarning):
            rockfall.dossier(case, folder, objects=case.path("houses.gpkg"), **PLACE)
    return folder, pages[0]


def first_page(page):
    part = page[page.index('<section id="answer">') : page.index('<div class="signature"')]
    return unescape(re.sub(r"<[^>]+>", " ", part))


@pytest.mark.all
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_one_place_has_one_frequency_in_all_products(case, made):
    folder, _ = made
    rows = pd.read_csv(folder / "frequencies.csv")
    rows = rows[(rows["quantity"] == "frequency") & (rows["statistic"] == "all")]
    rows = rows.set_index(["line", "variant"])["value"]
    yearly = rockfall.yearly_variants(case, **PLACE).table
    yearly = yearly[(yearly["quantity"] == "frequency") & (yearly["statistic"] == "all")]
    yearly = yearly.set_index(["line", "variant"])["value"]
    for name, own in variants(case).items():
        found = rockfall.hazard(own, objects=case.path("houses.gpkg"), **PLACE)
        kept = read_hazard(folder / f"hazard_{name}.nc")
        for kind, place in (("line", "road"), ("object", "house 1"), ("object", "house 2")):
            frequency = float(found[f"{kind}_frequency"].sel({kind: place}))
            assert float(kept[f"{kind}_frequency"].sel({kind: place})) == frequency
            assert rows[place, name] == pytest.approx(frequency, rel=1e-12)
            curve = rockfall.exceedance(kept, place)
            assert curve["frequency"][0] == frequency
        assert yearly["road", name] == pytest.approx(rows["road", name], rel=1e-12)
        assert (found["hazard_class"].values == kept["hazard_class"].values).all()


def test_every_number_of_page_1_is_in_the_tables_and_from_python(case, made):
    folder, page = made
    text = first_page(page)
    assert "Is the house safe?" in text
    document = docx.Document(str(folder / "dossier.docx"))
    cells = [cell.text for table in document.tables for row in table.rows for cell in row.cells]
    sentences = [paragraph.text for paragraph in document.paragraphs]
    known = {*NUMBER.findall("\n".join([*cells, *sentences]))}
    said = NUMBER.findall(text)
    assert len(said) > 40
    assert not [number for number in said if number not in known]
    with warnings.catch_warnings(action="error"):  # from headers that cannot be read
        book = openpyxl.load_workbook(folder / "dossier.xlsx")
    first = book.worksheets[1]
    assert first.oddHeader.left.text.startswith("Boulders at each place, with 95 % intervals")
    heads = [cell.value for cell in first[1]]
    assert heads[1:4] == [
        f"boulders per year{end}" for end in ("", ", lower limit", ", upper limit")
    ]
    values = {row[0]: row[1:] for row in first.iter_rows(min_row=2, values_only=True)}
    hazard = read_hazard(folder / "hazard_today.nc")
    for place in places_of(hazard):
        row = values[place.name]
        for end, number in zip(("", "_low", "_high"), row[:3], strict=True):
            assert number == float(hazard[f"{place.kind}_frequency{end}"].values[place.k])
        period = rockfall.return_period(hazard, place.name)
        assert row[3] == pytest.approx(period.value if np.isfinite(period.value) else None)
        level = hazard[f"{place.kind}_energy_by_period"].sel(event_period=100.0).values[place.k]
        assert row[6] == pytest.approx(level / 1000)


def test_the_answer_shows_the_numbers_of_the_hazard(made):
    folder, page = made
    hazard, text = read_hazard(folder / "hazard_today.nc"), first_page(page)
    for row in answer_table(hazard, 100.0).texts():
        for cell in row:
            assert " ".join(str(cell).split()) in " ".join(text.split())


@pytest.mark.parametrize(("north", "expected"), [(0.0, "high"), (60.0, "none")])
def test_a_line_has_the_highest_class_of_the_cells_that_it_crosses(made, north, expected):
    hazard = read_hazard(made[0] / "hazard_today.nc").copy(deep=True)
    road = next(line for line in case_in(hazard.attrs).lines if line["name"] == "road")
    grid, _ = grid_of(hazard["hazard_class"])
    middle = np.array([np.mean(road["x"])]), np.array([np.mean(road["y"])]) + north
    for end in ("", "_lower", "_upper"):
        classes = np.zeros(grid.shape, "i1")
        classes[grid.cells(*middle)] = 4
        hazard[f"hazard_class{end}"].values[:] = classes
    rows = {row[0]: row[-1] for row in answer_table(hazard, 100.0).texts()}
    assert rows["road"] == expected


@pytest.mark.parametrize(
    ("side", "beyond", "expected"),
    [("east", 0.0, "high"), ("west", 0.0, "high"), ("east", 1.0, "-"), ("west", -1.0, "-")],
)
def test_a_line_on_the_border_has_the_class_of_the_cells_there(made, side, beyond, expected):
    hazard = read_hazard(made[0] / "hazard_today.nc").copy(deep=True)
    grid, _ = grid_of(hazard["hazard_class"])
    lines = case_in(hazard.attrs).lines
    x = getattr(grid, side) + beyond
    road = {"name": "road", "x": [x, x], "y": [grid.south + 1.0, grid.north - 1.0]}
    moved = [road if line["name"] == "road" else line for line in lines if "height" not in line]
    hazard.attrs["case"] = case_in(hazard.attrs).replace(line=moved).text()
    for end in ("", "_lower", "_upper"):
        classes = np.zeros(grid.shape, "i1")
        classes[:, [0, -1]] = 4
        hazard[f"hazard_class{end}"].values[:] = classes
    rows = {row[0]: row[-1] for row in answer_table(hazard, 100.0).texts()}
    assert rows["road"] == expected


def test_what_remains_is_a_table_of_what_is_known(made):
    lines = read_hazard(made[0] / "hazard_today.nc").drop_dims("object")
    bare = Dossier({"today": lines, "net": lines}, yearly_table({}, {}))
    assert not list(remaining_tables(bare))
    (priced,) = remaining_tables(replace(bare, costs={"net": 5000.0}))
    assert [[*row] for row in priced.texts()] == [["today", "-"], ["net", "5,000"]]


def pages_of(made, monkeypatch, language):
    """HTML of the dossier in a language, and the document typeset from it as a PDF would be."""
    folder, _ = made
    hazards = {name: read_hazard(folder / f"hazard_{name}.nc") for name in ("today", "with net")}
    frequencies = pd.read_csv(folder / "frequencies.csv", dtype={"statistic": str})
    frequencies["verdict"] = frequencies["verdict"].astype(object)
    pages = []
    monkeypatch.setattr(dossier_page, "write_page", lambda page, _: pages.append(page))
    leave_pictures_blank(monkeypatch)
    from weasyprint import HTML

    from rockfall.html_report.inputs import Parties

    found = Dossier(hazards, frequencies)
    given = dossier_page.Given(Parties("P 1", "Client", "Author"))
    dossier_page.write_dossier_page(found, designs_of(found), given, "dossier.pdf", language)
    return pages[0], HTML(string=pages[0]).render()


@pytest.mark.all
@pytest.mark.parametrize("language", LANGUAGES)
def test_the_pages_are_few_and_signed(made, monkeypatch, language):
    page, document = pages_of(made, monkeypatch, language)
    assert len(document.pages) <= 8
    assert "signature" in document.pages[0].anchors
    assert [round(page.width) for page in document.pages[:2]] == [794, 794]  # A4
    assert round(document.pages[-1].width) == 1587  # A3
    with speaking(language):
        words = first_page(page)
    assert language == "en" or "boulders" not in words


@pytest.mark.all
@pytest.mark.parametrize(
    ("high", "coarsest", "number"),
    [
        (70.0, 5000.0, 0),
        *(
            pytest.param(*one, marks=pytest.mark.all)
            for one in ((70.0, 1.0, 1), (300.0, 5000.0, 1))
        ),
    ],
)
def test_the_map_is_on_page_1_if_its_places_fit(made, monkeypatch, high, coarsest, number):
    monkeypatch.setattr(dossier_page, "FIRST", high)
    for most in ("HOUSES", "ADVICE", "WARNINGS"):  # leaves room on page 1
        monkeypatch.setattr(dossier_page, most, 0)
    monkeypatch.setattr(close_map, "COARSEST", coarsest)
    drawn, draw = [], close_map.close_map
    monkeypatch.setattr(dossier_page, "close_map", lambda *how: drawn.append(how) or draw(*how))
    _, document = pages_of(made, monkeypatch, "en")
    assert len(drawn) == 1
    assert [k for k, page in enumerate(document.pages) if "map" in page.anchors] == [number]


def test_a_map_of_part_of_the_area_shows_objects_and_the_reached_part_of_lines(made):
    hazard = read_hazard(made[0] / "hazard_today.nc")
    west, east, south, north = places_extent(hazard)
    houses = shapely.total_bounds(HOUSES)
    assert west <= houses[0] and south <= houses[1] and east >= houses[2] and north >= houses[3]
    passed = hazard["hit_frequency"].values > 0
    x = hazard["x"].values[passed.any(axis=0)]
    assert west >= min(x.min(), houses[0]) and east <= max(x.max(), houses[2])
    assert not close_map.is_whole(hazard, None, Room(1.0, 1.5))


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_second_model_is_run_and_what_governs_is_said(case, made):
    """The second model is the table `talus` in place of the impact sets of the case."""
    folder, page = made
    other = read_hazard(folder / "hazard_by_second_model.nc")
    today = variants(case)["today"]
    talus = today.replace(surface={"ground": "talus"}, impact={"ratio": None, "turning": None})
    expected = rockfall.hazard(talus, objects=case.path("houses.gpkg"), **PLACE)
    for name in ("line_frequency", "object_frequency", "line_energy_by_period"):
        assert (other[name].values == expected[name].values).all()
    own = read_hazard(folder / "hazard_today.nc")
    more = float(other["line_frequency"][0]) > float(own["line_frequency"][0])
    governs = "Governs: talus" if more else "Governs: the case's model"
    assert "(talus)" in first_page(page)
    assert governs in first_page(page) or "frequency: " in first_page(page)
    by_sets = Dossier({"": own}, pd.DataFrame(), second=Second("impact sets, method B", other))
    with speaking("de"):
        (table,) = second_tables(by_sets)
    assert table.caption.endswith(": Parametersatz, Methode B")
    constant = Dossier({"": own}, pd.DataFrame(), second=Second("constant_a, constant_b", other))
    with speaking("fr"):
        (sentence,), (table,) = second_answer(constant), second_tables(constant)
    assert "l'autre modèle de rebond que ce sol admet (coefficients constants)" in sentence
    assert table.caption.endswith(": coefficients constants (constant_a, constant_b)")


def test_heights_of_both_models_are_compared(made):
    """Each quantity is governed by the model with the higher value, here height by the second
    model: frequencies and energies are halved, heights are doubled."""
    own = read_hazard(made[0] / "hazard_today.nc")
    other = own.copy(deep=True)
    for name, factor in (("frequency", 0.5), ("energy_by_period", 0.5), ("height_by_period", 2.0)):
        for end in ("", "_low", "_high"):
            other[f"line_{name}{end}"].values *= factor
    (table,) = second_tables(Dossier({"": own}, pd.DataFrame(), second=Second("talus", other)))
    (road,) = [row for row in table.rows if row[0] == "road"]
    height, higher = (hazard["line_height_by_period"].sel(event_period=100.0).values for hazard in
                      (own, other))  # fmt: skip
    assert [cell.value for cell in road[5:7]] == [height[0], higher[0]]
    governs = "frequency: the case's model, energy: the case's model, height: talus"
    assert road[7] == governs
    assert table.head[5] == "height once in 100 years [m]"
    other["line_energy_by_period"][...] = np.nan  # unknown: the higher frequency governs
    (table,) = second_tables(Dossier({"": own}, pd.DataFrame(), second=Second("talus", other)))
    assert [row[7] for row in table.rows if row[0] == "road"] == ["the case's model"]


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        ("impact sets, method B", "impact sets, method B: 31.0 % of the rebounds in the worst"),
        ("talus", "talus: 31.0 % of the rebounds in the worst"),
        ("constant_talus", None),
    ],
)
def test_rebounds_out_of_range_are_said_next_to_what_governs(made, model, expected):
    own = read_hazard(made[0] / "hazard_today.nc")
    other = own.copy(deep=True)
    other["fraction_out_of_range"].values[:] = (0.07, 0.31) if expected else 0.0
    said = [*second_answer(Dossier({"": own}, pd.DataFrame(), second=Second(model, other)))]
    assert "Governs: " in said[0]
    assert [text[: len(expected or "")] for text in said[1:]] == [expected] * bool(expected)


def test_warnings_of_the_second_model_are_those_of_its_worst_run(made):
    own = read_hazard(made[0] / "hazard_today.nc")
    other = own.copy(deep=True)
    parts = (3000, 9000)  # of 10,000 rebounds, by scenario
    texts = [say("model.outside_angle", part=part_of_rebounds(part, 10_000)) for part in parts]
    for k, text in enumerate(texts):
        for name, stored in zip(("warnings", "messages"), packed_texts([text]), strict=True):
            other[f"scenario_{name}"].values[k] = stored
    dossier = Dossier({"": own}, pd.DataFrame(), second=Second("impact sets, method B", other))
    found = [text for text in dossier_page.dossier_warnings(dossier) if "angle_range" in text]
    assert found == [f"impact sets, method B: {texts[1]}"]


def test_the_release_frequency_that_was_assumed_is_on_page_1(made):
    folder, page = made
    released = float(read_hazard(folder / "hazard_today.nc")["frequency"].sum())
    page_1 = " ".join(first_page(page).split())
    assert f"the assumed release frequency, {released:.2g} boulders per year" in page_1
    assert "Uncertainties of terrain, ground, block size and model are not included." in page_1


def test_the_first_places_have_the_highest_frequency_energy_and_height():
    """The first of 30 lines has the most boulders, the last two the highest height and energy."""
    levels = np.zeros((30, 5))
    energy, height = levels.copy(), levels.copy()
    energy[-1, -1], height[-2, -1] = 9e5, 7.0
    hazard = xr.Dataset(
        {
            "line_barrier_height": ("line", np.full(30, np.nan)),
            "line_frequency": ("line", np.linspace(0.3, 0.1, 30)),
            **{
                f"line_{name}_by_period{end}": (("line", "event_period"), values)
                for name, values in (("energy", energy), ("height", height))
                for end in ENDS
            },
        },
        {"line": [f"L{k}" for k in range(30)], "event_period": [10.0, 30.0, 100.0, 300.0, 1000.0]},
    )
    assert [place.name for place in places_of(hazard)[:4]] == ["L0", "L28", "L29", "L1"]
    captions = [table.caption for table in period_tables(hazard)]
    assert all("20 of 30 places" in caption for caption in captions) and len(captions) == 2


def test_page_1_has_the_net_of_the_second_model_if_it_must_be_stronger(made):
    """Boulders pass the road 1 m higher by the second model, so that its net is 1 m higher. This
    net is on page 1 only if it must be stronger."""
    usual = read_hazard(made[0] / "hazard_by_second_model.nc")
    higher = usual.copy(deep=True)
    rates = usual["line_class_behind"].values
    assert (np.diff(usual["exceeded_height"].values[:20]) == 0.5).all()
    higher["line_class_behind"].values[..., 2:20] = rates[..., :18]
    higher["line_class_behind"].values[..., :2] = rates[..., :1]

    def said(first, second):
        dossier = Dossier({"": first}, pd.DataFrame(), 10.0, second=Second("other", second))
        designs = designs_of(dossier)
        return barrier_answers(designs)[0], [*second_demands(dossier, designs)]

    (low, none), (high, fewer) = said(usual, usual), said(higher, usual)
    assert not none and not fewer
    first, (second,) = said(usual, higher)
    assert first == low and second == f"other: {high}"
    heights = [float(re.search(r"([\d.]+) m suffice", text)[1]) for text in (low, high)]
    assert heights[1] == heights[0] + 1


def test_advice_on_many_lines_leaves_room_for_barriers_that_fail(made, monkeypatch):
    dossier = Dossier({"": read_hazard(made[0] / "hazard_today.nc")}, pd.DataFrame())
    texts = {"barrier_answers": "Net on L{}.", "barrier_verdicts": "Net {} is too weak."}
    for name, text in texts.items():
        many = [text.format(k) for k in range(9)]
        monkeypatch.setattr(dossier_page, name, lambda _, many=many: many)
    said = [*dossier_page.answers(dossier, Designs({}))]
    shown = [[text.format(k) in said for k in range(9)].count(True) for text in texts.values()]
    assert min(shown) > 0
    left = f"{18 - sum(shown)} more sentences on barriers: see section Protection"
    assert any(sentence.startswith(left) for sentence in said)


@pytest.mark.parametrize(
    ("rate", "low", "high", "expected"),
    [
        (0.6, 0.5, 0.7, "road: rebound models differ by a factor of 50 in frequency. Before"),
        (0.0, 0.0, 0.5, "road: rebound models differ by a factor of over 60 in frequency. Before"),
        (12.0, 11.0, 13.0, "road: "),  # a factor of 2.5
        (6.0, 0.5, 28.5, "road: "),  # within the intervals
    ],
)
def test_page_1_begins_with_models_that_differ_widely(made, rate, low, high, expected):
    """By the model of the case, 30 boulders (28 to 32) per year pass a line. A factor of 2.5 by the
    other model, or of 5 with wide intervals, is not reported."""
    own = read_hazard(made[0] / "hazard_today.nc").drop_dims("object")
    other = own.copy(deep=True)
    for hazard, limits in ((own, (30.0, 28.0, 32.0)), (other, (rate, low, high))):
        for end, limit in zip(("", "_low", "_high"), limits, strict=True):
            hazard[f"line_frequency{end}"].values[:] = limit
    dossier = Dossier({"": own}, pd.DataFrame(), second=Second("talus", other))
    first = next(dossier_page.answers(dossier, Designs({})))
    assert first.startswith(expected)
    assert ("rebound models differ" in first) == ("factor" in expected)


@pytest.mark.all
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_runs_that_are_done_are_not_run_again(case, tmp_path, monkeypatch):
    """The four runs of a dossier, two of them by the second model, are read from their
    checkpoints."""
    inputs = read_dossier(case.replace(variant=[]), **PLACE)
    saved = {
        run: Checkpoint(tmp_path / f"run{k}", 1e-9, keep=True) for k, run in enumerate(inputs.runs)
    }
    assert len(saved) == 4
    first = run_dossier(inputs, checkpoints=saved)
    for checkpoint in saved.values():
        assert checkpoint.found() == 600
    monkeypatch.setattr(simulate, "_run_range", None)
    again = run_dossier(inputs, checkpoints=saved)
    assert again.second.hazard.equals(first.second.hazard)


def test_a_single_model_is_said(case):
    """Compact soil without rock sizes has no second model, which is reported before the run and on
    page 1."""
    alone = case.replace(surface={"ground": "compact", "uniform_mean_radius": None},
                         impact={"sets": None}, variant=[])  # fmt: skip
    inputs = read_dossier(alone, **PLACE)
    assert inputs.second is None
    assert any("rock sizes (&surface uniform_mean_radius)" in line for line in inputs.remarks)
    assert not read_dossier(alone, one_model=True, **PLACE).remarks
    (line,) = second_answer(run_dossier(inputs))
    assert line == "Only one rebound model was run: the spread between models is not included."


def test_tables_without_sizes_of_rocks_have_the_coefficients_of_their_ground(case, tmp_path):
    """Without rock sizes, the second model has constant coefficients for talus and meadow, but not
    for compact soil."""
    zones = [shapely.box(0, y, 300, y + 150) for y in (250, 100, -50)]
    names = ["talus", "meadow", "compact"]
    make_layer(tmp_path / "zones.gpkg", zones, crs=None, ground=names)
    unsized = {"uniform_mean_radius": None, "zones": str(tmp_path / "zones.gpkg")}
    own = case.replace(surface=unsized | {"ground": "meadow"}, impact={"sets": None}, variant=[])
    model, study = read_dossier(own, **PLACE).second
    assert {*model.split(", ")} == {"constant_talus", "constant_meadow"}
    make_layer(tmp_path / "named.gpkg", zones, crs=None,
               ground=["constant_talus", "constant_meadow", "compact"])  # fmt: skip
    named = {"ground": "constant_meadow", "zones": str(tmp_path / "named.gpkg")}
    expected = rockfall.hazard(own.replace(surface=unsized | named), **PLACE)
    found = run_study(study)
    for name in ("line_frequency", "line_energy_by_period"):
        assert (found[name].values == expected[name].values).all()
        assert found[name].values.any()


def test_only_tables_of_places_are_cut():
    rows = [("one", 1), ("two", 2), ("three", 3)]
    tables = [Table.of("measures", ("", "net"), rows), Table.of("places", ("place", "net"), rows)]
    cut = dossier_page._cut(Section("variants", "", [], tables), 2)
    assert [len(table.rows) for table in cut.tables] == [3, 2] and len(cut.notes) == 1


@pytest.mark.all
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_many_houses_take_no_more_pages(case, tmp_path, monkeypatch):
    from weasyprint import HTML

    houses = [shapely.box(x, y, x + 9, y + 9) for x in range(60, 240, 30) for y in (100, 130, 160)]
    long = "Einfamilienhaus mit Einliegerwohnung an der oberen Talstrasse"
    make_layer(tmp_path / "many.gpkg", houses, crs=None, name=[f"{long} {k}" for k in range(18)])
    pages = []
    monkeypatch.setattr(dossier_page, "write_page", lambda page, _: pages.append(page))
    leave_pictures_blank(monkeypatch)
    rockfall.dossier(case, tmp_path / "out", objects=tmp_path / "many.gpkg", **PLACE)
    document = HTML(string=pages[0]).render()
    assert len(document.pages) <= 8 and "signature" in document.pages[0].anchors
    book = openpyxl.load_workbook(tmp_path / "out/dossier.xlsx")
    assert book.worksheets[1].max_row == 1 + 1 + 18  # heading, road, houses


def test_bad_input_is_refused_in_one_line_before_a_run(case, tmp_path, monkeypatch, capsys):
    with refused("return_period = 50: must be one of 10, 30, 100, 300, 1000"):
        rockfall.dossier(case, tmp_path / "new", return_period=50.0, **PLACE)
    with refused("case: a dossier needs a road or houses: give a &line, --objects or --segments"):
        rockfall.dossier(case.replace(line=[], barrier=[], variant=[]), tmp_path / "new", **PLACE)
    with refused("case: a hazard needs a &scenario: a class of boulders with its frequency"):
        rockfall.dossier(case.replace(scenario=[]), tmp_path / "new", **PLACE)
    with refused("case: &output kept = 90: a dossier needs the rows of all boulders: kept = 'all'"):
        rockfall.dossier(case.replace(output={"kept": 90}), tmp_path / "new", **PLACE)
    assert not [*tmp_path.iterdir()]


@pytest.mark.all
@pytest.mark.parametrize("is_folder", [False, True])
def test_lines_design_and_report_take_a_hazard(
    case, made, tmp_path, monkeypatch, capsys, is_folder
):
    folder, _ = made
    path = str(folder / "hazard_with net.nc")
    if is_folder:
        (tmp_path / "net").mkdir()
        shutil.copy(path, tmp_path / "net/hazard.nc")
        path = str(tmp_path / "net")
    assert main(["lines", path, "-o", str(tmp_path / "lines.csv")]) == 0
    assert "house 1" in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "lines.csv")
    assert set(table["name"]) == {"road", "net", "house 1", "house 2"}
    assert main(["design", path, "--return-period", "30", "-o", str(tmp_path / "sheet")]) == 0
    assert "once in 30 years" in capsys.readouterr().out
    loads = pd.read_csv(tmp_path / "sheet" / "design_loads.csv")
    assert loads["line"].tolist() == ["road", "net"]
    leave_pictures_blank(monkeypatch)
    assert main(["report", path, "-o", str(tmp_path / "page.html")]) == 0
    assert "house 1" in (tmp_path / "page.html").read_text()
    for words in (["lines", path, "--by", "volume"], ["design", path, "--residual", "0.1"],
                  ["report", path, "--limits", "kJ=1"]):  # fmt: skip
        assert main(words) == 2
        assert "is only valid for results OUT.nc" in capsys.readouterr().err
    write_result(rockfall.run(case.replace(variant=[]), **PLACE), tmp_path / "out.nc")
    for words in ([path, str(tmp_path / "out.nc")], [str(tmp_path / "out.nc"), path]):
        assert main(["design", *words]) == 2
        said = capsys.readouterr().err
        assert "out.nc: has no frequencies, unlike the hazard " in said
        assert ": run design for each separately" in said


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_places_of_one_name_keep_their_own_numbers(case, tmp_path):
    house, shed = HOUSES[0], shapely.box(60.0, 240.0, 240.0, 260.0)
    make_layer(tmp_path / "twins.gpkg", [house, shed], crs=None, name=["road", "road"])
    made = run_dossier(read_dossier(case, AtRisk(tmp_path / "twins.gpkg"), one_model=True, **PLACE))
    rows = made.frequencies
    rows = rows[(rows["quantity"] == "frequency") & (rows["statistic"] == "all")]
    rows = rows[rows["variant"] == "today"].set_index("line")["value"]
    hazard = made.first
    expected = [float(hazard["line_frequency"][0]), *hazard["object_frequency"].values]
    assert rows.tolist() == pytest.approx(expected, rel=1e-12)
    assert rows.index.tolist() == ["road", "road 1", "road 2"]
    assert hazard["object"].values.tolist() == ["road 1", "road 2"]
    shown = {place.k: row for place, row in zip(places_of(hazard)[1:],
             answer_table(hazard, 100.0).rows[1:], strict=True)}  # fmt: skip
    for k, row in shown.items():
        assert row[1].value == hazard["object_frequency"].values[k]


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_what_arrives_at_a_net_and_what_passes_it_have_their_own_rows(case):
    """Rows of a net have the frequencies of boulders that reach it and of those that pass it; its
    energy is that of all that reach it."""
    few = case.replace(case={"boulders": 200}, hazard={"thresholds": [30.0, 300.0]})
    made = run_dossier(read_dossier(few, one_model=True, **PLACE))
    rows = made.frequencies[made.frequencies["line"] == "net"]
    assert {*rows["place"]} == {"barrier"}
    rows = rows.set_index(["quantity", "statistic"])["value"].sort_index()
    own = variants(few)["with net"]
    came, passed = np.zeros(2), np.zeros(2)
    for scenario in few.scenario:
        boulder = {"volume_mean": scenario["volume_mean"]} if "volume_mean" in scenario else {}
        result = rockfall.run(own.replace(scenario=[], boulder=boulder), **PLACE)
        k = line_names(result).index("net")
        energy = line_values(result, "energy_total", k)
        stopped = outcomes_at(result, k) == OUTCOME["stopped"]
        for at, limit in enumerate((0.0, 300e3)):
            came[at] += scenario["frequency"] * (energy >= limit).mean()
            passed[at] += scenario["frequency"] * ((energy >= limit) & ~stopped).mean()
    assert came[0] > passed[0] > 0
    for at, statistic in enumerate(("all", "above_300")):
        assert rows["frequency", statistic] == pytest.approx(came[at], rel=1e-12)
        assert rows["frequency_behind", statistic] == pytest.approx(passed[at], rel=1e-12)
    hazard = made.hazards["with net"].sel(line="net")
    assert float(hazard["line_frequency"]) == pytest.approx(came[0], rel=1e-12)
    level = float(hazard["line_energy_by_period"].sel(event_period=100.0))
    assert rows["energy_by_period", "100"] == level > 0
    road = made.frequencies[made.frequencies["line"] == "road"]
    assert "frequency_behind" not in {*road["quantity"]}


@pytest.mark.family(2)
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    ("language", "expected"),
    [("en", "155 of 450 m lie outside"), ("fr", "1 tronçons sur 8 s'étendent au-delà du terrain")],
)
def test_places_beyond_the_terrain_are_said_on_the_pages(case, tmp_path, language, expected):
    """A third of the line (between the outermost cell centres), one of 8 road segments, and half of
    a house are outside the terrain."""
    x = [-150.0, 300.0]
    line = case.line[0] | {"x": x, "y": [200.0, 200.0]}
    few = case.replace(case={"boulders": 10}, line=[line], variant=[])
    make_layer(tmp_path / "road.gpkg", [shapely.LineString([(-20, 200), (300, 200)])], crs=None,
               width=[6.0])  # fmt: skip
    make_layer(tmp_path / "hut.gpkg", [shapely.box(-10, 150, 10, 170)], crs=None, name=["hut"])
    at_risk = AtRisk(tmp_path / "hut.gpkg", None, None, tmp_path / "road.gpkg", None, 40.0)
    made = run_dossier(read_dossier(few, at_risk, one_model=True, **PLACE))
    with speaking(language):
        said = "\n".join(dossier_page.dossier_warnings(made))
    assert expected in said and "(hut)" in said


@pytest.mark.all
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_points_without_a_width_have_the_frequencies_of_their_hazard(case, tmp_path):
    """Differences at points without a width have no interval, and are therefore undecided."""
    middle = shapely.Point(150.0, 160.0), shapely.Point(30.0, 60.0)
    make_layer(tmp_path / "masts.gpkg", [*middle], crs=None, name=["mast", "road"])
    made = run_dossier(read_dossier(case, AtRisk(tmp_path / "masts.gpkg"), one_model=True, **PLACE))
    rows = made.frequencies.set_index(["line", "variant", "statistic"]).sort_index()
    for k, line in enumerate(["mast", "road (masts)"]):
        today, net = (rows.loc[line, name] for name in made.hazards)
        for name, part in (("today", today), ("with net", net)):
            hazard = made.hazards[name]
            assert {*part["place"]} == {"object"} and {*part["quantity"]} == {"frequency"}
            for end in ("", "_low", "_high"):
                row = part.loc["all"]
                assert row[f"value{end}"] == float(hazard[f"object_frequency{end}"][k])
                row = part.loc["above_300"]
                assert row[f"value{end}"] == float(
                    hazard[f"object_exceedance_frequency{end}"].sel(threshold=300e3)[k]
                )
        apart = net.loc["all"]["value"] - today.loc["all"]["value"]
        assert net.loc["all"]["difference"] == apart and net.loc["all"]["verdict"] == "undecided"
    assert rows.loc["mast", "today", "all"]["value"] > 0


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_house_is_never_compared_with_a_net_of_its_name(case, tmp_path):
    """A net, which one variant does not have, and a house of the same name are separate rows of
    differences."""
    make_layer(tmp_path / "twins.gpkg", HOUSES, crs=None, name=["net", None])
    few = case.replace(case={"boulders": 40})
    made = run_dossier(read_dossier(few, AtRisk(tmp_path / "twins.gpkg"), one_model=True, **PLACE))
    rows = made.frequencies
    rows = rows[(rows["quantity"] == "frequency") & (rows["statistic"] == "all")]
    rows = rows.set_index(["line", "variant"])
    assert {*rows.loc["net (twins)", "place"]} == {"object"}
    for number, line in enumerate(["net (twins)", "2"]):
        own = [float(each["object_frequency"][number]) for each in made.hazards.values()]
        assert rows.loc[line]["value"].tolist() == pytest.approx(own, rel=1e-12)
        assert rows.loc[line, "with net"]["difference"] == pytest.approx(own[1] - own[0])
    assert rows.loc["net"].index.tolist() == ["with net"]
    assert rows.loc["net", "with net"]["place"] == "barrier"
    assert np.isnan(rows.loc["net", "with net"]["difference"])
