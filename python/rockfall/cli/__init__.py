# SPDX-License-Identifier: BSD-3-Clause
"""The command line: arguments in, exit status out. What a command does stands elsewhere."""

from __future__ import annotations

import argparse
import errno
import io
import math
import os
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from rockfall.cli.lab import add_lab
from rockfall.errors import RockfallError
from rockfall.interrupts import exit_status, stoppable

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.case import Case
    from rockfall.scene.scene import Scene
    from rockfall.simulation.checkpoint import Checkpoint

DONE, FAULT, REFUSED = 0, 1, 2  # exit status; `exit_status` has that of interrupts


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status. Whatever goes wrong is one line on stderr."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # of the packages below us, to their programmers
    _open_closed_streams()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a name may have letters that it cannot take
    try:
        with stoppable():
            arguments = _parser().parse_args(argv)
            _check_names(arguments)
            status = arguments.command(arguments)
            sys.stdout.flush()
        return status
    except SystemExit as done:  # --help, --version
        return int(done.code or DONE)
    except RockfallError as error:
        return _say(str(error), error.code)
    except KeyboardInterrupt:
        return _say("interrupted; no file is half-written", exit_status())
    except ImportError as error:
        return _say(_NO_MEMORY, REFUSED) if "failed to map" in str(error) else _fault(error)
    except MemoryError:
        return _say(_NO_MEMORY, REFUSED)
    except BrokenPipeError:
        _close_stdout()  # who reads has seen enough
        return DONE
    except OSError as error:
        if error.errno == errno.ENOMEM:
            return _say(_NO_MEMORY, REFUSED)
        if error.filename is not None:
            return _fault(error)
        _close_stdout()  # takes no more
        return _say(f"output: {error.strerror or error}", REFUSED)
    except Exception as error:
        return _fault(error)


_NO_MEMORY = "not enough memory for this case; `rockfall check` says what it needs"
_MERGE = "Join all parts of a run; the result is that of a run in one piece, bit for bit."


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise RockfallError(f"{message}; see {self.prog} --help")


class _Version(argparse.Action):
    """`--version`, looked up only when asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from rockfall.version import __version__

        print(f"rockfall {__version__}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="rockfall", description="Where falling rocks go, how fast, how high and how often."
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, does: str, what: str) -> argparse.ArgumentParser:
        one = commands.add_parser(name, help=does, description=does[0].upper() + does[1:] + ".")
        one.add_argument(what.lower(), metavar=what, type=Path)
        one.set_defaults(command=globals()[f"_{name}"])
        return one

    check = command("check", "read and check everything, say what would run, run nothing", "CASE")
    run = command("run", "run a case and write its result as netCDF", "CASE")
    for one in check, run:
        about = "of the run; terrain beyond half of it is read in windows; default: the machine's"
        one.add_argument("--memory", metavar="SIZE", help=about)
    run.add_argument("-o", "--output", metavar="OUT.nc", type=Path, help="default: CASE.nc, here")
    rules = "'speed.mean@EL1<2%%, energy_total.q95@EL1<5%%, fraction@EL1<3%%'"
    run.add_argument("--until", metavar="RULES", help=f"until 95 %% intervals are narrow: {rules}")
    run.add_argument("--cap", metavar="N", type=int, help="with --until: most from each source")
    run.add_argument("--shard", metavar="I/N", help="the I-th of N parts, for `rockfall merge`")
    run.add_argument("--dask", metavar="WHERE", help="on a Dask cluster: its address, or local:N")
    run.add_argument("--resume", action="store_true", help="go on from the last checkpoint, if any")
    run.add_argument(
        "--checkpoint", metavar="SECONDS", type=float, default=60.0,
        help="between checkpoints, in OUT.nc.checkpoint; default: 60, 0 = none",
    )  # fmt: skip
    slurm = command("slurm", "write a job array of Slurm for a case, with its merge job", "CASE")
    slurm.add_argument("folder", metavar="DIR", type=Path, help="made; jobs, parts and result")
    slurm.add_argument("--shards", metavar="N", type=int, required=True, help="jobs of the array")
    slurm.add_argument("--program", default="python", help="python (default), or batch")
    slurm.add_argument("--threads", metavar="N", type=int, default=4, help="of each job; default 4")
    slurm.add_argument("--time", default="24:00:00", help="of each job; default 24:00:00")
    merge = commands.add_parser("merge", help="join the parts of a run", description=_MERGE)
    merge.add_argument("parts", metavar="PART.nc", type=Path, nargs="+")
    merge.add_argument("-o", "--output", metavar="OUT.nc", type=Path, required=True)
    merge.set_defaults(command=_merge)
    vary = command("ensemble", "run a case over what is uncertain in it, say what matters", "CASE")
    vary.add_argument("-o", "--output", metavar="OUT", type=Path, help="OUT.nc, or a table OUT.csv")
    vary.add_argument("--runs", metavar="M", type=int, help="draws of what is uncertain")
    for one in run, vary:
        one.add_argument("--boulders", metavar="N", type=int, help="released from each source")
        one.add_argument("--seed", metavar="N", type=int, help="of the random numbers")
        one.add_argument("--threads", metavar="N", type=int, help="0 = all cores")
        one.add_argument("--quiet", action="store_true", help="no progress, no summary")
    prepare = command("prepare", "make a case that rockfall-batch reads without Python", "CASE")
    prepare.add_argument("folder", metavar="DIR", type=Path, help="made; what is prepared there")
    converge = command("convergence", "measure how a case's numbers converge, and the cost", "CASE")
    converge.add_argument(
        "-o", "--output", metavar="DIR", type=Path, help="default: CASE_convergence"
    )
    converge.add_argument("--boulders", metavar="N", type=int, nargs="+", help="of the study")
    converge.add_argument("--reference", metavar="N", type=int, help="boulders; default: 1000000")
    export = command("export", "write a result as GeoTIFF, GeoPackage and CSV", "OUT.nc")
    export.add_argument("folder", metavar="DIR", type=Path, help="made where it is missing")
    compare = command("compare", "set a result beside observations", "OUT.nc")
    compare.add_argument("observed", metavar="OBSERVED.csv", type=Path, nargs="+")
    compare.add_argument("-o", "--output", metavar="TABLE.csv", type=Path, help="all tables as CSV")
    lines = command("lines", "print line statistics with intervals, and return levels", "OUT.nc")
    lines.add_argument("-o", "--output", metavar="TABLE.csv", type=Path, help="write them, too")
    figures = command("figures", "draw every figure of a result, those of the paper too", "OUT.nc")
    figures.add_argument("folder", metavar="DIR", type=Path, help="made where it is missing")
    figures.add_argument("--format", default="png", help="png (default), pdf or svg")
    report = command("report", "write a result as one HTML page, to be read offline", "OUT.nc")
    report.add_argument("-o", "--output", metavar="FILE", type=Path, help="default: OUT.html")
    for one in figures, report:
        one.add_argument(
            "--dem", metavar="FILE", type=Path, help="default: the case's, where found"
        )
        one.add_argument("--observed", metavar="CSV", type=Path, nargs="+", help="drawn beside it")
    add_lab(commands)
    return parser


def _check_names(arguments: argparse.Namespace) -> None:
    """Refuse names that are not text in UTF-8: netCDF and case files can hold no others."""
    encoding = sys.getfilesystemencoding()
    if encoding != "utf-8":
        raise RockfallError(f"file names are in {encoding} here: set LC_ALL=C.UTF-8")
    values = vars(arguments).values()
    names = [one for value in values for one in (value if isinstance(value, list) else [value])]
    for name in (*(one for one in names if isinstance(one, Path)), Path.cwd()):
        if os.fsencode(name).decode("utf-8", "replace") != str(name):
            raise RockfallError(f"{name}: is not a name in UTF-8")


def _check(arguments: argparse.Namespace) -> int:
    from rockfall.case import read_case
    from rockfall.scene.read import read_scene
    from rockfall.text.preview import preview

    scene = read_scene(read_case(arguments.case), memory=_memory(arguments))
    _warn(scene)
    print(preview(scene))
    return DONE


def _run(arguments: argparse.Namespace) -> int:
    from rockfall.case_files import input_files
    from rockfall.io.output_files import RESULT, check_output
    from rockfall.simulation.checkpoint import checkpoint_folder

    if arguments.until is not None and arguments.boulders is not None:
        raise RockfallError("--boulders: --until finds their number; limit it with --cap")
    if arguments.until is None and arguments.cap is not None:
        raise RockfallError("--cap: is of use with --until only")
    for word in "shard", "resume", "dask":
        if arguments.until is not None and getattr(arguments, word) not in (None, False):
            raise RockfallError(f"--{word}: --until decides on all boulders together")
    if arguments.dask is not None and (arguments.resume or arguments.shard is not None):
        raise RockfallError("--dask: makes parts of its own, and no checkpoints")
    if not arguments.checkpoint >= 0:
        raise RockfallError(f"--checkpoint {arguments.checkpoint}: must be >= 0 seconds")
    case = _overridden(arguments)
    which, of = shard = (1, 1) if arguments.shard is None else _shard(arguments.shard)
    stem = arguments.case.stem
    path = arguments.output or Path(f"{stem}.nc" if of == 1 else f"{stem}.part{which}of{of}")
    check_output(path, RESULT, input_files(case))
    with checkpoint_folder(path, _warning) as folder:
        return _run_to(path, case, arguments, shard, _checkpoint(arguments, folder))


def _run_to(
    path: Path,
    case: Case,
    arguments: argparse.Namespace,
    shard: tuple[int, int],
    checkpoint: Checkpoint | None,
) -> int:
    from rockfall.interrupts import interrupts
    from rockfall.result.dataset import write_result
    from rockfall.scene.read import read_scene
    from rockfall.simulation.simulate import Interrupted
    from rockfall.text.summary import summary

    scene = read_scene(case, memory=_memory(arguments))
    _warn(scene)
    with interrupts():  # what has been done is also written
        try:
            result = _fly(scene, arguments, shard, checkpoint)
        except Interrupted as stop:
            return _keep(stop, path, checkpoint)
        write_result(result, path)
    if checkpoint:
        checkpoint.remove()
    _warn_unmet(result)
    if not arguments.quiet:
        print(summary(result))
        print(path)
    return DONE


def _memory(arguments: argparse.Namespace) -> float:
    from rockfall.simulation.memory import machine_memory, read_memory

    return machine_memory() if arguments.memory is None else read_memory(arguments.memory)


def _shard(text: str) -> tuple[int, int]:
    which, slash, of = text.partition("/")
    if not (slash and which.isdecimal() and of.isdecimal() and 1 <= int(which) <= int(of)):
        raise RockfallError(f"--shard {text}: must be I/N with I from 1 to N")
    return int(which), int(of)


def _merge(arguments: argparse.Namespace) -> int:
    from rockfall.io.output_files import RESULT, check_output
    from rockfall.result.dataset import write_result
    from rockfall.simulation.merge import merge
    from rockfall.text.summary import summary

    check_output(arguments.output, RESULT, arguments.parts)
    result = merge(arguments.parts)
    write_result(result, arguments.output)
    print(summary(result))
    print(arguments.output)
    return DONE


def _checkpoint(arguments: argparse.Namespace, folder: Path) -> Checkpoint | None:
    """Where a run saves its work; one that is there is not overwritten unasked."""
    from rockfall.simulation.checkpoint import Checkpoint

    if arguments.until is not None or arguments.dask is not None:
        return None
    every = arguments.checkpoint or math.inf
    found = Checkpoint(folder, every, _warning)
    if not arguments.resume and (done := found.found()):
        raise RockfallError(
            f"{folder}: holds {done:,} boulders of a run that was stopped; go on with --resume, or "
            "remove it"
        )
    return found


def _fly(
    scene: Scene,
    arguments: argparse.Namespace,
    shard: tuple[int, int],
    checkpoint: Checkpoint | None,
) -> xr.Dataset:
    """As many boulders as the case says, or as the rules of `--until` need."""
    from rockfall.analysis.run_until import run_scene_until
    from rockfall.simulation.simulate import run_scene

    if arguments.dask is not None:
        from rockfall.simulation.dask import run_on_cluster

        return run_on_cluster(scene, arguments.dask, progress=not arguments.quiet)
    how = {"progress": not arguments.quiet, "keep": False}
    if arguments.until is None:
        return run_scene(scene, shard=shard, checkpoint=checkpoint, **how)
    return run_scene_until(scene, arguments.until, arguments.cap, **how)


def _slurm(arguments: argparse.Namespace) -> int:
    from rockfall.simulation.slurm import write_jobs

    how = {key: getattr(arguments, key) for key in ("program", "threads", "time")}
    for path in write_jobs(arguments.case, arguments.folder, arguments.shards, **how):
        print(path)
    return DONE


def _ensemble(arguments: argparse.Namespace) -> int:
    from rockfall.analysis.ensemble import (
        check_place,
        ensemble_summary,
        run_ensemble,
        write_ensemble,
    )
    from rockfall.case_files import input_files

    case = _overridden(arguments)
    if arguments.runs is not None:
        case = case.replace(ensemble={"runs": arguments.runs})
    path = arguments.output or Path(f"{arguments.case.stem}-ensemble.nc")
    check_place(path, len(case.line), input_files(case))
    found = run_ensemble(case, progress=not arguments.quiet)
    write_ensemble(found, path)
    if not arguments.quiet:
        print(ensemble_summary(found))
        print(path)
    return DONE


def _prepare(arguments: argparse.Namespace) -> int:
    from rockfall.case import read_case
    from rockfall.scene.prepare import prepare

    for path in prepare(read_case(arguments.case), arguments.folder):
        print(path)
    return DONE


def _convergence(arguments: argparse.Namespace) -> int:
    from rockfall.analysis.convergence import check_writable, converge, write
    from rockfall.case import read_case
    from rockfall.case_files import input_files
    from rockfall.text.convergence import text

    folder = arguments.output or Path(f"{arguments.case.stem}_convergence")
    case = read_case(arguments.case)
    inputs = list(input_files(case))
    check_writable(folder, inputs)
    given = {key: getattr(arguments, key) for key in ("boulders", "reference")}
    given = {key: value for key, value in given.items() if value is not None}
    found = converge(case, **given, progress=True)
    paths = write(found, folder, inputs)
    print(text(found))
    print("", *paths, sep="\n")
    return DONE


def _export(arguments: argparse.Namespace) -> int:
    from rockfall.result.export import export

    for path in export(getattr(arguments, "out.nc"), arguments.folder):
        print(path)
    return DONE


def _compare(arguments: argparse.Namespace) -> int:
    from rockfall.analysis.compare import compare, write_comparison
    from rockfall.case_files import files_behind
    from rockfall.result.dataset import read_result

    path, sources = getattr(arguments, "out.nc"), arguments.observed
    result = read_result(path)
    found = compare(result, *sources)
    if arguments.output:
        write_comparison(found, arguments.output, keep=(path, *sources, *files_behind(result)))
    print(found)
    return DONE


def _lines(arguments: argparse.Namespace) -> int:
    from rockfall.text.line_tables import print_lines

    print_lines(getattr(arguments, "out.nc"), arguments.output)
    return DONE


def _figures(arguments: argparse.Namespace) -> int:
    from rockfall.case_files import files_behind
    from rockfall.plots.figures import figures, write_figures

    result, terrain, observed = _shown(arguments)
    shown, inputs = figures(result, terrain, observed), [*_given(arguments), *files_behind(result)]
    for path in write_figures(shown, arguments.folder, arguments.format, inputs):
        print(path)
    return DONE


def _report(arguments: argparse.Namespace) -> int:
    from rockfall.html_report import check_page, write_report

    given = getattr(arguments, "out.nc")
    path = arguments.output or given.with_name(f"{given.name.removesuffix('.nc')}.html")
    check_page(path, _given(arguments))
    result, terrain, observed = _shown(arguments)
    write_report(result, path, terrain, observed)
    print(path)
    return DONE


def _given(arguments: argparse.Namespace) -> Iterator[str | Path]:
    """The files that a command which draws a result is given."""
    from rockfall.io.raster_file import raster_files

    yield getattr(arguments, "out.nc")
    yield from arguments.observed or ()
    if arguments.dem:
        yield from raster_files(arguments.dem)


def _shown(arguments: argparse.Namespace) -> tuple:
    """The result, its terrain and the observations that a command is to draw."""
    from rockfall.plots.figures import terrain_of
    from rockfall.result.dataset import read_result

    result, observed = read_result(getattr(arguments, "out.nc")), None
    if arguments.observed:
        from rockfall.analysis.observations import read_observed

        observed = read_observed(*arguments.observed)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", UserWarning)
        terrain = terrain_of(result, arguments.dem)
    for warning in said:
        _warning(str(warning.message))
    return result, terrain, observed


def _overridden(arguments: argparse.Namespace) -> Case:
    """The case with what the command line has in place of its own."""
    from rockfall.case import read_case

    case = read_case(arguments.case)
    given = {key: getattr(arguments, key) for key in ("boulders", "seed", "threads")}
    given = {key: value for key, value in given.items() if value is not None}
    return case.replace(case=given) if given else case


def _keep(stop: BaseException, path: Path, checkpoint: Checkpoint | None) -> int:
    """Write what was done before Ctrl-C."""
    from rockfall.result.dataset import write_result

    result = stop.result
    done, asked = result.sizes["boulder"], result.attrs["boulders_asked"]
    if not done:
        raise KeyboardInterrupt
    write_result(result, path)
    holds = f"{path} holds the first {done:,} of {asked:,} boulders and is a valid result"
    holds += "; --resume goes on" if checkpoint and checkpoint.saved else ""
    return _say(f"interrupted: {holds}", exit_status())


def _warning(text: str) -> None:
    print(f"rockfall: warning: {text}", file=sys.stderr)


def _warn(scene: Scene) -> None:
    from rockfall.scene.plausible import doubts

    for line in doubts(scene):
        _warning(line)


def _warn_unmet(result: xr.Dataset) -> None:
    from rockfall.analysis.run_until import verdicts_of

    for verdict in verdicts_of(result):
        if not verdict.met:
            _warning(f"--until {verdict}")


def _say(line: str, status: int) -> int:
    print("rockfall:", " ".join(line.splitlines()), file=sys.stderr)
    return status


def _fault(error: Exception) -> int:
    if os.environ.get("ROCKFALL_TRACEBACK"):
        traceback.print_exc()
    about = f"internal error: {type(error).__name__}: {error}"
    return _say(f"{about} (please report; set ROCKFALL_TRACEBACK=1 for the trace)", FAULT)


def _open_closed_streams() -> None:
    """Where a standard stream is closed (>&-), what is written there is lost, and does not go to a
    file that is opened later under the same number."""
    for name, mode in ("stdin", "r"), ("stdout", "w"), ("stderr", "w"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))


def _close_stdout() -> None:
    """Nobody takes what is still to be printed; Python must not try again when it exits."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
