# SPDX-License-Identifier: BSD-3-Clause
"""Hooks of mkdocs.yml for the site.

- Links from pages to files outside docs/ (cases, benchmarks, CHANGELOG.md, ...) work in a browser
  of the repository and here: Markdown becomes a page of the site, any other file is copied.
- Equations, `$...$` and `$$...$$` with `\\tag{n}`, become MathML, which browsers draw.
- The pages that FORD makes of the kernel, in out/fortran, are put under fortran/.
- Archived pages can be linked to, but are neither in the navigation nor in the search.
- No page may load anything from the network, and no link may be broken.
"""

import html
import posixpath
import re
import shutil
from pathlib import Path
from urllib.parse import unquote, urlsplit

import math_core
import mkdocs
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.nav import Link, Navigation, Section
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
FORTRAN = ROOT / "out/fortran"
SHIPPED: dict[str, str] = {}  # location in the repository of files from outside docs/
FRONT = {"README.md": "docs/index.md"}  # pages: in the repository, on the site
CODE = re.compile(r"^(```|~~~).*?^\1|`+[^`]+`+", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"(?<=\]\()([^)\s#]+)(?=[)#])")
MATH = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
TAG = re.compile(r"\\tag\{([^}]*)\}")
#: Attributes that a browser fetches when it shows a page, unlike links that a reader may follow.
FETCHED = re.compile(
    r"""<(?:script|img|iframe|source|video|audio|embed|object)\b[^>]*\s(?:src|srcset|data)=["']?(?:https?:)?//
    |<link\b(?![^>]*\brel=["']?canonical)[^>]*\shref=["']?(?:https?:)?//
    |url\(["']?(?:https?:)?//|@import\s+["'](?:https?:)?//|class=["']?mermaid""",
    re.VERBOSE,
)
TARGET = re.compile(r"""<(?:a|img|script|link)\b[^>]*?\s(?:href|src)=["']?([^"'\s>]+)""")
ANCHOR = re.compile(r"""\s(?:id|name)=["']?([^"'\s>]+)""")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    for path in sorted(FORTRAN.rglob("*")):
        if path.is_file():
            uri = "fortran/" + path.relative_to(FORTRAN).as_posix()
            files.append(File.generated(config, uri, abs_src_path=str(path)))
    left = [file for file in files if file.src_uri.endswith(".md")]
    while left:
        page = left.pop()
        text = Path(page.abs_src_path).read_text(encoding="utf-8")
        for link in LINK.findall(CODE.sub("", text)):
            path = target(page.src_uri, link)
            if path is None or files.get_file_from_path(site_path(path)):
                continue
            if not (ROOT / path).is_file():
                continue
            file = File.generated(config, site_path(path), abs_src_path=str(ROOT / path))
            SHIPPED[file.src_uri] = path
            files.append(file)
            if file.src_uri.endswith(".md"):
                left.append(file)
    return files


def in_repository(uri: str) -> str:
    """Path in the repository for a file of the site."""
    return SHIPPED.get(uri, f"docs/{uri}")


def target(page: str, link: str) -> str | None:
    """Path in the repository for a link of a page; None for a URL or an absolute link."""
    if ":" in link or link.startswith("/"):
        return None
    return posixpath.normpath(posixpath.join(posixpath.dirname(in_repository(page)), link))


def site_path(path: str) -> str:
    """Path on the site for a file of the repository; a site has no hidden folders."""
    return FRONT.get(path, path).removeprefix("docs/").lstrip(".")


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    if page.file.src_uri.startswith("archive/"):
        page.meta["search"] = {"exclude": True}
    folder = posixpath.dirname(page.file.src_uri)

    def link(found: re.Match) -> str:
        path = target(page.file.src_uri, found[1])
        return posixpath.relpath(site_path(path), folder or ".") if path else found[1]

    done, text = 0, ""
    for code in CODE.finditer(markdown):
        text += LINK.sub(link, markdown[done : code.start()]) + code[0]
        done = code.end()
    return text + LINK.sub(link, markdown[done:])


def on_page_content(text: str, page: Page, **_: object) -> str:
    to_mathml = math_core.LatexToMathML(fancy_error=False)

    def equation(found: re.Match) -> str:
        latex = html.unescape(found[2])
        tag = TAG.search(latex)
        try:
            drawn = to_mathml.convert_with_local_state(
                TAG.sub("", latex), displaystyle=found[1] == "div"
            )
        except math_core.LatexError as error:
            raise PluginError(f"{page.file.src_uri}: {error}: {latex.strip()}") from None
        if not tag:
            return drawn
        return f'<div class="equation" id="eq-{tag[1]}">{drawn}<span>({tag[1]})</span></div>'

    return MATH.sub(equation, text)


def on_nav(nav: Navigation, config: MkDocsConfig, files: Files) -> Navigation:
    if FORTRAN.exists():
        reference = next(one for one in nav if one.title == "Reference")
        assert isinstance(reference, Section)
        reference.children.append(Link("Fortran kernel", "fortran/index.html"))
    return nav


def on_post_build(config: MkDocsConfig) -> None:
    site = Path(config.site_dir)
    bundle_bootstrap(site / "fortran")
    pages = {path: path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    styles = {path: path.read_text(encoding="utf-8") for path in site.rglob("*.css")}
    wrong = [
        f"{path.relative_to(site)} asks the network: {found[0]}"
        for path, text in (pages | styles).items()
        for found in FETCHED.finditer(text)
    ]
    anchors = {path: {unquote(one) for one in ANCHOR.findall(text)} for path, text in pages.items()}
    for path, text in pages.items():
        for target in {html.unescape(one) for one in TARGET.findall(text)}:
            url = urlsplit(target)
            if url.scheme or url.netloc or path.name == "404.html":
                continue
            aim = (path.parent / unquote(url.path)).resolve() if url.path else path
            fragment = "" if "fortran" in path.parts else unquote(url.fragment)  # FORD's are wrong
            if not aim.exists() or (aim in anchors and fragment not in {"", *anchors[aim]}):
                wrong.append(f"{path.relative_to(site)}: leads nowhere: {target}")
    if wrong:
        raise PluginError("\n".join(wrong))


def bundle_bootstrap(folder: Path) -> None:
    """Bundle Bootstrap, which FORD would load from the network, and remove MathJax, which is not
    needed."""
    theme = Path(mkdocs.__file__).parent / "themes/mkdocs"
    for name in ("css/bootstrap.min.css", "js/bootstrap.bundle.min.js"):
        shutil.copy(theme / name, folder / name)
    for path in folder.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        here = posixpath.relpath(folder, path.parent)
        text = re.sub(r"https://cdn\.jsdelivr\.net/npm/bootstrap@[\d.]+/dist", here, text)
        text = re.sub(r"<script[^>]*mathjax[^>]*></script>", "", text, flags=re.IGNORECASE)
        text = re.sub(r"\s(?:integrity|crossorigin)=\"[^\"]*\"", "", text)
        path.write_text(text, encoding="utf-8")
