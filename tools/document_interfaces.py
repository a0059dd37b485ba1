# SPDX-License-Identifier: BSD-3-Clause
"""Pages of the command line and of the Python interface, for tools/document.py."""

import argparse
import ast
import inspect
import os
import re
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import rockfall
from rockfall.cli.arguments import make_parser

CLI = """# The command line

This page lists all commands and options, as `rockfall COMMAND --help` does; it is made from the
program's parsers. Exit status: 0 done; 1 a fault of the program; 2 wrong input, with its faults on
the standard error; 130 and 143 stopped by Ctrl-C or SIGTERM.

"""

API = """# The Python interface

This page lists the public names of `rockfall`. All quantities are in SI units, unless a name gives
another unit. `run` returns the variables of [result.md](result.md); keys of a case
are in [case.md](case.md). Functions by command: [start/python.md](start/python.md).

"""


def rows(parser: argparse.ArgumentParser) -> Iterator[list[str]]:
    formatter = argparse.HelpFormatter(parser.prog, width=100)
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction | argparse._SubParsersAction):
            continue
        value = "" if action.nargs == 0 else str(action.metavar or action.dest.upper())
        value += {"*": "...", "+": "..."}.get(str(action.nargs), "")
        names = ", ".join(action.option_strings)
        about = formatter._expand_help(action) if action.help else ""
        if action.option_strings and action.required:
            about = f"required; {about}" if about else "required"
        yield [f"`{f'{names} {value}'.strip()}`", about.replace("|", "\\|")]


def commands(parser: Any) -> Iterator[argparse.ArgumentParser]:
    """Commands without subcommands, in the order of `--help`."""
    parser.complete()
    inner = [one for one in parser._actions if isinstance(one, argparse._SubParsersAction)]
    if not inner:
        yield parser
    for one in inner:
        for below in one.choices.values():
            yield from commands(below)


def cli_page(table) -> str:
    page = CLI
    for one in commands(make_parser()):
        page += f"## {one.prog}\n\n{one.description}\n\n"
        page += table(["argument", "meaning"], list(rows(one))) + "\n"
    beside = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    program = shutil.which("rockfall-batch", path=beside)
    if program is None:
        sys.exit("rockfall-batch is not there: ./run setup")
    said = subprocess.run([program, "--help"], capture_output=True, text=True, check=True).stdout
    return page + f"## rockfall-batch\n\n```text\n{said}```\n"


def spaced(arguments: str) -> str:
    return re.sub(r"(: [^=,:]+)=", r"\1 = ", arguments)


def signature(name: str) -> str:
    """Signature as in the source; a long signature has one argument per line."""
    found = getattr(rockfall, name)
    made = found.__init__ if inspect.isclass(found) else found
    [node] = ast.parse(textwrap.dedent(inspect.getsource(made))).body
    node.args.args = [one for one in node.args.args if one.arg != "self"]
    node.name, node.body, node.decorator_list = f"rockfall.{name}", [ast.Pass()], []
    if inspect.isclass(found):
        node.returns = None
    for default in [*node.args.defaults, *filter(None, node.args.kw_defaults)]:
        if isinstance(default, ast.Name):  # a constant of the module, replaced by its value
            default.id = repr(getattr(sys.modules[found.__module__], default.id))
    text = spaced(ast.unparse(node).removeprefix("def ").partition(":\n")[0])
    if len(text) <= 90:
        return text
    arguments = spaced(ast.unparse(node.args))
    every = re.split(r", (?=[*\w]+(?:: | = |,|$)|/)(?![^\[(]*[\])])", arguments)
    return text.replace(f"({arguments})", "(\n" + "".join(f"    {one},\n" for one in every) + ")")


WITH_MEMBERS = {"Batch", "Session"}  # classes created by functions, whose methods are listed


def api_page() -> str:
    page = API
    for name, module in sorted(rockfall._MODULES.items(), key=lambda one: one[0].lower()):
        if name == "__version__":
            continue
        module, _, own = module.partition(":")
        if own and own in rockfall.__all__:
            page += f"## {name}\n\nAnother name of [{own}](#{own}).\n\n"
            continue
        page += f"## {name}\n\n"
        if name not in WITH_MEMBERS:
            page += f"```text\n{signature(name)}\n```\n\n"
        page += f"::: rockfall.{module}.{own or name}\n"
        more = ", members: true" if name in WITH_MEMBERS else ""
        page += f"    options: {{ show_root_heading: false, show_root_toc_entry: false{more} }}\n\n"
    return page.rstrip() + "\n"
