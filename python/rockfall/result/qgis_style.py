# SPDX-License-Identifier: BSD-3-Clause
"""QGIS styles (.qml) of maps, which QGIS finds next to the GeoTIFF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from rockfall.result.classes import Classes

HEAD = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
OPACITY = "0.7"


def write_palette(raster: Path, words: Mapping[int, str], colours: Mapping[int, str]) -> Path:
    """Write the style of a map of numbers with a label and a colour each; others are left blank."""
    renderer = ElementTree.Element("rasterrenderer", type="paletted")
    palette = ElementTree.SubElement(renderer, "colorPalette")
    for value, colour in colours.items():
        about = {"value": str(value), "label": words[value], "color": colour, "alpha": "255"}
        ElementTree.SubElement(palette, "paletteEntry", about)
    return _written(raster, renderer)


def write_classes(raster: Path, classes: Classes, per_unit: float = 1.0) -> Path:
    """Write the style of a map in `per_unit` times the unit of its classes (0.01: fractions, not
    per cent)."""
    renderer = ElementTree.Element("rasterrenderer", type="singlebandpseudocolor")
    about = {"colorRampType": "DISCRETE", "classificationMode": "1", "clip": "0"}
    shader = ElementTree.SubElement(renderer, "rastershader")
    shader = ElementTree.SubElement(shader, "colorrampshader", about)
    ends = [f"{per_unit * limit:.10g}" for limit in classes.limits]
    for end, colour, label in zip([*ends, "inf"], classes.colours, classes.labels, strict=True):
        about = {"value": end, "color": colour, "label": f"{label} {classes.unit}", "alpha": "255"}
        ElementTree.SubElement(shader, "item", about)
    return _written(raster, renderer)


def _written(raster: Path, renderer: ElementTree.Element) -> Path:
    for name, value in {"band": "1", "alphaBand": "-1", "opacity": OPACITY}.items():
        renderer.set(name, value)
    renderer.insert(0, ElementTree.Element("rasterTransparency"))
    root = ElementTree.Element("qgis", version="3.16", styleCategories="Symbology")
    ElementTree.SubElement(root, "pipe").append(renderer)
    ElementTree.indent(root)
    path = raster.with_suffix(".qml")
    path.write_text(f"{HEAD}{ElementTree.tostring(root, encoding='unicode')}\n", encoding="utf-8")
    return path
