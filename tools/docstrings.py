# SPDX-License-Identifier: BSD-3-Clause
"""Docstrings on the page of the Python interface (an extension of griffe).

In `help()`, docstrings are plain text: examples have no heading, pages are given by path, and names
are in angle brackets. For the site, examples become a section, paths become links, and brackets
become text.
"""

import re

from griffe import Extension, Object

PAGE = re.compile(r"\bdocs/([\w/]+)\.md")


class House(Extension):
    def on_object(self, *, obj: Object, **_: object) -> None:
        if obj.is_alias or not obj.docstring:
            return
        text, mark, examples = obj.docstring.value.partition(">>> ")
        text = PAGE.sub(r"[docs/\1.md](\1.md)", text.replace("<", "&lt;"))
        if mark:
            lines = "".join("    " + line for line in (mark + examples).splitlines(True))
            text += f"Examples:\n{lines}"
        obj.docstring.value = text
