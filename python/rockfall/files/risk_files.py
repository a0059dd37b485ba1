# SPDX-License-Identifier: BSD-3-Clause
"""Risk of a hazard: columns of objects, table of sums, styled layers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.hazard.variables import CLASS_ENDS
from rockfall.analysis.objects.exposure import QUANTITIES
from rockfall.analysis.objects.risk import CLASSES, SUMMED
from rockfall.files.vector_style import Style, fill, marker, plain_type, thick
from rockfall.result.variables import ENDS

#: Class colours of individual risk, from none to highest.
COLOURS = ("#bdbdbd", "#4daf4a", "#ffe14d", "#ff8c00", "#e03131")
LAYERS = {"Point": "risk_points", "LineString": "risk_lines", "Polygon": "risk_polygons"}
SYMBOLS = {"Point": marker, "LineString": thick, "Polygon": fill}


def has_risk(hazard: xr.Dataset) -> bool:
    """Return True if the objects of a hazard have exposure data."""
    return "object_individual_risk" in hazard


def class_words() -> np.ndarray:
    """Readable class names of individual risk."""
    return np.array([word.replace("_", " ") for word in CLASSES], dtype=object)


def risk_columns(hazard: xr.Dataset) -> Iterator[tuple[str, np.ndarray]]:
    """Yield columns of objects: kind, damage, individual risk and its class, collective risk."""
    if not has_risk(hazard):
        return
    yield "kind", hazard["object_kind"].values.astype(object)
    for name in QUANTITIES:
        yield from ((f"{name}{end}", hazard[f"object_{name}{end}"].values) for end in ENDS)
    for end in CLASS_ENDS:
        yield f"risk_class{end}", class_words()[hazard[f"object_risk_class{end}"].values]


def total_table(hazard: xr.Dataset) -> pd.DataFrame:
    """Table of sums over all objects, with limits that account for shared boulders, and with the
    wider sums of the objects' limits."""
    rows = []
    for name in SUMMED:
        three = [float(hazard[f"total_{name}{end}"]) for end in ENDS]
        added = [
            float(np.nansum(hazard[f"object_{name}{end}"].values)) for end in ("_low", "_high")
        ]
        rows.append([name, *three, *added])
    columns = ["quantity", "value", "low", "high", "low_added", "high_added"]
    return pd.DataFrame(rows, columns=columns)


def risk_layers(hazard: xr.Dataset) -> Iterator[tuple[str, tuple]]:
    """Yield a layer of objects and risks for each geometry type, as QGIS styles require."""
    import shapely

    shapes = shapely.from_wkt(hazard["object_geometry"].values.astype(str))
    columns = {"name": hazard["object"].values.astype(object)}
    columns |= {"layer": hazard["object_layer"].values.astype(object), **dict(risk_columns(hazard))}
    kinds = np.array([plain_type(shape.geom_type) for shape in shapes])
    for kind, layer in LAYERS.items():
        here = kinds == kind
        types = {shape.geom_type for shape in shapes[here]}
        if not types:
            continue
        written = types.pop() if len(types) == 1 else f"Multi{kind}"
        parts = shapes[here] if not types else _multiple(shapes[here])
        yield layer, (written, [(parts, {name: column[here] for name, column in columns.items()})])


def _multiple(shapes: np.ndarray) -> np.ndarray:
    """Convert shapes to multipart shapes, because a layer must have a single type."""
    import shapely

    collect = {
        "Point": shapely.multipoints, "LineString": shapely.multilinestrings,
        "Polygon": shapely.multipolygons,
    }  # fmt: skip
    return np.array(
        [collect[plain_type(shape.geom_type)](shapely.get_parts(shape)) for shape in shapes]
    )


def risk_styles(kinds: Mapping[str, str]) -> dict[str, Style]:
    """Styles of the risk layers, by class of individual risk."""
    words = class_words().tolist()
    return {
        layer: Style(
            "risk_class",
            [
                (word, f"{word} per year" if k else "no individual risk", SYMBOLS[kind](colour))
                for k, (word, colour) in enumerate(zip(words, COLOURS, strict=True))
            ],
        )
        for kind, layer in LAYERS.items()
        if layer in kinds
    }
