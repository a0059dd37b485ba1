# SPDX-License-Identifier: BSD-3-Clause
"""Run `rockfall` in forks of a process that has imported everything, because starting Python takes
longer than most commands. Back-analyses are short, and hazards have no figures. Prints a line when
ready. Usage: forks.py SOCKET"""

import json
import os
import socket
import sys

import pandas  # noqa: F401
import pyogrio  # noqa: F401
import rasterio  # noqa: F401
import scipy.stats  # noqa: F401
import xarray  # noqa: F401
from matplotlib.figure import Figure

from rockfall.cli import main
from rockfall.cli.commands import hazard
from rockfall.studies.back import study


def run(words, folder, env, streams):
    """Run a command as in a process of its own; return its exit status."""
    for k, stream in enumerate(streams):
        os.dup2(stream, k)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(env)
    status = main(words)
    sys.stdout.flush()
    return status


if __name__ == "__main__":
    study.ROUND = 16
    hazard.hazard_figures = lambda *_: []
    hazard.hazard_sheet = lambda *_: Figure(figsize=(1, 1))
    server = socket.socket(socket.AF_UNIX)
    server.bind(sys.argv[1])
    server.listen()
    print("ready", flush=True)
    while True:
        asked = server.accept()[0]
        text, streams, *_ = socket.recv_fds(asked, 2**20, 3)
        child = os.fork()
        if not child:
            os._exit(run(**json.loads(text), streams=streams))
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        asked.send(bytes([status if status >= 0 else 255]))
        for stream in streams:
            os.close(stream)
        asked.close()
