# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of any case for `rockfall-batch` alone: its text, and a scene file (docs/files.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case
from rockfall.case_files import input_files
from rockfall.errors import RockfallError
from rockfall.io.output_files import SCENE, atomic_folder, check_folder, check_outputs, kind_of
from rockfall.result.contents import Contents
from rockfall.result.dataset import (
    CONVENTIONS,
    centre_variables,
    feature_names,
    georeference,
    provenance,
    put_netcdf,
)
from rockfall.scene.kernel_scene import trees
from rockfall.scene.plausible import input_warnings
from rockfall.scene.reach import survey
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.version import __version__

LAYOUT = int(_core.constant("scene_layout"))  # layout version of the file
MARK = "! Prepared by rockfall"  # first words of a prepared case.nml
ABOUT = {  # units, long name
    "elevation": ("m", "elevation of cell centres"),
    "zone": ("1", "material of the cell, counted from 1; 0: none"),
    "cell_size": ("m", "mean rock radius, or Rg70, Rg20, Rg10, of the cell; infinite: it absorbs"),
    "material_size": ("m", "mean rock radius, or Rg70, Rg20, Rg10; infinite: it absorbs"),
    "source_x": ("m", "easting of the release"),
    "source_y": ("m", "northing of the release"),
    "area_ratio": ("1", "surface over plan area of the cell of the source"),
    "source_frequency": ("1/year", "how often boulders come from the source"),
    "source_feature": ("1", "polygon or point of the layer, counted from 1"),
    "feature_law": ("1", "law of its volumes: fixed, normal, uniform, lognormal; 0: the case's"),
    "feature_value": (
        "1",
        "mean, std, min, max of volumes, density, drop height, velocity east, north, up",
    ),
    "source_volume": ("m3", "volume of the boulders of the source"),
    "source_inertia": ("1", "their moment of inertia over mass and squared radius"),
    "source_density": ("kg/m3", "their density"),
    "ground_length": ("1", "bytes of the text of each ground; 0: the case's impact sets"),
    "material_ground": ("1", "ground of the material, counted from 1"),
    "cell_ground": ("1", "ground of the cell, counted from 1; 0: none"),
    "tree_x": ("m", "easting of the stem"),
    "tree_y": ("m", "northing of the stem"),
    "tree_dbh": ("cm", "diameter of the stem at breast height"),
    "tree_factor": ("1", "energy that the species takes over that of silver fir"),
}


def prepare(case: Case, folder: str | Path, **arrays: Any) -> list[Path]:
    """Write `scene.nc` and `case.nml` to `folder`; returns these paths.

    The scene file holds all numbers of the kernel's input, so rockfall-batch gives identical
    results. `arrays` are as in `rockfall.scene.read.read_scene`. A folder that holds anything other
    than a prepared case is refused.
    """
    folder, inputs = Path(folder), list(input_files(case))
    former = _prepared_files(folder)
    check_outputs(dict.fromkeys(former), inputs, former)
    scene = read_scene(case, **arrays)
    survey(scene)
    input_warnings(scene)
    with atomic_folder(folder, inputs, former, last="case.nml") as part:
        put_netcdf(_scene_file(scene), part / "scene.nc", folder / "scene.nc")
        head = f"{MARK} from {case.name}, for rockfall-batch and the scene file beside it."
        text = f"{' '.join(head.splitlines())}\n{scene.case.text()}"
        (part / "case.nml").write_text(text, encoding="utf-8")
    return [folder / "scene.nc", folder / "case.nml"]


def _scene_file(scene: Scene) -> Contents:
    """Inputs of the kernel in addition to the case."""
    text = np.frombuffer(scene.sets.text, "S1")
    about = {"long_name": "file of impact sets", "file": scene.sets.name}
    data: dict[str, tuple] = {
        "crs": ((), np.int32(0), georeference(scene.grid)),
        **centre_variables(scene.grid.x, scene.grid.y),
        **_variables("y x", elevation=scene.z),
        **_surface(scene),
        **_grounds(scene),
        **_variables("source", source_x=scene.x, source_y=scene.y),
        **_releases(scene),
        **_variables("source", **_of_sources(scene)),
        **(_variables("tree", **trees(scene)) if scene.trees else {}),
        "impact_sets": (("impact_sets_length",), text, about),
    }
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


def _releases(scene: Scene) -> dict[str, tuple]:
    """Numbers of boulders released by sources, and release attributes of the features of a
    layer."""
    found = _variables("source", area_ratio=scene.area, source_frequency=scene.frequency)
    if scene.features is not None:
        found |= _variables("source", source_feature=scene.features.of)
        found |= _variables("feature", feature_law=scene.features.law)
        found |= _variables("feature feature_field", feature_value=scene.features.value)
    return found


def _of_sources(scene: Scene) -> dict[str, np.ndarray | None]:
    """Boulder properties given by sources."""
    found = scene.source_boulders
    return {} if found is None else {f"source_{name}": one for name, one in found._asdict().items()}


def _surface(scene: Scene) -> dict[str, tuple]:
    """Rock sizes of the ground: of each cell, or of materials, with or without zones."""
    if scene.values is not None:
        return _variables("size y x", cell_size=scene.values)
    sizes = _variables("material size", material_size=scene.sizes)
    return sizes | _variables("y x", zone=scene.zone)


def _grounds(scene: Scene) -> dict[str, tuple]:
    """Grounds of the scene, where they differ from the case's impact sets."""
    if not scene.grounds:
        return {}
    text = np.frombuffer(b"".join(one.text for one in scene.grounds), "S1")
    names = "\n".join(f"{one.name}\n{one.file}" for one in scene.grounds)
    about = {"long_name": "grounds, one after the other", "names": names}
    lengths = np.array([len(one.text) for one in scene.grounds], "i4")
    return {
        "ground_text": (("ground_text_length",), text, about),
        **_variables("ground", ground_length=lengths),
        **_variables("material", material_ground=scene.material_ground),
        **_variables("y x", cell_ground=scene.cell_ground),
    }


def _variables(dims: str, **values: np.ndarray | None) -> dict[str, tuple]:
    """Variables of those that a scene has, with their attributes."""
    found, mapping = {}, {"grid_mapping": "crs"} if dims.endswith("y x") else {}
    for name, one in values.items():
        if one is not None:
            units, long_name = ABOUT[name]
            about = {"units": units, "long_name": long_name}
            found[name] = (tuple(dims.split()), one, about | mapping)
    return found


def _prepared_files(folder: Path) -> list[Path]:
    """Files of the prepared case in a folder; a folder with other files is refused."""
    check_folder(folder)
    if not folder.exists() or not any(folder.iterdir()):
        return []
    case, scene = folder / "case.nml", folder / "scene.nc"
    if not (case.is_file() and case.read_bytes().startswith(MARK.encode())) or (
        kind_of(scene) != SCENE
    ):
        raise RockfallError(f"{folder}: is not empty and holds no prepared case; take another")
    return [scene, case]
