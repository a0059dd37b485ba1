# SPDX-License-Identifier: BSD-3-Clause
"""Follow the tutorial exactly: its commands, its edits, and their printed output.

`python tools/tutorial.py FOLDER` does this in an empty folder and prints differences between pages
and program. On a page of docs/tutorial, blocks have these meanings:

    sh                           commands, run in the reader's folder
    text                         output of the preceding commands; "..." matches anything
    fortran title="case.nml"     keys to set in this file, and groups to add
    csv title="case_zones.csv"   contents of this file
"""

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from doctest import ELLIPSIS, OutputChecker
from pathlib import Path

from rockfall.cli import main

os.environ["ROCKFALL_PROGRESS"] = "none"  # progress depends on the speed of the machine

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs/tutorial"
LAYERS = ROOT / "cases/tutorial/make_layers.py"
BLOCK = re.compile(r'^```(\w+)(?: title="(.+?)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)
GROUP = re.compile(r"^&(\w+)(.*?)(?<=[\s'])/ *$", re.MULTILINE | re.DOTALL)
KEY = re.compile(r"^ *(\w+) = ([^!\n]*?) *$", re.MULTILINE)


def follow(folder: Path) -> Iterator[tuple[str, str, str]]:
    """Yield page, text and actual output of each block of output on the tutorial's pages. Raises a
    ValueError for other blocks."""
    shutil.copy(LAYERS, folder)
    with contextlib.chdir(folder):
        for page in sorted(PAGES.glob("[0-9]*.md")):
            printed = ""
            for kind, title, block in BLOCK.findall(page.read_text(encoding="utf-8")):
                if kind == "sh":
                    printed = "".join(run(command) for command in block.splitlines())
                elif kind == "text":
                    yield page.name, block, printed
                elif kind == "fortran":
                    Path(title).write_text(edited(Path(title).read_text(), block))
                elif kind == "csv":
                    Path(title).write_text(block)
                else:
                    raise ValueError(f"{page}: a block of {kind}")


def run(command: str) -> str:
    """Output of a command, without trailing spaces. Raises a ValueError for an unknown command, and
    a RuntimeError or CalledProcessError for a command that fails."""
    name, *arguments = shlex.split(command, comments=True) or [""]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        if name == "rockfall":
            if main(arguments) != 0:
                raise RuntimeError(f"{command}: {printed.getvalue()}")
        elif name == "python":
            subprocess.run([sys.executable, *arguments], check=True)
        elif name == "cp":
            shutil.copy(*arguments)
        elif name:
            raise ValueError(f"{command}: no command of the tutorial")
    return re.sub(r" +$", "", printed.getvalue(), flags=re.MULTILINE)


def edited(case: str, block: str) -> str:
    """Case with the keys of a block set in existing groups, and new groups added. Raises a
    ValueError unless each key occurs exactly once in its group."""
    had = set(re.findall(r"^&(\w+)", case, re.MULTILINE))
    for group in GROUP.finditer(block):
        name, keys = group.groups()
        if name not in had:
            case += f"\n{group[0]}\n"
            continue
        found = re.search(rf"^&{name}\n.*?^/$", case, re.MULTILINE | re.DOTALL)
        assert found, f"&{name} has lines of its own in a case by rockfall new"
        text = found[0]
        for key, value in KEY.findall(keys):
            text, count = re.subn(
                rf"^( *)(?:! )?{key} = [^!\n]*",
                lambda old, new=f"{key} = {value}": f"{old[1]}{new}  ",
                text,
                flags=re.MULTILINE,
            )
            if count != 1:
                raise ValueError(f"&{name}: {key} is there {count} times")
        case = case[: found.start()] + text + case[found.end() :]
    return case


def agree(said: str, printed: str) -> bool:
    """Return True if a page agrees with the program's output."""
    return OutputChecker().check_output(said, printed, ELLIPSIS)


def differences(folder: Path) -> Iterator[str]:
    """Yield differences between pages and the program."""
    for page, said, printed in follow(folder):
        if not agree(said, printed):
            yield f"docs/tutorial/{page} says\n{said}but the program prints\n{printed}"


if __name__ == "__main__":
    wrong = 0
    for difference in differences(Path(sys.argv[1]).resolve()):
        wrong += 1
        print(difference)
    sys.exit(bool(wrong))
