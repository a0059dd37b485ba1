# SPDX-License-Identifier: BSD-3-Clause
"""A result as one HTML page that needs no network: words, maps, lines, figures, provenance."""

from __future__ import annotations

import base64
import hashlib
import importlib.resources
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from rockfall.case_files import files_behind
from rockfall.errors import RockfallError, need
from rockfall.io.files import atomic_write
from rockfall.io.output_files import PAGE, check_output

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.html_report.words import Rows
    from rockfall.result.trajectories import Terrain

HOW_TO_ZOOM = (
    '<p class="hint">Click a map, then zoom with the wheel or + and −, move with the arrow keys or '
    "by dragging; 0 shows all. Two fingers do it too. All maps move together and tell the value "
    "under the pointer.</p>\n"
)


def write_report(
    result: xr.Dataset, path: str | Path, terrain: Terrain | None = None, observed: Any = None
) -> None:
    """Write the page of a result to `path`, whole or not at all; the rest is as in `report`."""
    check_page(path, files_behind(result))
    page = report(result, terrain, observed)
    with atomic_write(path) as part:
        part.write_text(page, encoding="utf-8")


def check_page(path: str | Path, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse a page that cannot be made or written, before the work and not after it."""
    path = Path(path)
    need("a report needs", "report", "matplotlib", "scipy")
    if path.suffix.lower() not in (".html", ".htm"):
        raise RockfallError(f"{path}: is no name for a page; it must end in .html")
    check_output(path, PAGE, inputs)


def report(result: xr.Dataset, terrain: Terrain | None = None, observed: Any = None) -> str:
    """The page of a result as text. The same result gives the same text.

    `terrain`, from `rockfall.plots.figures.terrain_of`, puts relief under maps; `observed`, from
    `rockfall.analysis.observations.read_observed`, is set beside it in the figures and in a
    comparison.
    """
    from rockfall.analysis.return_levels import return_levels
    from rockfall.html_report.maps import map_notes, maps
    from rockfall.html_report.markup import bullets, paragraphs, picture
    from rockfall.html_report.tables import level_table, line_tables, provenance
    from rockfall.html_report.words import cautions, in_words, rows_of, warnings
    from rockfall.plots.figures import figures
    from rockfall.quantities import count

    shown = figures(result, terrain, observed)
    zoomed = {f"map_{name}" for name in result.data_vars}
    rows, levels = rows_of(result), return_levels(result)
    sections = {
        "In words": paragraphs(in_words(result, rows)),
        "Limits of validity": bullets(cautions(result, rows, levels)),
        "Maps": HOW_TO_ZOOM + paragraphs(map_notes(result, terrain)) + _grid(maps(result, terrain)),
    }
    if rows:
        sections["Lines"] = "\n".join([*line_tables(rows), level_table(levels)])
        sections["Convergence"] = "\n".join(_convergence(result, rows))
    if observed is not None:
        from rockfall.analysis.compare import compare
        from rockfall.text.comparison import text

        beside = text(compare(result, observed))
        sections["Comparison"] = f'<pre tabindex="0">{escape(beside)}</pre>'
    sections["Figures"] = _grid(
        (picture(one.draw(), one.title, one.caption) for one in shown if one.name not in zoomed),
        "gallery",
    )
    sections["Provenance"] = "\n".join(provenance(result))
    boulders = count(result.sizes["boulder"], "boulder")
    title = str(result.attrs["title"]) or "rockfall"
    return _page(title, f"Rockfall simulation of {boulders}", sections, warnings(result))


def _convergence(result: xr.Dataset, rows: Rows) -> Iterator[str]:
    """How numbers settled, how sure they are now, and what more certainty would cost."""
    from rockfall.analysis.line_statistics import sources
    from rockfall.html_report.markup import paragraphs, picture
    from rockfall.html_report.running import running_figure
    from rockfall.html_report.tables import precision_table
    from rockfall.html_report.words import SPEED

    about = [
        "Half widths fall with the square root of the number of boulders: one more digit costs "
        "100 times as many."
    ]
    caption = "Numbers after so many boulders, with their 95 % band"
    if sources(result).max():
        caption += "; one of each source is taken in turn"
        about.append(
            "Boulders of one source are a cluster. The numbers of boulders hold when sources grow "
            "in number as boulders do; more from the same sources help less."
        )
    yield paragraphs(about)
    parts = []
    for k, (line, numbers) in enumerate(rows.items()):
        if numbers[SPEED]["n"]:
            figure = picture(running_figure(result, k), f"Convergence at {line}", f"{caption}.")
            settled = precision_table(line, numbers, result.sizes["boulder"])
            parts.append(f"<div>\n{figure}\n{settled}\n</div>")
        else:
            parts.append(paragraphs([f"{line}: no boulder passes, so no number settles."]))
    yield _grid(parts, "grid wide")


def _grid(parts: Iterable[str], kind: str = "grid") -> str:
    """Parts beside each other where the page is wide enough."""
    return f'<div class="{kind}">\n' + "\n".join(parts) + "\n</div>"


def _page(title: str, subtitle: str, sections: dict[str, str], warned: Sequence[str] = ()) -> str:
    """The template with its style and script; no other script may run in the page."""
    from rockfall.html_report.markup import warning_box

    folder = importlib.resources.files(__package__)
    page, style, script = (
        (folder / f"page.{end}").read_text(encoding="utf-8") for end in ("html", "css", "js")
    )
    ids = {name: name.lower().replace(" ", "-") for name in sections}
    return Template(page).substitute(
        title=escape(title),
        subtitle=escape(subtitle),
        style=style,
        script=script,
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        warned=warning_box("Beyond what the model knows", warned),
        contents=" ".join(f'<a href="#{ids[name]}">{name}</a>' for name in sections),
        sections="\n".join(
            f'<section id="{ids[name]}">\n<h2>{name}</h2>\n{content}\n</section>'
            for name, content in sections.items()
        ),
    )
