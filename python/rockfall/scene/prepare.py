# SPDX-License-Identifier: BSD-3-Clause
"""Preparation of a case for `rockfall-batch` alone: case text and scene file (docs/files.md)."""

from pathlib import Path
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.case.files import input_files
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_folder, check_outputs
from rockfall.result.contents import Contents
from rockfall.result.dataset import (
    CONVENTIONS,
    centre_variables,
    feature_names,
    georeference,
    provenance,
    put_netcdf,
)
from rockfall.scene.kernel_scene import ARRAYS
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import input_warnings
from rockfall.scene.scene import Scene
from rockfall.version import __version__

LAYOUT = int(_core.constant("scene_layout"))  # layout version of the scene file
MARK = "! Prepared by rockfall"  # start of a prepared case.nml


def prepare(case: Case, folder: str | Path, **arrays: Any) -> list[Path]:
    """Write `scene.nc` and `case.nml` to `folder`; return their paths.

    The scene file contains the full kernel input, so rockfall-batch gives identical results.
    `arrays` are as in `rockfall.scene.read.read_scene`.
    """
    folder, inputs = Path(folder), list(input_files(case))
    files = [folder / "scene.nc", folder / "case.nml"]
    check_folder(folder)
    check_outputs(files, inputs)
    scene = read_scene(case, **arrays)
    scene.survey()
    input_warnings(scene)
    with atomic_folder(folder, inputs, last="case.nml") as part:
        put_netcdf(_scene_file(scene), part / "scene.nc", folder / "scene.nc")
        head = f"{MARK} from {case.name}, for rockfall-batch and the scene file next to it."
        text = f"{' '.join(head.splitlines())}\n{scene.case.text()}"
        (part / "case.nml").write_text(text, encoding="utf-8")
    return files


def _scene_file(scene: Scene) -> Contents:
    """Kernel input apart from the case, as a dataset."""
    arrays = scene.kernel.arrays()
    if "cell_size" in arrays:
        del arrays["material_size"]
        arrays.pop("zone", None)
    data: dict[str, tuple] = {
        "crs": ((), np.int32(0), georeference(scene.grid)),
        **centre_variables(scene.grid.x, scene.grid.y),
    }
    for name, (_, dims, units, long_name) in ARRAYS.items():
        if name in arrays:
            texts = {"units": units, "long_name": long_name}
            texts |= {"grid_mapping": "crs"} if dims.endswith("y x") else {}
            data[name] = (tuple(dims.split()), arrays[name], texts)
    texts = {"long_name": "file of impact sets", "file": scene.sets.name}
    data["impact_sets"] = (("impact_sets_length",), arrays["impact_sets"].view("S1"), texts)
    if scene.grounds:
        names = arrays["ground_names"].tobytes().decode()
        texts = {"long_name": "grounds, one after the other", "names": names}
        data["ground_text"] = (("ground_text_length",), arrays["ground_text"].view("S1"), texts)
    attrs = {
        "Conventions": CONVENTIONS,
        "scene_layout": LAYOUT,
        "title": scene.case.case["title"],
        "source": f"rockfall {__version__}",
        "version": __version__,
        "case": scene.case.text(),
        "case_file": scene.case.name,
        **provenance(scene),
        **feature_names(scene),
    }
    return Contents(data, attrs, ("x", "y"))
