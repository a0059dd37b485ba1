# SPDX-License-Identifier: BSD-3-Clause
"""Runs of the program as a separate process, independent of QGIS."""

import os
import queue
import re
import signal
import subprocess
import threading

#: Variables of the Python, GDAL and PROJ of QGIS, or of its environment, which the program must
#: not inherit.
FOREIGN = ("PYTHON", "GDAL_", "PROJ_", "VIRTUAL_ENV", "CONDA_", "__PYVENV_LAUNCHER__")
PROGRESS = re.compile(r"rockfall: (\d+) of (\d+) ")
WARNING = "rockfall: warning: "
INTERRUPTED = 130


class Refused(Exception):
    """Raised if the program fails, with its message in one line."""


class Interrupted(Exception):
    """Raised if the program was cancelled, with a line on the results kept."""


def call(words, feedback):
    """Run the program with these arguments; returns its output.

    `feedback` is QgsProcessingFeedback, or has its setProgress, pushInfo, pushWarning, isCanceled.
    """
    feedback.pushInfo(" ".join(words))
    env = {key: value for key, value in os.environ.items() if not key.startswith(FOREIGN)}
    try:
        process = subprocess.Popen(
            words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            encoding="utf-8", errors="replace", env={**env, "ROCKFALL_PROGRESS": "lines"},
        )  # fmt: skip
    except OSError as error:
        raise Refused(f"{words[0]}: cannot be started: {error.strerror}") from error
    printed, last = _follow(process, feedback)
    if process.returncode == INTERRUPTED:
        raise Interrupted(last)
    if process.returncode != 0:
        raise Refused(last or f"rockfall: ended with status {process.returncode}")
    return printed


def _follow(process, feedback):
    """Forward the messages of a process until it ends; returns its output, and its last message."""
    lines = queue.Queue()
    for stream in process.stdout, process.stderr:
        threading.Thread(target=_read, args=(stream, lines), daemon=True).start()
    printed, last, open_streams, asked = [], "", 2, False
    while open_streams:
        if feedback.isCanceled() and not asked:
            process.send_signal(signal.SIGINT)  # once: a second signal would end it without saving
            asked = True
        try:
            stream, line = lines.get(timeout=0.1)
        except queue.Empty:
            continue
        if line is None:
            open_streams -= 1
        elif stream is process.stdout:
            printed.append(line)
            feedback.pushInfo(line)
        elif found := PROGRESS.match(line):
            feedback.setProgress(100.0 * int(found[1]) / max(1, int(found[2])))
        elif line.startswith(WARNING):
            feedback.pushWarning(line.removeprefix(WARNING))
        else:
            last = line or last
    process.wait()
    return printed, last


def _read(stream, lines):
    """Put the lines of a stream into a queue, and None at its end."""
    with stream:
        for line in stream:
            lines.put((stream, line.rstrip("\n")))
    lines.put((stream, None))
