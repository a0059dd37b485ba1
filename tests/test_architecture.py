# SPDX-License-Identifier: BSD-3-Clause
"""Modules and the imports allowed between them: see docs/architecture.md."""

import ast
import functools
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "python/rockfall"
LAB = ROOT / "lab/rockfall_lab"
#: Each level imports only from itself and earlier levels.
LEVELS = [
    ["accessor", "errors", "interrupts", "kernel_rules", "language", "limits", "system", "version"],
    ["io"],
    ["terrain"],
    [
        "case",
        "evidence",
        "grounds",
        "quantities",
        "result",
        "table",
    ],
    ["scene"],
    ["simulation"],
    ["analysis"],
    ["files", "protection"],
    ["studies"],
    ["draft", "importers", "rockyfor3d", "session"],
    ["__init__"],
    ["plots", "tables", "text"],
    ["html_report", "office", "qgis_project"],
    ["dossiers", "products"],
    ["app"],
    ["cli", "__main__"],
    ["rockfall_lab"],
]
LEVEL = {room: level for level, rooms in enumerate(LEVELS) for room in rooms}
#: Compiled modules, and the modules that may call them.
DOORS = {
    "_core": re.compile(
        r"case\.(case|keys|text)|errors|grounds\.grounds|kernel_rules|limits|scene\..*|simulation\..*"
        r"|result\.(boulders|run_arrays|variables)"
    ),
    "rockfall_lab._lab": re.compile(r"rockfall_lab\..*"),
}
MODULES = {
    ".".join(path.relative_to(home).with_suffix("").parts).removesuffix(".__init__"): path
    for package, home in ((PACKAGE, PACKAGE), (LAB, LAB.parent))
    for path in sorted(package.rglob("*.py"))
}
FORTRAN = [
    "base",
    "terrain",
    "boulder",
    "rebound",
    "tally",
    "maps",
    "trace",
    "lanes",
    "case",
    "run",
    "io",
    "f2py",
    "c",
]
MOST_FILES = 14  # maximum number of files in a folder of the kernel


def room(module):
    return module.split(".")[0]


@functools.cache
def parse(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def import_statements(node, within=False):
    """Yield each import below a node, and whether it is within a function."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.Import, ast.ImportFrom)):
            yield child, within
        elif not isinstance(child, ast.expr):  # expressions contain no statements
            yield from import_statements(child, within or isinstance(child, ast.FunctionDef))


def imports(path):
    """Yield the imports of rockfall modules in a file: line, module, name or "", and whether it is
    within a function."""
    for node, within in import_statements(parse(path)):
        if isinstance(node, ast.Import):
            found = [(alias.name, "") for alias in node.names]
        else:
            assert node.level == 0, f"{path}: relative import"
            found = [(node.module or "", alias.name) for alias in node.names]
        for module, name in found:
            if room(module) not in ("rockfall", "rockfall_lab"):
                continue
            module = re.sub(r"^rockfall\b\.?", "", module)
            if name and (module + "." + name).lstrip(".") in [*MODULES, *DOORS]:
                module, name = (module + "." + name).lstrip("."), ""
            yield node.lineno, module or "__init__", name, within


@functools.cache
def all_imports():
    """Rows of `imports` for all modules of the package, with the name of the importing module
    first. Slow, so not called while tests are collected."""
    return [(module, *found) for module, path in MODULES.items() for found in imports(path)]


def report(broken):
    broken = list(dict.fromkeys(broken))
    assert not broken, f"{len(broken)} broken:\n" + "\n".join(broken)


def test_every_room_has_a_level():
    assert {room(module) for module in MODULES} <= {*LEVEL}


def test_no_import_upwards():
    report(
        f"{module}:{line} imports {other}"
        for module, line, other, *_ in all_imports()
        if other not in DOORS and LEVEL[room(other)] > LEVEL[room(module)]
    )


def test_no_circles():
    graph = {module: set() for module in MODULES}
    for module, _, other, *_ in all_imports():
        if other in graph and other != module:
            graph[module].add(other)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as circle:
        report([" <- ".join(circle.args[1])])


def test_own_modules_are_imported_at_the_top():
    report(
        f"{module}:{line} imports {other} within a function"
        for module, line, other, _, within in all_imports()
        if within
    )


def test_what_begins_with_an_underscore_stays_at_home():
    named = [
        f"{module}:{line} imports {other}.{name}"
        for module, line, other, name, *_ in all_imports()
        if re.match("_[^_]", name)
    ]
    for module, path in MODULES.items():
        own = {other.split(".")[-1] for _, other, name, _ in imports(path) if not name}
        for node in ast.walk(parse(path)):
            if isinstance(node, ast.Attribute) and re.match("_[^_]", node.attr):
                if isinstance(node.value, ast.Name) and node.value.id in own:
                    named.append(f"{module}:{node.lineno} takes {node.value.id}.{node.attr}")
    report(named)


def test_the_kernel_is_called_by_few():
    report(
        f"{module}:{line} imports {other}"
        for module, line, other, *_ in all_imports()
        if other in DOORS and not DOORS[other].fullmatch(module)
    )


def test_studies_have_one_engine():
    """All studies have their progress bar in one module. Single runs have it in chunks, in parts on
    a cluster, and in runs until a precision."""
    drawing = {module for module, _, _, name, _ in all_imports() if name == "progress_bar"}
    assert {module for module in drawing if room(module) != "rockfall_lab"} == {
        "simulation.simulate", "simulation.dask", "studies.run_until", "studies.study"
    }  # fmt: skip


def test_the_laboratory_is_named_in_one_place():
    named = [path for path in PACKAGE.rglob("*.py") if "rockfall_lab" in path.read_text()]
    assert named == [PACKAGE / "cli/arguments.py"]


def test_the_plugin_for_qgis_imports_nothing_of_the_package():
    report(
        f"{path.relative_to(ROOT)}:{line} imports {module}"
        for path in sorted((ROOT / "python/rockfall_qgis").glob("*.py"))
        for line, module, *_ in imports(path)
    )


def test_no_test_imports_another():
    report(
        f"{path.relative_to(ROOT)} imports {found}"
        for folder in ("tests", "lab/tests")
        for path in sorted((ROOT / folder).rglob("*.py"))
        for found in re.findall(r"^ *(?:from|import) (test_\w+)", path.read_text(), re.MULTILINE)
    )


def statements(path):
    """Yield number and text of each line of a Fortran file, in lower case and without strings and
    comments."""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        yield number, re.sub(r"'[^']*'|\"[^\"]*\"|!.*", "", line).lower()


def fortran_files():
    for level, folder in enumerate(FORTRAN):
        for path in sorted((ROOT / "fortran/src" / folder).glob("*.f90")):
            yield level, path


@functools.cache
def fortran_modules():
    """Level of each module of the kernel, by its name."""
    return {
        found[1]: level
        for level, path in fortran_files()
        for _, line in statements(path)
        if (found := re.match(r"\s*(?:sub)?module (?!procedure)(\w+)", line))
    }


def test_every_folder_of_the_kernel_has_a_level_and_few_files():
    folders = {path.parent for path in (ROOT / "fortran/src").rglob("*") if path.is_file()}
    assert {folder.name for folder in folders} == {*FORTRAN}
    report(
        f"{folder.relative_to(ROOT)} has {n} files"
        for folder in sorted(folders)
        if (n := sum(path.suffix in (".f90", ".c") for path in folder.iterdir())) > MOST_FILES
    )


def test_fortran_uses_only_what_lies_below():
    home = fortran_modules()
    report(
        f"{path.relative_to(ROOT)}:{number} uses {found[1]} of {FORTRAN[home[found[1]]]}"
        for level, path in fortran_files()
        for number, line in statements(path)
        if (found := re.match(r"\s*use\s+(\w+)", line)) and home.get(found[1], 0) > level
    )


def test_the_laboratory_uses_of_the_kernel_what_its_tests_watch():
    """The laboratory uses only folders of the kernel whose changes make .ci/run test it."""
    watched = "base", "boulder", "rebound", "case"
    report(
        f"{path.relative_to(ROOT)}:{number} uses {found[1]}"
        for path in sorted((ROOT / "lab/fortran").rglob("*.f90"))
        for number, line in statements(path)
        if (found := re.match(r"\s*use\s+(\w+)", line))
        and FORTRAN[fortran_modules().get(found[1], 0)] not in watched
    )


def test_physics_sees_no_file_and_never_stops():
    statement = r"(?:^|[);])\s*(?:print\b|(?:error )?stop *\d*$)"
    reaches = re.compile(statement + r"|\bopen *\(|\b(?:write|read) *\( *\*|\bnf90_\w+")
    report(
        f"{path.relative_to(ROOT)}:{number} {found[0].strip()}"
        for level, path in fortran_files()
        for number, line in statements(path)
        if level < FORTRAN.index("io") and (found := reaches.search(line))
    )


def test_no_code_in_init():
    """Init files have at most a docstring and imports; that of `rockfall` itself may import
    lazily."""
    allowed = ast.Import, ast.ImportFrom
    report(
        f"{path.relative_to(ROOT)}:{node.lineno} holds code"
        for path in sorted(PACKAGE.rglob("__init__.py"))
        for node in parse(path).body
        if path.parent != PACKAGE
        and not isinstance(node, allowed)
        and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
    )
