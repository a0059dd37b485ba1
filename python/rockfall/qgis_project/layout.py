# SPDX-License-Identifier: BSD-3-Clause
"""XML of an A3 print layout: the map at a round scale and, next to it, a block with title, legend,
north arrow, scale bar, coordinate system, data and date.

Positions are in millimetres from the upper left corner of the paper.
"""

import base64
import textwrap
import uuid
from collections.abc import Iterable, Sequence
from typing import NamedTuple
from xml.etree import ElementTree

from rockfall.plots.cartography.sheet import round_scale
from rockfall.qgis_project.document import Extent, corners, tree_layer
from rockfall.qgis_project.layers import Layer

WIDE, HIGH, MARGIN, BLOCK, GAP = 420.0, 297.0, 10.0, 95.0, 6.0  # paper, margin, block width, gap
MAP_WIDE, MAP_HIGH = WIDE - 2 * MARGIN - BLOCK - GAP, HIGH - 2 * MARGIN
LEFT = WIDE - MARGIN - BLOCK  # left edge of the block
PAD = 4.0  # padding of texts in the block
FONT = "Arial"
SMALL, NORMAL, LARGE, TITLE = 7, 8, 10, 15  # font sizes [pt]
LETTER = 0.5  # mean letter width, relative to the font size
LINE = 1.45  # line height, relative to the font size
POINT = 25.4 / 72  # millimetres per point
LETTERS = 44  # letters in a bold legend title, for the widest fonts
BAR = 35.0  # maximum length of the scale bar
FOOT = 66.0  # height of the items below the legend
#: QGIS numbers of item types.
PAGE, MAP, PICTURE, LABEL, LEGEND, SHAPE, SCALE_BAR = (
    65638, 65639, 65640, 65641, 65642, 65643, 65646,
)  # fmt: skip
MAP_ITEM = "map"  # id used in the scale expression
SCALE = f"[% format_number(round(map_get(item_variables('{MAP_ITEM}'), 'map_scale')), 0) %]"
TODAY = "[% format_date(now(), 'yyyy-MM-dd') %]"
NORTH = (
    b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 60" width="40" height="60">'
    b'<path d="M20 16 L33 58 L20 49 L7 58 Z" fill="#ffffff" stroke="#222222" stroke-width="1.5"/>'
    b'<path d="M20 16 L20 49 L7 58 Z" fill="#222222"/>'
    b'<path d="M14.5 13 L14.5 1 L25.5 13 L25.5 1" fill="none" stroke="#222222" stroke-width="2"/>'
    b"</svg>"
)


class Texts(NamedTuple):
    """Texts of a layout: headings, lines of imprint and foot, words for scale and date."""

    title: str
    subtitle: str
    imprint: Sequence[str]
    foot: Sequence[str]
    scale: str
    printed: str


def layout(
    name: str, theme: str, extent: Extent, layers: Iterable[Layer], texts: Texts
) -> ElementTree.Element:
    """Layout of a theme; `layers` appear in the legend."""
    attrs = {"name": name, "units": "mm", "printResolution": "300", "worldFileMap": ""}
    root = ElementTree.Element("Layout", attrs)
    pages = ElementTree.SubElement(root, "PageCollection")
    pages.append(_item(name, PAGE, "page", (0, 0, WIDE, HIGH), background="true"))
    chart = _map(name, theme, paper_extent(extent))
    chart_id = chart.attrib["uuid"]
    items = [chart, _frame(name), *_head(name, texts)]
    y = MARGIN + PAD + sum(_height(*text) for text in _head_texts(texts))
    items.append(_legend(name, chart_id, y, layers))
    items += _foot(name, chart_id, extent, texts)
    root.extend(items)
    return root


def paper_extent(extent: Extent) -> Extent:
    """Map extent on paper that includes an extent, at the next round scale."""
    west, east, south, north = extent
    scale = scale_of(extent)
    x, y = (west + east) / 2, (south + north) / 2
    wide, high = (0.5e-3 * scale * side for side in (MAP_WIDE, MAP_HIGH))
    return x - wide, x + wide, y - high, y + high


def scale_of(extent: Extent) -> float:
    """Round scale denominator that fits an extent on the paper."""
    west, east, south, north = extent
    return round_scale(1e3 * max((east - west) / MAP_WIDE, (north - south) / MAP_HIGH))


def bar_unit(scale: float) -> float:
    """Length of each of the two parts of the scale bar [m]: 1, 2 or 5 times a power of ten."""
    most = 1e-3 * scale * BAR / 2
    power = 10.0 ** len(f"{most:.0f}") / 10 if most >= 1 else 1.0
    return next((k * power for k in (5.0, 2.0, 1.0) if k * power <= most), power)


def _item(layout_name: str, kind: int, what: str, place: Sequence[float], **options: str):
    """Layout item at x, y with width and height."""
    x, y, wide, high = (f"{number:.6g}" for number in place)
    own = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, f'rockfall/{layout_name}/{what}')}}}"
    usual = {
        "type": str(kind), "uuid": own, "templateUuid": own, "id": what, "visibility": "1",
        "position": f"{x},{y},mm", "positionOnPage": f"{x},{y},mm", "size": f"{wide},{high},mm",
        "referencePoint": "0", "opacity": "1", "background": "false", "frame": "false",
        "outlineWidthM": "0.3,mm", "itemRotation": "0",
    }  # fmt: skip
    item = ElementTree.Element("LayoutItem", usual | options)
    ElementTree.SubElement(item, "FrameColor", red="34", green="34", blue="34", alpha="255")
    ElementTree.SubElement(item, "BackgroundColor", red="255", green="255", blue="255", alpha="255")
    return item


def _map(name: str, theme: str, extent: Extent) -> ElementTree.Element:
    place = MARGIN, MARGIN, MAP_WIDE, MAP_HIGH
    attrs = {"followPreset": "true", "followPresetName": theme, "keepLayerSet": "false"}
    attrs |= {"frame": "true", "background": "true", "mapRotation": "0"}
    item = _item(name, MAP, MAP_ITEM, place, **attrs)
    ElementTree.SubElement(item, "Extent", corners(extent))
    return item


def _frame(name: str) -> ElementTree.Element:
    """Frame of the block: an empty label with a border."""
    place = LEFT, MARGIN, BLOCK, MAP_HIGH
    return _label(name, "block", "", place, NORMAL, frame="true", background="true")


def _label(
    name: str, what: str, text: str, place: Sequence[float], size: int, bold: bool = False,
    **options: str,
) -> ElementTree.Element:  # fmt: skip
    item = _item(name, LABEL, what, place, labelText=text, htmlState="0", halign="1", valign="32",
                 marginX="0", marginY="0", **options)  # fmt: skip
    ElementTree.SubElement(item, "LabelFont", description=_font(size, bold), style="")
    ElementTree.SubElement(item, "FontColor", red="34", green="34", blue="34", alpha="255")
    return item


def _font(size: int, bold: bool = False) -> str:
    """Font in Qt's description format."""
    return f"{FONT},{size},-1,5,{75 if bold else 50},0,0,0,0,0"


def _head_texts(texts: Texts) -> list[tuple[str, int, bool]]:
    head = [(texts.title, TITLE, True), (texts.subtitle, LARGE, False)]
    return [*head, *((line, NORMAL, False) for line in texts.imprint)]


def _height(text: str, size: int, *_: bool) -> float:
    """Height of a wrapped text in the block [mm]."""
    letters = (BLOCK - 2 * PAD) / (LETTER * size * POINT)
    return (int(len(text) / letters) + 1) * LINE * size * POINT


def _head(name: str, texts: Texts) -> Iterable[ElementTree.Element]:
    """Title, subtitle and imprint, from top to bottom."""
    y = MARGIN + PAD
    for k, (text, size, bold) in enumerate(_head_texts(texts)):
        high = _height(text, size)
        yield _label(name, f"head {k}", text, (LEFT + PAD, y, BLOCK - 2 * PAD, high), size, bold)
        y += high


def _legend(name: str, chart: str, y: float, layers: Iterable[Layer]) -> ElementTree.Element:
    place = LEFT + PAD, y + PAD, BLOCK - 2 * PAD, HIGH - MARGIN - FOOT - y - PAD
    attrs = {
        "map_uuid": chart, "title": "", "resizeToContents": "1", "wrapChar": "\n",
        "columnCount": "1", "symbolWidth": "6", "symbolHeight": "3.5", "lineSpacing": "1",
        "boxSpace": "0", "legendFilterByAtlas": "0", "splitLayer": "0", "rasterBorder": "1",
    }  # fmt: skip
    item = _item(name, LEGEND, "legend", place, **attrs)
    styles = ElementTree.SubElement(item, "styles")
    for style, size, space in (
        ("title", LARGE, {"marginBottom": "2"}), ("group", NORMAL, {"marginTop": "2"}),
        ("subgroup", NORMAL, {"marginTop": "2"}), ("symbol", SMALL, {"marginTop": "0.8"}),
        ("symbolLabel", SMALL, {"marginTop": "0.8", "marginLeft": "2"}),
    ):  # fmt: skip
        element = ElementTree.SubElement(
            styles, "style", {"name": style, "alignment": "1", **space}
        )
        bold = style in ("title", "subgroup")
        ElementTree.SubElement(element, "styleFont", description=_font(size, bold), style="")
    tree = ElementTree.SubElement(item, "layer-tree-group")
    for layer in layers:
        tree.append(tree_layer(layer, title="\n".join(textwrap.wrap(layer.title, LETTERS))))
    return item


def _foot(name: str, chart: str, extent: Extent, texts: Texts) -> Iterable[ElementTree.Element]:
    """North arrow, scale, coordinate system, data and date, at the bottom of the block."""
    top, left = HIGH - MARGIN - FOOT, LEFT + PAD
    svg = f"base64:{base64.b64encode(NORTH).decode()}"
    attrs = {"file": svg, "mode": "0", "mapUuid": chart, "northMode": "0", "northOffset": "0"}
    attrs |= {"resizeMode": "0", "anchorPoint": "0", "pictureRotation": "0"}
    yield _item(name, PICTURE, "north", (LEFT + BLOCK - PAD - 11, top, 11, 16), **attrs)
    size = (left, top + 8, BAR + 20, 10)
    yield _scale_bar(name, chart, size, bar_unit(scale_of(extent)))
    scale = f"{texts.scale} 1:{SCALE} (A3)"
    yield _label(name, "scale", scale, (left, top, 60, 5), LARGE, True)
    y = top + 21
    for k, text in enumerate([*texts.foot, f"{texts.printed}: {TODAY}"]):
        shown = text.replace(TODAY, "2000-01-01")  # has the length of the date shown
        high = _height(shown, SMALL)
        yield _label(name, f"foot {k}", text, (left, y, BLOCK - 2 * PAD, high), SMALL)
        y += high


def _scale_bar(name: str, chart: str, place: Sequence[float], unit: float) -> ElementTree.Element:
    attrs = {
        "mapUuid": chart, "style": "Single Box", "unitType": "meters", "unitLabel": "m",
        "numUnitsPerSegment": f"{unit:g}", "numMapUnitsPerScaleBarUnit": "1", "numSegments": "2",
        "numSegmentsLeft": "0", "segmentSizeMode": "0", "height": "1.8", "labelBarSpace": "1",
        "boxContentSpace": "0", "alignment": "0", "outlineWidth": "0.2",
        "labelVerticalPlacement": "0", "labelHorizontalPlacement": "0", "lineJoinStyle": "miter",
        "lineCapStyle": "square", "minBarWidth": "10", "maxBarWidth": "50",
    }  # fmt: skip
    item = _item(name, SCALE_BAR, "scale bar", place, **attrs)
    letters = {"fontFamily": FONT, "fontSize": str(SMALL), "fontSizeUnit": "Point"}
    letters |= {"textColor": "34,34,34,255", "textOpacity": "1", "fontWeight": "50"}
    ElementTree.SubElement(item, "text-style", letters)
    for colour, level in (("strokeColor", "0"), ("fillColor", "0"), ("fillColor2", "255")):
        ElementTree.SubElement(item, colour, red=level, green=level, blue=level, alpha="255")
    return item
