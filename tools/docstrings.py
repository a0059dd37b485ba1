# SPDX-License-Identifier: BSD-3-Clause
"""Docstrings of rockfall on the page of the Python interface (an extension of griffe).

In `help()` they are plain text: examples without a heading, pages by their path, names in angle
brackets. For the site the examples become a section, the paths links, the brackets text.
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
