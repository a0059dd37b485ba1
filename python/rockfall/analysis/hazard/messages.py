# SPDX-License-Identifier: BSD-3-Clause
"""Stored model warnings of the scenarios in a hazard."""

from __future__ import annotations

import json

import xarray as xr

from rockfall.language import Text, unpacked


def messages_of(hazard: xr.Dataset) -> dict[str, list[Text]]:
    """Model warnings of each scenario, in the current language."""
    names, messages = (hazard[f"scenario{end}"].values for end in ("", "_messages"))
    by_name: dict[str, list[Text]] = {}
    for name, packed_texts in zip(names, messages, strict=True):
        texts = (unpacked(data, "") for data in json.loads(packed_texts))
        by_name[str(name)] = [text for text in texts if isinstance(text, Text)]
    return by_name
