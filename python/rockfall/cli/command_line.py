# SPDX-License-Identifier: BSD-3-Clause
"""Entry point of the command line: from arguments to exit status."""

import argparse
import errno
import gc
import io
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path

from rockfall.cli.arguments import make_parser
from rockfall.cli.messages import DONE, FAULT, REFUSED, say
from rockfall.errors import RockfallError
from rockfall.interrupts import exit_status, stoppable

#: Garbage collection thresholds; with the defaults it takes a tenth of a report's time.
RARELY = 50_000, 20, 20
_NO_MEMORY = "not enough memory for this case: `rockfall check` estimates what it needs"


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return the exit status. Errors are printed to stderr, one per line."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # library warnings are for developers
    gc.set_threshold(*RARELY)
    _open_closed_streams()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # for names with letters that the terminal lacks
    if argv is None:
        _leave_out("geopandas", *(["dask"] if sys.argv[1:2] != ["run"] else []))
    try:
        with stoppable():
            arguments = make_parser().parse_args(argv)
            _check_names(arguments)
            status = arguments.command(arguments)
            sys.stdout.flush()
        return status
    except SystemExit as done:  # raised by --help and --version
        return int(done.code or DONE)
    except RockfallError as error:
        return [say(fault, error.code) for fault in error.faults][-1]
    except KeyboardInterrupt:
        return say("interrupted: no incomplete file was written", exit_status())
    except ImportError as error:
        return say(_NO_MEMORY, REFUSED) if "failed to map" in str(error) else _fault(error)
    except MemoryError:
        return say(_NO_MEMORY, REFUSED)
    except BrokenPipeError:
        _close_stdout()  # the reader has closed the pipe
        return DONE
    except OSError as error:
        if error.errno == errno.ENOMEM:
            return say(_NO_MEMORY, REFUSED)
        if error.filename is not None:
            return _fault(error)
        _close_stdout()  # the output is closed or full
        return say(f"output: {error.strerror or error}", REFUSED)
    except Exception as error:
        return _fault(error)


def _check_names(arguments: argparse.Namespace) -> None:
    """Refuse names that are not UTF-8, which netCDF and case files require."""
    encoding = sys.getfilesystemencoding()
    if encoding != "utf-8":
        raise RockfallError(f"file names are in {encoding} here: set LC_ALL=C.UTF-8")
    values = vars(arguments).values()
    names = [part for value in values for part in (value if isinstance(value, list) else [value])]
    for name in (*(name for name in names if isinstance(name, Path)), Path.cwd()):
        if os.fsencode(name).decode("utf-8", "replace") != str(name):
            raise RockfallError(f"{name}: is not a UTF-8 file name")


def _leave_out(*packages: str) -> None:
    """Hide unused packages, which saves 0.25 s: pyogrio would import GeoPandas, and xarray would
    import Dask (used only by `run`), to check data types."""
    for package in packages:
        sys.modules.setdefault(package, None)  # type: ignore[arg-type]


def _fault(error: Exception) -> int:
    if os.environ.get("ROCKFALL_TRACEBACK"):
        traceback.print_exc()
    text = f"internal error: {type(error).__name__}: {error}"
    return say(f"{text} (please report: set ROCKFALL_TRACEBACK=1 for the trace)", FAULT)


def _open_closed_streams() -> None:
    """Redirect closed standard streams (>&-) to the null device; otherwise output might be written
    to a file that is opened later with the same descriptor."""
    for name, mode in ("stdin", "r"), ("stdout", "w"), ("stderr", "w"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))


def _close_stdout() -> None:
    """Discard pending output of a closed stream, so that Python does not write it at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
