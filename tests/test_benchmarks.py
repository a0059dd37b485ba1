# SPDX-License-Identifier: BSD-3-Clause
"""Scripts that nobody runs for weeks still find what they import."""

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
    """Without running it: it may need what is not installed, or do its work when imported."""
    for node in ast.walk(ast.parse((ROOT / script).read_text(encoding="utf-8"))):
        package = (node.module or "").split(".")[0] if isinstance(node, ast.ImportFrom) else ""
        if package in ("rockfall", "rockfall_lab"):
            pytest.importorskip(package)
            module = importlib.import_module(node.module)
            for name in node.names:
                if not hasattr(module, name.name):
                    importlib.import_module(f"{node.module}.{name.name}")
