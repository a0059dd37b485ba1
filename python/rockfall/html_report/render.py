# SPDX-License-Identifier: BSD-3-Clause
"""Rendering of a page with its figures from a template."""

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

MAX_SVG = 400_000  # [bytes]; larger figures are rasterised
MAX_VERTICES = 200_000  # figures with more vertices are rasterised without trying SVG
DOTS_PER_INCH = 200
UNIT = re.compile(r"(?<=\d) (?=(?:%|kJ|m|m/s|m2|m³|kg/m³)(?!\w))")  # non-breaking space
SHEET = re.compile(r"<style[^>]*>\s*\*\s*\{([^}]*)\}\s*</style>")
STYLE = re.compile(r' style="([^"]*)"')
COLOURS = 256  # colours of a rasterised figure
NEARLY_WHITE = 250  # colours with red, green and blue from here to 255 become white


class Picture(NamedTuple):
    """A figure on the page: a data URI and its size [CSS pixels]."""

    title: str
    caption: str
    uri: str
    wide: int
    high: int


class EmbeddedView(NamedTuple):
    """The page of `rockfall.show` within a report: compressed, so that readers who do not open it
    need not wait, and the hash that permits its script in the report."""

    page: str
    script_hash: str


def embedded(page: str) -> EmbeddedView:
    """Compress a page that has a single script."""
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    checksum = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return EmbeddedView(base64.b64encode(zlib.compress(page.encode(), 9)).decode(), checksum)


def picture(figure: Figure, title: str, caption: str, on_paper: bool = False) -> Picture:
    """Figure as vectors (SVG), or rasterised if too dense. The same figure gives the same bytes.
    Texts are outlines, because readers may lack the font. On paper they stay texts with a font
    from `write_pdf`: outlines would take half of the typesetting time."""
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
    """Matplotlib's SVG with attributes instead of styles, which take WeasyPrint six times as long
    to parse. Texts keep their styles, because `font` is not an attribute."""
    for sheet in SHEET.finditer(svg):  # the universal rule, which would override attributes
        svg = svg.replace("<svg", f"<svg{_attributes(sheet[1])}", 1).replace(sheet[0], "")
    return STYLE.sub(
        lambda style: _attributes(style[1]) if "font:" not in style[1] else style[0], svg
    )


def _attributes(style: str) -> str:
    rules = [rule.partition(":") for rule in style.split(";") if rule.strip()]
    return "".join(f' {name.strip()}="{value.strip()}"' for name, _, value in rules)


def _vertices(figure: Figure) -> int:
    """Number of vertices in collections, such as trajectories."""
    collections = [collection for axes in figure.axes for collection in axes.collections]
    paths = [path for collection in collections for path in collection.get_paths()]
    return sum(np.shape(path.vertices)[0] for path in paths)


def _saved(figure: Figure, ending: str) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"figure.{ending}"
        how = {"pil_kwargs": {"compress_level": 1}} if ending == "png" else {}  # recompressed
        save(figure, path, DOTS_PER_INCH, **how)
        if ending == "png":  # reduces the size to a third
            from PIL import Image

            drawn = Image.open(path).convert("RGB").quantize(COLOURS, Image.Quantize.FASTOCTREE)
            palette: np.ndarray = np.reshape(drawn.getpalette() or [], (-1, 3))
            palette[(palette >= NEARLY_WHITE).all(axis=1)] = 255  # exactly white, like the page
            drawn.putpalette(palette.ravel().tolist())
            drawn.save(path)
        return path.read_bytes()


def rendered(template: str, **content: Any) -> str:
    """Render a template; all texts are escaped, and only the package's own scripts can run."""
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
    """Template environment, cached because compiling takes longer than rendering. Texts are
    translated when a template is rendered, in the current language."""
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
    folder = importlib.resources.files(__package__) / "templates"
    return (folder / name).read_text(encoding="utf-8")
