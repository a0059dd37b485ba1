# SPDX-License-Identifier: BSD-3-Clause
"""Figures of a hazard: zones, uncertain classes, intensities, objects."""

import re
from itertools import pairwise

import numpy as np
import pytest

import rockfall
from made import every_third, make_layer
from rockfall.analysis.hazard.zones import zones_of
from rockfall.language import say, speaking
from rockfall.plots.cartography import relief
from rockfall.plots.cartography.sheet import INCH
from rockfall.plots.hazard.hazard_figures import hazard_figures
from rockfall.plots.hazard.hazard_sheet import (
    HIGH,
    MARGIN,
    WIDE,
    Imprint,
    hazard_sheet,
    warning_pages,
)
from scenes import grid, make_case, rough, sets

shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
pytest.importorskip("matplotlib", reason="the report extra is not installed").use("Agg")

Z = rough()
TERRAIN = (Z, grid(Z))
HOUSE, POLE = shapely.box(140, 280, 155, 292), shapely.Point(100, 300)
ROAD = shapely.MultiLineString([[(0, 250), (300, 253)], [(0, 240), (100, 240)]])


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hazard")
    path = make_layer(folder / "o.gpkg", [HOUSE, ROAD, POLE], name=["$5", "road", "pole"])
    case = make_case(folder, *sets(2.0), release={"x": [120.0, 180.0], "y": 380.0 * np.ones(2)})
    case = case.replace(scenario=[{"name": "a", "frequency": 0.2}])
    return rockfall.hazard(case, objects=path, dem=Z, transform=TERRAIN[1])


def images(figure):
    return [image for image in figure.axes[0].images if image.get_cmap().name != "gray"]


def test_there_is_one_of_zones_and_one_for_each_period(found):
    shown = hazard_figures(found, TERRAIN)
    names = ["hazard_class", *(f"intensity_{years}years" for years in (30, 100, 300))]
    assert [one.name for one in shown] == names
    for one in shown:
        assert one.title and one.caption.endswith(".")
        figure = one.draw()
        figure.draw_without_rendering()
        assert 25.4 * figure.get_figwidth() in (pytest.approx(90), pytest.approx(180))
        texts = {text.get_text() for text in figure.axes[0].texts}
        assert {r"\$5", "road", "pole"} <= texts
        objects = [line for line in figure.axes[0].lines if line.get_color() != relief.BROWN]
        assert len(objects) == 4  # a house, two parts of a road, a pole


def test_zones_are_drawn_as_they_are(found):
    """Each class has a patch, and the cells with an uncertain class have a hatched patch."""
    zones = zones_of(found)
    *classes, doubtful = hazard_figures(found)[0].draw().axes[0].patches
    assert len(classes) == len(np.unique(zones.number)) and doubtful.get_hatch()
    drawn = sum(area_of(one) for one in classes)
    assert drawn == pytest.approx(shapely.area(zones.shapes).sum())
    uncertain = (found.hazard_class_certain.values == 0).sum()
    assert area_of(doubtful) == pytest.approx(25.0 * uncertain)


def area_of(patch):
    rings = [shapely.LinearRing(ring) for ring in patch.get_path().to_polygons()]
    return abs(sum(shapely.Polygon(r).area * (1 if r.is_ccw else -1) for r in rings))


def test_intensities_are_drawn_as_they_are(found):
    for period, one in zip(found.intensity.values, hazard_figures(found)[1:], strict=True):
        (image,) = images(one.draw())
        shown = np.ma.filled(image.get_array(), 0)[::-1]  # south is first in the image
        assert np.array_equal(shown, period)


# ---- sheet


@pytest.mark.parametrize("language", every_third(["en", "de", "fr", "it"]))
def test_the_sheet_says_what_the_zones_mean_and_fits_on_a3(found, language):
    imprint = Imprint("No. 12", "the canton", "A. Engineer")
    many = [
        f"warning {k}: {'boulders are faster than any that was observed; ' * 9}end {k}"
        for k in range(9)
    ]
    with speaking(language):
        figure = hazard_sheet(found, TERRAIN, imprint, many)
        scenario = say("join.colon", before="a", after="0")
    figure.draw_without_rendering()
    assert figure.get_size_inches() == pytest.approx([420 / 25.4, 297 / 25.4])
    texts = [text.get_text() for text in figure.texts]
    for part in ("No. 12", "the canton", "A. Engineer", "300", scenario, "warning 0", "(A3)"):
        assert any(part in text for text in texts), part
    shown = "\n".join(texts)
    assert shown.count("warning ") == shown.count("end ") < 9  # no warning is cut
    with speaking(language):
        assert say("sheet.warnings", n=9) in texts
    within = figure.bbox.padded(-0.9 * MARGIN * figure.dpi)
    for text in figure.texts:  # inside the paper; in the title block inside its frame
        box = text.get_window_extent()
        assert box.x0 >= 0 and box.y0 >= 0
        assert box.x1 <= within.x1 and box.y1 <= figure.bbox.y1, text.get_text()
        if box.x0 > figure.dpi * (WIDE - 110 / 25.4):
            assert box.y0 >= within.y0, text.get_text()


@pytest.mark.parametrize("n", [2, 40])
def test_pages_after_the_sheet_have_all_warnings_in_full(found, n):
    """Warnings of scenarios start with their names, and fit on the pages whatever their number and
    length."""
    groups = [
        (
            names,
            [f"warning {k}: {'the numbers err low; ' * (400 if k == 1 else 30)}end" for k in k_of],
        )
        for names, k_of in (("", range(n)), ("blocks; rare", range(n, n + 2)))
    ]
    pages = warning_pages(found, groups)
    assert (len(pages) > 1) == (n == 40)
    read = []
    for number, page in enumerate(pages, start=2):
        page.draw_without_rendering()
        ends = {}  # columns, by their left edges
        for k, text in enumerate(page.texts):
            box = text.get_window_extent()
            assert box.x0 >= 0 and box.y0 >= 0.9 * MARGIN * page.dpi
            assert box.x1 <= page.bbox.x1 and box.y1 <= page.bbox.y1
            if k >= 3:  # below the headings
                left = round(box.x0 / page.dpi)
                ends[left] = max(ends.get(left, 0), box.x1 / page.dpi)
        assert all(ends[left] < right for left, right in pairwise(sorted(ends)))
        texts = [text.get_text() for text in page.texts]
        assert f"page {number}" in texts
        read += texts[3:]
    assert " ".join(read) == " ".join(
        " ".join([names or "all scenarios", *texts]) for names, texts in groups
    )
    assert warning_pages(found, []) == []


def test_the_sheet_names_what_was_read_and_followed(found, tmp_path):
    """The sheet lists the grounds that rebounds followed, not the default sets of a case."""
    shown = [text.get_text() for text in hazard_sheet(found).texts]
    whole = re.sub(r"\s+", " ", " ".join(shown))
    assert "frequencies refer to the boulders of these scenarios, not to &boulder" in whole
    assert f"rebounds: impact sets {found.attrs['impact_set']}" in shown
    case = make_case(tmp_path, *sets(), release={"x": [150.0], "y": [380.0]})
    case = case.replace(
        scenario=[{"name": "a", "frequency": 0.2}, {"name": "b", "frequency": 0.1}],
        impact={"form": "table", "table": "talus", "sets": None},
        surface={"zones": "given", "table": "zones.csv", "uniform_mean_radius": None},
    )
    (tmp_path / "zones.csv").write_text("zone,mean_radius,ground\n1,0.2,\n2,0.2,meadow\n")
    zones = np.where(np.arange(Z.shape[0]) < Z.shape[0] // 2, 1, 2)[:, None]
    zones = zones + np.zeros(Z.shape, int)
    study = rockfall.hazard(case, dem=Z, transform=TERRAIN[1], zones=zones)
    assert int(study.rebounds_by_ground.sum()) > 0 and study.ground.values.tolist()
    shown = "\n".join(text.get_text() for text in hazard_sheet(study).texts)
    assert "zones.csv\nrebounds: " in shown
    for name in ("talus", "meadow"):
        assert f"{name} (impact table) " in shown
    assert "rocky-slope" not in shown and "Bourrier" not in shown
    assert f"rockfall {rockfall.__version__}, impact tables of rockfall's laboratory" in shown


def test_the_map_on_the_sheet_has_its_scale(found):
    figure = hazard_sheet(found, TERRAIN)
    (said,) = (text.get_text() for text in figure.texts if text.get_text().endswith("(A3)"))
    axes = figure.axes[0]
    metres = axes.get_xlim()[1] - axes.get_xlim()[0]
    scale = metres / INCH / (axes.get_position().width * WIDE)
    assert said == f"1:{scale:,.0f} (A3)"
    metres = axes.get_ylim()[1] - axes.get_ylim()[0]
    assert metres / INCH / (axes.get_position().height * HIGH) == pytest.approx(scale)
