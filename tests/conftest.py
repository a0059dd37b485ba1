# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures shared by several tests."""

import gc
import os
from collections import Counter
from functools import partial
from pathlib import Path

import pytest

# One worker per core, whose idle threads do not spin; read when rockfall is loaded.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("ROCKFALL_PROGRESS", "none")  # progress lines would be in messages
os.environ.setdefault("OGR_SQLITE_SYNCHRONOUS", "OFF")  # layers of tests need not survive a crash

import rockfall
import slope_case
from gallery import Gallery
from made import draw_no_hazard
from programs import MANY, find_program, make_prepared, run_program
from warning_filters import pytest_configure  # noqa: F401


def pytest_addoption(parser):
    parser.addoption("--all", action="store_true", help="run also what is marked `all`")


def pytest_collection_modifyitems(config, items):
    """Deselect tests marked `all`, all but every n-th test marked `family`, and tests that need a
    browser, unless --all is given."""
    kept, left, members = [], [], Counter()
    for item in items:
        extra = item.get_closest_marker("all") or "browser" in item.fixturenames
        if not extra and (family := item.get_closest_marker("family")):
            extra = members[item.function] % family.args[0]
            members[item.function] += 1
        (left if extra and not config.getoption("all") else kept).append(item)
    config.hook.pytest_deselected(items=left)
    items[:] = kept


def pytest_collection_finish():
    """Exclude loaded modules from garbage collection, which would take a tenth of the time, and
    collect other objects less often, which saves 3 %."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000)


@pytest.fixture(scope="session")
def gallery(tmp_path_factory):
    """Store of results made in this session, which all workers share."""
    root = tmp_path_factory.getbasetemp()
    return Gallery((root.parent if "PYTEST_XDIST_WORKER" in os.environ else root) / "gallery")


@pytest.fixture
def few_boulders(tmp_path):
    """Case file of cases/vaujany with 50 boulders, in a folder of its own."""
    folder = (Path(__file__).parents[1] / "cases/vaujany").resolve()
    case = rockfall.read_case(folder / "case.nml")
    case = case.replace(
        case={"boulders": 50},
        terrain={"dem": folder / "dem.tif"},
        surface={key: folder / case.surface[key] for key in ("zones", "table")},
    )
    path = tmp_path / "case.nml"
    path.write_text(case.text())
    return path


@pytest.fixture
def place(gallery, tmp_path, monkeypatch):
    """Work in a folder with a small case on a slope."""
    monkeypatch.chdir(tmp_path)
    return gallery.copy("slope", slope_case.write_slope, tmp_path)


@pytest.fixture
def blank_figures(monkeypatch):
    """Leave figures out, or blank: drawing takes longer than all other steps, and has its own
    tests."""
    figure = pytest.importorskip("matplotlib.figure", reason="the report extra is not installed")
    save = figure.Figure.savefig

    def blank(_, path, dpi=None, **how):
        save(figure.Figure(figsize=(1, 1)), path, dpi=20, **how)

    def empty(*_):
        return figure.Figure(figsize=(1, 1))

    monkeypatch.setattr(figure.Figure, "savefig", blank)
    for name in ("page.history_figure", *map("front.{}_figure".format, ("map", "stops", "zones"))):
        monkeypatch.setattr(f"rockfall.html_report.{name}", empty)
    for name in ("figures", "hazard_figures"):
        monkeypatch.setattr(f"rockfall.html_report.page.{name}", lambda *_: [])
    draw_no_hazard(monkeypatch)
    monkeypatch.setattr("rockfall.plots.figures.DRAWN", ("speed",))


@pytest.fixture
def batch():
    """Function that runs rockfall-batch; the test is skipped if the program is not built."""
    if not find_program():
        pytest.skip("rockfall-batch is not built")
    return run_program


@pytest.fixture
def ready(batch, gallery, tmp_path):
    """Folder with a case that has every kind of input and output, prepared in `ready`."""
    return gallery.copy("everything", _prepare, tmp_path)


def _prepare(folder, **groups):
    make_prepared(folder, **groups)


@pytest.fixture
def many(batch, gallery, tmp_path):
    """Folder like that of `ready`, with `MANY` boulders."""
    return gallery.copy("many", partial(_prepare, case={"boulders": MANY}), tmp_path)
