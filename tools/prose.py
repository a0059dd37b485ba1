# SPDX-License-Identifier: BSD-3-Clause
"""Style of pages, comments, docstrings and messages: lines of at most 100 columns, plain English,
the field's words; messages of at most 25 words in each language; no empty names of variables and
no headless docstrings. Quoted code is left alone.

python tools/prose.py           lists faults (exit status 0 or 1); spelling is codespell's
python tools/prose.py --wrap    wraps lines that are too long
"""

import ast
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted(
    path
    for pattern in (
        "*.md",
        "docs/**/*.md",
        "cases/*/README.md",
        "fortran/*.md",
        "lab/**/README.md",
        "lab/docs/*.md",
    )
    for path in ROOT.glob(pattern)
    if ROOT / "docs/archive" not in path.parents
)
CODE = sorted(
    path
    for folder in ("benchmarks", "cases", "fortran", "lab", "python", "tests", "tools")
    for pattern in ("*.py", "*.f90")
    for path in (ROOT / folder).rglob(pattern)
    if path != Path(__file__).resolve()
)
COLUMNS = 100
#: Words that must not appear on a page, and what to write instead.
WORDS = {
    r"foretold|foretell": "predicted",
    r"foreseen": "estimated",
    r"hopeless": "cannot be met",
    r"(?:rock|boulder)s?' fates?|its fate": "its end",
    r"the boulder's way|its way down": "its trajectory",
    r"law of volumes|volume law": "distribution of volumes",
    r"ignorance": "epistemic uncertainty",
    r"door 1|door 2": "Python interface, standalone program",
    r"spoiled": "malformed",
    r"mended(?!\.)": "repaired",
    r"runout": "run-out",
}
#: Words and idioms to avoid on pages and in comments, docstrings and messages, and what to write.
PLAIN = {
    r"beside": "next to, compared with",
    r"hangs? on": "depends on",
    r"anew": "again",
    r"without a word": "silently",
    r"fares?": "performs",
    r"what becomes of": "outcome of",
    r"(?<!power[ -])(?<!scaling )laws?(?! of succession)": "model, distribution, rule",
    r"so many": "this number of",
    r"of (?:which|whose)": "two sentences, or a noun in front",
    r"those of those|of those (?:of|that)|that of those": "repeat the noun",
    r"(?:tells?|told|says?|said|asks|asked)": "report, list, give, require, request",
    r"(?:go|goes|went|gone) on": "continue",
    r"as it is": "unchanged",
    r"are due": "expected",
    r"the same of": "repeat the noun",
    r"(?:bytes|crossings?|rebounds?) an? (?:cell|boulder|rebound|stem|point|crossing)": "per",
    r"(?:holds?|held) back": "stop, slow down",
    r"without end": "without limit",
    r"(?:is|are) not decided": "not known",
    r"in force": "current",
    r"made up": "invented",
    r"as far as there are|as it wants|lest|whence|thereof|hitherto": "plain English",
}
#: Pages about people, who may say, tell and ask.
PEOPLE = {"CODE_OF_CONDUCT.md", "SECURITY.md"}
#: Maximum words of a message, and texts of the catalogues that are not sentences.
MOST, LISTS = 25, {"join.list", "app.key.uniform_rg"}
#: Words that must not appear in the kernel: in names, comments or messages.
KERNEL_WORDS = {
    r"fates?": "outcome, result, status",
    r"laws|law_of|velocity_law_t|tree_law(?:_t)?": "distribution, model, rule",
    r"asked": "requested",
    r"told|tells": "complete, reports",
    r"stamps?": "last_source",
    r"lie_over|touch_down|look_up|go_on|take_out|set_out|let_go|unshare": "a verb with its object",
    r"take_apart|goes_on|meet_plane|keep_touch|draw_again|scene_from": "a verb with its object",
    r"spread_of|stands_in_way": "what the function returns",
    r"has no meaning": "is only valid with, is not valid for",
    r"must be another": "must be unique",
    r"are due": "expected",
    r"as it is|takes? no notice|none such": "plain English",
}
ODD = [(re.compile(rf"\b(?:{word})\b", re.IGNORECASE), said) for word, said in WORDS.items()]
ODD_IN_KERNEL = [
    (re.compile(rf"\b(?:{word})\b", re.IGNORECASE), said) for word, said in KERNEL_WORDS.items()
]
IDIOMS = [(re.compile(rf"\b(?:{word})\b", re.IGNORECASE), said) for word, said in PLAIN.items()]
KERNEL = ROOT / "fortran/src"
PACKAGE = ROOT / "python/rockfall"
WINDOW = sorted((ROOT / "web/src").rglob("*.ts"))
CATALOGUES = sorted((PACKAGE / "locale").glob("*.po"))
#: Code within text: between back quotes, values of f-strings, targets of links, anchors.
QUOTED = re.compile(r"`[^`]*`|\{(?:[^{}]|\{[^{}]*\})*\}|\]\([^)]*\)|<[^<>]*>|\$[^$]*\$|--[a-z-]+")
#: Names of variables and arguments of the package that do not name the thing.
EMPTY_NAMES = {"about", "found", "its", "known", "mine", "of", "one", "said", "some"}
#: Arguments of public functions, which the interface promises: (function, argument).
PROMISED = {("ensemble_table", "found"), ("write_hazard", "found")}
#: A docstring that begins like this is neither a sentence nor a noun phrase.
HEADLESS = re.compile(r"(?:What|Of|How|Whether|Where|Those|The same|Which|Who)\b")
FENCE = re.compile(r"^\s*(```|~~~|\$\$)")
FIXED = re.compile(r"^(\||#|<|:::|!\[|\[[^\]]+\]:|&nbsp;|    |---)")  # these keep their lines
ITEM = re.compile(r"^( *(?:[-*+]|\d+\.) +|> ?)")
WORD = re.compile(r"(?:`[^`]{1,60}`|\S)+")  # code within a line stays together
LONG = re.compile(r"\S{60,}|\]\(\S{40,}")  # links and paths, which cannot be broken


def lines_of(text: str) -> Iterator[tuple[int, str, bool]]:
    """Yield number and text of each line, and whether it is prose."""
    fence = ""
    for number, line in enumerate(text.splitlines(), 1):
        mark = FENCE.match(line)
        within = bool(fence)
        if mark and (not fence or mark[1] == fence):
            one_line = mark[1] == "$$" and line.count("$$") == 2
            fence = "" if fence or one_line else mark[1]
        yield number, line, not within and not mark and not FIXED.match(line)


def wrong(path: Path) -> Iterator[str]:
    place = path.relative_to(ROOT)
    for number, line, prose in lines_of(path.read_text(encoding="utf-8")):
        if len(line) > COLUMNS and not line.lstrip().startswith("|") and not LONG.search(line):
            yield f"{place}:{number}: {len(line)} columns"
        if path.name != "CHANGELOG.md" and (prose or line.startswith(("|", "#"))):  # old names
            for word, said in ODD:
                if found := word.search(line):
                    yield f"{place}:{number}: '{found[0]}': {said}"
            if path.name not in PEOPLE:
                yield from idioms(f"{place}:{number}", line)


def idioms(place: str, text: str) -> Iterator[str]:
    """Yield the idioms in a line of prose, outside quoted code."""
    left = QUOTED.sub("`", text)
    for word, said in IDIOMS:
        if found := word.search(left):
            yield f"{place}: '{found[0]}': {said}"


def wrong_in_catalogue(path: Path) -> Iterator[str]:
    """Yield faults of a catalogue: long messages, several thoughts in a message, English idioms."""
    key = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("msgid "):
            key = ast.literal_eval(line[6:])
        elif key and key not in LISTS and (form := re.fullmatch(r'msgstr(?:\[\d\])? (".*")', line)):
            text = ast.literal_eval(form[1])
            yield from long_message(f"{path.name}: {key}", text)
            if path.stem == "en":
                yield from idioms(f"{path.name}: {key}", text)


def long_message(place: str, text: str) -> Iterator[str]:
    """Yield a fault for more than 25 words (a value counts as one word), and one for a
    semicolon."""
    plain = re.sub(r"(?<=\d)[\u202f\xa0 ](?=\d{3})", "", re.sub(r"\{[^{}]*\}", "N", text))
    words = [word for word in plain.split() if re.search(r"\w", word)]
    if len(words) > MOST:
        yield f"{place}: {len(words)} words: at most {MOST}"
    if ";" in text and not place.startswith("python"):
        yield f"{place}: a semicolon: one thought, or two sentences"


def messages_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of each string in a module, except docstrings; N for values."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    parts = {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, (ast.JoinedStr, ast.Expr))
        for part in (node.values if isinstance(node, ast.JoinedStr) else [node.value])
    }
    for node in ast.walk(tree):
        if id(node) in parts:
            continue
        if isinstance(node, ast.JoinedStr):
            texts = (part.value if isinstance(part, ast.Constant) else "N" for part in node.values)
            yield node.lineno, "".join(map(str, texts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value


def texts_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of each comment and, except in TypeScript, of each string of a file."""
    if path.suffix == ".f90":
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            yield from ((number, text) for text in re.findall(r"\"[^\"]*\"|!.*", line))
        return
    if path.suffix == ".ts":
        code = path.read_text(encoding="utf-8")
        for comment in re.finditer(r"(?<![:\"'`\w])//[^\n]*|/\*.*?\*/", code, re.DOTALL):
            yield code.count("\n", 0, comment.start()) + 1, comment[0]
        return
    kinds = tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", None)
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type in kinds:
                yield token.start[0], token.string


def wrong_in_code(path: Path) -> Iterator[str]:
    place = path.relative_to(ROOT)
    is_plain = {KERNEL, PACKAGE, PACKAGE.parent / "rockfall_qgis"} & {*path.parents}
    for first, text in texts_of(path):
        for number, line in enumerate(text.splitlines(), first):
            for word, said in ODD:
                if found := word.search(line):
                    yield f"{place}:{number}: '{found[0]}': {said}"
            if (is_plain or path.suffix == ".ts") and " " in line.strip():  # not the name of code
                yield from idioms(f"{place}:{number}", line)
    if path.suffix == ".py":
        yield from headless(path)
    if PACKAGE in path.parents:
        yield from empty_names(path)
        for number, text in messages_of(path):
            if "\n" not in text and " TEXT," not in text:  # not code such as SQL
                yield from long_message(f"{place}:{number}", text)
    if KERNEL not in path.parents:
        return
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        for word, said in ODD_IN_KERNEL:
            if found := word.search(line):
                yield f"{place}:{number}: '{found[0]}': {said}"


def empty_names(path: Path) -> Iterator[str]:
    """Yield messages on meaningless names of variables and arguments."""
    place = path.relative_to(ROOT)
    tree = ast.parse(path.read_text(encoding="utf-8"))
    promised = {
        argument
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        for argument in node.args.args
        if (node.name, argument.arg) in PROMISED
    }
    for node in ast.walk(tree):
        if node in promised:
            continue
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            name = node.id
        else:
            name = node.arg if isinstance(node, ast.arg) else ""
        if name in EMPTY_NAMES:
            yield f"{place}:{node.lineno}: '{name}': name the thing"


def headless(path: Path) -> Iterator[str]:
    """Yield messages on docstrings that begin with neither a verb nor a noun."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef, ast.Module)):
            if HEADLESS.match(ast.get_docstring(node) or ""):
                name = getattr(node, "name", "module")
                yield f"{path.relative_to(ROOT)}: docstring of {name}: begin with a verb or a noun"


def wrapped(text: str) -> str:
    """Rewrap paragraphs and items that have a line that is too long; everything else remains
    unchanged."""
    out: list[str] = []
    block: list[str] = []

    def flush() -> None:
        if any(len(line) > COLUMNS for line in block):
            out.extend(fill(block))
        else:
            out.extend(block)
        block.clear()

    for _, line, prose in lines_of(text):
        if not prose or not line.strip():
            flush()
            out.append(line)
            continue
        if ITEM.match(line):
            flush()
        block.append(line)
    flush()
    return "\n".join(out) + "\n"


def fill(block: list[str]) -> list[str]:
    item = ITEM.match(block[0])
    first = item[0] if item else re.match(" *", block[0])[0]  # type: ignore[index]
    rest = " " * len(first) if not first.startswith(">") else first
    text = " ".join([block[0][len(first) :], *(line.strip() for line in block[1:])])
    words = WORD.findall(text)
    lines, now = [], first
    for k, word in enumerate(words):
        begins = re.fullmatch(r"[-+*>|#]+|\d+\.", words[k + 1]) if k + 1 < len(words) else None
        together = f"{word} {words[k + 1]}" if begins else word  # otherwise it would begin a list
        if now.strip() and len(now) + 1 + len(together) > COLUMNS and now not in (first, rest):
            lines.append(now)
            now = rest + word
        else:
            now += word if now in (first, rest) else f" {word}"
    return [*lines, now]


def main() -> int:
    if "--wrap" in sys.argv:
        for path in PAGES:
            path.write_text(wrapped(path.read_text(encoding="utf-8")), encoding="utf-8")
    found = [line for path in PAGES for line in wrong(path)]
    found += [line for path in [*CODE, *WINDOW] for line in wrong_in_code(path)]
    found += [line for path in CATALOGUES for line in wrong_in_catalogue(path)]
    print("\n".join(found), end="\n" if found else "")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
