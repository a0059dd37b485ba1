# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of any case for `rockfall-batch` alone: its text, and a scene file (docs/files.md)."""

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
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import input_warnings
from rockfall.scene.scene import Scene
from rockfall.version import __version__

LAYOUT = int(_core.constant("scene_layout"))  # layout version of the file
MARK = "! Prepared by rockfall"  # first words of a prepared case.nml
ABOUT = {  # dimensions, units, long name
    "elevation": ("y x", "m", "elevation of cell centres"),
    "zone": ("y x", "1", "material of the cell, counted from 1; 0: none"),
    "cell_size": ("size y x", "m",
        "mean rock radius, or Rg70, Rg20, Rg10, of the cell; infinite: it absorbs"),
    "material_size": ("material size", "m",
        "mean rock radius, or Rg70, Rg20, Rg10; infinite: it absorbs"),
    "source_x": ("source", "m", "easting of the release"),
    "source_y": ("source", "m", "northing of the release"),
    "area_ratio": ("source", "1", "surface over plan area of the cell of the source"),
    "source_frequency": ("source", "1/year", "how often boulders come from the source"),
    "source_feature": ("source", "1", "polygon or point of the layer, counted from 1"),
    "feature_law": ("feature", "1",
        "distribution of its volumes: fixed, normal, uniform, lognormal; 0: the case's"),
    "feature_value": ("feature feature_field", "1",
        "mean, std, min, max of volumes, density, drop height, velocity east, north, up"),
    "source_volume": ("source", "m3", "volume of the boulders of the source"),
    "source_inertia": ("source", "1", "their moment of inertia over mass and squared radius"),
    "source_shape": ("source", "1",
        "block shape of its boulders: compact, elongated, platy; 0: the case's"),
    "source_density": ("source", "kg/m3", "their density"),
    "ground_length": ("ground", "1", "bytes of the text of each ground; 0: the case's impact sets"),
    "ground_table": ("ground", "1", "table of impacts of the ground, counted from 1; 0: none"),
    "table_shape": ("table table_count", "1",
        "columns; rows; bins of the keys of flights, and of rolls; records"),
    "table_scale": ("table table_number", "1",
        "I/(m R_b^2) of the blocks; rest_angle, strength, strength_sigma, strength_radius, relief, "
        "relief_radius, hurst of the ground"),
    "table_size": ("table_column", "1",
        "R_b/R_m, or rho_b g R_b over the strength of ground that yields"),
    "table_relief": ("table_row", "degree", "slope of the relief"),
    "table_edge": ("table_edges", "1", "edges of the bins"),
    "table_first": ("table_bin_end", "1", "first record of each bin, counted from 1, and end"),
    "table_map": ("table_bin map_field", "1", "map of the bin, and range of its inputs"),
    "table_record": ("contact record_field", "1", "contacts by bin"),
    "shape_ground": ("block_shape base_ground", "1",
        "ground with the table of a block shape in place of a ground, both counted from 1"),
    "material_ground": ("material", "1", "ground of the material, counted from 1"),
    "cell_ground": ("y x", "1", "ground of the cell, counted from 1; 0: none"),
    "tree_x": ("tree", "m", "easting of the stem"),
    "tree_y": ("tree", "m", "northing of the stem"),
    "tree_dbh": ("tree", "cm", "diameter of the stem at breast height"),
    "tree_factor": ("tree", "1", "energy that the species takes over that of silver fir"),
}  # fmt: skip


def prepare(case: Case, folder: str | Path, **arrays: Any) -> list[Path]:
    """Write `scene.nc` and `case.nml` to `folder`; returns these paths.

    The scene file contains all numbers of the kernel's input, so rockfall-batch gives identical
    results. `arrays` are as in `rockfall.scene.read.read_scene`.
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
    """Input of the kernel other than the case."""
    arrays = scene.kernel.arrays()
    if "cell_size" in arrays:
        del arrays["material_size"]
        arrays.pop("zone", None)
    data: dict[str, tuple] = {
        "crs": ((), np.int32(0), georeference(scene.grid)),
        **centre_variables(scene.grid.x, scene.grid.y),
    }
    for name, (dims, units, long_name) in ABOUT.items():
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
