# SPDX-License-Identifier: BSD-3-Clause
"""XML of a project: coordinate system, layer tree, layers, themes, extent, layouts.

QGIS 3.22 and later reads these elements and attributes, and uses defaults for others.
Layer sources are relative to the project.
"""

import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from rockfall.files.qgis_style import HEAD
from rockfall.io.atomic import atomic_write
from rockfall.qgis_project.layers import Group, Layer

VERSION = "3.22.0"
LONG_AGO = (1980, 1, 1, 0, 0, 0)  # fixed date in the archive: equal projects have equal bytes
CLASS_ROWS = {"item", "paletteEntry"}  # elements with map classes
Extent = tuple[float, float, float, float]  # west, east, south, north [m]


class Theme(NamedTuple):
    """Named set of layers that are shown together."""

    name: str
    layers: tuple[Layer, ...]


class Project(NamedTuple):
    """Contents of a project."""

    title: str
    crs: str | None  # well-known text
    extent: Extent
    groups: Sequence[Group]
    themes: Sequence[Theme]
    layouts: Sequence[ElementTree.Element]


def write_project(project: Project, path: Path) -> Path:
    """Write a project as .qgz, an archive with the project XML."""
    text = HEAD + ElementTree.tostring(_document(project), encoding="unicode") + "\n"
    with atomic_write(path) as part, zipfile.ZipFile(part, "w") as archive:
        info = zipfile.ZipInfo(path.with_suffix(".qgs").name, LONG_AGO)
        info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
        archive.writestr(info, text)
    return path


def crs_element(name: str, crs: str | None) -> ElementTree.Element:
    """Coordinate system element from well-known text; empty if there is none."""
    element = ElementTree.Element(name)
    system = ElementTree.SubElement(element, "spatialrefsys")
    if crs:
        ElementTree.SubElement(system, "wkt").text = crs
    return element


def tree_layer(
    layer: Layer, visible: bool = True, expanded: bool = True, title: str = ""
) -> ElementTree.Element:
    """Layer in the tree of the project, or of a legend with its own title. For a map, the rows of
    its classes are shown, but not the row of its band, which comes first."""
    attrs = {
        "id": layer.id, "name": layer.title, "source": layer.source,
        "providerKey": provider(layer), "checked": _checked(visible),
        "expanded": str(int(expanded)),
    }  # fmt: skip
    element = ElementTree.Element("layer-tree-layer", attrs)
    rows = sum(element.tag in CLASS_ROWS for element in layer.style.iter())
    own = {"legend/title-label": title} if title else {}
    if layer.is_raster and rows:
        own["legend/node-order"] = ",".join(map(str, range(1, rows + 1)))
    if own:
        options = ElementTree.SubElement(element, "customproperties")
        options = ElementTree.SubElement(options, "Option", type="Map")
        for name, value in own.items():
            ElementTree.SubElement(options, "Option", type="QString", name=name, value=value)
    return element


def provider(layer: Layer) -> str:
    """QGIS provider that reads a layer."""
    return "gdal" if layer.is_raster else "ogr"


def _document(project: Project) -> ElementTree.Element:
    root = ElementTree.Element("qgis", version=VERSION, projectname=project.title)
    ElementTree.SubElement(root, "title").text = project.title
    root.append(crs_element("projectCrs", project.crs))
    root.append(_tree(project.groups))
    layers = [layer for group in project.groups for layer in group.layers]
    root.append(_canvas(project))
    order = ElementTree.SubElement(root, "layerorder")
    for layer in layers:
        ElementTree.SubElement(order, "layer", id=layer.id)
    every = ElementTree.SubElement(root, "projectlayers")
    every.extend(_layer(layer, project.crs) for layer in layers)
    root.append(_properties())
    themes = ElementTree.SubElement(root, "visibility-presets")
    themes.extend(_themes(project))
    ElementTree.SubElement(root, "Layouts").extend(project.layouts)
    view = ElementTree.SubElement(root, "ProjectViewSettings", UseProjectScales="0")
    ends = corners(project.extent)
    view.append(ElementTree.Element("DefaultViewExtent", ends))
    view[0].extend(crs_element("crs", project.crs))
    ElementTree.indent(root)
    return root


def _tree(groups: Iterable[Group]) -> ElementTree.Element:
    tree = ElementTree.Element("layer-tree-group")
    for group in groups:
        attrs = {"name": group.title, "checked": _checked(True)}
        attrs |= {"expanded": str(int(group.expanded))}
        branch = ElementTree.SubElement(tree, "layer-tree-group", attrs)
        for layer in group.layers:
            branch.append(tree_layer(layer, layer.visible, layer.visible and layer.in_legend))
    return tree


def _checked(yes: bool) -> str:
    return "Qt::Checked" if yes else "Qt::Unchecked"


def _layer(layer: Layer, crs: str | None) -> ElementTree.Element:
    """Layer element with its style, which consists of the children of the style element."""
    attrs = {"type": "raster" if layer.is_raster else "vector"}
    if "labelsEnabled" in layer.style.attrib:
        attrs["labelsEnabled"] = layer.style.attrib["labelsEnabled"]
    element = ElementTree.Element("maplayer", attrs)
    for name, text in (
        ("id", layer.id), ("datasource", layer.source), ("layername", layer.title),
    ):  # fmt: skip
        ElementTree.SubElement(element, name).text = text
    element.append(crs_element("srs", crs))
    encoding = {} if layer.is_raster else {"encoding": "UTF-8"}
    ElementTree.SubElement(element, "provider", encoding).text = provider(layer)
    element.extend(layer.style)
    return element


def _canvas(project: Project) -> ElementTree.Element:
    canvas = ElementTree.Element("mapcanvas", name="theMapCanvas", annotationsVisible="1")
    ElementTree.SubElement(canvas, "units").text = "meters"
    extent = ElementTree.SubElement(canvas, "extent")
    for name, value in corners(project.extent).items():
        ElementTree.SubElement(extent, name).text = value
    ElementTree.SubElement(canvas, "rotation").text = "0"
    canvas.append(crs_element("destinationsrs", project.crs))
    return canvas


def corners(extent: Extent) -> dict[str, str]:
    """Corners of an extent by their QGIS names."""
    west, east, south, north = extent
    named = {"xmin": west, "ymin": south, "xmax": east, "ymax": north}
    return {name: repr(float(value)) for name, value in named.items()}


def _properties() -> ElementTree.Element:
    """Project properties: coordinate system enabled, relative sources."""
    properties = ElementTree.Element("properties")
    system = ElementTree.SubElement(properties, "SpatialRefSys")
    ElementTree.SubElement(system, "ProjectionsEnabled", type="int").text = "1"
    paths = ElementTree.SubElement(properties, "Paths")
    ElementTree.SubElement(paths, "Absolute", type="bool").text = "false"
    return properties


def _themes(project: Project) -> Iterator[ElementTree.Element]:
    groups = [(group.title, {layer.id for layer in group.layers}) for group in project.groups]
    for theme in project.themes:
        attrs = {"name": theme.name, "has-expanded-info": "0", "has-checked-group-info": "1"}
        element = ElementTree.Element("visibility-preset", attrs)
        shown = {layer.id for layer in theme.layers}
        for layer in theme.layers:
            attrs = {"id": layer.id, "visible": "1", "style": "default"}
            ElementTree.SubElement(element, "layer", attrs)
        checked = ElementTree.SubElement(element, "checked-group-nodes")
        for title, members in groups:
            if members & shown:
                ElementTree.SubElement(checked, "checked-group-node", id=title)
        yield element
