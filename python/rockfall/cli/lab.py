# SPDX-License-Identifier: BSD-3-Clause
"""`rockfall lab ...`: arguments in, exit status out."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rockfall.errors import RockfallError, need
from rockfall.interrupts import exit_status

if TYPE_CHECKING:
    from rockfall.lab.fit import ImpactSet

    #: Sets by ratio, their provenance, and what is printed of them.
    Fitted = tuple[dict[int, ImpactSet], list[str], Callable[[], str]]


def add_lab(commands: argparse._SubParsersAction) -> None:
    """Add the laboratory to the commands of `rockfall`."""
    about = "discrete-element impacts, and impact sets from them"
    lab = commands.add_parser("lab", help=about, description=about.capitalize() + ".")
    verbs = lab.add_subparsers(required=True, metavar="COMMAND")

    def verb(name: str, does: str) -> argparse.ArgumentParser:
        one = verbs.add_parser(name, help=does, description=does[0].upper() + does[1:] + ".")
        one.set_defaults(command=globals()[f"_{name}"])
        return one

    pack = verb("pack", "let layers settle, say what they are, draw the first")
    pack.add_argument("case", metavar="LAB.nml", type=Path)
    pack.add_argument("-o", "--output", metavar="LAYER.png", type=Path, help="a picture")
    pack.add_argument("--layers", metavar="N", type=int, default=8, help="default: 8")
    pack.add_argument("--ratio", metavar="R", type=float, default=5.0, help="R_b/R_m; default: 5")
    impact = verb("impact", "fire all impacts of a laboratory case")
    impact.add_argument("case", metavar="LAB.nml", type=Path)
    impact.add_argument("-o", "--output", metavar="OUT.nc", type=Path, help="default: LAB.nc, here")
    impact.add_argument("--resume", action="store_true", help="go on with OUT.nc")
    fit = verb("fit", "make impact sets from impacts, or from measured contacts")
    fit.add_argument(
        "impacts", metavar="IMPACTS", type=Path, help=".nc of the laboratory, or .csv of contacts"
    )
    fit.add_argument("-o", "--output", metavar="SETS.nml", type=Path, help="for rockfall run")
    fit.add_argument(
        "--state", help="of the boulder in the laboratory: peak (default), loss or clear"
    )
    fit.add_argument(
        "--nearest-ratio", action="store_true",
        help="a ratio without measured contacts has the set of the nearest that has some",
    )  # fmt: skip
    card = verb("scorecard", "set impact sets beside what is known of rebounds on rocky slopes")
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
    card.add_argument("--rg-reading", default="diameter", help="as &surface rg_reading")
    remake = verb("remake", "make set files again from their provenance, and compare all bits")
    remake.add_argument("sets", metavar="SETS", nargs="+", help="shipped or files")
    for one in (pack, impact, remake):
        one.add_argument("--threads", metavar="N", type=int, default=0, help="default: all cores")
    for one in (impact, fit, card, remake):
        one.add_argument("--quiet", action="store_true", help="no progress, no summary")


def _pack(arguments: argparse.Namespace) -> int:
    from rockfall.io.output_files import FIGURE, check_output
    from rockfall.lab.case import read_lab_case
    from rockfall.lab.experiment import pack_layers

    if arguments.layers < 1:
        raise RockfallError(f"--layers {arguments.layers}: must be 1 or more")
    if arguments.output:
        need("a picture needs", "report", "matplotlib")
        check_output(arguments.output, FIGURE, [arguments.case])
    case = read_lab_case(arguments.case)
    layers = pack_layers(case, arguments.ratio, count=arguments.layers, threads=arguments.threads)
    unit = case.packing["mean_radius"]
    print(f"{'layer':>6}{'bodies':>8}{'surface [R_m]':>15}{'solid':>8}{'floor/weight':>14}")
    for k in range(len(layers)):
        surface, _, solid, floor, *_ = layers.facts[:, k]
        print(f"{k + 1:6d}{layers.bodies[k]:8d}{surface / unit:15.2f}{solid:8.3f}{floor:14.3f}")
    if arguments.output:
        from rockfall.plots.lab import layer_figure

        layer_figure(layers, arguments.output)
        print(arguments.output)
    return 0


def _impact(arguments: argparse.Namespace) -> int:
    from rockfall.io.output_files import IMPACTS, check_output
    from rockfall.lab.case import read_lab_case
    from rockfall.lab.experiment import run_impacts

    case = read_lab_case(arguments.case)
    path = arguments.output or Path(f"{arguments.case.stem}.nc")
    check_output(path, IMPACTS, [arguments.case])
    try:
        data = run_impacts(
            case, progress=not arguments.quiet, threads=arguments.threads, path=path,
            resume=arguments.resume,
        )  # fmt: skip
    except KeyboardInterrupt:
        print(f"rockfall: interrupted: {path} goes on with --resume", file=sys.stderr)
        return exit_status()
    if not arguments.quiet:
        from rockfall.text.lab import impact_summary

        print(impact_summary(data))
        print(path)
    return 0


def _fit(arguments: argparse.Namespace) -> int:
    from rockfall.io.output_files import SETS, check_output
    from rockfall.lab.setfile import write_sets

    need("a fit needs", "report", "scipy")
    if arguments.output:
        check_output(arguments.output, SETS, [arguments.impacts])
    measured = arguments.impacts.suffix.lower() == ".csv"
    sets, about, summary = (_from_contacts if measured else _from_impacts)(arguments)
    if not arguments.quiet:
        print(summary())
    if arguments.output:
        write_sets(arguments.output, sets, about)
        print(arguments.output)
    return 0


def _from_impacts(arguments: argparse.Namespace) -> Fitted:
    from rockfall.lab.experiment import open_impacts
    from rockfall.lab.fit import fit_impacts
    from rockfall.lab.setfile import provenance
    from rockfall.text.lab import fit_summary

    if arguments.nearest_ratio:
        raise RockfallError("--nearest-ratio: is for measured contacts (.csv)")
    state = arguments.state or "peak"
    data = open_impacts(arguments.impacts)
    about = provenance(data, state)
    sets = fit_impacts(data, state)
    return sets, about, lambda: fit_summary(data, sets, state)


def _from_contacts(arguments: argparse.Namespace) -> Fitted:
    from rockfall.lab.contacts import contacts_provenance, fit_contacts, read_contacts
    from rockfall.text.lab import contacts_summary

    if arguments.state is not None:
        raise RockfallError(f"--state {arguments.state}: is for impacts of the laboratory (.nc)")
    contacts = read_contacts(arguments.impacts)
    sets = fit_contacts(contacts, arguments.nearest_ratio)
    return sets, contacts_provenance(contacts), lambda: contacts_summary(contacts, sets)


def _scorecard(arguments: argparse.Namespace) -> int:
    from rockfall.impact_sets import shipped_sets
    from rockfall.lab.scorecard import by_ratio, score, table, targets
    from rockfall.lab.sets import read_sets
    from rockfall.lab.site import Site
    from rockfall.simulation.progress import progress_bar

    if arguments.slopes < 2:
        raise RockfallError(f"--slopes {arguments.slopes}: must be 2 or more")
    sets = [read_sets(name) for name in arguments.sets or shipped_sets()]
    site, wanted = Site(arguments.site), targets(arguments.site)
    how = {"turning": arguments.turning, "reading": arguments.rg_reading}
    with progress_bar(len(sets) * arguments.slopes, not arguments.quiet, "slopes") as advance:
        scores = [score(draws, site, arguments.slopes, advance, **how) for draws in sets]
    print(table(scores, wanted))
    for draws in sets:
        print("\n" + by_ratio(draws[0]))
    return 0


def _remake(arguments: argparse.Namespace) -> int:
    from rockfall.impact_sets import shipped_sets
    from rockfall.lab.remake import remake

    paths = [shipped_sets().get(name, Path(name)) for name in arguments.sets]
    for path, source, difference in remake(paths, arguments.threads, not arguments.quiet):
        again = f"made again from {source}" if source else "made again"
        if difference:
            raise RockfallError(f"{path}: {again}, it differs: {difference}", 1)
        print(f"{path}: {again}, the same in every bit")
    return 0
