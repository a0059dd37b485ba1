# SPDX-License-Identifier: BSD-3-Clause
"""A result as a self-contained page, for Jupyter and for files."""

from __future__ import annotations

import base64
import html
import json
import re
from pathlib import Path
from typing import Any

import xarray as xr

from rockfall.app.exhibit import Exhibit
from rockfall.app.messages import Message
from rockfall.app.room import about_shown
from rockfall.app.server import PAGE, check_page
from rockfall.errors import OUR_FAULT, RockfallError, need
from rockfall.io.atomic import atomic_write
from rockfall.io.output_files import check_output
from rockfall.language import texts_of
from rockfall.result.dataset import read_result
from rockfall.version import __version__

_END = re.compile(r"</(?=script|style)|<!--", re.IGNORECASE)
HEIGHT = 700  # height in a notebook [pixel]
_STYLE = re.compile(r'<link\b[^>]*href="\.?/?app\.css"[^>]*>')
_SCRIPT = re.compile(r'<script\b[^>]*src="\.?/?app\.js"[^>]*></script>')


def show(result: xr.Dataset | str | Path, language: str = "en") -> View:
    """Interactive view of a result (a Dataset, or its netCDF file) for Jupyter: map with lines,
    rasters and stopping points, and trajectories in three dimensions, as in `rockfall app`.

    Needs the `[app]` extra. Raises RockfallError for an unknown language, or a file that is not a
    result.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> rockfall.show(result).save("view.html").name
    'view.html'
    """
    need("a view needs", "app", "shapely")
    check_page(PAGE)
    file = Path(result) if isinstance(result, str | Path) else None
    data: Any = result if file is None else read_result(file)
    exhibit = Exhibit(data, file)
    exhibit.language = language
    welcome = {
        "type": "welcome", "writer": False, "version": __version__, "language": language,
        "languages": [language], "texts": texts_of(language, "app"), "recent": [],
        "offers": {"objects": [], "basemaps": []}, "wms": None, **about_shown(exhibit, language),
    }  # fmt: skip
    return View([json.dumps(welcome), *(message for _, message in exhibit.messages())])


class View:
    """Interactive view of a result, from `rockfall.show`; `page` is its HTML."""

    def __init__(self, messages: list[Message]) -> None:
        held = [
            json.loads(message) if isinstance(message, str) else base64.b64encode(message).decode()
            for message in messages
        ]
        self.page = _page(json.dumps(held, ensure_ascii=False))

    def _repr_html_(self) -> str:
        """HTML frame with the page, for a notebook."""
        style = f"width: 100%; height: {HEIGHT}px; border: 0"
        return f'<iframe srcdoc="{html.escape(self.page)}" style="{style}"></iframe>'

    def save(self, path: str | Path) -> Path:
        """Write the page to a self-contained file; return its path."""
        path = Path(path)
        check_output(path)
        with atomic_write(path) as part:
            part.write_text(self.page, encoding="utf-8")
        return path


def _page(messages: str) -> str:
    """The page with its style, messages and script inlined; an internal error if the page lacks
    them."""
    text, script, style = (
        (PAGE / name).read_text(encoding="utf-8") for name in ("index.html", "app.js", "app.css")
    )
    held = messages.replace("<", "\\u003c")  # valid in JSON; no HTML tag can end within
    data = f'<script type="text/plain" id="messages">{held}</script>'
    text, styles = _STYLE.subn(lambda _: f"<style>{_inline(style)}</style>", text)
    code = f"{data}<script>{_inline(script)}</script>"
    text, scripts = _SCRIPT.subn(lambda _: code, text)
    if (styles, scripts) != (1, 1):
        raise RockfallError(
            f"internal error: {PAGE}/index.html: lacks app.css or app.js", code=OUR_FAULT
        )
    return text


def _inline(text: str) -> str:
    """Script or style, escaped so that it cannot close its element."""
    return _END.sub(lambda match: f"<\\{match[0][1:]}", text)
