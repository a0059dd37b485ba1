# SPDX-License-Identifier: BSD-3-Clause
"""Tests under Wine: Fortran tests, and cases that must be bit-identical to this system; or Python
tests.

usage: wine_test.py             after `./run wheel-windows`; packages for Windows come from PyPI
       wine_test.py ARGS        pytest alone
       wine_test.py --python [FILE...]   these files of Python tests, or those not yet run; hours

`--python` stores the outcome of each file in build-windows/python-tests.json, and the output next
to it. After a stop it continues with the next file, or starts again if the table was removed.
"""

import json
import os
import pty
import re
import shutil
import subprocess
import sys
import threading
import time
import zipfile
from contextlib import suppress
from multiprocessing.pool import ThreadPool
from pathlib import Path
from queue import SimpleQueue

import rockfall

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "build-windows"
PYTHON = BUILD / "python/org/bytedeco/cpython/windows-x86_64"
WINE, WINESERVER = "/usr/lib/wine/wine64", "/usr/lib/wine/wineserver64"
#: netCDF4 1.6.5 warns about NumPy's size: import it before tests for which this is an error.
PYTEST = [WINE, PYTHON / "python.exe", "-m", "pytest", "--all", "-p", "no:cacheprovider"]
PYTEST += ["-p", "netCDF4"]
#: Newest versions that Wine 8 can load, with dependencies; then packages for tests.
PACKAGES = """
numpy==1.26.4 scipy==1.12.0 netCDF4==1.6.5 cftime==1.6.3 pandas==2.1.4 xarray==2024.11.0
nanoarrow==0.7.0 pyogrio==0.11.0 shapely==2.0.2 pyproj==3.6.1 rasterio==1.4.0 rich colorama tzdata
pytest hypothesis psutil matplotlib pillow jinja2 threadpoolctl openpyxl python-docx ezdxf laspy
pooch lazrs==0.6.0 starlette uvicorn websockets babel
""".split()
#: Test files that cannot run there, with reasons.
LEFT_OUT = {
    "app/test_page.py": "needs Chromium",
    "cluster/test_slurm.py": "needs Slurm",
    "docs": "runs shell scripts of pages",
    "fuzz/test_foreign.py": "GDAL's HDF5 needs feholdexcept, which Wine's ucrtbase lacks",
    "fuzz/test_hostile.py": "needs limits of a process",
    "protection/test_siting.py": "SciPy needs cexp, which Wine's ucrtbase lacks",
    "qgis/test_qgis.py": "needs QGIS",
    "simulation/test_dask.py": "needs Dask, whose workers are forked",
    "simulation/test_slurm.py": "needs a shell",
    "test_architecture.py": "looks at sources",
    "test_packages.py": "looks at sources",
    "test_release.py": "looks at sources",
    "test_theory.py": "looks at sources",
}
#: Tests that only fail under Wine, with reasons.
DESELECTED = dict.fromkeys(
    [
        "cli/test_hazard_command.py::test_gdal_opens_every_map_where_the_terrain_lies",
        "io/test_rasters.py::test_netcdf_is_north_up_whichever_way_y_runs",
        "io/test_rasters.py::test_a_variable_of_a_netcdf_file_can_be_named",
        "io/test_rasters.py::test_what_netcdf_says_of_its_numbers_is_honoured",
        "io/test_rasters.py::test_packed_floats_are_unpacked_in_double_precision",
        "io/test_rasters.py::test_netcdf_in_any_unit_but_the_metre_is_refused",
        "io/test_rasters.py::test_what_netcdf_says_against_itself_is_refused",
        "io/test_rasters.py::test_a_part_of_a_file_lies_where_its_coordinates_are",
        "io/test_rasters.py::test_netcdf_with_unmarked_coordinates_and_the_cure",
        "scene/test_windows.py::test_windows_of_other_files[netcdf from the south]",
    ],
    "GDAL's netCDF driver ends the process",
)
#: Maximum time of a file there [s].
LIMIT = 2400
#: Number of boulders of the run stopped by Ctrl-C: enough that it never ends earlier.
TYPED = 3_000_000


def main(words: list[str]) -> str | None:
    env = os.environ | {"WINEDEBUG": "-all", "WINEPREFIX": str(BUILD / "prefix")}
    env["PYTHONUTF8"] = "1"  # files written by tests have no code page
    env.pop("PYTHONPATH", None)  # path of this system's Python
    env.pop("PYTHONDONTWRITEBYTECODE", None)  # otherwise each file would compile all packages again
    env["WINEPATH"] = str(ROOT / "dist")  # tests need rockfall-batch.exe
    install()
    start_wine(env)  # not in parallel: tests run two at a time
    if words[:1] == ["--python"]:
        return run_files(words[1:], env)
    if words:
        return "tests fail" if run_piped([*PYTEST, *words], ROOT, env) else None
    tests = ["meson", "test", "-C", BUILD / "kernel", "--print-errorlogs"]
    if subprocess.run(tests, env=env).returncode:
        return "the Fortran tests fail"
    return compare_cases(env) or press_ctrl_c(env)


def start_wine(env: dict[str, str]) -> None:
    """Create or update the Wine prefix."""
    subprocess.run([WINE, "wineboot", "--init"], env=env, check=True)


def compare_cases(env: dict[str, str]) -> str | None:
    """Run cases on both systems; return the fault, if any."""
    script = Path(__file__).with_name("system_cases.py")
    program = [WINE, BUILD / "kernel/fortran/rockfall-batch.exe"]
    inputs, here, there, ready, batch_here, batch_there = (
        BUILD / "cases" / name
        for name in ("Übung in", "here", "over there", "ready", "batch here", "batch there")
    )
    shutil.rmtree(BUILD / "cases", ignore_errors=True)
    for python, *words in (
        ([sys.executable], "make", inputs),
        ([sys.executable], "run", inputs, here),
        ([WINE, PYTHON / "python.exe"], "run", inputs, there),
        ([sys.executable], "compare", here, there),
        ([sys.executable], "prepare", inputs, ready),
        ([sys.executable], "batch", ready, batch_here, shutil.which("rockfall-batch")),
        ([sys.executable], "batch", ready, batch_there, *program),
        ([sys.executable], "compare", batch_here, batch_there),
    ):
        if run_piped([*python, script, *words], BUILD, env):
            return f"{words[0]} of the cases fails"
    return None


def press_ctrl_c(env: dict[str, str]) -> str | None:
    """Type Ctrl-C in the console of a run that has written a checkpoint; return the fault, if
    any."""
    folder = BUILD / "cases/Übung in/vaujany"
    result, state = folder / "typed.nc", folder / "typed.nc.checkpoint"
    for path in (result, state):
        path.unlink(missing_ok=True)
    words = ["run", "many.nml", "--boulders", str(TYPED), "--checkpoint", "0.1"]
    here, there = pty.openpty()  # Wine turns this into a console

    def take_terminal() -> None:
        os.login_tty(there)  # only the controlling terminal of a process can send Ctrl-C

    command = [WINE, PYTHON / "python.exe", "-m", "rockfall", *words, "-o", result.name]
    with subprocess.Popen(command, cwd=folder, env=env, preexec_fn=take_terminal) as process:
        os.close(there)

        def press() -> None:
            while process.poll() is None and not state.exists():
                time.sleep(0.05)
            os.write(here, b"\x03")

        threading.Thread(target=press).start()
        with suppress(OSError):  # raised when the console is closed
            while os.read(here, 4096):
                pass
    kept = rockfall.read_result(result).sizes["boulder"] if result.exists() else 0
    print(f"Ctrl-C: status {process.returncode}, {kept} of {TYPED} boulders kept")
    well = process.returncode == 130 and 0 < kept < TYPED and state.exists()
    return None if well else "Ctrl-C does not keep what was done"


def run_files(words: list[str], env: dict[str, str]) -> str | None:
    """Run files of Python tests, each in a separate process, because Wine ends some; print a table
    and return the fault, if any. Each core has its own Wine prefix, whose processes are all ended
    if a file takes too long."""
    table = BUILD / "python-tests.json"
    done = json.loads(table.read_text("utf-8")) if table.exists() else {}
    idle: SimpleQueue[dict[str, str]] = SimpleQueue()
    for number in range(os.cpu_count() or 1):
        idle.put(env | {"WINEPREFIX": f"{env['WINEPREFIX']}{number or ''}"})
        if number:
            start_wine(env | {"WINEPREFIX": f"{env['WINEPREFIX']}{number}"})

    def run_idle(name: str) -> tuple[str, dict[str, int | str]]:
        place = idle.get()
        try:
            return name, run_file(name, place)
        finally:
            idle.put(place)

    names = words or [name for name in test_files() if name not in done]
    with ThreadPool(idle.qsize()) as pool:  # its threads end with the main thread
        for name, result in pool.imap_unordered(run_idle, names):
            done[name] = result
            table.write_text(json.dumps(done, indent=1), "utf-8")
            print(one_row(name, done[name]), flush=True)
    print("", *(one_row(name, done[name]) for name in sorted(done)), sep="\n")
    for name, reason in {**LEFT_OUT, **DESELECTED}.items():
        print(f"{name:44} left out: {reason}")
    total = {key: sum(one[key] for one in done.values()) for key in COUNTED}
    print(", ".join(f"{number} {key}" for key, number in total.items()))
    wrong = [name for name, one in done.items() if one["ended"]]
    return f"tests fail in {', '.join(wrong)}" if wrong else None


#: Outcomes of a test, as reported by pytest.
COUNTED = "passed", "failed", "error", "skipped"


def test_files() -> list[str]:
    """Test files that can run under Wine, relative to `tests`."""
    tests = ROOT / "tests"
    names = [path.relative_to(tests).as_posix() for path in tests.rglob("test_*.py")]
    return sorted(name for name in names if not {name, name.split("/")[0]} & {*LEFT_OUT})


def run_file(name: str, env: dict[str, str]) -> dict[str, int | str]:
    """Run a test file; return its outcome: counts, seconds, and the kind of failure."""
    begun = time.monotonic()
    # `-v` shows the test that was running when Wine ended the process
    command = [*PYTEST, "-v", "--tb=short", "--color=no", f"tests/{name}"]
    command += [f"--deselect=tests/{one}" for one in DESELECTED if one.startswith(name)]
    lines: list[str] = []
    status = run_piped(command, ROOT, env, lines, LIMIT)
    seconds = round(time.monotonic() - begun)
    said = BUILD / "python-tests" / name.replace("/", "-").replace(".py", ".txt")
    said.parent.mkdir(exist_ok=True)
    said.write_text("\n".join(lines), "utf-8")
    # count the lines of tests: if a file is stopped, the final line with counts is missing
    counts = {
        key: sum(bool(re.search(rf" {key.upper()}\b.*\[ *\d+%\]$", line)) for line in lines)
        for key in COUNTED
    }
    ends = {0: "", 1: "tests fail", 5: ""}  # 5: no test was found
    ended = "timed out" if seconds >= LIMIT else ends.get(status, f"ended by {status}")
    return {**counts, "seconds": seconds, "ended": ended}


def one_row(name: str, one: dict[str, int | str]) -> str:
    counts = ", ".join(f"{one[key]} {key}" for key in COUNTED if one[key])
    return f"{name:44} {one['seconds']:5} s  {counts}  {one['ended']}"


def run_piped(
    command: list[object],
    folder: Path,
    env: dict[str, str],
    lines: list[str] | None = None,
    limit: float | None = None,
) -> int:
    """Run a command, and show or store its output through a pipe, because Python for Windows does
    not start under Wine if its output is a file. After `limit` seconds all processes of the Wine
    prefix are ended."""
    pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "stdin": subprocess.PIPE}
    timer = threading.Timer(limit or 0, subprocess.run, [[WINESERVER, "-k"]], {"env": env})
    with subprocess.Popen([*map(str, command)], cwd=folder, env=env, **pipe) as process:
        if limit:
            timer.start()
        process.stdin.close()
        for raw in process.stdout:
            line = raw.decode("utf-8", "replace").rstrip()
            if lines is None:
                print(line, flush=True)
            else:
                lines.append(line)
    timer.cancel()
    return process.returncode


def install() -> None:
    """Unpack packages for Windows, and the wheel, next to its Python, unless they exist."""
    place, wheels = PYTHON / "lib/site-packages", BUILD / "wheels"
    if not wheels.exists():
        where = "--platform", "win_amd64", "--python-version", "3.11", "--only-binary=:all:"
        download = [sys.executable, "-m", "pip", "download", "-q", "-d", wheels]
        subprocess.run([*download, *where, *PACKAGES], check=True)
    for path in [*wheels.glob("*.whl"), *(ROOT / "dist").glob("rockfall-*-win_amd64.whl")]:
        stamp = place / f"{path.stem}.installed"
        if stamp.exists() and stamp.stat().st_mtime > path.stat().st_mtime:
            continue
        if path.name.startswith("rockfall-"):  # remove files of an earlier version
            shutil.rmtree(place / "rockfall", ignore_errors=True)
        with zipfile.ZipFile(path) as archive:
            archive.extractall(place)
        stamp.touch()
    if not (PYTHON / "python3.dll").exists():
        add_stable_interface()


def add_stable_interface() -> None:
    """Make the python3.dll that this Python lacks: it forwards calls to python311.dll."""
    dump = ["x86_64-w64-mingw32-objdump", "-p", PYTHON / "python311.dll"]
    text = subprocess.check_output(dump, text=True).partition("[Ordinal/Name Pointer] Table")[2]
    names = re.findall(r"^\s*\[ *\d+\] (?:\+base\[ *\d+\] +\w+ )?(\w+)$", text, re.MULTILINE)
    definition = BUILD / "python3.def"
    definition.write_text("EXPORTS\n" + "".join(f"{one} = python311.{one}\n" for one in names))
    command = ["x86_64-w64-mingw32-gcc", "-shared", "-nostdlib", "-o", PYTHON / "python3.dll"]
    subprocess.run([*command, definition], check=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
