# SPDX-License-Identifier: BSD-3-Clause
"""Arguments of `rockfall lab ...`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rockfall.cli.arguments import command_of


def add_commands(lab: argparse.ArgumentParser) -> None:
    """Add the commands of the laboratory to the parser of `rockfall lab`."""
    verbs = lab.add_subparsers(required=True, metavar="COMMAND")

    def verb(name: str, does: str) -> argparse.ArgumentParser:
        parser = verbs.add_parser(name, help=does, description=does[0].upper() + does[1:] + ".")
        parser.set_defaults(command=command_of("rockfall_lab.commands", name))
        return parser

    pack = verb("pack", "let layers settle, describe them, draw the first")
    pack.add_argument("case", metavar="LAB.nml", type=Path)
    _option(pack, "-o --output LAYER.png", Path, "a picture")
    _option(pack, "--layers N", int, "default: 8", default=8)
    _option(pack, "--ratio R", float, "R_b/R_m; default: 5", default=5.0)
    impact = verb("impact", "fire all impacts of a laboratory case")
    impact.add_argument("case", metavar="LAB.nml", type=Path)
    _option(impact, "-o --output OUT.nc", Path, "default: LAB.nc, here")
    _switch(impact, "--resume", "continue OUT.nc")
    _option(impact, "--radius R", float, "the same ground for blocks of another R_b [m]")
    relief = verb("relief", "give the spectrum of a measured patch, for &ground of blocks")
    relief.add_argument("patch", metavar="PATCH.tif", type=Path, help="elevations in small cells")
    _option(relief, "--radius R", float, "R_b of the blocks [m]; default: 0.4", default=0.4)
    _option(relief, "--shortest L", float, "wave over R_b; default: 2", default=2.0)
    _option(relief, "--longest L", float, "wave over R_b; default: 16", default=16.0)
    fit = verb("fit", "make impact sets from impacts, or from measured contacts")
    fit.add_argument(
        "impacts", metavar="IMPACTS", type=Path, help=".nc of the laboratory, or .csv of contacts"
    )
    _option(fit, "-o --output SETS.nml", Path, "for rockfall run")
    fit.add_argument(
        "--state", help="of the boulder in the laboratory: peak (default), loss or clear"
    )
    fit.add_argument(
        "--nearest-ratio", action="store_true",
        help="a ratio without measured contacts has the set of the nearest that has some",
    )  # fmt: skip
    tables = verb("table", "make a table of impacts from contacts of the laboratory")
    tables.add_argument("contacts", metavar="CONTACTS.nc", nargs="+", type=Path, help="of blocks")
    _option(tables, "-o --output TABLE.nc", Path, "for &impact table", required=True)
    card = verb("scorecard", "compare impact sets with known rebounds on rocky slopes")
    card.add_argument("sets", metavar="SETS", nargs="*", help="shipped or files; default: shipped")
    card.add_argument(
        "--site", metavar="DIR", type=Path, default=Path("cases/vaujany"),
        help="the case of the slope; default: cases/vaujany",
    )  # fmt: skip
    card.add_argument(
        "--slopes", metavar="N", type=int, default=32,
        help="of the site's recipe, for means and standard errors; default: 32",
    )  # fmt: skip
    card.add_argument("--turning", default="past_aspect", help="as &impact turning")
    card.add_argument("--rg-reading", default="radius", help="as &surface rg_reading; radius")
    card.add_argument("--ratio", default="nearest", help="as &impact ratio; nearest")
    remake = verb("remake", "make set files and tables again from their provenance, and compare")
    remake.add_argument("sets", metavar="FILE", nargs="+", help="shipped or files")
    for parser in (pack, impact, remake):
        _option(parser, "--threads N", int, "default: all cores", default=0)
    for parser in (pack, impact, fit, tables):
        text = "replace existing files, never inputs; default: refuse"
        _switch(parser, "--overwrite", text)
    for parser in (impact, fit, tables, card, remake):
        _switch(parser, "--quiet", "no progress, no summary")


def _option(parser: argparse.ArgumentParser, names: str, kind: Any, does: str, **more: Any) -> None:
    """Add an option with a value; the option's names end with the name of the value."""
    *flags, value = names.split()
    parser.add_argument(*flags, metavar=value, type=kind, help=does, **more)


def _switch(parser: argparse.ArgumentParser, name: str, does: str) -> None:
    """Add an option without a value."""
    parser.add_argument(name, action="store_true", help=does)
