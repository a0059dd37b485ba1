# SPDX-License-Identifier: BSD-3-Clause
"""Commands with two input files refuse files that do not belong together, in one line and without
writing; variants of a site are accepted."""

import re
from pathlib import Path

import numpy as np
import pytest
from affine import Affine

from made import PLACE, make_raster
from programs import everything, refuses
from rockfall.cli import main
from rockfall.studies.models import read_models
from slope_case import CASE, slope, zones

pytest.importorskip("matplotlib", reason="the report extra is not installed")

ON_GROUND = CASE.replace("table = 'zones.csv'", "table = 'zones.csv', ground = 'soil_4'")
SCENARIOS = "&scenario name = 'small', frequency = 3.0, volume_mean = 0.1 /\n"
OBSERVED = "line,quantity,unit,mean\nL,speed,m/s,12.0\n"
pytestmark = pytest.mark.usefixtures("blank_figures")


def run(text, name):
    Path("case.nml").write_text(text)
    assert main(["run", "case.nml", "-o", name, "--quiet", "--overwrite"]) == 0
    return name


def elsewhere(transform=None, crs="EPSG:32632", steeper=0.0):
    """Write another DEM for the next run, and zones on its cells."""
    z = slope() + steeper * np.arange(slope().shape[0])[::-1, None]
    place = {} if transform is None else {"transform": transform}
    make_raster("dem.tif", z.astype("f4"), nodata=-9999, crs=crs, **place)
    make_raster("zones.tif", zones(), nodata=-9999, crs=crs, **place)


OTHERS = {  # changes between the result and the hazard or models, and the message
    "nothing": ("", "", None),
    "seed, boulders, lines' outputs": ("seed = 7", "seed = 8", None),
    "stop speed": ("&impact", "&impact stop_speed = 0.3,", "different &impact stop_speed"),
    "drop height": ("drop_height = 2.0", "drop_height = 3.0", "different &release drop_height"),
    "sets": ("sets = 'sets.nml'", "sets = 'laboratory-spheres'", "different impact sets"),
    "place": ("x = 600060.0", "x = 600050.0", "different &release x"),
    "trees": ("&output", "&forest uniform_stems = 9.0, uniform_dbh_mean = 30.0, uniform_dbh_std ="
              " 1.0, uniform_conifers = 9.0 /\n&output", "different trees"),
}  # fmt: skip


@pytest.mark.all
@pytest.mark.parametrize("what", ["hazard", "models"])
@pytest.mark.parametrize("change", OTHERS)
def test_a_report_takes_hazard_and_models_of_its_own_case_only(place, capsys, what, change):
    if what == "hazard":
        pytest.importorskip("shapely", reason="the vector extra is not installed")
    old, new, said = OTHERS[change]
    run(CASE, "out.nc")
    Path("case.nml").write_text(CASE.replace(old, new) + SCENARIOS)
    assert main([what, "case.nml", "-o", "more", "--quiet", "--overwrite"]) == 0
    words = ["report", "out.nc", f"--{what}", f"more/{what}.nc"]
    capsys.readouterr()
    if said is None:
        assert main(words) == 0
        return
    before = everything(place)
    refuses(words, f"more/{what}.nc: belongs to another case: {said}", capsys)
    assert everything(place) == before


@pytest.mark.all
def test_a_report_refuses_what_is_of_another_terrain(place, capsys):
    run(CASE, "out.nc")
    elsewhere(steeper=0.1)
    assert main(["models", "case.nml", "-o", "more", "--quiet", "--overwrite"]) == 0
    words = ["report", "out.nc", "--models", "more/models.nc"]
    refuses(words, "more/models.nc: belongs to another case: different terrain", capsys)
    elsewhere(crs="EPSG:32633")
    assert main(["models", "case.nml", "-o", "more", "--quiet", "--overwrite"]) == 0
    said = "more/models.nc: has a different coordinate system: .*33N instead of .*32N"
    refuses(words, said, capsys)
    refuses([*words[:-1], "out.nc"], "out.nc: is not a models.nc of `rockfall models`", capsys)
    elsewhere()
    Path("case.nml").write_text(CASE.replace("y = 4999930.0,", "y = 4999935.0,"))
    assert main(["models", "case.nml", "-o", "more", "--quiet", "--overwrite"]) == 0
    refuses(words, "more/models.nc: line 'L' is missing or elsewhere: run .* again", capsys)


def test_variants_of_a_site_may_be_compared_and_others_not(place, capsys):
    """Another dam, volume or ground is accepted; another CRS, or a terrain elsewhere, is not."""
    Path("observed.csv").write_text(OBSERVED)
    dam = "&dam x = 600020.0, 600100.0, y = 4999940.0, 4999940.0, height = 3.0,"
    dam += " allow_coarse = .true. /\n"
    run(CASE, "bare.nc")
    run(CASE + dam, "dam.nc")
    run(ON_GROUND.replace("0.8", "2.0"), "large.nc")
    results = ["bare.nc", "dam.nc", "large.nc"]
    assert main(["compare", *results, "observed.csv"]) == 0
    assert main(["design", *results]) == 0
    elsewhere(crs="EPSG:32633")
    run(CASE, "crs.nc")
    elsewhere(Affine.translation(7000.0, 0.0) * PLACE)
    moved = CASE.replace("6000", "6070").replace("600120", "607120")
    run(moved, "far.nc")
    capsys.readouterr()
    for words in (["compare", "observed.csv"], ["design"]):
        said = "crs.nc: has a different coordinate system: .*33N instead of .*32N"
        refuses([*words, "bare.nc", "crs.nc"], said, capsys)
        said = "far.nc: does not overlap bare.nc"
        refuses([*words, "bare.nc", "far.nc"], said, capsys)


# ---- page 1


@pytest.fixture
def page(place, capsys):
    """Function that makes a report and returns its text and its first section."""

    def made(*words):
        assert main(["report", "out.nc", "--overwrite", *words]) == 0
        text = Path("out.html").read_text().replace("\u00a0", " ")
        return text, text[text.index('id="answer"') : text.index('id="inputs"')]

    return made


@pytest.mark.all
def test_page_1_of_classical_rebounds_asks_for_the_spread_and_shows_it(page):
    """If the spread over rebound models is missing, the box at the top of the page gives the
    command for it. Unused impact sets are not mentioned."""
    text = ON_GROUND.replace("boulders = 20", "boulders = 200")
    run(text.replace("&output", "&output rebounds = .true.,"), "out.nc")
    text, first = page()
    box = first[: first.index("</aside>")]
    assert "followed classical grounds (soil_4 (rockyfor3d) 100 %) with" in box
    assert (
        "The spread over rebound models is missing: run rockfall models case.nml -o models" in box
    )
    words = re.sub("<style.*?</style>|<[^>]*>", "", text.split("<pre")[0], flags=re.S)
    for theirs in ("spheres on layers of spheres", "paper", "stochastic impact model"):
        assert theirs not in words
    assert "soil_4 (rockyfor3d) 100 %" in text[text.index('id="inputs"') :]
    assert "not used by any rebound" in text
    assert main(["models", "case.nml", "-o", "models", "--quiet"]) == 0
    text, first = page("--models", "models/models.nc")
    assert "is missing" not in first and "without calibration" in first
    found = read_models("models/models.nc")
    assert f"Lowest and highest values of {len(found.names)} rebound models" in first
    assert "Depending on the rebound model, one boulder in 20 travels farther" in first
    assert "L: by each rebound model" in text


def test_page_1_of_impact_sets_is_as_it_was(page):
    run(CASE, "out.nc")
    text, first = page()
    assert "classical" not in text and "rebound models" not in text
