# SPDX-License-Identifier: BSD-3-Clause
"""PDF report: the same page, with maps as figures, typeset by WeasyPrint."""

from __future__ import annotations

import logging
import warnings
from pathlib import Path

from rockfall.errors import RockfallError, need
from rockfall.io.files import atomic_write

PANGO = "libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0"  # packages of Debian


def check_pdf() -> None:
    """Refuse PDF output if its libraries are missing, before the work starts."""
    try:
        need("a PDF needs", "pdf", "weasyprint")
    except OSError:  # missing C library
        raise RockfallError(f"a PDF needs Pango, as root: apt-get install {PANGO}") from None


def write_pdf(page: str, path: Path) -> None:
    """Typeset an HTML page, atomically and without network access."""
    from weasyprint import HTML
    from weasyprint.urls import URLFetcher

    logging.getLogger("weasyprint").setLevel(logging.ERROR)  # it warns about CSS for screens
    with atomic_write(path) as part:
        fetcher = URLFetcher(allowed_protocols=["data"])
        attrs = {"pdf_version": "1.4"}  # later versions hide the creator in a stream
        document = HTML(string=page, url_fetcher=fetcher).render(**attrs)
        if "signature" not in document.pages[0].anchors:
            reason = "the signature is not on page 1; shorten the title and the names of lines"
            warnings.warn(f"{path}: {reason}", stacklevel=4)
        document.write_pdf(part, **attrs)
