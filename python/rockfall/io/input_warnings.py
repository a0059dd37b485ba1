# SPDX-License-Identifier: BSD-3-Clause
"""Warnings about likely mistakes in inputs, as stored in result files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rockfall.io.vectors.layers import REPROJECTED
from rockfall.language import Text, packed, unpacked


class InputWarning(NamedTuple):
    """An input that is likely a mistake."""

    where: str  # file, group and key, with the names used in the case
    text: str  # its literal meaning, and what may have been meant

    @classmethod
    def of(cls, stored: Sequence[Any]) -> InputWarning:
        """Warning from the attribute `input_warnings` of a file; older files have English only."""
        where, text, *data = stored
        return cls(str(where), unpacked(data[0] if data else None, text))

    @property
    def is_reprojection(self) -> bool:
        """Return True for a reprojected layer, which reports list with the files."""
        if isinstance(self.text, Text):
            return self.text.key.startswith("input.reprojected")
        return self.text.startswith(REPROJECTED)


def stored_warnings(warnings: Iterable[InputWarning]) -> str:
    """Value of the attribute `input_warnings`: place, English text and message."""
    return json.dumps([[*warning, packed(warning.text)] for warning in warnings])
