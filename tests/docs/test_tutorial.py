# SPDX-License-Identifier: BSD-3-Clause
"""The notebook of the tutorial runs. Its pages are tested by `./run docs` with tools/figures.py."""

import json
from pathlib import Path

import pytest

from tools import tutorial

pytest.importorskip("pyogrio", reason="the vector extra is not installed")
pytest.importorskip("jinja2", reason="the report extra is not installed")
#: Numbers of boulders and precisions in cells, and smaller values that suffice for a test.
FEW = {"20_000": "2_000", "1360": "136", "road<5%": "road<20%"}


@pytest.mark.all
def test_the_notebook_runs(tmp_path, monkeypatch, blank_figures):
    path = tutorial.PAGES / "tutorial.ipynb"
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert code and not any(cell["outputs"] or cell["execution_count"] for cell in code)
    monkeypatch.chdir(tmp_path)
    plt = pytest.importorskip("matplotlib.pyplot")
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    plt.switch_backend("agg")
    Path("make_layers.py").write_bytes(tutorial.LAYERS.read_bytes())
    names = {}
    for cell in code:
        code = "".join(cell["source"])
        for boulders, few in FEW.items():
            code = code.replace(boulders, few)
        exec(code, names)
    assert names["result"].sizes["boulder"] == 2000
    assert names["bare"] > names["with_net"] > 0
    assert Path("case.html").exists() and Path("gis/rockfall.gpkg").exists()
