# SPDX-License-Identifier: BSD-3-Clause
"""What is drawn of a result: the page, and figures as files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rockfall.analysis.observations import read_observed
from rockfall.case_files import files_behind
from rockfall.html_report import check_page, write_report
from rockfall.io.raster_file import raster_files
from rockfall.plots.figures import figures as figures_of
from rockfall.plots.figures import write_figures
from rockfall.plots.terrain import terrain_of
from rockfall.result.dataset import read_result

if TYPE_CHECKING:
    import xarray as xr

    Result = xr.Dataset | str | Path
    Files = Sequence[str | Path]


def report(
    result: Result, path: str | Path, *, dem: str | Path | None = None, observed: Files = ()
) -> Path:
    """Write a result (a Dataset, or its netCDF file) as one HTML page, to be read offline.

    `dem` is the terrain under maps (default: the case's, if it is there), `observed` are CSV files
    of observations that are drawn beside the result. Returns the path of the page. What cannot be
    drawn or written is a RockfallError, missing terrain a UserWarning.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> rockfall.report(result, "report.html").name
    'report.html'
    """
    path = Path(path)
    check_page(path, _given(result, dem, observed))
    data = _read(result)
    write_report(data, path, terrain_of(data, dem), read_observed(*observed) if observed else None)
    return path


def figures(
    result: Result,
    folder: str | Path,
    *,
    format: str = "png",
    dem: str | Path | None = None,
    observed: Files = (),
) -> list[Path]:
    """Write every figure that a result can feed to a folder, as png, pdf or svg; returns the files.
    The rest is as in `report`.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> files = rockfall.figures(result, "figures", format="svg")
    >>> "passing.svg" in [path.name for path in files]
    True
    """
    data, inputs = _read(result), [*_given(result, dem, observed)]
    seen = read_observed(*observed) if observed else None
    shown = figures_of(data, terrain_of(data, dem), seen)
    return write_figures(shown, folder, format, [*inputs, *files_behind(data)])


def _read(result: Result) -> xr.Dataset:
    return read_result(result) if isinstance(result, str | Path) else result


def _given(result: Result, dem: str | Path | None, observed: Files) -> Iterator[str | Path]:
    """The files that are read."""
    if isinstance(result, str | Path):
        yield result
    yield from observed
    if dem is not None:
        yield from raster_files(dem)
