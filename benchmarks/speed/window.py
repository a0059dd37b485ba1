# SPDX-License-Identifier: BSD-3-Clause
"""Time of the live window from an edit to its results, and from its command to the map.

    python -m benchmarks.speed.window [--repeat 15] [--side 2000] [--trajectories 100] [--page]

A websocket client, instead of the page, moves the release of `cases/vaujany`, and a release on a
synthetic relief of 2000 x 2000 cells. Prints wall-clock milliseconds, minimum and median of
`--repeat` edits, from sending an edit to its state, its first results, and the results of all
10,000 boulders, with and without a map; and once, from the hello message to the terrain. The server
is another process; use an idle machine.

`--page` times the page itself, in an open headless Chromium that draws by software, as without a
graphics processor (a graphics processor is emulated only for the 3D view; for the complete page
this is ten times slower): from the start of `rockfall app` to the first terrain on the map and to
the end of the run, for both cases, and for the second case with thousands of lines and of sources.
Then, by the clock of the page: a click into the list, which selects a feature and moves the map,
until the page is redrawn; an arrow key, which moves the feature by one cell, until the first and
all results are drawn, with the time spent in the page's script according to the browser's profiler.
The rest is simulation and software drawing.

Last, frames of the 3D view while 500 trajectories play: medians over at most `FRAMES` frames or
`FRAME_SECONDS`, of the time between frames with software drawing, the script time without drawing,
and the amount handed over for drawing.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import shutil
import statistics
import struct
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from websockets.sync.client import ClientConnection, connect

import rockfall
from benchmarks.machine import VAUJANY, machine
from benchmarks.speed.valley import CELL, SAME, relief
from rockfall.app.room import Room
from rockfall.app.server import FILES, Server, bind
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import Grid

BOULDERS = 10_000
STARTS = 3
PHASES = (
    "command to terrain", "command to all boulders", "click", "move to first results",
    "move to all boulders", "of it script of the page",
)  # fmt: skip
#: Time of a mark of the page: since the epoch, or for a revision since the key was pressed.
MARKED = """const [mark] = performance.getEntriesByName(arguments[0]).slice(-1);
return mark && (arguments[1] === null || mark.detail === arguments[1])
    ? mark.startTime + (arguments[1] === null ? performance.timeOrigin : -window.pressed) : null"""
RUN_COMPLETE = "window.rockfall && !rockfall.preliminary && rockfall.batch?.complete"
LISTEN = """document.querySelector('#map').focus();
addEventListener('keydown', (event) => window.pressed = event.timeStamp, {capture: true});
return rockfall.revision + 1"""
MORE = """const number = document.querySelector('[data-action="trajectories"]');
number.value = '500';
number.dispatchEvent(new Event('change'))"""
SHOW = """document.querySelector('[data-view="scene"]').click()"""
CAN_PLAY = "document.querySelector('.view3d-player')?.hidden === false"
PLAY = """document.querySelector('.view3d-player select').value = '0.25';
document.querySelector('.view3d-player button').click();
window.played = performance.now()"""
#: Counts the drawing and uploads of each frame, from the first use of WebGL.
COUNT = """window.drawn = {calls: 0, vertices: 0, bytes: 0};
const of = WebGL2RenderingContext.prototype;
const count = (name, number) => {
    const draw = of[name];
    of[name] = function (...given) { number(...given); return draw.apply(this, given); };
};
const draws = (n, instances = 1) => { drawn.calls++; drawn.vertices += n * instances; };
count('drawArrays', (mode, first, n) => draws(n));
count('drawElements', (mode, n) => draws(n));
count('drawArraysInstanced', (mode, first, n, instances) => draws(n, instances));
count('drawElementsInstanced', (mode, n, type, offset, instances) => draws(n, instances));
count('bufferSubData', (target, offset, data, from, length) => {
    drawn.bytes += length ? length * data.BYTES_PER_ELEMENT : data.byteLength; });
count('bufferData', (target, data) => drawn.bytes += data.byteLength ?? data);
for (const name of ['texImage2D', 'texSubImage2D'])
    count(name, (...given) => drawn.bytes += given.at(-1)?.byteLength ?? 0);"""
FRAMES, FRAME_SECONDS = 30, 30.0
CLICK = """const done = arguments[0], begun = performance.now();
document.querySelector('[data-feature]').click();
requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now() - begun)));"""
WHAT = ("state", "first results", f"{BOULDERS:,} boulders")


def serve(path: Path, folder: Path, said: Connection) -> None:
    """Serve a case to a single page, and send its address."""
    warnings.simplefilter("ignore")
    os.environ["XDG_STATE_HOME"] = str(folder)
    server = Server(bind(0), page=folder, grace=0.0)
    server.admit(Room(path))
    said.send(server.url)
    server.run()


def messages(socket: ClientConnection) -> Iterator[dict[str, Any]]:
    """Headers of incoming messages."""
    while True:
        found = socket.recv(600)
        if isinstance(found, bytes):
            found = found[4 : 4 + struct.unpack_from("<I", found)[0]].decode()
        yield json.loads(found)


def measure(path: Path, folder: Path, places: np.ndarray, trajectories: int) -> None:
    """Print the times of edits that move the release of a case along places (n, 2)."""
    here, there = multiprocessing.Pipe()
    server = multiprocessing.get_context("spawn").Process(target=serve, args=(path, folder, there))
    server.start()
    origin, _, key = here.recv().partition("/#key=")
    url = f"{origin.replace('http', 'ws')}/live"
    with connect(url, origin=origin, max_size=None, compression=None, proxy=None) as socket:
        coming, begun = messages(socket), time.perf_counter()
        socket.send(json.dumps({"type": "hello", "key": key}))
        welcome = next(coming)
        wait(coming, "terrain")
        print(f"{'hello to terrain':<24}{1e3 * (time.perf_counter() - begun):9.0f}")
        wait(coming, "batch", complete=True)
        settings, revision = welcome["document"]["settings"], 0
        total = {"case": {**settings["case"], "boulders_total": BOULDERS, "boulders": None}}
        for shown in "passages", "":
            socket.send(json.dumps({"type": "view", "map": shown, "trajectories": trajectories}))
            found = []
            for x, y in places:
                revision += 1
                point = {"id": "s", "type": "Point", "coordinates": [x, y], "properties": {}}
                edit = {"revision": revision, "layers": {"sources": [point]}, "settings": total}
                begun = time.perf_counter()
                socket.send(json.dumps({"type": "edit", **edit}))
                found.append(times(coming, revision, begun))
            for name, column in zip(WHAT, zip(*found[1:], strict=True), strict=True):
                about = f"{name}, {'with' if shown else 'without'} a map"
                print(f"{about:<44}{min(column):9.0f}{statistics.median(column):9.0f}")
    server.join()


def wait(coming: Iterator[dict[str, Any]], type: str, **content: Any) -> None:
    """Wait for a message with a given type and content."""
    for one in coming:
        assert one["type"] not in ("fault", "refused") and not one.get("errors"), one
        if one["type"] == type and content.items() <= one.items():
            return


def times(coming: Iterator[dict[str, Any]], revision: int, begun: float) -> list[float]:
    """Milliseconds from `begun` to the state, the first results and all results of a revision."""
    found: list[float] = []
    for one in coming:
        assert one["type"] not in ("fault", "refused") and not one.get("errors"), one
        if one["type"] == ("batch" if found else "state") and one["revision"] == revision:
            if len(found) < 2:
                found.append(1e3 * (time.perf_counter() - begun))
            if one.get("complete"):
                return [*found, 1e3 * (time.perf_counter() - begun)]
    return found


def made(folder: Path, side: int) -> tuple[Path, np.ndarray]:
    """Case on a synthetic relief, and a release point on it."""
    z = relief(side, np.random.default_rng(1))
    grid = Grid(0.0, side * CELL, CELL, side, side)
    write_geotiff(folder / "dem.tif", z, grid, None)
    middle = slice(side // 4, 3 * side // 4)
    north, east = np.gradient(z[middle, middle], CELL)
    row, column = np.unravel_index(np.argmax(np.hypot(north, east)), north.shape)
    place = np.array([grid.x[column + side // 4], grid.y[row + side // 4]])
    line = {"name": "L", "x": [*(place[0] + [-300, 300])], "y": [place[1] - 100.0] * 2}
    case = rockfall.Case(
        folder=folder, case={"boulders_total": BOULDERS}, terrain={"dem": "dem.tif"}, **SAME,
        release={"x": [place[0]], "y": [place[1]], "drop_height": 2.0}, line=[line],
    )  # fmt: skip
    path = folder / "case.nml"
    path.write_text(case.text())
    return path, place


def measure_page(name: str, path: Path, environment: dict[str, str]) -> None:
    """Print the times of a case's page, each the minimum of three starts."""
    browser = _chromium()
    starts = [_start(browser, path, environment) for _ in range(STARTS)]
    browser.quit()
    for what, *values in zip(PHASES, *starts, strict=True):
        print(f"{name + ', ' + what:<60}{min(values):9.0f}")


def _chromium() -> Any:
    """Driver of a headless Chromium."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium") or shutil.which("google-chrome"))
    for one in ("headless=new", "no-sandbox", "window-size=1280,800", "enable-unsafe-swiftshader"):
        options.add_argument(f"--{one}")
    service = webdriver.ChromeService(str(shutil.which("chromedriver")))
    browser = webdriver.Chrome(options=options, service=service)
    browser.set_script_timeout(600)  # a script waits for the preceding frame
    return browser


def _start(browser: Any, path: Path, environment: dict[str, str]) -> list[float]:
    """Start `rockfall app` for a case; return the milliseconds of each of PHASES."""
    browser.get("about:blank")
    command = [sys.executable, "-m", "rockfall", "app", str(path), "--no-browser"]
    begun = 1e3 * time.time()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as server:
        try:
            assert server.stdout is not None
            browser.get(server.stdout.readline().strip())
            drawn, found = _marked(browser, "terrain"), []
            found.append(drawn - begun)
            found.append(_marked(browser, "all results") - begun)
            _wait(browser, RUN_COMPLETE)
            found.append(browser.execute_async_script(CLICK))
            found += _move(browser)
            browser.get("about:blank")
        finally:
            server.terminate()
    return found


def _move(browser: Any) -> list[float]:
    """Times [ms] from a key press that moves the selected feature until the first results and until
    all results, and the part of the latter spent in the page's script."""
    time.sleep(0.5)  # let the map arrive at the feature
    revision = browser.execute_script(LISTEN)
    browser.execute_cdp_cmd("Profiler.enable", {})
    browser.execute_cdp_cmd("Profiler.start", {})
    for kind in "rawKeyDown", "keyUp":
        key = {"type": kind, "key": "ArrowRight", "code": "ArrowRight"}
        browser.execute_cdp_cmd("Input.dispatchKeyEvent", {**key, "windowsVirtualKeyCode": 39})
    found = [_marked(browser, name, revision) for name in ("first results", "all results")]
    return [*found, script_time(browser.execute_cdp_cmd("Profiler.stop", {})["profile"])]


def script_time(profile: dict[str, Any]) -> float:
    """Milliseconds in functions of a script and in garbage collection, from a browser profile."""
    native = "(root)", "(program)", "(idle)"
    own = {
        node["id"] for node in profile["nodes"]
        if node["callFrame"]["functionName"] not in native
    }  # fmt: skip
    pairs = zip(profile["samples"], profile["timeDeltas"], strict=True)
    return 1e-3 * sum(spent for node, spent in pairs if node in own)


def measure_frames(path: Path, environment: dict[str, str]) -> None:
    """Print medians of frames of the 3D view while 500 trajectories play."""
    browser = _chromium()
    browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": COUNT})
    command = [sys.executable, "-m", "rockfall", "app", str(path), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as server:
        assert server.stdout is not None
        browser.get(server.stdout.readline().strip())
        _wait(browser, RUN_COMPLETE)
        browser.execute_script(MORE)
        _wait(browser, "rockfall.trajectories === 500")
        browser.execute_script(SHOW)
        _wait(browser, CAN_PLAY)  # wait until the trajectories exist
        browser.execute_script(PLAY)
        played = "rockfall.frames.filter(({now}) => now > window.played)"
        _wait(browser, f"{played}.length > 1")  # earlier frames build what is drawn
        browser.execute_script("Object.keys(drawn).forEach((key) => drawn[key] = 0)")
        before = browser.execute_script(f"return {played}.length")
        end = time.monotonic() + FRAME_SECONDS
        while time.monotonic() < end:
            time.sleep(0.1)
            frames, drawn = browser.execute_script(f"return [{played}, {{...drawn}}]")
            if len(frames) - before >= FRAMES:
                break
        server.terminate()
    browser.quit()
    n = len(frames) - before
    print(f"{f'frame, 500 trajectories ({n} in the time)':<60}", end="")
    if not n:
        print("none")
        return
    between = np.diff([frame["now"] for frame in frames[before - 1 :]])
    print(f"{np.median(between):9.1f}")
    cost = np.median([frame["cost"] for frame in frames[before:]])
    print(f"{'of it script of the page':<60}{cost:9.2f}")
    for what, total in drawn.items():
        print(f"{f'{what} of a frame':<60}{total / n:9.0f}")


def _marked(browser: Any, name: str, revision: int | None = None) -> float:
    """Time of a mark of the page [ms], once it exists."""
    while (found := browser.execute_script(MARKED, name, revision)) is None:
        time.sleep(0.02)
    return float(found)


def _wait(browser: Any, script: str) -> None:
    while not browser.execute_script(f"return {script}"):
        time.sleep(0.02)


def time_page(folder: Path, side: int, lines: int) -> None:
    """Print the times of the page of each case [ms]."""
    environment = os.environ | {"XDG_STATE_HOME": str(folder), "PYTHONWARNINGS": "ignore"}
    made_case, _ = made(folder, side)
    cases = {
        "cases/vaujany": VAUJANY, f"{side} x {side} cells": made_case,
        f"{lines:,} lines": many(made_case, lines, 0), "5,000 sources": many(made_case, 0, 5000),
    }  # fmt: skip
    for name, path in cases.items():
        measure_page(name, path, environment)
    measure_frames(VAUJANY, environment)


def many(path: Path, lines: int, sources: int) -> Path:
    """Synthetic case with many short lines, or with many points as sources."""
    case, dem = rockfall.read_case(path), Grid(0.0, 0.0, CELL, 1, 1)
    x, y, line = case.release["x"][0], case.release["y"][0], case.line[0]
    rows = [
        {"name": f"L{k}", "x": [x - 300.0, x + 300.0], "y": [y - 2.0 * k - 40] * 2}
        for k in range(lines)
    ]
    at = np.arange(max(sources, 1))
    places = {"x": [*(x + at % 100 * dem.cell)], "y": [*(y + at // 100 * dem.cell)]}
    several = case.replace(line=rows or [line], release=places, output={"maps": ["passages"]})
    found = path.with_name(f"lines{lines}_sources{sources}.nml")
    found.write_text(several.text())
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeat", type=int, default=15)
    parser.add_argument("--side", type=int, default=2000)
    parser.add_argument("--trajectories", type=int, default=100)
    parser.add_argument("--lines", type=int, default=2000)
    parser.add_argument("--page", action="store_true")
    given = parser.parse_args()
    print(machine())
    steps = np.linspace(0.0, 5.0, given.repeat + 1)[:, None] * (1.0, 0.0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if given.page:
            time_page(folder, given.side, given.lines)
            return
        for file, _ in FILES.values():
            (folder / file).touch()
        print("cases/vaujany [ms]")
        measure(VAUJANY, folder, steps + (97.5, 587.5), given.trajectories)
        print(f"{given.side} x {given.side} cells [ms]")
        path, place = made(folder, given.side)
        measure(path, folder, steps + place, given.trajectories)


if __name__ == "__main__":
    main()
