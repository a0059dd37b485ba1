# SPDX-License-Identifier: BSD-3-Clause
"""The live window in a browser."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from threading import Thread

from rockfall.app.room import Room
from rockfall.app.server import Server, bind, open_browser
from rockfall.cli.messages import DONE
from rockfall.errors import need
from rockfall.interrupts import interrupts

LOOK_SECONDS = 0.1  # between looks for Ctrl-C


def app_command(arguments: argparse.Namespace) -> int:
    need("the window needs", "app", "starlette", "uvicorn", "websockets", "shapely")
    bound = bind(arguments.port)
    room = Room(arguments.path, arguments.language)
    server = Server(room, bound, keep=arguments.keep)
    with interrupts() as interrupted:  # uvicorn heeds no signals outside the main thread
        print(server.url, flush=True)
        thread = Thread(target=server.run, name="server")
        thread.start()
        with ExitStack() as opening:
            if not arguments.no_browser:
                opening.enter_context(open_browser(server.url))
            while thread.is_alive() and not interrupted():
                thread.join(LOOK_SECONDS)
                if not room.is_empty:
                    opening.close()  # the page has the key
        server.stop()
        thread.join()
    return DONE
