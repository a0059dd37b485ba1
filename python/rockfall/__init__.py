# SPDX-License-Identifier: BSD-3-Clause
"""Simulation of rockfall: paths, speeds, heights and frequencies of boulders."""

from importlib import import_module

_MODULES = {  # public name -> its module, and its name there if different
    "Case": "case.case",
    "Batch": "session.batch",
    "Interrupted": "simulation.simulate",
    "RockfallError": "errors",
    "Session": "session.session",
    "__version__": "version",
    "at_lines": "result.crossings",
    "back_analysis": "studies.back.study",
    "barrier_statistics": "protection.barriers",
    "compare": "analysis.observed.compare",
    "compare_variants": "studies.variants",
    "convergence": "studies.convergence:converge",
    "crossings": "result.crossings",
    "design": "protection.design",
    "design_block": "analysis.design_block",
    "dossier": "dossiers",
    "ensemble": "studies.ensemble.study:run_ensemble",
    "ensemble_table": "studies.ensemble.study",
    "exceedance": "analysis.hazard.levels",
    "export": "files.export",
    "export_project": "products",
    "export_tables": "products",
    "figures": "products",
    "ground_strength": "result.boulders",
    "hazard": "studies.hazard",
    "import_avaframe": "importers.avaframe",
    "import_platrock": "importers.platrock",
    "import_rockyfor3d": "rockyfor3d.imported",
    "layers": "files.geodataframes",
    "line_profile": "analysis.lines.profile",
    "line_statistics": "analysis.line_statistics",
    "measure_ground": "grounds.measured_ground",
    "merge": "studies.runs",
    "new_case": "draft.new_case",
    "open": "session.session:open_session",
    "origins": "studies.hazard",
    "read_case": "case.case",
    "read_result": "result.dataset",
    "report": "products",
    "report_variants": "products",
    "return_levels": "analysis.return_levels",
    "return_period": "analysis.hazard.levels",
    "run": "studies.runs",
    "run_ensemble": "studies.ensemble.study",
    "run_until": "studies.run_until",
    "run_variants": "studies.variants",
    "section": "products",
    "show": "app.show",
    "site": "studies.siting",
    "trajectories": "result.trajectories",
    "variants": "case.variants",
    "yearly_variants": "studies.yearly_variants",
    "yearly_design": "protection.yearly",
    "write_hazard": "files.hazard_files",
    "write_result": "result.dataset",
}
__all__ = list(_MODULES)


def __getattr__(name: str) -> object:
    """Import a public name on first use, so that `rockfall --help` needs no NumPy (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module 'rockfall' has no attribute {name!r}")
    module, _, own = _MODULES[name].partition(":")
    globals()[name] = attribute = getattr(import_module(f"rockfall.{module}"), own or name)
    return attribute


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
