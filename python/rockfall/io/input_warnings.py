# SPDX-License-Identifier: BSD-3-Clause
"""Warnings about likely mistakes in inputs, in the form stored in result files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rockfall.language import Text, packed, unpacked


class InputWarning(NamedTuple):
    """A warning about an input that is probably a mistake."""

    where: str  # file, group and key, as named in the case
    text: str  # literal meaning of the input, and the probable intention

    @classmethod
    def of(cls, stored: Sequence[Any]) -> InputWarning:
        """Warning from a row of the attribute `input_warnings`: place, English text, and
        message."""
        where, text, data = stored
        return cls(str(where), unpacked(data, text))

    @property
    def is_reprojection(self) -> bool:
        """Return True for a reprojected layer; reports mention it in the list of files."""
        return isinstance(self.text, Text) and self.text.key.startswith("input.reprojected")


def doubts_in(*stored: str) -> list[InputWarning]:
    """Warnings in these attribute values, without duplicates and without reprojections."""
    rows = dict.fromkeys(InputWarning.of(row) for text in stored for row in json.loads(text))
    return [row for row in rows if not row.is_reprojection]


def stored_warnings(warnings: Iterable[InputWarning]) -> str:
    """Attribute value `input_warnings`: place, English text and message."""
    return json.dumps([[*warning, packed(warning.text)] for warning in warnings])
