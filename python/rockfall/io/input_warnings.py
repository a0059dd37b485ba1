# SPDX-License-Identifier: BSD-3-Clause
"""Warnings about likely mistakes in inputs, in the form stored in result files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rockfall.io.vectors.layers import REPROJECTED
from rockfall.language import Text, packed, unpacked


class InputWarning(NamedTuple):
    """A warning about an input that is probably a mistake."""

    where: str  # file, group and key, as named in the case
    text: str  # literal meaning of the input, and the probable intention

    @classmethod
    def of(cls, stored: Sequence[Any]) -> InputWarning:
        """Warning from the attribute `input_warnings` of a file; older files have only English."""
        where, text, *data = stored
        return cls(str(where), unpacked(data[0] if data else None, text))

    @property
    def is_reprojection(self) -> bool:
        """Return True for a reprojected layer; reports mention it in the list of files."""
        if isinstance(self.text, Text):
            return self.text.key.startswith("input.reprojected")
        return self.text.startswith(REPROJECTED)


def stored_warnings(warnings: Iterable[InputWarning]) -> str:
    """Attribute value `input_warnings`: place, English text and message."""
    return json.dumps([[*warning, packed(warning.text)] for warning in warnings])
