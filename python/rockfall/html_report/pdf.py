# SPDX-License-Identifier: BSD-3-Clause
"""PDF report: the same page with maps as figures, typeset by WeasyPrint."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rockfall.errors import RockfallError, need
from rockfall.io.atomic import atomic_write
from rockfall.simulation.progress import add_steps, step

if TYPE_CHECKING:
    from weasyprint import Document

PANGO = "libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0"  # Debian packages of Pango
FONTS = "fonts-dejavu-core"
OPTIONS: dict[str, Any] = {"pdf_version": "1.4"}  # later versions compress the creator metadata
CSS_PIXELS = 96 / 25.4  # CSS pixels per millimetre
SIGNATURE = "signature"  # anchor of the signature in templates/dossier.html.j2
BOTTOM = 16.0  # bottom margin of a sheet [mm], as in templates/page.css


def check_pdf() -> None:
    """Raise a RockfallError if libraries for PDF output are missing, before the work starts."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # without fonts, WeasyPrint warns, then crashes
            need("a PDF needs", "pdf", "weasyprint")
    except OSError:  # a C library is missing
        raise RockfallError(f"a PDF needs Pango, as root: apt-get install {PANGO}") from None
    if not _number_of_fonts():  # without fonts, Pango would crash
        raise RockfallError(f"a PDF needs fonts, as root: apt-get install {FONTS}")


def _number_of_fonts() -> int:
    """Number of system fonts, from the library and configuration used by Pango."""
    from weasyprint.text.ffi import ffi, fontconfig

    configuration = ffi.gc(fontconfig.FcInitLoadConfigAndFonts(), fontconfig.FcConfigDestroy)
    fonts = fontconfig.FcConfigGetFonts(configuration, fontconfig.FcSetSystem)
    return int(fonts.nfont) if fonts != ffi.NULL else 0


def _fonts_of_figures() -> str:
    """Style sheet with the figures' fonts, which the system may lack."""
    from matplotlib.font_manager import FontProperties, findfont

    rules = []
    for weight in ("normal", "bold"):
        font = FontProperties(family="DejaVu Sans", weight=weight)
        uri = Path(findfont(font)).resolve().as_uri()  # data URIs are parsed very slowly
        face = f"font-family: 'DejaVu Sans'; font-weight: {weight}; src: url('{uri}')"
        rules.append(f"@font-face {{ {face} }}")
    return "\n".join(rules)


def write_pdf(page: str, path: Path) -> None:
    """Typeset an HTML page as a PDF, atomically and without network access."""
    with atomic_write(path) as part:
        document = _laid_out(page)
        if SIGNATURE not in document.pages[0].anchors:
            reason = "the signature is not on page 1: shorten the title and the line names"
            warnings.warn(f"{path.name}: {reason}", stacklevel=4)  # the folder may be temporary
        add_steps(len(document.pages))
        for sheet in document.pages:
            sheet.paint = _noted(sheet.paint)
        document.write_pdf(part, **OPTIONS)


def _noted(paint: Callable[..., None]) -> Callable[..., None]:
    """Wrap a function that paints a sheet so that it reports progress and can be stopped."""

    def painted(*arguments: Any, **options: Any) -> None:
        paint(*arguments, **options)
        step()

    return painted


class Layout(NamedTuple):
    """Number of sheets of a typeset page, the height [mm] below each anchor on its sheet, and
    whether the signature is on the first sheet."""

    sheets: int
    below: dict[str, float]
    is_signed: bool


def layout(page: str) -> Layout:
    """Compute the layout of an HTML page without writing the page."""
    sheets = _laid_out(page).pages
    below = {
        anchor: (sheet.height - place[1]) / CSS_PIXELS - BOTTOM
        for sheet in sheets
        for anchor, place in sheet.anchors.items()
    }
    return Layout(len(sheets), below, SIGNATURE in sheets[0].anchors)


def _laid_out(page: str) -> Document:
    """Typeset an HTML page; figures are drawn only when it is written."""
    from weasyprint import CSS, HTML
    from weasyprint.text.fonts import FontConfiguration
    from weasyprint.urls import URLFetcher

    logging.getLogger("weasyprint").setLevel(logging.ERROR)  # hide its warnings on CSS for screens
    fetcher, fonts = URLFetcher(allowed_protocols=["data"]), FontConfiguration()
    local = URLFetcher(allowed_protocols=["file"])  # only for the package's own style sheet
    style = CSS(string=_fonts_of_figures(), font_config=fonts, url_fetcher=local)
    source = HTML(string=page, url_fetcher=fetcher)
    return source.render(font_config=fonts, stylesheets=[style], **OPTIONS)
