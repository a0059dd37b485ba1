# SPDX-License-Identifier: BSD-3-Clause
"""Commands of `rockfall lab ...`: single impacts and their impact sets, block throws and their
impact tables."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from math import inf
from pathlib import Path

from rockfall.case.text import namelist_text
from rockfall.cli.messages import DONE, say, warn
from rockfall.errors import RockfallError, need
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.grounds.impact_tables import save_table, shipped_tables
from rockfall.grounds.relief import Spectrum, measure
from rockfall.interrupts import exit_status
from rockfall.io.output_files import check_output, overwriting
from rockfall.io.rasters.dem import read_dem
from rockfall.scene.rebounds.sets import read_sets
from rockfall.simulation.parts.finished import FINISHED
from rockfall.simulation.parts.lock import locked
from rockfall.simulation.progress import progress_bar
from rockfall_lab.blocks.case import is_block_case, read_block_case, relief_keys
from rockfall_lab.blocks.contacts import run_throws
from rockfall_lab.case import read_lab_case
from rockfall_lab.contact_records import open_contacts, save_contacts
from rockfall_lab.figures import layer_figure
from rockfall_lab.remake import remake
from rockfall_lab.scorecard.score import by_ratio, score, table, targets
from rockfall_lab.scorecard.site import Site
from rockfall_lab.sets.contacts import contacts_provenance, fit_contacts, read_contacts
from rockfall_lab.sets.fit import ImpactSet, fit_impacts
from rockfall_lab.sets.setfile import provenance, write_sets
from rockfall_lab.spheres.experiment import load_measured, open_impacts, pack_layers, run_impacts
from rockfall_lab.spheres.sequences import (
    open_sequences,
    rebounds_of,
    run_sequences,
    sequences_provenance,
)
from rockfall_lab.summary import (
    contact_summary,
    contacts_summary,
    fit_summary,
    impact_summary,
    sequences_summary,
)
from rockfall_lab.tables import table_of

#: Sets by ratio, lines of provenance, and their printed summary.
Fitted = tuple[dict[int, ImpactSet], list[str], Callable[[], str]]


def pack_command(arguments: argparse.Namespace) -> int:
    if arguments.layers < 1:
        raise RockfallError(f"--layers {arguments.layers}: must be 1 or more")
    if arguments.output:
        need("a picture needs", "report")
        check_output(arguments.output, [arguments.case])
    case = read_lab_case(arguments.case)
    layers = pack_layers(case, arguments.ratio, count=arguments.layers, threads=arguments.threads)
    unit = case.packing["mean_radius"]
    print(f"{'layer':>6}{'bodies':>8}{'surface [R_m]':>15}{'solid':>8}{'floor/weight':>14}")
    for k, (surface, _, solid, floor, *_) in enumerate(layers.facts.T):
        print(f"{k + 1:6d}{layers.bodies[k]:8d}{surface / unit:15.2f}{solid:8.3f}{floor:14.3f}")
    if arguments.output:
        layer_figure(layers, arguments.output)
        print(arguments.output)
    return DONE


def impact_command(arguments: argparse.Namespace) -> int:
    path = arguments.output or Path(f"{arguments.case.stem}.nc")
    with overwriting(arguments.overwrite or arguments.resume):
        check_output(path, [arguments.case])
    if is_block_case(arguments.case):
        return _throw(arguments, path)
    if arguments.radius is not None:
        raise RockfallError("--radius: is for blocks on a ground")
    case = read_lab_case(arguments.case)
    run = run_sequences if case.throws else run_impacts
    before = path.stat().st_ino if path.exists() else None
    try:
        with locked(path, warn):
            data = run(
                case, progress=not arguments.quiet, threads=arguments.threads, path=path,
                resume=arguments.resume,
            )  # fmt: skip
    except KeyboardInterrupt:
        return say(f"interrupted: {path} goes on with --resume", exit_status())
    if path.stat().st_ino == before:  # a file that was written has a new inode
        return say(f"{path}: {FINISHED}", DONE)
    if not arguments.quiet:
        print(sequences_summary(data) if case.throws else impact_summary(data))
        print(path)
    return DONE


def _throw(arguments: argparse.Namespace, path: Path) -> int:
    if arguments.resume:
        raise RockfallError("--resume: throws of blocks take minutes at most and are not resumed")
    case = read_block_case(arguments.case)
    if (radius := arguments.radius) is not None:
        if not 0 < radius < inf:
            raise RockfallError(f"--radius {radius:g}: must be > 0")
        case = case.at_radius(radius)
    data = run_throws(case, progress=not arguments.quiet, threads=arguments.threads)
    save_contacts(data, path)
    if not arguments.quiet:
        print(contact_summary(data))
        print(path)
    return DONE


def relief_command(arguments: argparse.Namespace) -> int:
    for name in "radius", "shortest", "longest":
        if not 0 < getattr(arguments, name) < inf:
            raise RockfallError(f"--{name} {getattr(arguments, name)}: must be > 0")
    if arguments.shortest >= arguments.longest:
        raise RockfallError(f"--shortest {arguments.shortest}: must be below --longest")
    heights, grid = read_dem(arguments.patch)
    band = Spectrum(0.0, arguments.shortest, arguments.longest)
    spectrum, _ = measure(heights, grid.cell, arguments.radius, band, str(arguments.patch))
    print(namelist_text({"ground": relief_keys(spectrum)}, indent=2), end="")
    return DONE


def fit_command(arguments: argparse.Namespace) -> int:
    need("a fit needs", "report", "threadpoolctl")
    if arguments.output:
        check_output(arguments.output, [arguments.impacts])
    measured = arguments.impacts.suffix.lower() == ".csv"
    sets, attrs, summary = (_from_contacts if measured else _from_impacts)(arguments)
    if not arguments.quiet:
        print(summary())
    if arguments.output:
        write_sets(arguments.output, sets, attrs)
        print(arguments.output)
    return DONE


def _from_impacts(arguments: argparse.Namespace) -> Fitted:
    if "contact" in load_measured(arguments.impacts, "impacts").sizes:
        return _from_sequences(arguments)
    if arguments.nearest_ratio:
        raise RockfallError("--nearest-ratio: is for contacts, not for single impacts")
    state = arguments.state or "peak"
    data = open_impacts(arguments.impacts)
    attrs = provenance(data, state)
    sets = fit_impacts(data, state)
    return sets, attrs, lambda: fit_summary(data, sets, state)


def _from_sequences(arguments: argparse.Namespace) -> Fitted:
    if arguments.state is not None:
        raise RockfallError(f"--state {arguments.state}: is for single impacts")
    data = open_sequences(arguments.impacts)
    contacts = rebounds_of(data, arguments.impacts.name)
    attrs = sequences_provenance(data, contacts)
    sets = fit_contacts(contacts, arguments.nearest_ratio)
    return sets, attrs, lambda: contacts_summary(contacts, sets)


def _from_contacts(arguments: argparse.Namespace) -> Fitted:
    if arguments.state is not None:
        raise RockfallError(f"--state {arguments.state}: is for impacts of the laboratory (.nc)")
    contacts = read_contacts(arguments.impacts)
    sets = fit_contacts(contacts, arguments.nearest_ratio)
    return sets, contacts_provenance(contacts), lambda: contacts_summary(contacts, sets)


def table_command(arguments: argparse.Namespace) -> int:
    check_output(arguments.output, arguments.contacts)
    made = table_of([open_contacts(path) for path in arguments.contacts])
    save_table(made, arguments.output)
    if not arguments.quiet:
        print(f"{made.attrs['contacts']} contacts, {len(made.record)} records")
        print(arguments.output)
    return DONE


def scorecard_command(arguments: argparse.Namespace) -> int:
    if arguments.slopes < 2:
        raise RockfallError(f"--slopes {arguments.slopes}: must be 2 or more")
    sets = [read_sets(name) for name in arguments.sets or shipped_sets()]
    site, wanted = Site(arguments.site), targets(arguments.site)
    how = {
        "turning": arguments.turning, "reading": arguments.rg_reading, "ratio": arguments.ratio,
    }  # fmt: skip
    with progress_bar(len(sets) * arguments.slopes, not arguments.quiet, "slopes") as advance:
        scores = [score(draws, site, arguments.slopes, advance, **how) for draws in sets]
    print(table(scores, wanted))
    for draws in sets:
        print("\n" + by_ratio(draws[0]))
    return DONE


def remake_command(arguments: argparse.Namespace) -> int:
    shipped = shipped_sets() | shipped_tables()
    paths = [shipped.get(name, Path(name)) for name in arguments.sets]
    for path, source, difference in remake(paths, arguments.threads, not arguments.quiet):
        again = f"made again from {source}" if source else "made again"
        if difference:
            raise RockfallError(f"{path}: {again}, it differs: {difference}", 1)
        print(f"{path}: {again}, the same in every bit")
    return DONE
