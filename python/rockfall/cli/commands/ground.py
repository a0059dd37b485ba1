# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall ground`: row of a ground table from impact scars and a measured patch."""

import argparse
import csv
import io
import math
from pathlib import Path

from rockfall.cli.messages import DONE
from rockfall.errors import RockfallError
from rockfall.grounds import GroundTable
from rockfall.grounds.measured_ground import (
    COLUMNS,
    ONE_SLOPE,
    MeasuredGround,
    Scars,
    measure_ground,
)
from rockfall.io.atomic import atomic_write
from rockfall.io.files import read_text
from rockfall.io.output_files import check_output, overwriting
from rockfall.io.tables import spreadsheet_text, table_rows
from rockfall.table import Table, as_text


def ground_command(arguments: argparse.Namespace) -> int:
    output = arguments.output
    inputs = [path for path in (arguments.scars, arguments.patch) if path]
    if output:
        with overwriting(True):  # adds a row to an existing table
            check_output(output, inputs)
    ground = measure_ground(
        _scars(arguments), arguments.patch, model=arguments.model, shape=arguments.shape,
        radius=arguments.radius, shortest=arguments.shortest, longest=arguments.longest,
        proportional=arguments.proportional, rest_angle=arguments.rest_angle,
    )  # fmt: skip
    both = not (math.isnan(ground.strength) or math.isnan(ground.relief))
    row = ground.row(arguments.name, arguments.source) if both or output else None
    if row and output:
        _add_row(output, row)
    parts = [as_text(_table(ground)), *ground.remarks]
    parts.append(f"Nearest shipped ground of this model: {ground.nearest}.")
    print("\n".join([*parts, ONE_SLOPE]))
    if row:
        print("", _csv([list(row), list(row.values())]), sep="\n", end="")
        print(*([output] if output else []))
    return DONE


def _scars(arguments: argparse.Namespace) -> Scars | None:
    """Scars from the file or the options; a single value applies to all scars. Refuses options
    with different numbers of values, and options together with a file."""
    given = {key: getattr(arguments, key) for key in COLUMNS}
    given = {key: values for key, values in given.items() if values}
    if not given:
        return arguments.scars
    if arguments.scars:
        raise RockfallError(f"{arguments.scars}: cannot be combined with --{next(iter(given))}")
    count = max(map(len, given.values()))
    for key, values in given.items():
        if len(values) not in (1, count):
            name = key.replace("_", "-")
            raise RockfallError(f"--{name}: has {len(values)} values but must have 1 or {count}")
    return [
        {key: values[k if len(values) > 1 else 0] for key, values in given.items()}
        for k in range(count)
    ]


def _table(ground: MeasuredGround) -> Table:
    """Table of the measured quantities with their standard errors."""
    rows = [("R_b [m]", f"{ground.radius:.3g}", "")]
    if not math.isnan(ground.strength):
        low, high = (ground.strength * math.exp(k * ground.strength_error) for k in (-1, 1))
        limits = f"{low / 1e6:.3g} to {high / 1e6:.3g}"
        rows.append(("strength [MPa]", f"{ground.strength / 1e6:.3g}", limits))
        rows.append(("  scars", f"{len(ground.strengths)}", ""))
        scatter = f"{ground.attitude_sigma:.2f}"
        rows.append(("  scatter by block orientation [ln]", scatter, ""))
    if not math.isnan(ground.strength_sigma):
        error = f"{ground.strength_sigma_error:.2f}"
        rows.append(("strength_sigma", f"{ground.strength_sigma:.2f}", error))
    if not math.isnan(ground.relief):
        rows.append(("relief [degree]", f"{ground.relief:.1f}", f"{ground.relief_error:.1f}"))
        rows.append(("hurst", f"{ground.hurst:.2f}", ""))
    return Table.of("", ("", "value", "standard error"), rows)


def _csv(rows: list[list[str]]) -> str:
    text = io.StringIO()
    safe = [[spreadsheet_text(cell) for cell in row] for row in rows]
    csv.writer(text, lineterminator="\n").writerows(safe)
    return text.getvalue()


def _add_row(path: Path, row: dict[str, str]) -> None:
    """Write a ground table with a row, or add the row to an existing table; refuses a repeated
    name, missing columns and semicolons."""
    if not path.exists():
        text = _csv([list(row), list(row.values())])
    else:
        names = GroundTable(path).rows
        if row["name"] in names:
            raise RockfallError(f"{path}: already has a ground {row['name']}: give another --name")
        _, header = next(table_rows(path))
        columns = [name.lower() for name in header]
        if missing := [name for name in row if name not in columns]:
            raise RockfallError(
                f"{path}: column {', '.join(missing)} is missing: add it to the header"
            )
        before = read_text(path)
        if ";" in before.splitlines()[0]:
            raise RockfallError(f"{path}: is separated by semicolons: use commas")
        added = _csv([[row.get(name, "") for name in columns]])
        text = before + ("" if before.endswith("\n") else "\n") + added
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
