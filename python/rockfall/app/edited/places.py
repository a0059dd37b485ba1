# SPDX-License-Identifier: BSD-3-Clause
"""Positions of errors and warnings in the document."""

import os
import re

from rockfall.app.edited.document import Document, Site
from rockfall.app.edited.forms import Form
from rockfall.scene.frames import GROUPS

_LAYER = re.compile(r"(lines|barriers|dams|zones|sources): ")
_FEATURE = re.compile(r"feature (\d+)(?:: )?")
_GROUP = re.compile(r"&(\w+)")
_KEY = re.compile(r"\s*,?\s*(\w+)(?= = | is | must|:)")
_LAYERS = {group: layer for layer, group in GROUPS.items()}


def entry_of(text: str, site: Site, document: Document) -> dict[str, str]:
    """Entry for the page from an error: text and place (layer and feature, or group and key)."""
    text = without_files(text, site)
    place: dict[str, str] = {}
    rest = text
    if match := _LAYER.match(rest):
        place["layer"], rest = match[1], rest[match.end() :]
        if number := _FEATURE.match(rest):
            rest = rest[number.end() :]
            features = document.layers.get(match[1], [])
            if 0 < int(number[1]) <= len(features):
                place["id"] = features[int(number[1]) - 1].id
        text = rest or text
        rest = _GROUP.sub("", rest, count=1)
        form = site.layer_forms.get(match[1], {})
    elif match := _GROUP.match(rest):
        group, rest = match[1], rest[match.end() :]
        if group in _LAYERS:
            place["layer"] = _LAYERS[group]
            place |= _named(rest, document, place["layer"])
            form = site.layer_forms.get(place["layer"], {})
        else:
            place["group"] = group
            place |= _source(rest, document)
            form = site.settings_forms.get(group, {})
    else:
        return {"text": text}
    return {"text": text, **place, **_key(rest, form)}


def _key(text: str, form: Form) -> dict[str, str]:
    """Key at the start of a text, if the form has it."""
    match = _KEY.match(text)
    return {"key": match[1]} if match and match[1] in form else {}


def _named(text: str, document: Document, layer: str) -> dict[str, str]:
    """Feature whose name is at the start of a text, or the only feature of a layer."""
    match, features = re.match(r" name = '([^']*)'", text), document.layers.get(layer, [])
    for feature in features:
        if len(features) == 1 or (match and feature.properties.get("name") == match[1]):
            return {"id": feature.id}
    return {}


def _source(text: str, document: Document) -> dict[str, str]:
    """Point source whose number is at the start of a text."""
    match, points = re.match(r": source (\d+) \(", text), document.layers["sources"]
    if match and points and points[0].type == "Point" and int(match[1]) <= len(points):
        return {"layer": "sources", "id": points[int(match[1]) - 1].id}
    return {}


def without_files(text: str, site: Site) -> str:
    """Text without the case name and the folder of files; drawn layers keep only their name."""
    text = text.removeprefix(f"{site.case_name}: ").replace(" = (GeoDataFrame)", "")
    for folder in (site.folder, site.file.parent):
        text = text.replace(f"{folder}{os.sep}", "")
    return text
