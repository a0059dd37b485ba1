# SPDX-License-Identifier: BSD-3-Clause
"""What `help()` shows of the Python interface runs as it stands."""

import doctest
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import rockfall
from made import make_layer, surveyed_blocks
from slope_case import CASE

OBSERVED = "line,quantity,unit,mean,std,n\nL,speed,m/s,9.5,2.5,40\n"
NO_EXAMPLE = {"__version__", "Interrupted", "RockfallError", "import_rockyfor3d"}
SAME = {"run_ensemble", "ensemble_table"}  # in the example of ensemble


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", sorted({*rockfall.__all__} - NO_EXAMPLE - SAME))
def test_example(name, place, monkeypatch, blank_figures):
    monkeypatch.setattr("rockfall.analysis.back.study.ROUND", 16)
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
    Path("observed.csv").write_text(OBSERVED)
    Path("case.nml").write_text(CASE.partition("&output")[0])
    Path("survey.csv").write_text("volume,year\n" + "".join(surveyed_blocks()))
    make_layer("cliff.gpkg", [shapely.box(600050, 4999980, 600060, 4999990)])
    examples = doctest.DocTestParser().get_examples(inspect.getdoc(getattr(rockfall, name)))
    assert examples, "help() shows no example"
    test = doctest.DocTest(examples, {}, name, None, None, None)
    said = []
    doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    assert not said, "".join(said)


def test_the_package_loads_nothing_heavy():
    heavy = "{'numpy', 'xarray', 'pandas', 'rasterio', 'matplotlib', 'geopandas'}"
    code = f"import rockfall, sys; dir(rockfall); sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
