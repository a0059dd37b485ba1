# SPDX-License-Identifier: BSD-3-Clause
"""Rendering of a page from its template, with figures inside it."""

from __future__ import annotations

import base64
import hashlib
import importlib.resources
import re
import zlib
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rockfall.html_report.maps import data_uri
from rockfall.language import say, spoken, translated
from rockfall.plots.style import capital, save

if TYPE_CHECKING:
    import jinja2
    from matplotlib.figure import Figure

MAX_SVG = 400_000  # bytes; a denser figure is rasterised
MAX_VERTICES = 200_000  # with more vertices, SVG is not tried first
DOTS_PER_INCH = 200
UNIT = re.compile(r"(?<=\d) (?=(?:%|kJ|m|m/s|m2|m³|kg/m³)(?!\w))")  # kept on the line of its number
SHEET = re.compile(r"<style[^>]*>\s*\*\s*\{([^}]*)\}\s*</style>")
STYLE = re.compile(r' style="([^"]*)"')
COLOURS = 256  # of a rasterised figure
NEARLY_WHITE = 250  # grey value, 0 to 255: mean of a leaf of the octree


class Picture(NamedTuple):
    """A figure of the page: a data URI and its size [CSS pixels]."""

    title: str
    caption: str
    uri: str
    wide: int
    high: int


class EmbeddedView(NamedTuple):
    """The page of `rockfall.show` within a report: packed, and unpacked on request, so that other
    readers do not wait; and the hash that permits its script there."""

    page: str
    script_hash: str


def embedded(page: str) -> EmbeddedView:
    """Pack a page that has one script."""
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    checksum = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return EmbeddedView(base64.b64encode(zlib.compress(page.encode(), 9)).decode(), checksum)


def picture(figure: Figure, title: str, caption: str, on_paper: bool = False) -> Picture:
    """Figure as vectors (SVG), or rasterised if too dense. The same figure gives the same bytes.
    Texts are outlines, since readers lack the font; on paper they are texts, whose font `write_pdf`
    includes: outlines would take half of the typesetting time."""
    import matplotlib

    wide, high = (round(96 * inch) for inch in figure.get_size_inches())
    content, kind = b"", "image/svg+xml"
    if _vertices(figure) <= MAX_VERTICES:
        with matplotlib.rc_context({"svg.fonttype": "none" if on_paper else "path"}):
            content = _saved(figure, "svg")
        if on_paper:
            content = _without_styles(content.decode()).encode()
    if not 0 < len(content) <= MAX_SVG:
        content, kind = _saved(figure, "png"), "image/png"
    return Picture(capital(title), caption, data_uri(content, kind), wide, high)


def _without_styles(svg: str) -> str:
    """SVG of Matplotlib with attributes in place of styles, because WeasyPrint needs a sixth of its
    time to parse styles. Texts keep their styles: `font` is no attribute."""
    for sheet in SHEET.finditer(svg):  # the rule of all elements, which would precede attributes
        svg = svg.replace("<svg", f"<svg{_attributes(sheet[1])}", 1).replace(sheet[0], "")
    return STYLE.sub(
        lambda style: _attributes(style[1]) if "font:" not in style[1] else style[0], svg
    )


def _attributes(style: str) -> str:
    rules = [rule.partition(":") for rule in style.split(";") if rule.strip()]
    return "".join(f' {name.strip()}="{value.strip()}"' for name, _, value in rules)


def _vertices(figure: Figure) -> int:
    """Number of vertices of collections, such as trajectories."""
    collections = [collection for axes in figure.axes for collection in axes.collections]
    paths = [path for collection in collections for path in collection.get_paths()]
    return sum(np.shape(path.vertices)[0] for path in paths)


def _saved(figure: Figure, ending: str) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"figure.{ending}"
        how = {"pil_kwargs": {"compress_level": 1}} if ending == "png" else {}  # written again
        save(figure, path, DOTS_PER_INCH, **how)
        if ending == "png":  # a third of the bytes
            from PIL import Image

            drawn = Image.open(path).convert("RGB").quantize(COLOURS, Image.Quantize.FASTOCTREE)
            palette: np.ndarray = np.reshape(drawn.getpalette() or [], (-1, 3))
            palette[(palette >= NEARLY_WHITE).all(axis=1)] = 255  # white, like the paper
            drawn.putpalette(palette.ravel().tolist())
            drawn.save(path)
        return path.read_bytes()


def rendered(template: str, **content: Any) -> str:
    """Render a page; all texts are escaped, and only our scripts can run in it."""
    from markupsafe import Markup

    script = _read("page.js")
    page = _environment().get_template(template)
    return page.render(
        language=spoken(),
        style=Markup(_read("page.css")),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        **content,
    )


@cache
def _environment() -> jinja2.Environment:
    """Templates, which take longer to compile than to fill. Texts are looked up when they are
    filled, in the language of the time."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_read), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters["capital"] = capital
    environment.filters["say"] = lambda text: UNIT.sub("\u00a0", translated(text))
    environment.filters["unit"] = lambda text: UNIT.sub("\u00a0", text)
    environment.globals["say"] = say
    return environment


def _read(name: str) -> str:
    """Text of a template, style or script."""
    folder = importlib.resources.files(__package__) / "templates"
    return (folder / name).read_text(encoding="utf-8")
