# SPDX-License-Identifier: BSD-3-Clause
"""Stored model warnings of the scenarios in a hazard."""

from __future__ import annotations

import xarray as xr

from rockfall.language import Text, unpacked_texts


def stored_warnings(hazard: xr.Dataset) -> dict[str, list[str]]:
    """Model warnings of each scenario, in the current language; English for those of later
    versions."""
    stored = (hazard[f"scenario{end}"].values for end in ("", "_warnings", "_messages"))
    rows = zip(*stored, strict=True)
    return {str(name): unpacked_texts(str(lines), data) for name, lines, data in rows}


def messages_of(hazard: xr.Dataset) -> dict[str, list[Text]]:
    """Model warnings of each scenario that this version can word."""
    return {
        name: [text for text in texts if isinstance(text, Text)]
        for name, texts in stored_warnings(hazard).items()
    }
