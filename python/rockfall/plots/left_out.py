# SPDX-License-Identifier: BSD-3-Clause
"""Parts that figures and pages omit, because a file of the case cannot be read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import ParamSpec, TypeVar

from rockfall.errors import RockfallError
from rockfall.language import Text, say

Given = ParamSpec("Given")
Made = TypeVar("Made")


class LeftOut:
    """Omitted parts, by the error that prevents them."""

    def __init__(self) -> None:
        self._parts: dict[str, list[Text]] = {}

    def attempt(
        self, part: str, make: Callable[Given, Made], *given: Given.args, **more: Given.kwargs
    ) -> Made | None:
        """Return the result of `make` for its arguments. On a RockfallError, note the omitted
        `part` (a message id) and return None."""
        try:
            return make(*given, **more)
        except RockfallError as error:
            for fault in error.faults:
                parts = self._parts.setdefault(fault, [])
                parts += [] if part in (text.key for text in parts) else [say(part)]
            return None

    def notes(self) -> Iterator[Text]:
        """A line for each error, with the omitted parts."""
        for fault, parts in self._parts.items():
            yield say("page.left_out", parts=[*map(say, (text.key for text in parts))], why=fault)
