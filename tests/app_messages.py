# SPDX-License-Identifier: BSD-3-Clause
"""Messages of the live window's server, decoded as its page does."""

import json
import struct

import numpy as np

PATIENCE = 600.0  # maximum wait [s], on a busy machine


def decoded(message):
    if isinstance(message, str):
        return json.loads(message)
    size = struct.unpack_from("<I", message)[0]
    header, base = json.loads(message[4 : 4 + size]), 4 + size
    assert base % 8 == 0
    header["arrays"] = {
        one["name"]: np.frombuffer(
            message, f"<{one['dtype']}", int(np.prod(one["shape"])), base + one["offset"]
        ).reshape(one["shape"])
        for one in header["arrays"]
    }
    return header


class Talk:
    """Client of a room that acts like the page in the browser, but without a socket."""

    def __init__(self, room, page, sent):
        self.room, self.page, self.sent = room, page, sent

    def send(self, type, **content):
        self.room.take(self.page, json.dumps({"type": type, **content}))

    def ask(self, **view):
        self.send("view", **{"map": "passages", "trajectories": 20, "lines": [], **view})

    def until(self, type, **content):
        while True:
            found = self.sent.get(timeout=PATIENCE)
            assert found["type"] != "fault", found
            if found["type"] == type and content.items() <= found.items():
                return found
