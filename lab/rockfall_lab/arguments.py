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

    pack = verb("pack", "settle layers, describe them and draw the first one")
    pack.add_argument("case", metavar="LAB.nml", type=Path)
    _option(pack, "-o --output LAYER.png", Path, "image of the first layer")
    _option(pack, "--layers N", int, "default: 8", default=8)
    _option(pack, "--ratio R", float, "R_b/R_m; default: 5", default=5.0)
    impact = verb("impact", "simulate all impacts or throws of a laboratory case")
    impact.add_argument("case", metavar="LAB.nml", type=Path)
    _option(impact, "-o --output OUT.nc", Path, "default: LAB.nc in the current folder")
    _switch(impact, "--resume", "continue OUT.nc")
    _option(impact, "--radius R", float, "R_b of blocks thrown at the same ground [m]")
    relief = verb("relief", "print the spectrum of a measured patch, for &ground of blocks")
    relief.add_argument("patch", metavar="PATCH.tif", type=Path, help="elevations in small cells")
    _option(relief, "--radius R", float, "R_b of the blocks [m]; default: 0.4", default=0.4)
    _option(relief, "--shortest L", float, "shortest wave, in R_b; default: 2", default=2.0)
    _option(relief, "--longest L", float, "longest wave, in R_b; default: 16", default=16.0)
    fit = verb("fit", "make impact sets from impacts, or from measured contacts")
    fit.add_argument(
        "impacts",
        metavar="IMPACTS",
        type=Path,
        help="impacts (.nc), or measured contacts (.csv)",
    )
    _option(fit, "-o --output SETS.nml", Path, "file for &impact sets")
    fit.add_argument("--state", help="recorded state of the boulder: peak (default), loss or clear")
    fit.add_argument(
        "--nearest-ratio", action="store_true",
        help="copy the set of the nearest ratio to ratios without measured contacts",
    )  # fmt: skip
    tables = verb("table", "make an impact table from contacts of the laboratory")
    tables.add_argument("contacts", metavar="CONTACTS.nc", nargs="+", type=Path, help="contacts")
    _option(tables, "-o --output TABLE.nc", Path, "file for &impact table", required=True)
    card = verb("scorecard", "compare impact sets with known rebounds on rocky slopes")
    card.add_argument(
        "sets", metavar="SETS", nargs="*", help="sets or files; default: all shipped sets"
    )
    card.add_argument(
        "--site", metavar="DIR", type=Path, default=Path("cases/vaujany"),
        help="case of the slope; default: cases/vaujany",
    )  # fmt: skip
    card.add_argument(
        "--slopes", metavar="N", type=int, default=32,
        help="number of slopes of the site's recipe; default: 32",
    )  # fmt: skip
    card.add_argument(
        "--turning", default="past_aspect", help="as in &impact turning; default: past_aspect"
    )
    card.add_argument(
        "--rg-reading", default="radius", help="as in &surface rg_reading; default: radius"
    )
    card.add_argument("--ratio", default="nearest", help="as in &impact; default: nearest")
    remake = verb("remake", "reproduce set files and tables from their provenance, and compare")
    remake.add_argument("sets", metavar="FILE", nargs="+", help="shipped names, or files")
    for parser in (pack, impact, remake):
        _option(parser, "--threads N", int, "default: all cores", default=0)
    for parser in (pack, impact, fit, tables):
        text = "replace existing files, never inputs; default: refuse"
        _switch(parser, "--overwrite", text)
    for parser in (impact, fit, tables, card, remake):
        _switch(parser, "--quiet", "print no progress and no summary")


def _option(parser: argparse.ArgumentParser, names: str, kind: Any, does: str, **more: Any) -> None:
    """Add an option with a value; the option's names end with the name of the value."""
    *flags, value = names.split()
    parser.add_argument(*flags, metavar=value, type=kind, help=does, **more)


def _switch(parser: argparse.ArgumentParser, name: str, does: str) -> None:
    """Add an option without a value."""
    parser.add_argument(name, action="store_true", help=does)
