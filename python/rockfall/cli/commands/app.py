# SPDX-License-Identifier: BSD-3-Clause
"""Live window in a browser."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from importlib import import_module
from threading import Thread
from typing import TYPE_CHECKING

from rockfall.app.server import Server, bind, open_browser
from rockfall.cli.messages import DONE
from rockfall.errors import RockfallError, need
from rockfall.interrupts import interrupts

if TYPE_CHECKING:
    from rockfall.app.room import Room

LOOK_SECONDS = 0.1  # interval between checks for Ctrl-C
TELL_SECONDS = 5.0  # time for the browser to connect and show an error [s]


def app_command(arguments: argparse.Namespace) -> int:
    need("the window needs", "app", "starlette", "uvicorn", "websockets")
    if arguments.path is not None and not arguments.path.is_file():
        raise RockfallError(f"{arguments.path}: no such file")
    server = Server(bind(arguments.port), keep=arguments.keep, wms=arguments.wms)
    with interrupts() as interrupted, ExitStack() as ending:  # uvicorn ignores signals in a thread
        print(server.url, flush=True)
        thread = Thread(target=server.run, name="server")
        thread.start()
        ending.callback(thread.join)
        ending.callback(server.stop)
        with ExitStack() as opening:
            if not arguments.no_browser:
                opening.enter_context(open_browser(server.url))
            try:
                room = _open_room(arguments)
            except RockfallError as error:
                server.refuse(error)
                if not arguments.no_browser:
                    thread.join(TELL_SECONDS)
                raise
            server.admit(room)
            while thread.is_alive() and not interrupted():
                thread.join(LOOK_SECONDS)
                if not room.is_empty:
                    opening.close()  # the page has the key
    return DONE


def _open_room(arguments: argparse.Namespace) -> Room:
    """Open the file; imports are delayed until here, while the browser loads the page."""
    need("the window needs", "app", "shapely")
    rooms = import_module("rockfall.app.room")
    given = rooms.Given(
        arguments.objects, arguments.objects_layer, arguments.basemap, arguments.wms
    )
    room: Room = rooms.Room(arguments.path, arguments.language, given)
    return room
