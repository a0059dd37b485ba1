# SPDX-License-Identifier: BSD-3-Clause
"""Server of the live window: accepted input, runs, and equality with the saved case."""

import asyncio
import base64
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from subprocess import PIPE
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the app extra is not installed")
pytest.importorskip("uvicorn", reason="the app extra is not installed")
client = pytest.importorskip("websockets.sync.client", reason="the app extra is not installed")
shapely = pytest.importorskip("shapely", reason="the vector extra is not installed")
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402

import rockfall  # noqa: E402
import scenes  # noqa: E402
from app_messages import decoded  # noqa: E402
from made import make_layer, make_page, make_raster  # noqa: E402
from programs import makes_links, sends_signals  # noqa: E402
from rockfall.app import exhibit, show  # noqa: E402
from rockfall.app.edited.document import runnable  # noqa: E402
from rockfall.app.edited.opening import open_site  # noqa: E402
from rockfall.app.edited.saving import save  # noqa: E402
from rockfall.app.messages import MAX_BYTES, binary_message  # noqa: E402
from rockfall.app.outbox import Client, Outbox  # noqa: E402
from rockfall.app.pictures import MAX_LINES  # noqa: E402
from rockfall.app.room import Room  # noqa: E402
from rockfall.app.server import FILES, Server, bind  # noqa: E402
from rockfall.cli.command_line import main  # noqa: E402
from rockfall.draft.grounds import GROUNDS  # noqa: E402
from rockfall.errors import RockfallError  # noqa: E402
from rockfall.plots import style  # noqa: E402
from rockfall.result.crossings import line_names  # noqa: E402
from same import same_bits  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

W, N = 600000.0, 5000000.0
SHOWN = ["speed", "energy_total", "passing_height"]
CASE = f"""&case title = 'Ünter "dem" Fels', boulders_total = 120, seed = 7, threads = 1 /
&terrain dem = 'dem.tif' /
&surface uniform_mean_radius = 0.25 /
&impact sets = 'sets.nml' /
&boulder volume = 'normal', volume_mean = 0.8, volume_std = 0.2 /
&release x = {W + 150}, y = {N - 40}, drop_height = 5.0 /
&line name = 'L', x = {W}, {W + 300}, y = {N - 250}, {N - 250} /
&output maps = 'passages', trajectories = 20 /
"""
NET = {"name": "Netz 'Nord'", "height": 4.0, "capacity": 2000.0}


def point(x, y, id="p1", **properties):
    return {"id": id, "type": "Point", "coordinates": [W + x, N - y], "properties": properties}


def line(y, id="l1", **properties):
    places = [[W + 20.5, N - y], [W + 280.25, N - y - 3.125]]
    return {"id": id, "type": "LineString", "coordinates": places, "properties": properties}


def polygon(west, south, east, north, id="z1", **properties):
    ring = [[W + west, N - south], [W + east, N - south], [W + east, N - north],
            [W + west, N - north], [W + west, N - south]]  # fmt: skip
    return {"id": id, "type": "Polygon", "coordinates": [ring], "properties": properties}


@pytest.fixture(autouse=True)
def place(tmp_path, write_place):
    """Work in a folder with a case on a rough slope and a page to serve; return the folder."""
    write_place(CASE)
    page = make_page(tmp_path / "page")
    (page / "secret.txt").write_text("secret")
    return tmp_path


@pytest.fixture
def serve(place):
    """Function that starts a server; all are stopped at the end."""
    running = []

    def start(path="case.nml", keep=True):
        server = Server(bind(0), page=place / "page", keep=keep, grace=1000.0)
        server.admit(Room(None if path is None else Path(path)))
        thread = threading.Thread(target=server.run)
        thread.start()
        running.append((server, thread))
        while not server._server.started:
            time.sleep(0.01)
        return server

    yield start
    for server, thread in running:
        server.stop()
        thread.join(10)
        assert not thread.is_alive()


@pytest.fixture
def visit():
    """Function that opens a page of a server; all are closed at the end."""
    with ExitStack() as stack:

        def enter(server, first=None, **how):
            origin = f"http://127.0.0.1:{server.port}"
            about = {"origin": origin, "max_size": None, "compression": None, "proxy": None} | how
            url = f"ws://127.0.0.1:{server.port}/live"
            page = Page(stack.enter_context(client.connect(url, **about)))
            hello = {"type": "hello", "key": server.key, "language": "en"}
            page.socket.send(first if isinstance(first, str) else json.dumps(hello | (first or {})))
            return page

        yield enter


class Page:
    """Client that acts like the page in the browser."""

    def __init__(self, socket):
        self.socket = socket

    def send(self, type, **content):
        self.socket.send(json.dumps({"type": type, **content}))

    def get(self):
        """Return the next message: its header, with arrays in place of their descriptions."""
        return decoded(self.socket.recv(120))

    def until(self, type, **content):
        """Return the next message of a given type and content."""
        return self.all_until(type, **content)[-1]

    def all_until(self, type, **content):
        found = []
        while True:
            found.append(self.get())
            assert found[-1]["type"] != "fault", found[-1]
            if found[-1]["type"] == type and content.items() <= found[-1].items():
                return found

    def edit(self, revision, **content):
        """Send an edit; return the messages up to the state that answers it."""
        self.send("edit", revision=revision, **content)
        return self.until("state", revision=revision)

    def close(self):
        self.socket.close()


def editor_and_reader(visit, server, hello=None):
    """Open a page, wait until it is the editor, and open a second page."""
    editor = visit(server)
    assert editor.until("welcome")["writer"]
    return editor, visit(server, hello)


def same_variables(one, other):
    assert {*one.variables} == {*other.variables}
    for name in one.variables:
        a, b = one[name].values, other[name].values
        if a.dtype.kind == "O":
            assert a.tolist() == b.tolist(), name
        else:
            assert same_bits(a, b), name


# Input.


def test_hello_without_the_key_is_refused(serve, visit):
    server = serve()
    for key in "", "x", server.key[:-1], 5, "\ud800":
        page = visit(server, {"key": key})
        with pytest.raises(ConnectionClosed) as closed:
            page.get()
        assert closed.value.rcvd.code == 4401
    page = visit(server)
    assert page.get()["type"] == "welcome"


@pytest.mark.parametrize("first", ["", "{", "[]", '{"type": "edit"}', '{"type": "hello"}'])
def test_a_first_message_that_is_no_hello_is_refused(serve, first, visit):
    server = serve(None)
    page = visit(server, first)
    with pytest.raises(ConnectionClosed) as closed:
        page.get()
    assert closed.value.rcvd.code == 4401


def test_foreign_origins_and_hosts_are_refused(serve, visit):
    server = serve(None)
    ours = f"127.0.0.1:{server.port}"
    for origin in None, "http://evil.example", "null", "http://127.0.0.1", f"https://{ours}":
        with pytest.raises(InvalidStatus) as refused:
            visit(server, origin=origin)
        assert refused.value.response.status_code == 403
    hosts = "evil.example", "127.0.0.1", f"evil.example:{server.port}", ours + ".evil.example"
    for host in hosts:
        assert fetched(server, "/", Host=host)[0] == 403
    assert fetched(server, "/", Host=ours, Origin="http://evil.example")[0] == 403
    assert fetched(server, "/", Host=f"localhost:{server.port}")[0] == 200


def fetched(server, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=600)
    connection.putrequest(method, path, skip_host=True)
    for name, value in ({"Host": f"127.0.0.1:{server.port}"} | headers).items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    return answer.status, answer.read().decode(), answer.headers


def test_only_the_files_of_the_page_are_served(serve, place):
    server = serve(None)
    for path, (name, kind) in FILES.items():
        status, body, headers = fetched(server, path)
        assert (status, body) == (200, (place / "page" / name).read_text())
        assert headers["content-type"].startswith(kind)
        assert headers["x-content-type-options"] == "nosniff"
        policy = headers["content-security-policy"]
        assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
        assert f"ws://127.0.0.1:{server.port} " in policy and "unsafe" not in policy
    others = "/secret.txt", "/page/app.js", "/../case.nml", "/%2e%2e/case.nml", "/app.js/", "/live"
    for path in others:
        assert fetched(server, path)[0] in (404, 307), path
    assert fetched(server, "/app.js", method="POST")[0] == 405


def test_the_connectionis_bound_to_this_machine_only():
    with bind(0) as bound:
        host, port = bound.getsockname()
        assert host == "127.0.0.1"
        with pytest.raises(RockfallError, match=f"^--port {port}: cannot be used: "):
            bound.listen()
            bind(port)


HOSTILE = {
    "no JSON": "{", "text": '"edit"', "list": "[1]", "no type": "{}", "a number": '{"type": 1}',
    "unknown": '{"type": "rm"}', "nesting": "[" * 100_000,
    "NaN": '{"type": "edit", "revision": NaN}',
    "infinite": '{"type": "edit", "revision": 1e999}',
    "long number": '{"type": "edit", "revision": ' + "9" * 5000 + "}",
    "no revision": '{"type": "edit"}', "no map": '{"type": "view", "map": "../x"}',
    "list as a map": '{"type": "view", "map": ["passages"], "trajectories": 5}',
    "many": '{"type": "view", "map": "", "trajectories": 1e9}',
    "lines of no names": '{"type": "view", "map": "", "trajectories": 5, "lines": [1]}',
    "no name": '{"type": "save"}', "index": '{"type": "open_recent", "index": -1}',
    "layers": '{"type": "edit", "revision": 1, "layers": []}',
    "half a character": r'{"type": "\ud800"}',
}  # fmt: skip


def test_hostile_messages_get_one_line_and_the_server_lives(serve, visit):
    page = visit(serve())
    page.until("batch", complete=True)
    for about, text in HOSTILE.items():
        page.socket.send(text)
        refused = page.until("refused")
        assert "\n" not in refused["text"] and 0 < len(refused["text"]) < 200, about
    page.socket.send(b"\0\1\2")
    page.until("refused")
    assert page.edit(1)["errors"] == []


def test_an_internal_error_is_told_and_closes_no_page(serve, visit, monkeypatch):
    page = visit(serve())
    page.until("batch", complete=True)
    monkeypatch.setattr("rockfall.app.room.check_name", lambda _: 1 / 0)
    page.send("save", name="x")
    fault = next(said for said in iter(page.get, None) if said["type"] == "fault")
    assert fault["text"] == "internal error: ZeroDivisionError: division by zero"
    assert page.edit(1)["errors"] == []


def test_a_message_that_is_too_large_closes_its_page_only(serve, visit):
    server = serve("dem.tif")
    first, second = editor_and_reader(visit, server)
    second.until("welcome")

    def send_too_much():
        with suppress(ConnectionClosed):
            first.socket.send('{"type": "' + "x" * MAX_BYTES + '"}')

    # a page reads while sending; otherwise it would not notice that the connection is closed
    sender = threading.Thread(target=send_too_much)
    sender.start()
    with pytest.raises(ConnectionClosed):
        first.all_until("never")
    sender.join()
    with suppress(OSError):  # the library may leave the connection open
        first.socket.socket.shutdown(socket.SHUT_RDWR)
    assert second.until("role")["writer"]


def test_a_slow_page_gets_the_latest_results():
    async def through():
        box = Outbox(asyncio.get_running_loop())
        for kind, message in (
            ("welcome", "w"), ("state", "s1"), ("batch", "b1"), ("trajectories", "t1"),
            ("more", "t2"), ("batch", "b2"), ("saved", "x"), ("state", "s2"), ("batch", "b3"),
            ("trajectories", "t3"), ("batch", "b4"), ("more", "t4"),
        ):  # fmt: skip
            box.put(kind, message)
        return [await box.get() for _ in range(6)]

    assert asyncio.run(through()) == ["w", "x", "s2", "t3", "b4", "t4"]


def mute(server):
    """Connection of a page that does not read, with two messages of 20 MB waiting for it."""
    connection = socket.create_connection(("127.0.0.1", server.port))
    ours = f"127.0.0.1:{server.port}"
    connection.sendall(
        f"GET /live HTTP/1.1\r\nHost: {ours}\r\nOrigin: http://{ours}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
        "Sec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    assert connection.recv(4096).startswith(b"HTTP/1.1 101 ")
    hello = json.dumps({"type": "hello", "key": server.key}).encode()
    assert len(hello) < 126
    connection.sendall(bytes([0x81, 0x80 | len(hello), 0, 0, 0, 0]) + hello)
    while server._opening.result().is_empty:
        time.sleep(0.01)
    for _ in range(2):  # the second message waits for the first, which waits in buffers
        server._opening.result()._clients[0].send("x", b"x" * 20_000_000)
    return connection


def test_a_page_that_takes_nothing_is_left(serve, visit, monkeypatch, capfd):
    server = serve("dem.tif")
    with monkeypatch.context() as patch:
        patch.setattr("rockfall.app.server.TAKE_SECONDS", 0.1)
        connection = mute(server)
        while not server._opening.result().is_empty:
            time.sleep(0.01)
    with connection:
        assert visit(server).until("welcome")["writer"]
        server.stop()
        while not server._bound._closed:
            time.sleep(0.01)
    assert capfd.readouterr().err == ""


WRONG = {
    "a layer": ({"trees": []}, {}, {}),
    "no list": ({"lines": {}}, {}, {"layer": "lines"}),
    "no feature": ({"lines": [5]}, {}, {"layer": "lines"}),
    "an id": ({"lines": [line(250, id="../x")]}, {}, {"layer": "lines"}),
    "one id twice": ({"lines": [line(250), line(260)]}, {}, {"layer": "lines"}),
    "a shape": ({"lines": [point(9, 9)]}, {}, {"layer": "lines", "id": "p1"}),
    "two shapes": ({"sources": [point(9, 9), polygon(1, 9, 9, 1)]}, {}, {"layer": "sources"}),
    "a name": ({"lines": [line(250, file="x")]}, {}, {"layer": "lines", "id": "l1"}),
    "half a character": ({"lines": [line(250, **{"\ud800": 1})]}, {}, {"id": "l1"}),
    "a value": (
        {"barriers": [line(250, height="3")]}, {},
        {"layer": "barriers", "id": "l1", "key": "height"},
    ),
    "a truth": ({"barriers": [line(250, height=True)]}, {}, {"id": "l1", "key": "height"}),
    "a ground": (
        {"zones": [polygon(1, 9, 9, 1, ground="../sets.nml")]}, {}, {"id": "z1", "key": "ground"},
    ),
    "a place": ({"sources": [point(1e300, 9)]}, {}, {"layer": "sources", "id": "p1"}),
    "no place": (
        {"sources": [{"id": "a", "type": "Point", "coordinates": [None, {}]}]}, {}, {"id": "a"},
    ),
    "a ring": (
        {"zones": [{"id": "a", "type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}]}, {},
        {"layer": "zones", "id": "a"},
    ),
    "a long text": ({"lines": [line(250, name="x" * 10_000)]}, {}, {"id": "l1", "key": "name"}),
    "a line break": ({}, {"case": {"title": "a\n&line /"}}, {"group": "case", "key": "title"}),
    "a group": ({}, {"line": {"name": "x"}}, {}),
    "a key": ({}, {"boulder": {"mass": 1}}, {"group": "boulder", "key": "mass"}),
    "a type": ({}, {"boulder": {"density": "x"}}, {"group": "boulder", "key": "density"}),
    "a fraction": ({}, {"case": {"seed": 1.5}}, {"group": "case", "key": "seed"}),
    "a file": ({}, {"terrain": {"dem": "/etc/passwd"}}, {"group": "terrain", "key": "dem"}),
    "sets": ({}, {"impact": {"sets": "other.nml"}}, {"group": "impact", "key": "sets"}),
    "ground": ({}, {"surface": {"ground": "sets.nml"}}, {"group": "surface", "key": "ground"}),
    "points": ({}, {"release": {"points": "x.csv"}}, {"group": "release", "key": "points"}),
    "many": ({"sources": [point(9, 9)] * 10_001}, {}, {"layer": "sources"}),
    "no set": ({"lines": {"remove": []}}, {}, {"layer": "lines"}),
    "no ids": ({"lines": {"set": [], "remove": [5]}}, {}, {"layer": "lines"}),
    "another shape": ({"sources": {"set": [polygon(1, 9, 9, 1), point(9, 9)], "remove": []}}, {},
                      {"layer": "sources"}),
}  # fmt: skip


def test_what_the_page_cannot_mean_is_refused_at_its_place(serve, visit):
    page = visit(serve())
    document = page.until("welcome")["document"]
    for revision, (about, (layers, settings, place)) in enumerate(WRONG.items(), start=1):
        state = page.edit(revision, layers=layers, settings=settings, whole=True)
        assert len(state["errors"]) == 1 and state["refused"], about
        assert place.items() <= state["errors"][0].items(), (about, state)
    page.send("save", name="x")
    assert page.until("refused")["task"] == "save"
    # The page and server now differ: changes would make another document.
    assert page.edit(98)["errors"] == state["errors"]
    drawn = {name: features for name, features in document["layers"].items() if features}
    state = page.edit(99, layers=drawn, settings=document["settings"], whole=True)
    assert state["errors"] == [] and not state["refused"]
    assert page.until("batch", revision=99, complete=True)["boulders"] == 120


def test_what_differs_is_sent_alone(serve, place, visit):
    page = visit(serve())
    three = [point(x, 40, id=f"p{x}") for x in (90, 120, 150)]
    page.edit(1, layers={"sources": three})
    moved, added = point(91.5, 42, id="p90", name="A"), point(100, 45, id="q")
    change = {"set": [added, moved], "remove": ["p120", "unknown"]}
    assert page.edit(2, layers={"sources": change})["errors"] == []
    changed = page.until("batch", revision=2, complete=True)
    whole = [moved, three[2], added]
    page.edit(3, layers={"sources": whole})
    assert page.until("batch", revision=3, complete=True)["lines"] == changed["lines"]
    page.send("save", name="x")
    page.until("saved")
    site, document = open_site(Path("x.nml"))
    places = [(one.coordinates, one.properties) for one in document.layers["sources"]]
    assert places == [(one["coordinates"], one["properties"]) for one in whole]


REFUSED = {
    "a range": ({}, {"boulder": {"volume_mean": 1.0, "density": -5.0}}, ("boulder", "density")),
    "a choice": ({}, {"output": {"min_passages": 0}}, ("output", "min_passages")),
    "a height": ({"barriers": [line(200, **NET), line(210, id="b2", height=-1.0, capacity=9.0)]},
                 {}, ("barriers", "b2", "height")),
    "a source": ({"sources": [point(150, 40), point(90, 40, id="p2", drop_height=-1.0)]}, {},
                 ("sources", "p2", "drop_height")),
    "a name": ({"lines": [line(200, name="B"), line(210, id="l2", name="A")],
                "barriers": [line(220, name="A", height=3.0, capacity=9.0)]}, {},
               ("barriers", "l1", "name")),
    "a knot": ({"zones": [{"id": "z9", "type": "Polygon", "properties": {"mean_radius": 0.1},
                "coordinates": [[[W, N], [W + 9, N - 9], [W + 9, N], [W, N - 9], [W, N]]]}]}, {},
               ("zones", "z9")),
    "a zone": ({"zones": [polygon(50, 200, 250, 60, id="z7", name="x")]}, {}, ("zones", "z7")),
    "outside": ({"sources": [point(-150, 40, id="x1")]}, {}, ("sources", "x1")),
    "a dam": ({"dams": [line(220, height=8.0, slope=80.0)]}, {}, ("dams", "l1")),
    "no sources": ({"sources": []}, {}, ("sources",)),
}  # fmt: skip


def test_errors_of_the_case_land_at_their_field(serve, place, visit):
    page = visit(serve())
    for revision, (about, (layers, settings, where)) in enumerate(REFUSED.items(), start=1):
        (error,) = page.edit(revision, layers=layers, settings=settings)["errors"]
        got = [error.get(one) for one in ("layer", "id", "group", "key") if error.get(one)]
        assert got[: len(where)] == [*where] or about == "a name" and got[0] == "lines", (
            about,
            error,
        )
        for leaked in str(place), "GeoDataFrame", "/tmp", "case.nml:":
            assert leaked not in error["text"], (about, error)
        none = {name: [] for name in ("barriers", "dams", "zones", "lines")}
        undone = {"layers": none | {"sources": [point(150, 40)]}}
        undone["settings"] = {"boulder": {"volume_mean": 1.0}, "output": {}}
        assert page.edit(100 + revision, **undone)["errors"] == [], about


# Runs.


def test_an_edit_is_run_and_its_statistics_are_those_of_the_saved_case(serve, place, visit):
    page = visit(serve())
    welcome = page.get()
    assert welcome["writer"] and welcome["mode"] == "case"
    document = welcome["document"]
    assert [one["type"] for one in document["layers"]["sources"]] == ["Point"]
    assert document["layers"]["lines"][0]["properties"] == {"name": "L"}
    assert "release" in document["settings"] and "x" not in document["settings"]["release"]
    terrain = page.until("terrain")
    assert terrain["arrays"]["heights"].shape == (terrain["ny"], terrain["nx"]) == (80, 60)
    assert terrain["arrays"]["shade"].min() >= 1
    page.until("batch", complete=True)
    barriers = [line(200, **NET)]
    page.edit(7, layers={"barriers": barriers}, settings={"release": {"drop_height": 3}})
    batch = page.until("batch", revision=7, complete=True)
    page.send("save", name="Hang 2")
    assert page.until("saved")["files"] == ["Hang 2.nml", "Hang 2.gpkg"]
    result = rockfall.run(rockfall.read_case("Hang 2.nml"))
    assert batch["boulders"] == 120 and sum(batch["ended"].values()) == 120
    assert [one["kind"] for one in batch["lines"]] == ["line", "barrier"]
    table = rockfall.line_statistics(result).set_index(["line", "quantity"])
    for one in batch["lines"]:
        for quantity, numbers in one["quantities"].items():
            row = table.loc[one["name"], quantity]
            assert one["n"] == row["n"] == sum(numbers["counts"])
            for name in "mean", "q50", "q95":
                expected = [
                    numbers["factor"] * row[f"{name}{end}"] for end in ("", "_low", "_high")
                ]
                if name in row["withheld"].split(", "):
                    expected = [None] * 3
                assert numbers[name] == expected
    overlay = batch["arrays"]["overlay"]
    passages = result["passages"].values.astype("f4")
    assert np.array_equal(np.nan_to_num(overlay), passages)
    assert (batch["overlay"]["west"], batch["overlay"]["cell"]) == (
        result["x"].values[0] - 2.5, 5.0,
    )  # fmt: skip


DOCUMENTS = {
    "points": (
        {"sources": [point(150.1, 40.7, name="Fels 'A'", volume="fixed", volume_mean=0.5),
                     point(90, 50, id="p2", drop_height=2, density=2500.5),
                     point(91, 55, id="p3", name="Ö \"B\"", volume="uniform", volume_min=0.1,
                           volume_max=1.1)]}, {},
    ),
    "with frequencies": (
        {"sources": [point(150, 40, frequency=0.25), point(90, 50, id="p2", frequency=1)]}, {},
    ),
    "polygons": (
        {"sources": [polygon(100, 60, 180, 30, name="A", velocity_x=1.5),
                     polygon(40.2, 61.1, 71.3, 30, id="s2", volume_mean=0.3)]},
        {"release": {"steep_cells": True, "slope_threshold": 35}},
    ),
    "nets": (
        {"barriers": [line(150, **NET), line(160, id="b2", height=2, **{"class": 3}),
                      line(180, id="b3", name="Holz", height=0.5, diameter=40.0, decay_class=2)],
         "lines": [line(250), line(260, id="l2"), line(265, id="l3", name="é/è", object_width=4)]},
        {},
    ),
    "a dam": (
        {"dams": [line(220, height=8.0, slope=40.0, crest_width=2.0, allow_coarse=True)]}, {},
    ),
    "zones by radius": (
        {"zones": [polygon(50, 200, 250, 60.5, mean_radius=0.1, name="Wiese"),
                   polygon(20, 310, 250.3, 220, id="z2", mean_radius=0.6)]}, {},
    ),
    "zones by ground": (
        {"zones": [polygon(50, 200, 250, 60, ground="meadow", ground_strength=8e5),
                   polygon(50, 300, 250, 201, id="z2", ground="soil_4", mean_radius=0.05)]},
        {"surface": {"uniform_mean_radius": 0.3}},
    ),
    "zones on a measured ground": (
        {"zones": [polygon(50, 200, 250, 60, ground="meadow")]},
        {"surface": {"uniform_mean_radius": None, "ground": "talus", "ground_relief": 12.0}},
    ),
    "shapes by boulder": (
        {"sources": [point(150.1, 40.7), point(90, 50, id="p2", block_shape="platy"),
                     point(91, 55, id="p3", a=2.0, b=1.2, c=1.125)]},
        {"impact": {"form": "table"},
         "boulder": {"volume": "fixed", "volume_mean": 0.5, "block_shape": ["compact", "elongated"],
                     "block_shape_share": [0.75, 0.25]}},
    ),
    "settings": ({}, {"boulder": {"volume": "list", "volumes": [0.1, 1, 2.5]}, "case": {
        "title": "it's", "boulders": 40}, "flight": {"gravity": 9.8}}),
}  # fmt: skip


@pytest.mark.family(3)
@pytest.mark.parametrize(
    "about",
    [one if one in ("nets", "zones by radius", "settings")
     else pytest.param(one, marks=pytest.mark.all) for one in DOCUMENTS],
)  # fmt: skip
def test_what_is_run_is_what_is_saved(place, about):
    """Every variable is bit-identical in the live run and in a run of the saved case, also after
    the saved case is opened and saved again."""
    layers, settings = DOCUMENTS[about]
    site, document = open_site(Path("case.nml"))
    document = site.edited(document, layers, settings)
    made = runnable(site, document)
    frames = {name: layer.frame(site.grid.crs) for name, layer in made.layers.items()}
    with rockfall.open(made.case, **frames) as session:
        live = [*session.run()][-1].dataset()
    names = [one.name for one in save(site, document, "Größe 1.2", False).files]
    assert names == ["Größe 1.2.nml", "Größe 1.2.gpkg"]
    for _ in range(2):
        saved = rockfall.run(rockfall.read_case(names[0]))
        same_variables(live, saved)
        site, reopened = open_site(Path(names[0]))
        for layer, features in document.layers.items():
            for one, other in zip(features, reopened.layers[layer], strict=True):
                assert one[1:3] == other[1:3]
                assert one.properties.items() <= other.properties.items()
        assert reopened.settings["surface"] == document.settings["surface"]
        save(site, reopened, "Größe 1.2", True)


def test_a_net_drawn_and_removed_brings_the_numbers_back(serve, visit):
    page = visit(serve())
    before = page.until("batch", complete=True)
    page.edit(1, layers={"barriers": [line(150, **NET)]})
    with_net = page.until("batch", complete=True, revision=1)
    assert with_net["ended"]["stopped_by_barrier"] > 0 == before["ended"]["stopped_by_barrier"]
    page.edit(2, layers={"barriers": []})
    after = page.until("batch", complete=True, revision=2)
    assert after["lines"] == before["lines"]
    assert np.array_equal(after["arrays"]["stops"], before["arrays"]["stops"])


@pytest.mark.all
def test_of_many_lines_those_in_view_come_first_and_all_at_the_end(serve, visit):
    page = visit(serve())
    count = 2 * MAX_LINES + 10
    many = [line(100 + 3 * k, id=f"l{k}", name=f"M{k}") for k in range(count)]
    page.send("view", map="passages", trajectories=0, lines=[f"M{count - 1}", "gone"])
    page.edit(1, layers={"lines": many})
    found = page.all_until("batch", revision=1, complete=True)
    for batch in [one for one in found if one["type"] == "batch" and one["revision"] == 1]:
        assert [one["name"] for one in batch["lines"] if "n" in one] == [f"M{count - 1}"]
        assert [one["name"] for one in batch["lines"]] == [
            one["properties"]["name"] for one in many
        ]
    lines = {one["name"]: one for one in batch["lines"] if "n" in one}
    page.send("view", map="passages", trajectories=0, lines=["M50"])
    while len(lines) < count:
        further = page.until("lines", revision=1, boulders=batch["boulders"])["lines"]
        assert not {one["name"] for one in further} & {*lines}
        lines |= {one["name"]: one for one in further}
    page.send("save", name="many")
    page.until("saved")
    table = rockfall.line_statistics(rockfall.run(rockfall.read_case("many.nml")), quantities=SHOWN)
    for row in table.itertuples():
        shown = lines[row.line]
        assert shown["n"] == row.n and shown["fraction"][0] == row.fraction
        mean = shown["quantities"][row.quantity]
        assert mean["max"] == (None if np.isnan(row.max) else row.max * mean["factor"])


def test_trajectories_come_once_each_and_thinned(serve, visit):
    page = visit(serve())
    some = page.all_until("batch", complete=True)
    some += page.all_until("trajectories")
    sent = [one for one in some if one["type"] == "trajectories"]
    assert [one["append"] for one in sent] == [k > 0 for k in range(len(sent))]
    boulders = np.concatenate([one["arrays"]["boulder"] for one in sent])
    assert np.unique(boulders).size == boulders.size == 100
    for one in sent:
        points, first = one["arrays"]["points"], one["arrays"]["first"]
        assert first[0] == 0 and first[-1] == len(points) and first.size == one["count"] + 1
        time = points[:, 3]
        assert (time[first[:-1]] == 0).all()
        assert all((np.diff(time[a:b]) >= 0).all() for a, b in zip(first, first[1:], strict=False))
        assert (one["arrays"]["mass"] > 100).all()
    page.send("view", map="passages", trajectories=7)
    found = page.until("trajectories", append=False)
    assert found["count"] == 7


def test_masses_are_those_of_each_source(serve, visit):
    page = visit(serve())
    settings = {"boulder": {"volume": "fixed", "volume_mean": 2.0}}
    sources = [point(150, 40, density=2000.0), point(90, 40, id="p2")]
    page.edit(1, layers={"sources": sources}, settings=settings)
    live = page.until("trajectories", revision=1)["arrays"]
    assert {*live["mass"].tolist()} == {4000.0, 5600.0}
    page.send("save", name="dense")
    page.until("saved")
    result = rockfall.run(rockfall.read_case("dense.nml"))
    shown = dict((decoded(one)["type"], one) for _, one in exhibit.Exhibit(result, None).messages())
    kept = decoded(shown["trajectories"])["arrays"]
    known = dict(zip(live["boulder"].tolist(), live["mass"].tolist(), strict=True))
    assert all(known.get(k, m) == m for k, m in zip(kept["boulder"], kept["mass"], strict=True))
    assert {*kept["mass"].tolist()} == {4000.0, 5600.0}


def test_another_map_is_another_run_of_the_same_revision(serve, visit):
    page = visit(serve())
    page.until("batch", complete=True)
    page.send("view", map="energy_max", trajectories=0)
    batch = page.until("batch", complete=True)
    assert batch["overlay"]["name"] == "energy_max" and batch["overlay"]["unit"] == "kJ"
    page.send("view", map="", trajectories=0)
    batch = page.until("batch", complete=True)
    assert batch["overlay"] is None and "overlay" not in batch["arrays"]


LONG = {"case": {"boulders_total": 3_000_000, "seed": 7, "threads": 1}}


def test_an_edit_cancels_the_run_and_nothing_older_follows(serve, visit):
    page = visit(serve())
    page.edit(1, settings=LONG)
    assert not page.until("batch", revision=1)["complete"]
    for revision in range(2, 8):  # in quick succession
        page.send("edit", revision=revision, settings=LONG)
    page.send("edit", revision=8, settings={"case": {"boulders_total": 50, "threads": 1}})
    page.until("state", revision=8)
    found = page.all_until("batch", complete=True)
    assert {one["revision"] for one in found if "revision" in one} == {8}
    assert found[-1]["boulders"] == 50


def test_warnings_are_in_the_language_of_the_page_that_writes(serve, visit):
    server, found = serve(), {}
    for revision, language in enumerate(("en", "de"), start=1):
        page = visit(server, {"language": language})
        page.send("take_over")
        release = {"drop_height": 0.0}
        flat = {"surface": {"uniform_mean_radius": 5.0}, "release": release}
        state = page.edit(revision, settings=flat)
        batch = page.until("batch", complete=True, revision=revision)
        found[language] = state["warnings"] + batch["warnings"]
    assert len(found["en"]) == len(found["de"]) >= 2
    assert all(one != other for one, other in zip(found["en"], found["de"], strict=True))


def test_a_page_in_another_language_gets_everything_in_it(serve, visit):
    server = serve()
    page = visit(server)
    flat = {"surface": {"uniform_mean_radius": 5.0}, "release": {"drop_height": 0.0}}
    english = page.edit(1, settings=flat)["warnings"]
    english += page.until("batch", complete=True, revision=1)["warnings"]
    page = visit(server, {"language": "de"})
    page.send("take_over")
    page.until("role", writer=True)
    german = page.until("state", revision=1)["warnings"]
    german += page.until("batch", complete=True, revision=1)["warnings"]
    assert len(english) == len(german) >= 2 and not {*english} & {*german}


def test_a_run_pauses_and_goes_on(serve, visit):
    page = visit(serve())
    page.edit(1, settings=LONG)
    page.until("batch", revision=1)
    page.send("stop")
    paused = page.until("batch", running=False)
    page.send("run")
    later = page.until("batch", running=True)
    assert later["boulders"] >= paused["boulders"] and not later["complete"]
    page.send("stop")
    stopped = page.until("batch", running=False)
    page.edit(2, settings={"case": {"boulders_total": 50, "threads": 1}})  # runs when resumed
    page.send("run")
    assert page.until("batch", revision=2, complete=True)["boulders"] == 50
    assert stopped["revision"] == 1


def test_a_bare_dem_lacks_sources_and_a_ground(serve, visit):
    page = visit(serve("dem.tif"))
    welcome = page.get()
    assert welcome["document"]["settings"]["case"]["boulders_total"] == 10_000
    state = page.until("state")
    assert [one["layer"] for one in state["errors"]] == ["sources"]
    small, sources = {"case": {"boulders_total": 60}}, [point(150, 40)]
    (error,) = page.edit(1, layers={"sources": sources}, settings=small)["errors"]
    assert (error["group"], error["key"]) == ("surface", "ground")
    for revision, choice in enumerate(welcome["grounds"], start=2):
        radius = choice["radius"]
        surface = {"ground": choice["name"]} | ({"uniform_mean_radius": radius} if radius else {})
        assert page.edit(revision, settings={"surface": surface})["errors"] == []
        assert page.until("batch", complete=True, revision=revision)["boulders"] == 60
        assert f"app.ground.{choice['name']}" in welcome["texts"]
    assert [one["name"] for one in welcome["grounds"]] == [*GROUNDS]


def test_raster_zones_steep_cells_and_trees_are_background(serve, place, visit):
    make_raster("zones.tif", np.tile(np.repeat([3, 8], 30), (80, 1)).astype("i4"))
    Path("zones.csv").write_text("zone,mean_radius,name\n3,0.3,Wald\n8,0.2,\n")
    Path("trees.csv").write_text(f"x,y,dbh,species\n{W + 50},{N - 200},40,Picea abies\n")
    text = CASE.replace("uniform_mean_radius = 0.25", "zones = 'zones.tif', table = 'zones.csv'")
    text = re.sub("x = [0-9.]+, y = [0-9.]+", "steep_cells = .true.", text, count=1)
    Path("rasters.nml").write_text(text + "&forest trees = 'trees.csv' /\n", encoding="utf-8")
    page = visit(serve("rasters.nml"))
    welcome = page.get()
    assert "zones" not in welcome["forms"]["layers"]
    fields = {one["name"]: one for one in welcome["forms"]["settings"]["surface"]}
    assert fields["zones"]["read_only"] and fields["table"]["read_only"]
    found = page.until("background")
    assert found["zones"] == [{"value": 1, "name": "Wald"}, {"value": 2, "name": "8"}]
    assert np.array_equal(found["arrays"]["zones"][0], np.repeat([1, 2], 30))
    assert found["sources"] == len(found["arrays"]["sources"]) > 1
    assert found["arrays"]["trees"].tolist() == [[W + 50, N - 200, 40]]
    state = page.edit(1, layers={"zones": [polygon(1, 9, 9, 1)]})
    assert state["errors"]
    settings = welcome["document"]["settings"]
    sources = [point(150, 40)]  # instead of steep cells
    page.edit(2, layers={"sources": sources}, settings=settings, whole=True)
    assert page.until("background")["sources"] == 0
    assert page.until("batch", revision=2, complete=True)["boulders"] == 120


def test_layers_of_a_case_become_features(place):
    """Zones, sources and barriers from three file formats become features; the case saved from them
    gives a bit-identical run."""
    box = shapely.box
    make_layer(
        "zones.gpkg", [box(W, N - 200, W + 300, N), box(W, N - 400, W + 300, N - 200)],
        id=[5, 9], nr=[1, 2],
    )  # fmt: skip
    Path("zones.csv").write_text("zone,mean_radius\n5,0.3\n9,0.2\n")
    make_layer(
        "cliff.geojson", [box(W + 100, N - 60, W + 180, N - 30), box(W, N - 60, W + 9, N - 30)],
        Kluft=["A", "B"], DROP_HEIGHT=[2.0, 3.0], a=["x", "y"],
    )  # fmt: skip
    make_layer("nets.shp", [shapely.LineString([(W, N - 150), (W + 300, N - 150)])], height=[3],
               capacity=[500.0], name=["N"])  # fmt: skip
    surface = "zones = 'zones.gpkg', zone_field = 'id', table = 'zones.csv'"
    text = CASE.replace("uniform_mean_radius = 0.25", surface)
    release = "polygons = 'cliff.geojson', name_field = 'Kluft'"
    text = re.sub("x = [0-9.]+, y = [0-9.]+", release, text, count=1)
    text += "&barrier file = 'nets.shp' /\n"
    Path("layers.nml").write_text(text, encoding="utf-8")
    site, document = open_site(Path("layers.nml"))
    sources = document.layers["sources"]
    assert [one.properties for one in sources] == [  # without the single column a
        {"name": "A", "drop_height": 2.0}, {"name": "B", "drop_height": 3.0},
    ]  # fmt: skip
    assert document.layers["barriers"][0].properties == {
        "name": "N", "height": 3.0, "capacity": 500.0,
    }  # fmt: skip
    assert [one.properties["zone"] for one in document.layers["zones"]] == [5, 9]
    save(site, document, "again", False)
    one, other = (rockfall.run(rockfall.read_case(f"{name}.nml")) for name in ("layers", "again"))
    same_variables(one, other)


NUMBERED = """zones = 'zones.gpkg', default_zone = 2"""


def test_zones_with_numbers_of_their_own_get_more_of_them(place):
    """A drawn zone gets a number above those of the layer: 8, after 2 and 7."""
    shapes = [shapely.box(W, N - 200, W + 150, N), shapely.box(W, N - 400, W + 150, N - 200)]
    make_layer("zones.gpkg", shapes, zone=[2, 7], mean_radius=[0.2, 0.4])
    Path("own.nml").write_text(CASE.replace("uniform_mean_radius = 0.25", NUMBERED), "utf-8")
    site, document = open_site(Path("own.nml"))
    assert [one.properties["zone"] for one in document.layers["zones"]] == [2, 7]
    drawn = [one._asdict() for one in document.layers["zones"]]
    drawn.append(polygon(160, 300, 250, 100, id="new", mean_radius=0.1))
    document = site.edited(document, {"zones": drawn}, {})
    zones = runnable(site, document).layers["zones"].features
    assert [one.properties["zone"] for one in zones] == [2, 7, 8]
    save(site, document, "more", False)
    assert rockfall.run(rockfall.read_case("more.nml")).sizes["boulder"] == 120


def test_around_zones_the_ground_keeps_its_numbers(place):
    surface = "ground = 'talus', ground_relief = 12.0"
    Path("own.nml").write_text(CASE.replace("uniform_mean_radius = 0.25", surface), "utf-8")
    site, document = open_site(Path("own.nml"))
    document = site.edited(document, {"zones": [polygon(50, 200, 250, 60, ground="meadow")]}, {})
    made = runnable(site, document)
    grounds = [
        zone.properties for zone in made.layers["zones"].features if "rest" in zone.properties
    ]
    assert grounds and all(one["ground_relief"] == 12.0 for one in grounds)
    frames = {name: layer.frame(site.grid.crs) for name, layer in made.layers.items()}
    names = rockfall.run(made.case, **frames)["ground"].values.tolist()
    assert sorted(names) == ["meadow", "talus (12 degrees)"]


VARIANTS = f"""&barrier name = 'Netz', x = {W}, {W + 300}, y = {N - 150}, {N - 150}, height = 4.0,
    capacity = 2000.0 /
&barrier name = 'Zaun', x = {W}, {W + 300}, y = {N - 180}, {N - 180}, height = 1.0,
    capacity = 100.0 /
&variant name = 'bare', without = 'barrier', cost = 0.0 /
&variant name = 'net', barriers = 'Netz', release_drop_height = 9.0 /
&variant name = 'dug', terrain_dem = 'other.tif' /
"""


def same_ends(one, other):
    """Check that boulders of two cases end alike; return the result of the second."""
    one, other = rockfall.run(one), rockfall.run(other)
    for name in "stop_x", "stop_y", "travel_time", "status":
        assert same_bits(one[name].values, other[name].values), name
    return other


@pytest.fixture
def varied(place):
    make_raster("other.tif", scenes.rough(dtype="f4") - 1)
    path = Path("varied.nml")
    path.write_text(CASE + VARIANTS, encoding="utf-8")
    return path


def test_variants_of_a_case_are_listed_run_and_taken_as_the_document(serve, varied, visit):
    cases = rockfall.variants(rockfall.read_case(varied))
    page = visit(serve(varied))
    bare, net = page.until("welcome")["variants"]
    assert [bare["variant"], net["variant"]] == ["bare", "net"]
    assert "variant dug is not in the list" in page.until("state")["warnings"][1]
    page.until("batch", complete=True)
    for name in "net", "bare":
        page.send("compare", variant=name)
    for name in "net", "bare":
        fresh = rockfall.line_statistics(rockfall.run(cases[name]), quantities=["speed"])
        lines = page.until("batch", variant=name, complete=True)["lines"]
        assert [one["n"] for one in lines] == fresh["n"].tolist()
        assert lines[0]["quantities"]["speed"]["mean"][0] == fresh["mean"][0]
    state = page.edit(1, layers=net["layers"], settings=net["settings"], variant="net")
    assert state["errors"] == []
    taken = page.until("batch", revision=1, complete=True)
    assert [one["name"] for one in taken["lines"]] == ["L", "Netz"]
    page.send("save", name="one")
    saved = page.until("saved")
    assert saved["remark"].startswith("written without the &variant groups: this state includes")
    same_ends(cases["net"], rockfall.read_case("one.nml"))
    for kind in "compare", "edit":
        page.send(kind, variant="dug", revision=2)
        page.until("refused" if kind == "compare" else "state")


def test_a_variant_that_is_compared_brings_its_trees(serve, place, visit):
    Path("trees.csv").write_text(f"x,y,dbh,species\n{W + 50},{N - 300},40,Picea\n")
    groups = "&forest trees = 'trees.csv' /\n&variant name = 'felled', without = 'forest' /\n"
    Path("wood.nml").write_text(CASE + groups, encoding="utf-8")
    page = visit(serve("wood.nml"))
    present = page.until("background")
    assert "variant" not in present and present["arrays"]["trees"].tolist() == [
        [W + 50, N - 300, 40]
    ]
    page.until("batch", complete=True)
    page.send("compare", variant="felled")
    assert page.until("background", variant="felled")["trees"] == 0


def test_all_maps_have_names_in_the_language_of_the_page(serve, visit):
    server = serve()
    english, german = (
        {one["name"]: one["label"] for one in visit(server, {"language": tongue}).get()["maps"]}
        for tongue in ("en", "de")
    )
    assert {*english} == {*german} and len(english) > 50
    assert [name for name in english if english[name] == german[name]] == []


@pytest.mark.all
def test_variants_are_saved_with_what_they_name(varied, place):
    site, document = open_site(varied)
    drawn = [one._asdict() for one in document.layers["lines"]] + [line(100, id="m", name="M")]
    saved = save(site, site.edited(document, {"lines": drawn}, {}), "more", False)
    assert "--variant base" in saved.remark
    cases = rockfall.variants(rockfall.read_case("more.nml"))
    assert [*cases] == ["bare", "net", "dug"]
    for name, one in rockfall.variants(rockfall.read_case(varied)).items():
        assert line_names(same_ends(one, cases[name]))[:2] == ["L", "M"], name
    nets = [one._asdict() for one in document.layers["barriers"][1:]]
    saved = save(site, site.edited(document, {"barriers": nets}, {}), "less", False)
    assert "&variant name = 'net' barriers: unknown &barrier 'Netz'" in saved.remark
    assert rockfall.read_case("less.nml").variant == []


# Output.


NAMES = ["", ".x", "..", "../x", "a/b", "a\\b", "/tmp/x", "x ", " x", "x.", "a\0", "a\nb", "x" * 81,
         "a:b", "~", "$HOME", None, 5, ["x"]]  # fmt: skip


def test_names_that_are_no_bare_names_are_refused(serve, place, visit):
    page = visit(serve("dem.tif"))
    before = sorted(place.iterdir())
    settings = {"case": {"boulders_total": 5}, "surface": {"ground": "meadow"}}
    page.edit(1, layers={"sources": [point(150, 40)]}, settings=settings)
    for name in NAMES:
        for kind in "save", "report", "export":
            page.send(kind, name=name, overwrite=True)
            assert page.until("refused")["task"] == kind, name
    assert sorted(place.iterdir()) == before


def test_files_are_replaced_on_request_only_and_inputs_never(serve, place, visit):
    make_layer(
        "stand.gpkg", [__import__("shapely").box(W, N - 400, W + 300, N - 300)], stems=[300.0]
    )
    forest = "&forest polygons = 'stand.gpkg', uniform_dbh_mean = 30.0, uniform_dbh_std = 8.0 /\n"
    Path("case.nml").write_text(CASE + forest, encoding="utf-8")
    page, text = visit(serve()), Path("case.nml").read_text()
    page.send("save", name="case")
    refused = page.until("refused")
    assert refused["exists"] and "case.nml" in refused["text"]
    assert Path("case.nml").read_text() == text and not Path("case.gpkg").exists()
    page.send("save", name="stand", overwrite=True)
    refused = page.until("refused")
    assert not refused["exists"] and "stand.gpkg: is an input" in refused["text"]
    assert str(place) not in refused["text"] and not Path("stand.nml").exists()
    page.send("save", name="case", overwrite=True)
    assert page.until("saved")["files"] == ["case.nml", "case.gpkg"]
    assert Path("case.nml").read_text() != text


@pytest.mark.skipif(
    os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere, Windows has other rights"
)
def test_a_folder_that_is_read_only_serves_until_something_is_saved(serve, place, visit):
    folder = place / "locked"
    folder.mkdir()
    for name in "dem.tif", "sets.nml", "case.nml":
        (place / name).rename(folder / name)
    folder.chmod(0o555)
    page = visit(serve(folder / "case.nml"))
    page.until("batch", complete=True)
    page.send("save", name="x")
    assert "cannot be written" in page.until("refused")["text"]
    folder.chmod(0o755)


@pytest.mark.all
def test_layers_are_exported_from_a_fresh_run(serve, visit):
    page = visit(serve())
    page.send("export", name="out")
    done = page.until("done", task="export")
    assert done["files"][0] == "out.nc" and Path("out_layers/rockfall.gpkg").is_file()
    fresh = rockfall.run(rockfall.read_case("out.nml"))
    same_variables(fresh, rockfall.read_result("out.nc"))
    page.send("export", name="out")
    assert page.until("refused")["exists"]


def test_the_report_is_that_of_a_fresh_run(serve, visit, blank_figures):
    page = visit(serve(), {"language": "fr"})
    page.send("report", name="rapport")
    found = page.all_until("done", task="report")
    assert found[-1]["files"] == ["rapport.nc", "rapport.html"]
    done = [one["done"] for one in found if one["type"] == "progress" and one["total"]]
    assert done[-1] == 120 and done == sorted(done)
    assert '<html lang="fr"' in Path("rapport.html").read_text(encoding="utf-8")


@makes_links
def test_nothing_is_written_through_a_link_to_a_folder(serve, place, visit):
    (place / "elsewhere").mkdir()
    os.symlink(place / "elsewhere", "out_layers")
    os.symlink(place / "sets.nml", "out.nc")
    page, sets = visit(serve()), Path("sets.nml").read_text()
    page.send("export", name="out", overwrite=True)
    assert "out_layers: is a link" in page.until("refused")["text"]
    assert not Path("out.nml").exists() and not [*(place / "elsewhere").iterdir()]
    assert Path("sets.nml").read_text() == sets


def test_drawing_a_report_can_be_cancelled(serve, visit, monkeypatch):
    figure = pytest.importorskip("matplotlib.figure", reason="the report extra is not installed")

    def report(*_, **__):
        while True:
            style.save(figure.Figure((1, 1)), "x.png")

    monkeypatch.setattr("rockfall.products.report", report)
    page = visit(serve())
    page.send("report", name="x")
    page.until("progress", total=0)
    page.send("cancel")
    assert page.until("refused", task="report")["text"] == "cancelled"
    assert page.edit(1)["errors"] == []


def test_a_case_that_is_being_run_is_not_saved_over(serve, visit):
    page = visit(serve())
    page.edit(1, settings=LONG)
    page.send("export", name="long")
    page.until("progress")
    page.edit(2, settings={"case": {"boulders_total": 5}})
    page.send("save", name="long", overwrite=True)
    assert page.until("refused")["task"] == "save"
    page.send("save", name="other")
    assert page.until("saved")["document_revision"] == 2
    page.send("cancel")
    page.until("refused", task="export")


def test_a_task_can_be_cancelled_and_leaves_no_result(serve, visit):
    page = visit(serve())
    page.edit(1, settings=LONG)
    page.send("export", name="long")
    page.until("saved")
    page.send("export", name="other")
    assert page.until("refused", task="export")
    page.send("cancel")
    page.until("refused", task="export")
    assert not Path("long.nc").exists() and not Path("long_layers").exists()


PROGRAM = """
import os
import sys
import time
from pathlib import Path
from rockfall.app import server, tasks
from rockfall.cli.command_line import main
server.PAGE = Path("page")
tasks.SAVE_SECONDS = 0.01


def replace(source, target, rename=os.replace):
    if str(target).endswith(os.environ.get("HELD", "/")):
        print("held", flush=True)
        time.sleep(1000)
    rename(source, target)


os.replace = replace
if os.environ.get("HELD", "").endswith(".html"):
    import pytest
    from made import leave_pictures_blank

    leave_pictures_blank(pytest.MonkeyPatch())
sys.exit(main(["app", "case.nml", *sys.argv[1:]]))
"""


@contextmanager
def program(*options, **environment):
    """Yield the process of a window and its address; the process is killed at the end."""
    command = [sys.executable, "-c", PROGRAM, *(options or ("--no-browser",))]
    path = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    about = {"stdout": PIPE, "stderr": PIPE, "text": True}
    about["env"] = os.environ | {"PYTHONPATH": path} | environment
    with subprocess.Popen(command, **about) as child:
        address = child.stdout.readline()
        port, key = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/#key=([\w-]{32})\n", address).groups()
        try:
            yield child, SimpleNamespace(port=int(port), key=key)
        finally:
            child.kill()


@pytest.mark.all
def test_a_run_to_a_file_has_the_bits_of_the_command_line(serve, visit):
    page = visit(serve())
    assert page.until("unfinished")["runs"] == []
    page.send("simulate", name="long")
    found = page.all_until("done", task="simulate")
    assert found[-1]["files"] == ["long.nc"]
    told = [(one["done"], one["total"]) for one in found if one["type"] == "progress"]
    assert told[-1] == (120, 120)
    assert main(["run", "long.nml", "--quiet", "--output", "other.nc"]) == 0
    same_variables(rockfall.read_result("long.nc"), rockfall.read_result("other.nc"))
    assert sorted(one.name for one in Path().glob("long.*")) == ["long.gpkg", "long.nc", "long.nml"]


@pytest.mark.all
def test_a_run_to_a_file_that_is_stopped_goes_on(serve, visit):
    page = visit(serve())
    page.edit(1, settings={"case": {"boulders_total": 40_000}})
    page.send("stop")
    page.send("simulate", name="long")
    page.until("progress")
    page.send("cancel")
    *_, (run,), _ = [one.get("runs") for one in page.all_until("refused", task="simulate")]
    assert run["name"] == "long" and 0 < run["boulders"] < 40_000
    assert not Path("long.nc").exists()
    page.send("simulate", name="long", overwrite=False)
    assert page.until("refused")["exists"]
    later = visit(serve())
    assert later.until("unfinished")["runs"] == [run]
    for name in "other", "../long", 5:
        later.send("resume", name=name)
        assert later.until("refused", task="resume")
    later.send("resume", name="long")
    found = later.all_until("done", task="simulate")
    assert min(one["done"] for one in found if one["type"] == "progress") >= run["boulders"]
    assert found[-2] == {"type": "unfinished", "runs": []}
    fresh = rockfall.run(rockfall.read_case("long.nml"))
    same_variables(fresh, rockfall.read_result("long.nc"))


@pytest.mark.all
def test_a_run_to_a_file_outlives_its_window(serve, visit):
    with program() as (child, server):
        page = visit(server)
        page.edit(1, settings={"case": {"boulders_total": 40_000}})
        page.send("simulate", name="long")
        page.until("saved")
        while not Path("long.nc.checkpoint").exists():
            time.sleep(0.01)
        child.kill()
    assert not Path("long.nc").exists()
    page = visit(serve())
    (run,) = page.until("unfinished")["runs"]
    assert run["name"] == "long" and run["boulders"] > 0
    page.send("resume", name="long")
    page.until("done", task="simulate")
    assert rockfall.read_result("long.nc").sizes["boulder"] == 40_000


@pytest.mark.all
@pytest.mark.parametrize("name", ["x.nc", "x.html", "x_layers"])
def test_a_killed_task_leaves_no_half_file_of_its_name(name, visit):
    """The process is killed when the content is written, but the file does not have its name
    yet."""
    kind = "export" if name == "x_layers" else "report"
    with program(HELD="rockfall.gpkg" if kind == "export" else name) as (child, server):
        page = visit(server)
        page.send(kind, name="x")
        assert child.stdout.readline() == "held\n"
        child.kill()
    assert not Path(name).exists()
    assert rockfall.read_case("x.nml").case["boulders_total"] == 120
    if name != "x.nc":
        assert rockfall.read_result("x.nc").sizes["boulder"] == 120


def test_the_second_page_reads_until_it_takes_over(serve, visit):
    server = serve()
    first, second = editor_and_reader(visit, server, {"language": "de"})
    welcome = second.until("welcome")
    assert not welcome["writer"] and welcome["language"] == "de"
    first.edit(3, layers={"lines": [line(260, name="M")]})
    document = second.until("document", revision=3)["document"]
    assert document["layers"]["lines"][0]["properties"] == {"name": "M"}
    batch = second.until("batch", revision=3, complete=True)
    assert [one["name"] for one in batch["lines"]] == ["M"]
    for kind in "edit", "save", "stop", "view":
        second.send(kind, revision=4)
        assert second.until("refused", task=kind)
    second.send("take_over")
    document = second.until("document")
    assert document["document"]["layers"]["lines"][0]["properties"] == {"name": "M"}
    assert second.until("role")["writer"] and not first.until("role")["writer"]
    second.edit(4, layers={"lines": []})
    first.send("edit", revision=5, layers={})
    assert first.until("refused", task="edit")
    second.close()
    assert first.until("role")["writer"]


def test_a_page_that_comes_later_gets_what_is_known(serve, visit):
    server = serve()
    first = visit(server)
    first.until("batch", complete=True)
    first.until("trajectories")
    first.send("view", map="passages", trajectories=3)
    first.until("trajectories", append=False)
    second = visit(server)
    kinds = [one["type"] for one in second.all_until("trajectories")]
    assert kinds == ["welcome", "unfinished", "terrain", "state", "batch", "trajectories"]


def test_the_server_ends_when_the_last_page_has_closed(place, visit):
    server = Server(bind(0), page=place / "page", grace=0.0)
    server.admit(Room(Path("case.nml")))
    thread = threading.Thread(target=server.run)
    thread.start()
    first, second = editor_and_reader(visit, server)
    second.until("welcome")
    first.close()
    assert second.until("role")["writer"]
    second.edit(1)
    second.close()
    thread.join(600)
    assert not thread.is_alive()


@pytest.mark.skipif(os.name == "nt", reason="modes of files are POSIX's")
def test_command_lines_have_no_key(place, visit):
    browser = place / "browser"
    browser.write_text('#!/bin/sh\necho "$@" >asked.new\nmv asked.new asked\n')
    browser.chmod(0o755)
    with program("--keep", BROWSER=f"{browser} %s") as (_, server):
        while not Path("asked").exists():
            time.sleep(0.01)
        asked = Path("asked").read_text().strip()
        assert server.key not in asked
        file = Path(asked.removeprefix("file://"))
        assert (file.stat().st_mode & 0o777, file.parent.stat().st_mode & 0o777) == (0o600, 0o700)
        assert f'url=http://127.0.0.1:{server.port}/#key={server.key}"' in file.read_text()
        visit(server).until("welcome")
        end = time.monotonic() + 600
        while file.parent.exists():
            assert time.monotonic() < end
            time.sleep(0.01)


@pytest.mark.all
@sends_signals
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_the_server_quietly(place, stop):
    with program() as (child, _):
        child.send_signal(stop)
        said, errors = child.communicate(timeout=600)
    assert (said, errors, child.returncode) == ("", "", 0)


def test_a_file_that_cannot_be_opened_is_told_on_the_page(place, visit):
    server = Server(bind(0), page=place / "page")
    thread = threading.Thread(target=server.run)
    thread.start()
    page = visit(server)
    server.refuse(RockfallError("case.nml: &case: no such key"))
    assert page.get() == {"type": "fault", "text": "case.nml: &case: no such key"}
    thread.join(600)
    assert not thread.is_alive()


def test_a_case_that_is_wrong_ends_the_command(place, capsys):
    Path("wrong.nml").write_text("&case seed = 'x' /\n")
    assert main(["app", "wrong.nml", "--no-browser"]) == 2
    assert "wrong.nml: &case seed" in capsys.readouterr().err


@pytest.mark.all
def test_the_base_of_a_case_with_variants_is_named_and_run_by_its_command(serve, varied, visit):
    page = visit(serve(varied))
    welcome = page.until("welcome")
    assert welcome["base"] == welcome["document"] and welcome["base"]["variant"] == ""
    assert "--variant base" in page.until("state")["warnings"][0]
    shown = page.until("batch", complete=True)["lines"]
    assert main(["run", str(varied), "--variant", "base", "-o", "base.nc"]) == 0
    fresh = rockfall.line_statistics(rockfall.read_result("base.nc"), quantities=["speed"])
    assert [one["n"] for one in shown] == fresh["n"].tolist() and len(shown) == 3
    net = welcome["variants"][1]
    page.edit(1, layers=net["layers"], settings=net["settings"], variant="net")
    base = welcome["base"]
    page.edit(2, layers=base["layers"], settings=base["settings"], variant="")
    assert page.until("batch", revision=2, complete=True)["lines"] == shown


def test_a_reload_does_not_end_the_server(serve, visit):
    server = serve("dem.tif", keep=False)
    visit(server).close()
    while server._left is None:
        time.sleep(0.01)
    visit(server).until("welcome")
    assert server._left is None


def test_a_page_that_comes_while_another_leaves_keeps_the_server(place):
    with bind(0) as bound:
        server = Server(bound, page=place / "page", grace=0.0)
        server.admit(Room(Path("dem.tif")))

        async def leave_and_come():
            server._end_later(server._opening.result())
            server._opening.result().enter(Client(lambda *_: None), {})
            await asyncio.sleep(0.01)

        asyncio.run(leave_and_come())
        assert not server._server.should_exit
        server._opening.result().close()


def test_files_opened_before_are_offered(serve, place, visit):
    serve("dem.tif")
    serve("case.nml")
    page = visit(serve(None))
    welcome = page.get()
    assert welcome["mode"] == "start"
    assert [one["name"] for one in welcome["recent"]] == ["case.nml", "dem.tif"]
    page.send("edit", revision=1)
    page.until("refused")
    visit(serve("dem.tif")).get()  # now first, but not in this page's list
    page.send("open_recent", index=0)
    assert page.until("welcome")["mode"] == "case"
    page.until("batch", complete=True)


# Results.


@pytest.fixture
def result(place):
    case = rockfall.read_case("case.nml").replace(case={"boulders_total": 40})
    rockfall.write_result(rockfall.run(case), "result.nc")
    return Path("result.nc")


def test_a_result_is_shown_and_not_edited(serve, result, visit):
    page = visit(serve(result))
    welcome = page.get()
    assert welcome["mode"] == "result" and [one["name"] for one in welcome["maps"]] == ["passages"]
    assert np.isfinite(page.until("terrain")["arrays"]["heights"]).any()
    assert page.until("background")["arrays"]["sources"].tolist() == [[W + 150, N - 40]]
    batch = page.until("batch")
    assert batch["complete"] and batch["total"] == 40 and batch["lines"][0]["name"] == "L"
    assert page.until("trajectories")["count"] == 20
    page.send("edit", revision=1)
    page.until("refused", task="edit")
    page.send("view", map="", trajectories=2)
    assert page.until("trajectories")["count"] == 2


def test_a_result_without_its_terrain_is_shown_all_the_same(result):
    Path("dem.tif").unlink()
    found = exhibit.Exhibit(rockfall.read_result(result), result)
    kinds = [decoded(message)["type"] for _, message in found.messages()]
    assert kinds == ["terrain", "background", "state", "batch", "trajectories"]


def test_show_makes_one_page_that_needs_nothing_else(place, result, monkeypatch):
    monkeypatch.setattr(show, "PAGE", place / "page")
    (place / "page/app.js").write_text("const end = '</script><!--';")
    data = rockfall.read_result(result)
    data.attrs["title"] = "</script><b>"
    data.attrs["case"] = data.attrs["case"].replace('Ünter "dem" Fels', "</script><b>")
    shown = rockfall.show(data)
    path = shown.save("shown.html")
    text = path.read_text(encoding="utf-8")
    assert text.count("</script>") == 2 and "src=" not in text and "href=" not in text
    assert r"const end = '<\/script><\!--';" in text and "<b>" not in text
    held = re.search(r'<script type="text/plain" id="messages">(.*?)</script>', text, re.DOTALL)[1]
    messages = [
        decoded(base64.b64decode(one)) if isinstance(one, str) else one for one in json.loads(held)
    ]
    kinds = [one["type"] for one in messages]
    assert kinds == ["welcome", "terrain", "background", "state", "batch", "trajectories"]
    assert messages[0]["title"] == "</script><b>"
    assert 'srcdoc="' in shown._repr_html_() and "<!doctype" not in shown._repr_html_()
    (place / "page/app.js").unlink()
    with pytest.raises(RockfallError, match=r"run `\./run page`$"):
        rockfall.show(result)


def test_binary_messages_are_aligned():
    for size in range(9):
        arrays = {"a": np.arange(size, dtype="u1"), "b": np.array([[1.5, np.nan]], "f8")}
        found = decoded(binary_message("x", arrays, name="ä" * size, value=np.nan))
        assert found["value"] is None and found["name"] == "ä" * size
        assert found["arrays"]["a"].tolist() == [*range(size)]
        assert found["arrays"]["b"][0, 0] == 1.5
