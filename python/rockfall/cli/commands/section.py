# SPDX-License-Identifier: BSD-3-Clause
"""Section of a result along a drawn line: tables and figure."""

import argparse
import itertools
import math
import re
from collections.abc import Sequence
from pathlib import Path

from rockfall.case.files import files_behind
from rockfall.cli.given import given_options, warn_of_results
from rockfall.cli.messages import DONE, warnings_told
from rockfall.errors import RockfallError, need
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_output
from rockfall.io.tables import plain_decimal
from rockfall.plots.section_figure import section_figure
from rockfall.plots.style import FORMATS, save
from rockfall.products import section
from rockfall.result.dataset import open_result
from rockfall.table import write_csv
from rockfall.tables.section import section_data, section_text

TABLE = ".csv"
ENDINGS = [TABLE, *(f".{form}" for form in FORMATS)]


def section_command(arguments: argparse.Namespace) -> int:
    path: Path = getattr(arguments, "out.nc")
    need("a section needs", "report", "matplotlib")
    line = drawn(arguments.line, "--line")
    places = _places(arguments.output or Path(f"{path.name.removesuffix('.nc')}_section.csv"))
    with open_result(path) as data:
        inputs = [path, *files_behind(data), *([line] if isinstance(line, Path) else [])]
    for place in places:
        check_output(place, inputs)
    given = given_options(arguments, ("within", "every"))
    with warnings_told() as told:
        cut = section(path, line, layer=arguments.line_layer, dem=arguments.dem, **given)
    table, lines, picture = places
    with atomic_folder(table.parent, inputs) as part:
        write_csv(section_data(cut.table), part / table.name)
        write_csv(section_data(cut.lines), part / lines.name)
        save(section_figure(cut), part / picture.name)
    warn_of_results(path, told=told)
    print(section_text(cut))
    print(*places, sep="\n")
    return DONE


def drawn(given: Sequence[str], option: str) -> Path | list[tuple[float, float]]:
    """Line of a section from a file, or from pairs X,Y."""
    words = " ".join(given).split()
    pairs = [tuple(map(plain_decimal, word.split(","))) for word in words if word.count(",") == 1]
    if len(pairs) == len(words) > 1 and all(map(math.isfinite, itertools.chain(*pairs))):
        return [(x, y) for x, y in pairs]
    numbers = [plain_decimal(text) for text in re.split(r"[,;\s]+", " ".join(given)) if text]
    if len(given) == 1 and (not all(map(math.isfinite, numbers)) or Path(given[0]).exists()):
        return Path(given[0])
    raise RockfallError(
        f"{option} {' '.join(given)}: must be X,Y X,Y ... (two vertices or more, separated by "
        "spaces), or a file with one line"
    )


def _places(output: Path) -> list[Path]:
    """Files of a section: tables, and the figure in the format of the output."""
    ending = output.suffix.lower()
    if ending not in ENDINGS:
        raise RockfallError(f"{output}: output name must end in {', '.join(ENDINGS)}")
    figure = output if ending != TABLE else output.with_suffix(".png")
    return [
        output if ending == TABLE else output.with_suffix(TABLE),
        output.with_name(f"{output.stem}_lines{TABLE}"),
        figure,
    ]
