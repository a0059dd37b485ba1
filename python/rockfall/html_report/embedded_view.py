# SPDX-License-Identifier: BSD-3-Clause
"""The page of `rockfall.show` within a report: maps and trajectories in three dimensions.

It is packed, and unpacked on request, so that other readers do not wait.
"""

from __future__ import annotations

import base64
import hashlib
import re
import zlib
from typing import NamedTuple


class EmbeddedView(NamedTuple):
    """Packed page, and the hash that permits its script within the report."""

    page: str
    script_hash: str


def embedded(page: str) -> EmbeddedView:
    """Pack a page that has one script."""
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    checksum = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return EmbeddedView(base64.b64encode(zlib.compress(page.encode(), 9)).decode(), checksum)
