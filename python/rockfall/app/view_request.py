# SPDX-License-Identifier: BSD-3-Clause
"""Checks of the view that a page requests."""

from collections.abc import Collection
from typing import Any

from rockfall.app.edited.features import positions
from rockfall.app.messages import Refused
from rockfall.app.pictures import MAX_TRAJECTORIES, View
from rockfall.app.surroundings import Offers
from rockfall.language import say

MAX_VISIBLE = 200  # maximum lines in view


def view_of(message: dict[str, Any], maps: Collection[str], offers: Offers) -> View:
    """Return the view in a message `view`. Raise Refused for values of a wrong type, and for a map
    or layer not in `maps` or `offers`."""

    def text(key: str, allowed: Collection[str] | None = None) -> str:
        value = message.get(key, "")
        if type(value) is not str or not (allowed is None or value in ("", *allowed)):
            raise Refused(say("app.server_wrong_type", name=key))
        return value

    number, lines = message.get("trajectories", 0), message.get("lines", [])
    if type(number) is not int or not 0 <= number <= MAX_TRAJECTORIES:
        raise Refused(say("app.server_wrong_type", name="trajectories"))
    if (
        not isinstance(lines, list)
        or len(lines) > MAX_VISIBLE
        or any(type(line) is not str for line in lines)
    ):
        raise Refused(say("app.server_wrong_type", name="lines"))
    cut = message.get("section") or []
    hazard = message.get("hazard", False)
    if type(hazard) is not bool:
        raise Refused(say("app.server_wrong_type", name="hazard"))
    return View(
        text("map", maps), number, tuple(lines),
        section=tuple(tuple(at) for at in positions(cut, 2, {})) if cut else (),
        objects=text("objects", offers.objects), basemap=text("basemap", offers.basemaps),
        net=text("net"), hazard=hazard, origin=text("origin"),
    )  # fmt: skip
