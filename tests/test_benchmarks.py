# SPDX-License-Identifier: BSD-3-Clause
"""Names that rarely used scripts import from the package exist."""

import ast
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPTS = sorted(
    path.relative_to(ROOT)
    for folder in ("benchmarks", "lab/benchmarks", "tools")
    for path in ROOT.glob(f"{folder}/**/*.py")
)


@pytest.mark.parametrize("script", SCRIPTS, ids=str)
def test_what_a_script_imports_of_the_package_is_there(script):
    """Scripts are read and not imported, because they may need missing packages or run at
    import."""
    for node in ast.walk(ast.parse((ROOT / script).read_text(encoding="utf-8"))):
        package = (node.module or "").split(".")[0] if isinstance(node, ast.ImportFrom) else ""
        if package in ("rockfall", "rockfall_lab"):
            pytest.importorskip(package)
            module = importlib.import_module(node.module)
            for name in node.names:
                if not hasattr(module, name.name):
                    importlib.import_module(f"{node.module}.{name.name}")


def test_tables_of_sites_are_made_once(tmp_path, monkeypatch, capsys):
    """A table that exists is not made again by the same command; a failure leaves no file."""
    sites = importlib.import_module("benchmarks.physics.sites")
    runaway = importlib.import_module("benchmarks.physics.runaway")
    calls = []

    def made(words):
        calls.append(words)
        print("| law | one |")
        return 2 if len(calls) == 1 else None

    monkeypatch.setattr(runaway, "main", made)

    def remake(*words):
        command = ["sites", "-o", str(tmp_path / "out"), "--only", "runaway", *words]
        monkeypatch.setattr("sys.argv", command)
        sites.main()

    with pytest.raises(SystemExit):
        remake("--law", "meadow")
    assert not [*(tmp_path / "out").iterdir()]
    remake("--law", "meadow")
    remake("--law", "meadow")
    words = ("--law", "meadow")
    assert calls == [words] * 2
    head = "    python -m benchmarks.physics.runaway --law meadow\n\n"
    assert (tmp_path / "out/runaway.md").read_text() == f"{head}| law | one |\n"
    remake("--law", "meadow", "--ground", "soil_4", "--boulders", "3")
    assert calls[2:] == [(*words, "--ground", "soil_4", "--boulders", "3")]
    assert capsys.readouterr().out.count("done before") == 1


def test_tables_of_sites_are_by_every_law_and_of_every_site():
    argparse = importlib.import_module("argparse")
    sites = importlib.import_module("benchmarks.physics.sites")
    nothing = argparse.Namespace(laws=None, slopes=None, boulders=None, data=None)
    alone = {piece.name for piece in sites.pieces(nothing)}
    nothing.data = Path("field")
    by_name = {piece.name: piece for piece in sites.pieces(nothing)}
    assert alone < by_name.keys()
    assert {"shadow", "runaway", "tschamut-held-out", "vaujany-observed"} <= by_name.keys()
    laws = by_name["runaway"].words
    for name in "talus", "meadow", "rocky-slope", "soil_4", "pfeiffer_talus", "bourrier_hungr":
        assert name in laws
    assert "laboratory-spheres" in by_name["vaujany-observed"].words
    for piece in by_name.values():
        importlib.import_module(f"benchmarks.physics.{piece.script}")
