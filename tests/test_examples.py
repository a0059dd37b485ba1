# SPDX-License-Identifier: BSD-3-Clause
"""Examples in `help()` of the Python interface run as printed."""

import doctest
import inspect
import re
import shutil
import subprocess
import sys
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

import rockfall
from made import make_layer, make_page, make_rockyfor3d, surveyed_blocks
from projects import avaframe, platrock
from scenes import FACTORS
from slope_case import CASE, NX, NY, slope, write_slope

OBSERVED = "line,quantity,unit,mean,std,n\nL,speed,m/s,9.5,2.5,40\n"
#: Promised names as listed in `tests/interface.txt`: `rockfall.run`, and so on.
PROMISED = (Path(__file__).parent / "interface.txt").read_text(encoding="utf-8")
NAMES = {*re.findall(r"^rockfall\.([\w.]+)", PROMISED, re.MULTILINE)} - {"__version__"}
#: Examples of whole studies, which take a second or more.
SLOW = {"back_analysis", "convergence", "dossier", "figures", "measure_ground", "write_hazard"}


def test_all_that_is_public_is_promised():
    assert {*rockfall.__all__} - {"__version__"} == {one for one in NAMES if "." not in one}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder with every file that an example reads."""
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    folder = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as here:
        here.chdir(folder)
        write_slope()
        Path("observed.csv").write_text(OBSERVED)
        shutil.copy(FACTORS, "factors.csv")
        Path("case.nml").write_text(CASE.partition("&output")[0])
        Path("survey.csv").write_text("volume,year\n" + "".join(surveyed_blocks()))
        source = np.zeros((NY, NX))
        source[4, 8:12] = 1
        make_rockyfor3d("folder", slope(), source)
        platrock("simulation")
        (avaframe("avaHill") / "Inputs/RES/fsi.asc").unlink()
        make_layer("cliff.gpkg", [shapely.box(600050, 4999980, 600060, 4999990)])
    return folder


@pytest.mark.family(2)
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=[pytest.mark.all] * (one in SLOW)) for one in sorted(NAMES)],
)
def test_example(name, site, tmp_path, monkeypatch, blank_figures):
    monkeypatch.setattr("rockfall.studies.back.study.ROUND", 16)
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    monkeypatch.chdir(shutil.copytree(site, tmp_path / "site"))
    monkeypatch.setattr("rockfall.app.show.PAGE", make_page(Path("page")))
    examples = doctest.DocTestParser().get_examples(inspect.getdoc(attrgetter(name)(rockfall)))
    assert examples, "help() shows no example"
    test = doctest.DocTest(examples, {}, name, None, None, None)
    said = []
    doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    assert not said, "".join(said)


def test_the_package_loads_nothing_heavy():
    heavy = "{'numpy', 'xarray', 'pandas', 'rasterio', 'matplotlib', 'geopandas'}"
    code = f"import rockfall, sys; dir(rockfall); sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
