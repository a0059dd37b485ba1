# SPDX-License-Identifier: BSD-3-Clause
"""Web map service added by the user: the only external host that the page contacts."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING
from urllib.parse import parse_qsl, urlsplit

from rockfall.errors import RockfallError

if TYPE_CHECKING:
    from rockfall.io.rasters.grid import Grid

_HOST = re.compile(r"[A-Za-z0-9.-]+(:[0-9]+)?")


def origin_of(url: str) -> str:
    """Scheme, host and port of a WMS address, or "" without an address. Raises a RockfallError if
    the address is not valid or has no layers."""
    parts = urlsplit(url)
    if not url:
        return ""
    if parts.scheme not in ("http", "https") or not _HOST.fullmatch(parts.netloc) or not _of(url):
        raise RockfallError(f"--wms {url}: must be https://HOST/PATH?LAYERS=NAME")
    return f"{parts.scheme}://{parts.netloc}"


def _of(url: str) -> str:
    """Layers in a WMS address."""
    given = {key.lower(): value for key, value in parse_qsl(urlsplit(url).query)}
    return given.get("layers", "")


def web_map(url: str, grid: Grid) -> dict[str, str] | None:
    """Address and layers of a WMS, and the CRS of the terrain, as sent to the page; None without a
    WMS. Raises a RockfallError if the CRS has no EPSG code."""
    if not origin_of(url):
        return None
    code = grid.crs.to_epsg() if grid.crs is not None else None
    if code is None:
        raise RockfallError("--wms needs a terrain whose CRS has an EPSG code")
    return {"url": url.partition("?")[0], "layers": _of(url), "crs": f"EPSG:{code}"}
