# SPDX-License-Identifier: BSD-3-Clause
"""A project from four layers to the dossier, with a user's commands: each table equals a
calculation by hand from the boulders of the runs and from the result files."""

import csv
import hashlib
import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rockfall
from made import PLACE, UTM, leave_pictures_blank, make_layer, make_raster
from rockfall.cli import main
from rockfall.files.hazard_files import read_hazard
from rockfall.html_report import dossier_page
from rockfall.studies.dossier import Dossier
from rockfall.tables.dossier import remaining_tables
from rockfall.tables.hazard import risk_table

for package in ("weasyprint", "docx", "matplotlib", "jinja2"):
    pytest.importorskip(package, reason="an extra is not installed")
openpyxl = pytest.importorskip("openpyxl", reason="the office extra is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

NX, NY, CELL, WEST, NORTH = 50, 80, 5.0, PLACE.c, PLACE.f
PERIODS = (10, 30, 100, 300, 1000)  # [years]
SCENARIOS = {"stones": (0.1, 0.02, 0.2), "blocks": (0.02, 0.2, 1.0)}  # per year, from and to [m3]
BOULDERS, DENSITY = 300, 2700.0
NET = {"height": 3.0, "capacity": 250.0}  # [m], [kJ]
CLASSES = (100, 250, 500, 1000, 1500, 2000, 3000, 4500)  # EAD 340059 [kJ]
CLOSE = 1e-7  # relative tolerance: limits use a rounded 97.5 % quantile
LAMBDA = 0.2, 0.8, 0.5  # lethality, presence, vulnerability of the houses
HOUSES = {"house A": (4.0, 300e3), "house B": (2.0, 500e3)}  # persons, value
STEP, ROAD = 80.0, ((WEST + 5, NORTH - 300), (WEST + 245, NORTH - 306))  # of segments [m]; ends
SECOND = {"talus": "constant_talus", "meadow": "constant_meadow"}  # grounds of the second model
OTHER = ("residual", "low", "moderate", "high")
MATRIX = (("moderate", "low", "low"), ("high", "moderate", "moderate"), ("high",) * 3)


def below(y):
    return NORTH - y


def site(folder):
    """Write layers of a site: a cliff of 60 degrees above a slope of 38 degrees and a flat,
    grounds, road, net, houses. Return the shapes of the houses."""
    south = (np.arange(NY) + 0.5) * CELL
    z = np.interp(south, [0, 40, 80, 320, 400], [1270, 1260, 1190, 1003, 1000])
    waves = 0.4 * np.sin(np.arange(NX) / 3)[None, :] * np.cos(np.arange(NY) / 4)[:, None]
    make_raster(folder / "dem.tif", z[:, None] + waves)
    at = WEST + 120, WEST + 150
    layers = {
        "cliff": ([shapely.box(WEST + 90, below(78), WEST + 160, below(45))], {"name": ["wall"]}),
        "ground": (
            [shapely.box(WEST, below(320), WEST + 250, below(0)),
             shapely.box(WEST, below(400), WEST + 250, below(320))],
            {"name": ["slope", "flat"], "ground": ["talus", "meadow"]},
        ),
        "road": (
            [shapely.LineString(ROAD)], {"name": ["road"]},
        ),
        "net": (
            [shapely.LineString([(WEST + 60, below(250)), (WEST + 190, below(250))])],
            {"name": ["net"]} | {key: [value] for key, value in NET.items()},
        ),
    }  # fmt: skip
    for name, (shapes, columns) in layers.items():
        make_layer(folder / "site.gpkg", shapes, UTM, name, **columns)
    shapes = [shapely.box(x, below(326), x + 12, below(314)) for x in at]
    lethality, presence, vulnerability = ([value] * 2 for value in LAMBDA)
    make_layer(
        folder / "houses.gpkg", shapes, UTM, name=[*HOUSES], lethality=lethality,
        presence=presence, vulnerability=vulnerability,
        persons=[persons for persons, _ in HOUSES.values()],
        value=[value for _, value in HOUSES.values()],
    )  # fmt: skip
    make_layer(folder / "axis.gpkg", [shapely.LineString(ROAD)], UTM, name=["way"], width=[0.0])
    return shapes


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Project folder after `new`, manual edits, `check` and `dossier`, and the shapes of the
    houses."""
    folder = tmp_path_factory.mktemp("project")
    shapes = site(folder)
    names = {name: str(folder / name) for name in ("dem.tif", "site.gpkg", "case.nml")}
    assert main(["new", names["dem.tif"], names["site.gpkg"], "-o", names["case.nml"]]) == 0
    path = folder / "case.nml"
    text = re.sub(r"boulders_total = \d+", f"boulders_total = {BOULDERS}", path.read_text())
    text = text.replace("density = 2800.0", f"density = {DENSITY}")
    for name, (rate, low, high) in SCENARIOS.items():
        text += f"&scenario name = '{name}', frequency = {rate}, volume = 'uniform', "
        text += f"volume_min = {low}, volume_max = {high} /\n"
    text += "&variant name = 'today', without = 'barrier' /\n"
    text += "&variant name = 'with net', cost = 120000.0 /\n"
    path.write_text(text)
    assert main(["check", names["case.nml"], "--variant", "with net"]) == 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dossier_page, "write_page", lambda page, path: Path(path).write_text(page))
        patch.setattr(dossier_page, "is_pdf", lambda _: False)  # typeset in test_dossier.py
        leave_pictures_blank(patch)
        words = ["dossier", names["case.nml"], "-o", str(folder / "dossier"), "--quiet"]
        words += ["--objects", str(folder / "houses.gpkg"), "--author", "A. Muster"]
        words += ["--segments", str(folder / "axis.gpkg"), "--segment-length", f"{STEP}"]
        assert main(words) == 0
    return folder, shapes


@pytest.fixture(scope="module")
def sheets(project):
    """Rows of each sheet of the workbook, by number of the sheet."""
    book = openpyxl.load_workbook(project[0] / "dossier/dossier.xlsx")
    return [[*sheet.iter_rows(values_only=True)] for sheet in book.worksheets]


@pytest.fixture(scope="module")
def boulders(project):
    """Crossings at each place, by variant and scenario; `second` has the other rebound model."""
    folder, shapes = project
    cases = rockfall.variants(rockfall.read_case(folder / "case.nml"))
    grounds = (folder / "case_zones.csv").read_text()
    for name, other in SECOND.items():
        grounds = grounds.replace(f",{name},", f",{other},")
    (folder / "second.csv").write_text(grounds)
    cases["second"] = cases["today"].replace(surface={"table": "second.csv"})
    return {name: {own: run(case, own, shapes) for own in SCENARIOS}
            for name, case in cases.items()}  # fmt: skip


def pieces():
    """Ends of the segments of the road, by their names."""
    start, end = np.array(ROAD)
    length = math.dist(start, end)
    edges = [*np.arange(0, length - STEP / 2, STEP), length]
    return {
        f"way, {low:.1f} to {high:.1f} m".replace(".0", ""):
            [start + (end - start) * edge / length for edge in (low, high)]
        for low, high in zip(edges, edges[1:], strict=False)
    }  # fmt: skip


def run(case, scenario, shapes):
    """Boulder, energy [kJ] and height [m] of each crossing by place, and under `touches` the number
    of boulders whose path in plan touches each house."""
    _, low, high = SCENARIOS[scenario]
    lines = [
        {"name": name, "x": list(x), "y": list(y), "object_width": 0.0}
        for name, shape in zip(HOUSES, shapes, strict=True)
        for x, y in [shape.exterior.xy]
    ]
    for name, ends in pieces().items():
        x, y = np.array(ends).T.tolist()
        lines.append({"name": name, "x": x, "y": y, "object_width": 0.0})
    law = {"volume": "uniform", "volume_mean": None, "volume_min": low, "volume_max": high}
    alone = case.replace(scenario=[], boulder=law, output={"trajectories": BOULDERS})
    roads = [{"file": "site.gpkg", "layer": "road", "field": "name"}]
    result = rockfall.run(alone.replace(line=[*roads, *lines]))
    mass, volume = result["mass"].values, result["volume"].values
    inertia = 0.4 * mass * (3 * volume / (4 * np.pi)) ** (2 / 3)
    k = result["crossing_boulder"].values - result["boulder"].values[0]
    speed = sum(result[f"crossing_velocity_{axis}"].values ** 2 for axis in "xyz")
    energy = 0.5e-3 * (mass[k] * speed + inertia[k] * result["crossing_omega"].values ** 2)
    height = result["crossing_passing_height"].values
    names = np.array([str(name) for name in result["line_name"].values])
    line = names[np.searchsorted(result["line"].values, result["crossing_line"].values)]
    at = {name: tuple(values[line == name] for values in (k, energy, height)) for name in names}
    return at | {"touches": touched(result, shapes, (3 * volume / (4 * np.pi)) ** (1 / 3))}


def touched(result, shapes, radius):
    """Number of boulders whose path in plan, straight between contacts, comes within their radius
    of each shape."""
    owner = result["trajectory_boulder"].values
    x, y = result["trajectory_x"].values, result["trajectory_y"].values
    paths = [np.column_stack([x[owner == b], y[owner == b]]) for b in np.unique(owner)]
    return [
        sum(shape.distance(shapely.LineString(path)) <= radius[b] for b, path in enumerate(paths))
        for shape in shapes
    ]


def wilson(k, n, z=1.959963984540054):
    middle, wide = k + z * z / 2, z * math.sqrt(k * (n - k) / n + z * z / 4)
    return (middle - wide) / (n + z * z), (middle + wide) / (n + z * z)


def rates(counts):
    """Boulders per year and limits, from the number of boulders in each scenario."""
    three = [(k / BOULDERS, *wilson(k, BOULDERS)) for k in counts]
    yearly = [rate for rate, _, _ in SCENARIOS.values()]
    return [sum(rate * ends[i] for rate, ends in zip(yearly, three, strict=True)) for i in range(3)]


def count(at, place, test):
    """Number of boulders, in each scenario, with a crossing at a place whose energy and height pass
    `test`."""
    crossings = (at[name][place] for name in SCENARIOS)
    return [np.unique(boulder[test(*own)]).size for boulder, *own in crossings]


def reached(boulders, place, index, least):
    """Number of boulders today, in each scenario, with more energy (index 0) or height (index 1)
    than `least`."""
    return count(boulders["today"], place, lambda *own: own[index] > least)


def table(sheets, words):
    """Rows of the table whose caption contains `words`, by their first cell."""
    (number,) = [int(row[0]) for row in sheets[0] if row[0] and words in row[1]]
    return {row[0]: row[1:] for row in sheets[number][1:]}


@pytest.mark.all
def test_frequencies_and_return_periods_of_page_1(sheets, boulders):
    """Road and houses have the frequencies and return periods of the hand calculation, also by
    variant. Houses also have those of hits in plan, and above 30 and 300 kJ."""
    rows, by_variant = table(sheets, "at each place"), table(sheets, "year, by variant")
    objects = table(sheets, "Objects")
    for place in ("road", *HOUSES):
        expected = rates(count(boulders["today"], place, lambda energy, _: energy >= 0))
        assert rows[place][:3] == pytest.approx(expected, rel=CLOSE)
        years = [1 / expected[0], 1 / expected[2], 1 / expected[1]]
        assert rows[place][3:6] == pytest.approx(years, rel=CLOSE)
        assert by_variant[place][:3] == pytest.approx(expected, rel=CLOSE)
        net = rates(count(boulders["with net"], place, lambda energy, _: energy >= 0))
        assert by_variant[place][3:6] == pytest.approx(net, rel=CLOSE)
    for number, house in enumerate(HOUSES):
        counts = [boulders["today"][name]["touches"][number] for name in SCENARIOS]
        assert rows[house][:3] == pytest.approx(rates(counts), rel=CLOSE)
        for k, least in enumerate((-1, 30, 300)):
            counts = count(boulders["today"], house, lambda energy, _, least=least: energy > least)
            found = objects[house][3 * k : 3 * k + 3]
            assert found == pytest.approx(rates(counts), rel=CLOSE)


def test_levels_by_return_period(sheets, boulders, project):
    """Boulders above a level are as frequent as its return period requires, to within the steps of
    levels in a result."""
    hazard = read_hazard(project[0] / "dossier/hazard_today.nc")
    for words, (name, unit, index) in {
        "[kJ] reached once per": ("energy", 1e-3, 0), "Height [m]": ("height", 1.0, 1),
    }.items():  # fmt: skip
        steps = hazard[f"exceeded_{name}"].values * unit
        for place, row in table(sheets, words).items():
            for k, period in enumerate(PERIODS):
                level = row[3 * k]
                at = int(np.searchsorted(steps, level))
                ends = steps[at - 1] if at else -1, steps[min(at, len(steps) - 1)]
                above = [rates(reached(boulders, place, index, end))[0] for end in ends]
                assert (above[0] >= 1 / period * (1 - 1e-9)) or level == 0
                assert above[1] <= 1 / period * (1 + 1e-9)
    sentences = {row[1] for row in sheets[0] if not row[0]}
    rows = [
        row
        for words in ("[kJ] reached once per", "Height [m]")
        for row in table(sheets, words).values()
    ]
    limits = [row[k + 1 : k + 3] for row in rows for k in range(0, 15, 3)]
    is_open = any(low is not None and high is None for low, high in limits)
    assert ("A single limit: too few boulders pass for the other." in sentences) == is_open
    assert is_open
    first = table(sheets, "at each place")
    for words, columns in {
        "[kJ] reached once per": slice(6, 9),
        "Height [m]": slice(9, 12),
    }.items():
        for place, row in table(sheets, words).items():
            assert [*first[place][columns]] == [*row[6:9]]
    by_variant = table(sheets, "reached once in 100 years, by variant")
    assert {place: row[:3] for place, row in by_variant.items()} == {
        place: row[6:9] for place, row in table(sheets, "[kJ] reached once per").items()
    }


def test_barriers(sheets, boulders):
    """A boulder passes a barrier if it is above the top or has more energy than the capacity."""

    def behind(height, capacity):
        return rates(count(boulders["today"], "road", lambda e, h: (h > height) | (e > capacity)))

    rows = table(sheets, "smallest barrier")
    assert [row[0] for row in rows.values()] == [*CLASSES]
    assert sum(row[8] == "suffices" for row in rows.values()) == 1
    for capacity, height, *numbers in (row[:8] for row in rows.values()):
        through = rates(count(boulders["today"], "road", lambda e, _, c=capacity: e > c))
        assert numbers[3:] == pytest.approx(through, rel=CLOSE)
        if height is None:
            assert behind(10.0, capacity)[2] > 0.01
            continue
        assert numbers[:3] == pytest.approx(behind(height, capacity), rel=CLOSE)
        assert behind(height, capacity)[2] <= 0.01
        lower = [h for h in np.arange(0.5, height, 0.5) if behind(h, capacity)[2] <= 0.01]
        assert lower == []
    loads, first = (
        table(sheets, "Boulders that reach lines")["road"],
        table(sheets, "at each place")["road"],
    )
    assert [*loads] == [*first[:3], *first[6:12]]


def test_barriers_of_the_case(sheets, project):
    """Boulders that reach the net of the case, and those that pass it, are as frequent as in a
    separate run."""
    case = rockfall.variants(rockfall.read_case(project[0] / "case.nml"))["with net"]
    come, passed = [], []
    for _, low, high in SCENARIOS.values():
        law = {"volume": "uniform", "volume_mean": None, "volume_min": low, "volume_max": high}
        result = rockfall.run(case.replace(scenario=[], boulder=law))
        net = result["line"].values[[str(name) for name in result["line_name"].values].index("net")]
        here = result["crossing_line"].values == net
        owner = result["crossing_boulder"].values[here]
        come.append(np.unique(owner).size)
        words = result["status"].attrs["flag_meanings"].split()
        stopped = result["status"].values == words.index("stopped_by_barrier") + 1
        passed.append(come[-1] - np.count_nonzero(stopped))
    row = table(sheets, "Barriers of the case")["net"]
    assert row[:2] == (NET["height"], NET["capacity"])
    assert row[2:5] == pytest.approx(rates(come), rel=CLOSE)
    assert row[5:8] == pytest.approx(rates(passed), rel=CLOSE)
    assert row[8] == ("yes" if row[7] <= 0.01 else "no" if row[6] > 0.01 else "undecided")


def class_of(f):
    """Hazard class, by the default matrix, from the frequencies of hits, of hits above 30 kJ, and
    above 300 kJ."""
    found = ["residual"]
    for k, period in enumerate((30, 100, 300)):
        intensity = max((i for i in range(3) if f[i] >= 1 / period), default=None)
        if intensity is not None:
            found.append(MATRIX[intensity][k])
    return max(found, key=OTHER.index)


def test_classes_and_risks_of_houses(sheets):
    rows, risks = table(sheets, "Objects"), table(sheets, "individual risk")
    lethality, presence, vulnerability = LAMBDA
    deaths = damage = 0.0
    for house, (persons, value) in HOUSES.items():
        frequencies = rows[house][0:9:3]
        assert rows[house][9].split("\n")[0] == class_of(frequencies)
        individual = frequencies[0] * lethality * presence
        assert risks[house][0] == pytest.approx(frequencies[0] * value * vulnerability, rel=CLOSE)
        fixed = {3: 1.0, 7: persons}  # columns of individual and collective risk
        for column, times in fixed.items():
            hits = [rows[house][k] * lethality * presence * times for k in range(3)]
            assert risks[house][column : column + 3] == pytest.approx(hits, rel=CLOSE)
        deaths, damage = deaths + persons * individual, damage + risks[house][0]
        assert int(risks[house][6]) == int(np.searchsorted([0, 1e-6, 1e-5, 1e-4], individual))
    remaining = table(sheets, "Remaining hazard")["today"]
    assert remaining[1] == pytest.approx(damage, rel=CLOSE)
    assert remaining[4] == pytest.approx(deaths, rel=CLOSE)
    assert remaining[7] == max(risks[house][3] for house in HOUSES)
    rows |= table(sheets, "Road segments")
    assert remaining[0] == max((class_of(row[0:9:3]) for row in rows.values()), key=OTHER.index)


def test_what_no_object_has_is_not_zero(project):
    """Damage is unknown without values or vulnerabilities, deaths without persons: the tables have
    "-"."""
    hazard = read_hazard(project[0] / "dossier/hazard_today.nc")
    for what, column in {"damage": 2, "collective_risk": 3}.items():
        without = hazard.assign({f"object_{what}": hazard[f"object_{what}"] * np.nan})
        (remaining,) = remaining_tables(Dossier({"": without}, pd.DataFrame()))
        (row,) = remaining.texts()
        *_, last = risk_table(without).texts()
        assert row[column] == "-" != row[5 - column]
        assert last[1 if column == 2 else 4] == "-"


def test_variants_and_their_differences(sheets, project):
    rows = table(sheets, "year, by variant")
    measures = table(sheets, "Variants")
    assert measures["nets and walls"] == ("-", "net: 3 m, 250 kJ")
    assert measures["cost"] == ("-", "120,000")
    assert [table(sheets, "Remaining hazard")[name][-1] for name in ("today", "with net")] == [
        "-", 120000,
    ]  # fmt: skip
    for place, (_, net) in (
        (place, row) for place, row in table(sheets, "difference from the first").items()
    ):
        if place in rows:
            number, difference = net.split("\n")[:2]
            assert float(number) == pytest.approx(rows[place][3], rel=6e-3, abs=1e-6)
            apart = rows[place][3] - rows[place][0]
            assert float(difference.rstrip(" ?")) == pytest.approx(apart, rel=6e-3, abs=1e-6)
    with open(project[0] / "dossier/frequencies.csv", encoding="utf-8") as file:
        csv_rows = [row for row in csv.DictReader(file) if row["statistic"] == "all"]
    for row in csv_rows:
        if row["line"] in rows:
            at = 0 if row["variant"] == "today" else 3
            assert float(row["value"]) == pytest.approx(rows[row["line"]][at], rel=CLOSE)


def test_scenarios_areas_and_files(sheets, project):
    folder, _ = project
    for name, row in table(sheets, "Scenarios").items():
        rate = SCENARIOS[name][0]
        assert row[:3] == pytest.approx((rate, 1 / rate, BOULDERS))
        _, low, high = SCENARIOS[name]
        drawn = [float(number) for number in re.findall(r"[0-9.]+", row[3])]  # min, max, mean
        assert low <= drawn[0] < drawn[2] < drawn[1] <= high
        assert row[4] == f"{DENSITY:,.0f}"
    hazard = read_hazard(folder / "dossier/hazard_today.nc")
    classes = hazard["hazard_class"].values
    certain = hazard["hazard_class_certain"].values == 1
    for name, (cells, area, share) in table(sheets, "Hazard classes").items():
        here = classes == OTHER.index(name) + 1
        assert cells == np.count_nonzero(here) and area == cells * CELL**2
        fraction = np.count_nonzero(here & certain) / cells
        assert float(share.split()[0]) == pytest.approx(100 * fraction, abs=0.06)
    sums = {cell for row in sheets[-1] for cell in row if cell and ": " in str(cell)}
    for file, key in {"dem.tif": "dem", "case_zones.csv": "table"}.items():
        digest = hashlib.sha256((folder / file).read_bytes()).hexdigest()
        assert f"{key}: {digest}" in sums


def test_segments(sheets, boulders):
    """Segments have frequencies, a class, and a 95 % quantile of energy. None is hit more often
    than the road; together they are hit at least as often."""
    rows, today = table(sheets, "Road segments"), boulders["today"]
    assert {*rows} == {*pieces()}
    for name, row in rows.items():
        for k, least in enumerate((-1, 30, 300)):
            counts = count(today, name, lambda energy, _, least=least: energy > least)
            assert row[3 * k : 3 * k + 3] == pytest.approx(rates(counts), rel=CLOSE)
        assert row[9].split("\n")[0] == class_of(row[0:9:3])
        energies = [pd.Series(at[name][1]).groupby(at[name][0]).max() for at in today.values()]
        weights = [rate for rate, _, _ in SCENARIOS.values()]
        assert row[10] == pytest.approx(weighted_q95(energies, weights), rel=CLOSE)
    hits = (np.concatenate([at[name][0] for name in rows]) for at in today.values())
    once = [np.unique(boulder).size for boulder in hits]
    assert sum(row[0] for row in rows.values()) >= rates(once)[0] * (1 - CLOSE)
    assert max(row[0] for row in rows.values()) <= rates(once)[0]


def weighted_q95(energies, weights):
    """95 % quantile, by Hazen's rule, of boulders' maximum energies, weighted by scenario."""
    each = sorted((own, weight) for of, weight in zip(energies, weights, strict=True) for own in of)
    values, weight = np.array(each).T
    return np.interp(0.95, (np.cumsum(weight) - weight / 2) / weight.sum(), values)


def test_the_second_model(sheets, boulders):
    """The table has the frequency of each place on other grounds, and the model that governs."""
    (head,) = [row[1] for row in sheets[0] if row[0] and "other rebound model" in row[1]]
    assert all(ground in head for ground in SECOND.values())
    for place in ("road", *HOUSES):
        row = table(sheets, "other rebound model")[place]
        for k, name in enumerate(("today", "second")):
            counts = count(boulders[name], place, lambda energy, _: energy >= 0)
            assert row[3 * k : 3 * k + 3] == pytest.approx(rates(counts), rel=CLOSE)
        first = table(sheets, "at each place")[place]
        assert row[6:9] == first[6:9] and row[12:15] == first[9:12]
        by_second = row[3] > row[0], row[9] > row[6], row[15] > row[12]
        case, other = by_second.count(False), by_second.count(True)
        assert ("the case" in row[18]) == (case > 0)
        assert ("constant" in row[18]) == (other > 0)


def test_class_of_the_road(sheets, project):
    """The class is the highest of the map cells that the line crosses."""
    classes = read_hazard(project[0] / "dossier/hazard_today.nc")["hazard_class"].values
    line, n = shapely.LineString(ROAD), classes.shape
    crossed = [
        classes[row, column]
        for row, column in np.ndindex(*n)
        if shapely.box(WEST + column * CELL, NORTH - (row + 1) * CELL,
                       WEST + (column + 1) * CELL, NORTH - row * CELL).intersection(line).length > 1
    ]  # fmt: skip
    road = table(sheets, "at each place")["road"]
    assert road[12].split("\n")[0] == OTHER[max(crossed) - 1]
