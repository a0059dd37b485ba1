# SPDX-License-Identifier: BSD-3-Clause
"""Browser, and the case on a rough slope that it shows."""

import queue
from pathlib import Path

import pytest

import scenes
from browser import open_browser, resize
from made import make_raster


@pytest.fixture(scope="module")
def browser():
    one = open_browser("--enable-unsafe-swiftshader")  # for WebGL; otherwise software drawing
    yield one
    one.quit()


@pytest.fixture
def write_place(tmp_path, monkeypatch):
    """Function that writes a case on a rough slope to a folder and makes it the current folder. The
    list of recent files is in the same folder."""

    def write(case):
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
        monkeypatch.chdir(tmp_path)
        make_raster("dem.tif", scenes.rough(dtype="f4"))
        scenes.write_sets(tmp_path / "sets.nml", *scenes.sets(2.0), scenes.usual)
        Path("case.nml").write_text(case, encoding="utf-8")

    return write


@pytest.fixture
def slope(write_place):
    write_place(pytest.importorskip("app_window", exc_type=ImportError).CASE)


@pytest.fixture
def window(browser, slope):
    """Window of the case, with complete results."""
    import app_window  # needs Selenium, which `slope` has checked

    with app_window.served("case.nml") as server:
        resize(browser, 1280, 800)
        yield app_window.open_window(browser, server)
        errors = [one for one in browser.get_log("browser") if one["level"] == "SEVERE"]
        browser.get("about:blank")
    assert errors == []


@pytest.fixture
def enter():
    """Function that opens a file in a room and returns a client, which sends messages as a page
    does."""
    from app_messages import Talk, decoded
    from rockfall.app.outbox import Client
    from rockfall.app.room import Room

    rooms = []

    def opened(path, **given):
        room = Room(Path(path), **given)
        rooms.append(room)
        sent = queue.Queue()
        page = Client(lambda kind, message: sent.put(decoded(message)))
        room.enter(page, {"language": "en"})
        return Talk(room, page, sent)

    yield opened
    for room in rooms:
        room.close()
