# SPDX-License-Identifier: BSD-3-Clause
"""Actions in the live window in a browser, and what it then shows."""

import threading
import time
from contextlib import contextmanager
from pathlib import Path

from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

import rockfall
from rockfall.app.room import Given, Room
from rockfall.app.server import Server, bind

W, N = 600000.0, 5000000.0
CASE = f"""&case title = 'Hang', boulders_total = 200, seed = 7, threads = 1 /
&terrain dem = 'dem.tif' /
&surface uniform_mean_radius = 0.25 /
&impact sets = 'sets.nml' /
&boulder volume = 'normal', volume_mean = 0.8, volume_std = 0.2 /
&release x = {W + 150}, y = {N - 40}, drop_height = 5.0 /
&line name = 'L', x = {W}, {W + 300}, y = {N - 200}, {N - 200} /
"""
PATIENCE = 600.0  # maximum wait [s], on a busy machine


@contextmanager
def served(path, wms=""):
    server = Server(bind(0), keep=True, wms=wms)
    server.admit(Room(Path(path), given=Given(wms=wms)))
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(20)


def open_window(browser, server):
    browser.get("about:blank")
    browser.get(server.url)
    page = Window(browser)
    page.complete()
    return page


class Window:
    def __init__(self, browser):
        self.browser = browser

    def until(self, what, script, *values):
        """Wait until a script returns a true value; return that value."""
        end = time.monotonic() + PATIENCE
        while not (found := self.browser.execute_script(f"return {script}", *values)):
            assert time.monotonic() < end, f"{what} did not come: {self.text('body')[:400]}"
            time.sleep(0.05)
        return found

    def complete(self, revision=0):
        """Wait for all results of this or a later revision; return them by line."""
        ready = "window.rockfall && !rockfall.preliminary && rockfall.batch?.complete"
        ready += " && rockfall.batch.lines.every(({ n }) => n !== undefined)"
        self.until("a complete run", f"{ready} && rockfall.revision >= arguments[0]", revision)
        batch = self.browser.execute_script("return rockfall.batch")
        return {line["name"]: line for line in batch["lines"]}

    def changed(self, act):
        """Return the results by line after an action that changes the document."""
        before = self.revision
        act()
        self.until("a revision", "rockfall.revision > arguments[0]", before)
        return self.complete(before + 1)

    @property
    def revision(self):
        return self.browser.execute_script("return rockfall.revision")

    @property
    def layers(self):
        return self.browser.execute_script("return rockfall.document")["layers"]

    def find(self, selector):
        return self.browser.find_element(By.CSS_SELECTOR, selector)

    def text(self, selector):
        return self.find(selector).text

    def click(self, selector):
        self.until(selector, "document.querySelector(arguments[0])", selector)
        self.find(selector).click()

    def pixel(self, place):
        return [
            round(one) for one in self.until("the map", "rockfall.pixelOf(arguments[0])", place)
        ]

    def touch(self, *places, drag=False, double=False):
        """Click at points of the map [m], or drag through them."""
        builder = ActionBuilder(self.browser, duration=20)
        mouse = builder.pointer_action
        for number, place in enumerate(places):
            mouse.move_to_location(*self.pixel(place))
            if drag and not number:
                mouse.pointer_down()
            elif not drag:
                mouse.click()
        if drag:
            mouse.pointer_up()
        elif double:
            mouse.click()
        builder.perform()

    def draw(self, tool, *places):
        self.click(f'[data-tool="{tool}"]')
        self.touch(*places, double=len(places) > 1)

    def fill(self, name, value):
        shown = "[...document.querySelectorAll(arguments[0])].find((one) => one.offsetParent)"
        field = self.until(name, shown, f'[data-field="{name}"]')
        field.click()
        field.send_keys(Keys.CONTROL + "a" + Keys.NULL + f"{value}{Keys.TAB}")

    def undo(self):
        chain = ActionChains(self.browser).key_down(Keys.CONTROL).send_keys("z")
        chain.key_up(Keys.CONTROL).perform()

    def save(self, name):
        self.click('[data-action="save"]')
        field = self.find("dialog[open] input")
        field.clear()
        field.send_keys(name)
        self.click('dialog[open] [data-action="write"]')
        self.until("a saved file", "document.querySelector('dialog[open] .files')")
        self.click('[data-action="close-dialog"]')


def agrees(lines, case):
    """Check that the lines of a window have exactly the statistics of a run of a case."""
    found = rockfall.line_statistics(rockfall.run(rockfall.read_case(case)))
    assert {*found["line"]} == {*lines}
    for row in found.itertuples():
        if row.quantity not in (shown := lines[row.line]["quantities"]):
            continue
        one = shown[row.quantity]
        assert lines[row.line]["n"] == row.n
        assert lines[row.line]["fraction"][0] == row.fraction
        if one["mean"][0] is not None:
            assert one["mean"][0] == row.mean * one["factor"]
            assert one["max"] == row.max * one["factor"]
