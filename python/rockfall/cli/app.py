# SPDX-License-Identifier: BSD-3-Clause
"""The live window in a browser."""

from __future__ import annotations

import argparse

from rockfall.app.room import Room
from rockfall.app.server import Server, bind, open_browser
from rockfall.cli.messages import DONE
from rockfall.errors import need


def app_command(arguments: argparse.Namespace) -> int:
    need("the window needs", "app", "starlette", "uvicorn", "websockets", "babel", "shapely")
    bound = bind(arguments.port)
    server = Server(Room(arguments.path, arguments.language), bound, keep=arguments.keep)

    def ready() -> None:
        print(server.url, flush=True)
        if not arguments.no_browser:
            open_browser(server.url)

    try:
        server.run(ready)
    except KeyboardInterrupt:  # that is how it is left
        pass
    return DONE
