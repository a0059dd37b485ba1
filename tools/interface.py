# SPDX-License-Identifier: BSD-3-Clause
"""Write tests/interface.txt: the names promised in docs/stability_policy.md, one per line. A test
compares the list with the program; it is updated deliberately and reviewed like any change.

python tools/interface.py           writes it
python tools/interface.py --check   prints the differences (exit status 0 or 1)
"""

import argparse
import difflib
import inspect
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from shutil import which
from typing import Any

import rockfall
from rockfall.analysis.hazard.combined import LAYOUT as HAZARD_LAYOUT
from rockfall.analysis.hazard.variables import TABLE as HAZARD
from rockfall.analysis.line_statistics import COLUMNS
from rockfall.case import REPEATABLE, key_table
from rockfall.cli.arguments import make_parser
from rockfall.cli.messages import DONE, FAULT, REFUSED
from rockfall.grounds import models, other_tables, parameters, shipped_grounds
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.quantities import QUANTITIES
from rockfall.result import variables
from rockfall.result.validate import ALWAYS, known_variables
from rockfall.scene.prepare import LAYOUT as SCENE_LAYOUT
from rockfall.simulation.parts.part_file import LAYOUT as PART_LAYOUT

MADE = rockfall.Batch, rockfall.Session  # classes created only by functions and methods
LIST = Path(__file__).resolve().parents[1] / "tests/interface.txt"


def listed() -> str:
    """Expected text of tests/interface.txt, from this program."""
    parts = {
        "keys of a case: type, number of values, default, what is allowed, unit": _keys(),
        "commands of rockfall, their arguments: number, default, choices": _commands(),
        "options of rockfall-batch": _program(),
        "exit statuses": iter(
            [f"{DONE} done", f"{FAULT} fault", f"{REFUSED} refused", "130 SIGINT", "143 SIGTERM"]
        ),
        "variables of a result: dimensions, unit": _variables(),
        "attributes of a result": iter(ALWAYS),
        "statuses and outcomes": _words(),
        "variables of a hazard: dimensions, unit": _hazard(),
        "columns of line statistics, and quantities with units": _statistics(),
        "names in Python": _names(),
        "impact sets that are shipped": iter(shipped_sets()),
        "models of grounds, columns of their table, rows and tables that are shipped": _grounds(),
        "layouts of files": iter(
            [f"scene {SCENE_LAYOUT}", f"part {PART_LAYOUT}", f"hazard {HAZARD_LAYOUT}"]
        ),
    }
    blocks = ["\n".join([f"# {title}", *lines]) for title, lines in parts.items()]
    return "\n\n".join(blocks) + "\n"


def _keys() -> Iterator[str]:
    for key in key_table():
        if key.is_varied:  # GROUP_KEY of &variant: same properties as the key in its group
            continue
        several = "" if key.most == 1 else f"({key.most})" if key.most == 3 else "(:)"
        again = " repeatable" if key.group in REPEATABLE else ""
        about = f"{key.kind}{several}{again} | {key.default} | {key.allowed} | {key.unit}"
        yield f"&{key.group} {key.name} | {about}".rstrip(" |")


def _commands() -> Iterator[str]:
    yield from _arguments("rockfall", make_parser())


def _arguments(name: str, parser: Any) -> Iterator[str]:
    yield name
    parser.complete()
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for verb, below in action.choices.items():
                yield from _arguments(f"{name} {verb}", below)
        elif not isinstance(action, argparse._HelpAction):
            words = "/".join(action.option_strings) or action.dest.upper()
            kind = getattr(action.type, "__name__", "" if action.nargs == 0 else "str")
            default = "" if action.default in (None, False, argparse.SUPPRESS) else action.default
            default = default.as_posix() if isinstance(default, Path) else default
            needed = "required" if action.required and action.option_strings else ""
            number = "" if action.nargs in (None, 0) else f"({action.nargs})"
            yield f"{name} {words} | {kind}{number} | {default} | {needed}".rstrip(" |")


def _program() -> Iterator[str]:
    program = which("rockfall-batch")
    if not program:
        sys.exit("no rockfall-batch on the PATH")
    done = subprocess.run([program, "--help"], capture_output=True, text=True, check=True)
    for line in done.stdout.splitlines():
        if line.startswith("  -"):
            yield line[:23].strip()  # the description follows in the next column


def _variables() -> Iterator[str]:
    units = _units()
    for name, dims in known_variables().items():
        yield f"{name} ({', '.join(dims)}) | {units.get(name, '')}".rstrip(" |")


def _units() -> dict[str, str]:
    """Units of the result variables by name; "" for variables without a unit."""
    tables = {
        "": (variables.BOULDER, variables.COUNT, variables.GROUND, variables.ENERGY,
             variables.TREE, variables.FEATURE, variables.SHAPE, variables.MASS, variables.SHADOW,
             variables.BREAKAGE, variables.MAP),
        "crossing_": (variables.CROSSING, variables.FRAGMENT, variables.HIT),
        "line_vertex_": (variables.LINE_VERTEX,), "barrier_": (variables.BARRIER,),
        "trajectory_": (variables.VERTEX,), "sample_": (variables.SAMPLE,),
    }  # fmt: skip
    found = {
        prefix + name: about.get("units", "")
        for prefix, groups in tables.items()
        for group in groups
        for name, about in group.items()
    }
    for name, about in variables.HISTOGRAM.items():
        found |= {f"{name}_bin": about["units"], f"{name}_histogram": "1"}
    return found


def _words() -> Iterator[str]:
    yield from (f"status {number} {name}" for name, number in variables.STATUS.items())
    yield from (f"crossing_outcome {number} {name}" for name, number in variables.OUTCOME.items())


def _hazard() -> Iterator[str]:
    for name, about in HAZARD.items():
        yield f"{name} ({', '.join(about.dims)}) | {about.units}".rstrip(" |")


def _statistics() -> Iterator[str]:
    yield " ".join(["line", "quantity", *COLUMNS])
    yield from (f"{name} | {about.units}" for name, about in QUANTITIES.items())


def _grounds() -> Iterator[str]:
    yield " ".join(models())
    yield " ".join(one.name for one in parameters())
    rows = shipped_grounds().read_text(encoding="utf-8").splitlines()
    yield from (row.split(",")[0] for row in rows[1:])
    yield from (f"ground_table {name}" for name in other_tables())


def _names() -> Iterator[str]:
    for name in sorted(rockfall.__all__):
        thing = getattr(rockfall, name)
        made = callable(thing) and thing not in MADE
        yield f"rockfall.{name}{inspect.signature(thing) if made else ''}"
    for of in rockfall.Case, *MADE:
        for name, method in inspect.getmembers(of):
            if not name.startswith("_"):
                is_method = inspect.isfunction(method)
                signature = inspect.signature(method) if is_method else ""
                yield f"rockfall.{of.__name__}.{name}{signature}"


def main() -> int:
    text = listed()
    if "--check" not in sys.argv:
        LIST.write_text(text, encoding="utf-8")
        return 0
    old = LIST.read_text(encoding="utf-8")
    sys.stdout.writelines(
        f"{line}\n"
        for line in difflib.unified_diff(
            old.splitlines(), text.splitlines(), "promised", "is", lineterm="", n=0
        )
    )
    return int(text != old)


if __name__ == "__main__":
    sys.exit(main())
