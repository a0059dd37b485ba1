# SPDX-License-Identifier: BSD-3-Clause
"""Risk of objects: sums by hand over the boulders that hit, their limits, and refusals."""

from pathlib import Path

import numpy as np
import pytest

import rockfall
import scenes
from made import make_layer, refused
from rockfall.analysis.objects.risk import layered, mean_of, risk_classes
from rockfall.analysis.objects.vulnerability import BUILDING, read_curves
from rockfall.analysis.precision.clusters import Clusters
from rockfall.analysis.precision.intervals import Sources
from rockfall.files.risk_files import class_words
from rockfall.kernel_rules import fraction_limits
from rockfall.language import LANGUAGES, speaking, translated
from rockfall.result.crossings import at_lines
from rockfall.tables.hazard import class_legend, class_number, risk_table
from rockfall.text.hazard import hazard_summary

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
pytest.importorskip("pyogrio", reason="the vector extra is not installed")

Z = scenes.rough()
GRID = scenes.grid(Z)
YEARLY, N = 0.5, 200
RELEASE = {"x": [120.0, 180.0], "y": [380.0, 385.0], "drop_height": 5.0}
HOUSE = shapely.box(110, 280, 155, 292)
ROAD = shapely.LineString([(0, 250), (300, 253)])


@pytest.fixture
def case(tmp_path):
    groups = {"release": RELEASE, "case": {"boulders": N // 2}}
    groups["boulder"] = {"volume": "normal", "volume_mean": 1.0, "volume_std": 0.4}
    case = scenes.make_case(tmp_path, *scenes.sets(2.0), **groups)
    return case.replace(scenario=[{"name": "one", "frequency": YEARLY}])


def hazard(case, shapes, **columns):
    path = make_layer(case.folder / "objects.gpkg", shapes, "EPSG:32632", **columns)
    return rockfall.hazard(case, dem=Z, transform=GRID, objects=path)


def hits(case, shape, width=0.0):
    """Energy [J] and diameter [m] of the boulders that hit an object."""
    x, y = getattr(shape, "exterior", shape).coords.xy
    line = [{"name": "o", "x": list(x), "y": list(y), "object_width": width}]
    result = rockfall.run(case.replace(line=line, scenario=[]), dem=Z, transform=GRID)
    parts = (
        at_lines(result)[f"line_energy_{kind}"].values[0]
        for kind in ("translational", "rotational")
    )
    energy = sum(parts)
    hit = np.isfinite(energy)
    return energy[hit], np.cbrt(6 * result.volume.values[hit] / np.pi)


def test_persons_in_a_house(case):
    """Individual risk is presence x lethality x frequency; collective risk is individual risk x
    persons."""
    about = {"persons": [3.0], "presence": [0.5], "lethality": [0.2]}
    found = hazard(case, [HOUSE], **about)
    k = len(hits(case, HOUSE)[0])
    assert 10 < k < N
    low, high = fraction_limits(k / N, N)
    for name, factor in (("individual_risk", 0.1), ("collective_risk", 0.3)):
        got = [float(found[f"object_{name}{end}"][0]) for end in ("", "_low", "_high")]
        assert got == pytest.approx([YEARLY * factor * one for one in (k / N, low, high)])
    assert np.isnan(found.object_damage.values[0])
    expected = risk_classes(np.array([YEARLY * 0.1 * k / N]))
    assert found.object_risk_class.values[0] == expected[0] == 4


def test_damage_of_a_building_follows_its_curve(case):
    found = hazard(case, [HOUSE], kind=["building"], value=[8e5])
    energy, _ = hits(case, HOUSE)
    by_hand = 1 - 1.358 / (1 + np.exp((energy - 129_000) / 120_300))
    by_hand = YEARLY * 8e5 * np.maximum(by_hand, 0).sum() / N
    assert float(found.object_damage[0]) == pytest.approx(by_hand, rel=1e-12)
    assert float(found.object_damage_low[0]) < by_hand < float(found.object_damage_high[0])
    assert BUILDING.fraction(np.array([0.0, 1e9])).tolist() == pytest.approx([0.0, 1.0])


def test_vehicles_on_a_road(case):
    """A block hits aadt (block diameter + vehicle length) / (24000 speed) vehicles."""
    traffic = {"aadt": [2400.0], "speed": [60.0], "vehicle_length": [4.5], "width": [6.0]}
    found = hazard(case, [ROAD], persons_per_vehicle=[1.5], lethality=[0.8], trips=[4.0], **traffic)
    _, diameter = hits(case, ROAD, 6.0)
    metres = (diameter + 4.5).sum() / N
    deaths = YEARLY * 2400 / (24_000 * 60) * metres * 1.5 * 0.8
    assert float(found.object_collective_risk[0]) == pytest.approx(deaths, rel=1e-12)
    one = YEARLY * 4 / (24_000 * 60) * metres * 0.8
    assert float(found.object_individual_risk[0]) == pytest.approx(one, rel=1e-12)


def test_sums_are_of_the_boulders_that_objects_share(case):
    about = {"persons": [2.0, 5.0], "lethality": [0.5, 0.1]}
    found = hazard(case, [HOUSE, ROAD], **about)
    parts = found.object_collective_risk.values
    assert float(found.total_collective_risk) == pytest.approx(parts.sum(), rel=1e-12)
    low, high = (float(found[f"total_collective_risk{end}"]) for end in ("_low", "_high"))
    assert found.object_collective_risk_low.values.sum() <= low + 1e-15
    assert high <= found.object_collective_risk_high.values.sum() + 1e-15
    assert low < parts.sum() < high


def test_limits_hold_the_mean_of_other_boulders():
    """At least 95 % of limits include the mean of a skewed quantity that is mostly zero. Limits of
    an indicator are Wilson's."""
    rng = np.random.default_rng(20261124)
    mean, held = 0.1 * 0.5, 0
    for _ in range(400):
        values = np.where(rng.random(300) < 0.1, rng.random(300), 0.0)
        _, low, high = mean_of(values, 1.0, Clusters(Sources.alone(values.size), 1))
        held += low <= mean <= high
    assert held >= 0.95 * 400
    found = layered(np.array([1.0]), np.array([7]), 50, 1)
    assert (found.low, found.high) == pytest.approx(fraction_limits(7 / 50, 50))


def test_no_hit_is_no_proof(case):
    far = shapely.box(5, 5, 15, 15)
    found = hazard(case, [far], persons=[1.0], lethality=[1.0])
    assert float(found.object_individual_risk[0]) == 0 < float(found.object_individual_risk_high[0])
    assert found.object_risk_class.values[0] == 0 < found.object_risk_class_upper.values[0]


def test_a_point_without_a_width_has_the_upper_end_of_its_intensity(case):
    """Only counts above thresholds are known for a point without a width: its damage errs high."""
    at, about = shapely.Point(122.5, 342.5), {"kind": ["building"], "value": [1.0]}
    usual, disc = hazard(case, [at], **about), hazard(case, [at], width=[10.0], **about)
    assert float(usual.object_damage[0]) >= float(disc.object_damage[0]) > 0
    assert "upper limit of its intensity (errs high)" in usual.attrs["risk_assumptions"]
    assert "upper end" not in disc.attrs["risk_assumptions"]


def test_every_assumption_is_printed(case):
    found = hazard(case, [HOUSE], persons=[3.0], name=["school"])
    said = hazard_summary(found)
    assert "frequencies refer to the boulders of these scenarios, not to &boulder" in said
    for text in found.attrs["risk_assumptions"].splitlines():
        assert f"  assumption: {text}" in said
    assert "assumption: default lethality = 1: school" in said
    assert "assumption: default presence = 1: school" in said
    files = {path.name for path in rockfall.write_hazard(found, case.folder / "out")}
    assert "risk.csv" in files and "objects.csv" in files
    text = (case.folder / "out" / "objects.csv").read_text()
    assert "individual_risk" in text and "collective_risk_high" in text


def test_a_layer_without_persons_has_the_risk_that_it_had(case):
    found = hazard(case, [HOUSE], vulnerability=[0.5], value=[10.0])
    assert "object_risk" in found and "object_individual_risk" not in found


CURVES = "name,energy,vulnerability,source\nown,0,0.1,A. (2020)\nown,100,0.7,A. (2020)\n"


def test_curves_of_a_table(tmp_path):
    """Damage is linear between rows, and 1 beyond the last row."""
    path = tmp_path / "curves.csv"
    path.write_text(CURVES)
    own = read_curves(path)["own"]
    assert own.fraction(1000 * np.array([0.0, 50.0, 100.0, 101.0])) == pytest.approx(
        [0.1, 0.4, 0.7, 1.0]
    )
    assert "1 above 100 kJ" in own.source and {*read_curves(None)} == {"agliardi2009"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (CURVES + "own,50,0.8,A.\n", "line 4: energy = 50: must be above that of the "
         "previous row of own"),
        (CURVES + "own,200,0.6,A.\n", "line 4: vulnerability = 0.6: must not be below that of the "
         "previous row of own"),
        (CURVES.replace("own", "agliardi2009"), "line 2: name = agliardi2009: is a curve of the "
         "package: choose another name"),
        ("name,energy,vulnerability\n",
         "column source is missing (columns: name, energy, vulnerability)"),
    ],
)  # fmt: skip
def test_curves_that_cannot_be_are_refused(tmp_path, text, message):
    path = Path(tmp_path / "curves.csv")
    path.write_text(text)
    with pytest.raises(rockfall.RockfallError) as caught:
        read_curves(path)
    assert message in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("shape", "columns", "message"),
    [
        (HOUSE, {"persons": [2.0], "aadt": [100.0]}, "aadt = 100: cannot be combined with persons"),
        (ROAD, {"aadt": [100.0], "persons_per_vehicle": [1.0]}, "aadt = 100: needs the attribute "
         "speed"),
        (shapely.Point(150, 250), {"aadt": [100.0], "speed": [50.0], "persons_per_vehicle": [1.0]},
         "aadt = 100: needs a line, a polygon, or a point with a width"),
        (HOUSE, {"persons": [1.0], "presence": [1.5]}, "presence = 1.5: must be 0 to 1"),
        (HOUSE, {"value": [1.0], "curve": ["mine"]}, "curve = mine: must be one of: "
                                                     "agliardi2009, or a curve of the "
                                                     "--vulnerability table"),
    ],
)  # fmt: skip
def test_exposures_that_cannot_be_are_refused(case, shape, columns, message):
    with refused(f"{case.folder / 'objects.gpkg'}: feature 1: {message}"):
        hazard(case, [shape], **columns)


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_interval_of_classes_is_one_of_their_numbers(language):
    """Class names are ranges, such as "1e-6 to 1e-5", so that intervals of classes are given as
    numbers. The legend explains the numbers."""
    names = class_words()

    def row(*numbers):
        keys = (f"risk_class{end}" for end in ("", "_lower", "_upper"))
        return dict(zip(keys, names[[*numbers]], strict=True))

    with speaking(language):
        assert translated(class_number(row(2, 1, 3))) == "2\n(1–3)"
        assert translated(class_number(row(4, 4, 4))) == "4"
        legend = translated(class_legend())
    ends = [legend.index(f"{k} ") for k in (0, 1, 2, 3, 4)]
    assert ends == sorted(ends) and all(end in legend for end in ("1e-6", "1e-5", "1e-4"))
    assert risk_classes(np.array([0.0, 5e-7, 5e-6, 5e-5, 5e-4])).tolist() == [0, 1, 2, 3, 4]


def test_the_table_of_risks_is_in_the_language_of_the_command(case):
    found = hazard(case, [HOUSE], persons=[3.0], presence=[0.5], lethality=[0.2])
    table = risk_table(found)
    row, total = table.texts()
    assert table.head[0] == "risk per year (95 %)" and table.head[3] == "class" and row[3] == "4"
    assert total[0] == "all objects" and f"\n  {class_legend()}\n" in hazard_summary(found)
    assert "\n(" in total[-1]
    with speaking("de"):
        table = risk_table(found)
        _, total = table.texts()
    assert table.head[3] == "Klasse" and total[0].endswith("Objekte") and "," in total[-1]
