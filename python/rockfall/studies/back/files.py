# SPDX-License-Identifier: BSD-3-Clause
"""Files of a back-analysis: tables, members, draws, and a case with the posterior."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from rockfall.case import FROM_ARRAY, REPEATABLE, Case, file_keys
from rockfall.case.files import input_files
from rockfall.io.atomic import atomic_folder
from rockfall.io.files import relative_name
from rockfall.io.output_files import check_folder, check_outputs
from rockfall.io.tables import write_csv
from rockfall.result.contents import Contents
from rockfall.result.dataset import put_netcdf
from rockfall.studies.back.posterior import ALONE, alone_table, draws_table, posterior_table
from rockfall.studies.back.study import Back
from rockfall.version import __version__

Draw = Callable[[Back, Path], None]

TABLE, DRAWN, ALL, CASE = "posterior.csv", "draws.csv", "members.nc", "case.nml"
DRAWING = "posterior.png"
MARK = "! Made by `rockfall back`"


def write_back(
    analysis: Back, folder: str | Path, inputs: Iterable[str | Path] = (), draw: Draw | None = None
) -> list[Path]:
    """Write posterior.csv, draws.csv, by_data.csv, members.nc, case.nml and, given `draw`,
    posterior.png: all files or none. Return their paths."""
    folder = Path(folder)
    inputs = [*inputs, *input_files(analysis.case)]
    check_back(folder, inputs)
    with atomic_folder(folder, inputs, last=CASE) as part:
        write_csv(posterior_table(analysis), part / TABLE)
        write_csv(draws_table(analysis), part / DRAWN)
        write_csv(alone_table(analysis), part / ALONE)
        put_netcdf(_contents(analysis), part / ALL, folder / ALL)
        if draw:
            draw(analysis, part / DRAWING)
        (part / CASE).write_text(_case_text(analysis, folder), encoding="utf-8")
    return [folder / name for name in (TABLE, DRAWN, ALONE, ALL, *[DRAWING] * bool(draw), CASE)]


def check_back(folder: Path, inputs: Iterable[str | Path]) -> None:
    """Raise a RockfallError if an output in the folder must not be overwritten, before the work
    starts."""
    check_folder(folder)
    check_outputs([folder / name for name in (TABLE, DRAWN, ALONE, ALL, DRAWING, CASE)], inputs)


def _contents(analysis: Back) -> Contents:
    members, data = analysis.members, analysis.data
    long_names = {"log_likelihood": "log-likelihood of the observations, less for dependent data",
             "smooth": "log_likelihood without Monte Carlo noise",
             "weight": "weight of the member in the posterior"}  # fmt: skip
    variables: dict[str, tuple] = {
        str(name): ("member", members[name].to_numpy(float),
                    {"units": "1", "long_name": long_names.get(str(name), f"drawn: {name}")})
        for name in members
    }  # fmt: skip
    variables["data"] = ("data", data["data"].to_numpy(object), {"long_name": "data set"})
    for name, what in (("n", "boulders"), ("counts", "weight of the data set, reduced for "
                                                     "dependent data"),
                       ("predictive_p", "posterior predictive probability"),
                       ("loss", "log-likelihood lost when fitted with the other data"),
                       ("loss_error", "its standard error")):  # fmt: skip
        column_attrs = {"units": "1", "long_name": what}
        variables[f"data_{name}"] = ("data", data[name].to_numpy(float), column_attrs)
    about_alone = {"units": "1", "long_name": "weight of the member by each data set alone"}
    variables["data_weight"] = ("data", "member"), analysis.alone, about_alone
    attrs = {
        "title": analysis.case.case["title"], "source": f"rockfall {__version__}",
        "case": analysis.case.text(), "case_file": analysis.case.name, "back_layout": 1,
        "boulders": analysis.boulders, "effective_members": analysis.effective,
        "asked_members": analysis.asked,
    }  # fmt: skip
    return Contents(variables, attrs, ("data",))


def _case_text(analysis: Back, folder: Path) -> str:
    """Case text that has the posterior as uncertain inputs, and file names relative to a folder."""
    ensemble = {"source_shift": 0.0, "draws": DRAWN}
    ensemble |= {key: 1.0 for key in analysis.case.ensemble if key.endswith("_factor")}
    case = _seen_from(folder, analysis.case).replace(ensemble=ensemble)
    head = f"{MARK} from {case.name}: &ensemble draws has the posterior, for `rockfall ensemble`."
    return f"{' '.join(head.splitlines())}\n{case.text()}"


def _seen_from(folder: Path, case: Case) -> Case:
    """Case in which the names of existing files are relative to a folder."""

    def moved(name: str) -> str:
        path = case.path(name)
        return relative_name(path, folder) if name != FROM_ARRAY and path.exists() else name

    groups: dict[str, Any] = {}
    for key in file_keys():
        several = key.group in REPEATABLE
        held = groups.get(key.group, getattr(case, key.group))
        changed = [dict(entry) for entry in held] if several else [dict(held)]
        for entry in changed:
            if key.name in entry:
                named = entry[key.name]
                is_list = isinstance(named, list)
                entry[key.name] = [*map(moved, named)] if is_list else moved(named)
        groups[key.group] = changed if several else changed[0]
    return case.replace(**groups)
