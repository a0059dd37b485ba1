# SPDX-License-Identifier: BSD-3-Clause
"""Messages of commands: warnings of results, and the list of written files."""

import warnings
from pathlib import Path

import pytest

import rockfall
from rockfall.cli import main
from rockfall.cli.messages import print_files, warnings_told
from rockfall.cli.result_warnings import warn_of_results
from slope_case import write_slope

PACKAGE = Path(rockfall.__file__).parent


@pytest.mark.parametrize(
    "module",
    [
        f"rockfall.{'.'.join(path.relative_to(PACKAGE).with_suffix('').parts)}"
        for path in [PACKAGE / "products.py", *sorted((PACKAGE / "files").glob("*.py")),
                     *sorted((PACKAGE / "result").glob("*.py"))]
        if "warnings.warn(" in path.read_text(encoding="utf-8")
    ],
)  # fmt: skip
def test_commands_print_the_warnings_of_products(module, capsys):
    with warnings_told() as told:
        warnings.warn_explicit("far", UserWarning, "file.py", 1, module=module)
        warnings.warn_explicit("of a library", UserWarning, "file.py", 1, module="numpy.core")
    assert told == ["far"]
    assert capsys.readouterr().err == "rockfall: warning: far\n"


def test_few_files_are_listed_each_and_many_by_kind(capsys):
    few = [Path("out") / name for name in ("a.nc", "b.tif")]
    print_files(few)
    assert capsys.readouterr().out.split() == [str(path) for path in few]
    maps = [Path("out") / f"{k}.tif" for k in range(20)]
    print_files([*few, *maps])
    assert capsys.readouterr().out == "out: a.nc, 21 .tif\n"


def test_results_with_equal_file_names_have_all_their_warnings(tmp_path, monkeypatch, capsys):
    """Only the first of two results with the same file name uses a shipped set, which causes a
    warning."""
    monkeypatch.chdir(tmp_path)
    write_slope()
    own = Path("case.nml").read_text()
    Path("shipped.nml").write_text(own.replace("sets.nml", "laboratory-spheres"))
    paths = Path("a/out.nc"), Path("b/out.nc")
    for case, path in zip(("shipped.nml", "case.nml"), paths, strict=True):
        path.parent.mkdir()
        assert main(["run", case, "-o", str(path), "--quiet"]) == 0
    capsys.readouterr()
    warn_of_results(*paths)
    assert "a/out.nc: " in capsys.readouterr().err.replace("\\", "/")
