# SPDX-License-Identifier: BSD-3-Clause
"""QGIS styles (.qml) of maps; QGIS loads the style next to a GeoTIFF."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from rockfall.files.vector_style import Symbol, rgba, symbol_element
from rockfall.result.maps.classes import Classes

HEAD = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
OPACITY = "0.7"
RELIEF = "0.6"  # opacity; opaque steep ground would be black


def write_palette(raster: Path, words: Mapping[int, str], colours: Mapping[int, str]) -> Path:
    """Write the style of a map of class numbers, with a label and colour for each class; other
    numbers stay blank."""
    renderer = ElementTree.Element("rasterrenderer", type="paletted")
    palette = ElementTree.SubElement(renderer, "colorPalette")
    for value, colour in colours.items():
        attrs = {"value": str(value), "label": words[value], "color": colour, "alpha": "255"}
        ElementTree.SubElement(palette, "paletteEntry", attrs)
    return _written(raster, renderer)


def write_classes(raster: Path, classes: Classes, per_unit: float = 1.0) -> Path:
    """Write the style of a class map. Its values, divided by `per_unit` (0.01 for fractions), are
    in the unit of the classes."""
    renderer = ElementTree.Element("rasterrenderer", type="singlebandpseudocolor")
    attrs = {"colorRampType": "DISCRETE", "classificationMode": "1", "clip": "0"}
    shader = ElementTree.SubElement(renderer, "rastershader")
    shader = ElementTree.SubElement(shader, "colorrampshader", attrs)
    ends = [f"{per_unit * limit:.10g}" for limit in classes.limits]
    for end, colour, label in zip([*ends, "inf"], classes.colours, classes.labels, strict=True):
        attrs = {"value": end, "color": colour, "label": f"{label} {classes.unit}", "alpha": "255"}
        ElementTree.SubElement(shader, "item", attrs)
    return _written(raster, renderer)


def write_relief(raster: Path) -> Path:
    """Write a style that shows elevations as shaded relief, with light from several directions."""
    attrs = {"azimuth": "315", "angle": "45", "zfactor": "1", "multidirection": "1"}
    renderer = ElementTree.Element("rasterrenderer", {"type": "hillshade", **attrs})
    return _written(raster, renderer, RELIEF, smooth=True)


def contour_style(interval: float, index: int, colour: str) -> ElementTree.Element:
    """Style that shows elevations as contours at an interval [m]; every `index`-th is thicker."""
    attrs = {"contour-interval": f"{interval:g}", "contour-index-interval": f"{interval * index:g}"}
    attrs |= {"type": "contour", "downscale": "4"}
    renderer = ElementTree.Element("rasterrenderer", attrs)
    symbols = ElementTree.SubElement(renderer, "symbols")
    for name, width in (("contour", 0.12), ("index", 0.3)):
        line = Symbol({"line_color": rgba(colour), "line_width": width}, 0.6)
        symbols.append(symbol_element(name, "line", "SimpleLine", line))
    return _style(renderer, "1", smooth=True)


def _written(
    raster: Path, renderer: ElementTree.Element, opacity: str = OPACITY, smooth: bool = False
) -> Path:
    text = ElementTree.tostring(_style(renderer, opacity, smooth), encoding="unicode")
    path = raster.with_suffix(".qml")
    path.write_text(f"{HEAD}{text}\n", encoding="utf-8")
    return path


def _style(
    renderer: ElementTree.Element, opacity: str, smooth: bool = False
) -> ElementTree.Element:
    """QGIS style with this renderer; `smooth` interpolates cells to avoid steps in a relief."""
    for name, value in {"band": "1", "alphaBand": "-1", "opacity": opacity}.items():
        renderer.set(name, value)
    renderer.insert(0, ElementTree.Element("rasterTransparency"))
    root = ElementTree.Element("qgis", version="3.16", styleCategories="Symbology")
    pipe = ElementTree.SubElement(root, "pipe")
    if smooth:
        attrs = {"zoomedInResamplingMethod": "cubic", "zoomedOutResamplingMethod": "bilinear"}
        attrs |= {"enabled": "true", "maxOversampling": "2"}
        ElementTree.SubElement(ElementTree.SubElement(pipe, "provider"), "resampling", attrs)
    pipe.append(renderer)
    if smooth:
        ElementTree.SubElement(pipe, "resamplingStage").text = "provider"
    ElementTree.indent(root)
    return root
