"""The language of the code and the pages: names of several words, no bare participles, short sentences."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path
from statistics import mean

import pytest

ROOT = Path(__file__).parents[2]
MAX_ONE_WORD = 0.55  # of the names of functions
MAX_PARTICIPLES = 0.03
MAX_SHARED_CONSTANTS = 40  # names that stand in several modules with other values
MAX_MEAN_WORDS, MAX_WORDS = 18.0, 40  # of a sentence
IRREGULAR = re.findall(
    r"\w+",
    "been begun bent born bought built caught come cut done drawn driven fallen felt found given gone grown heard held"
    " hidden hit kept known laid left lent lost made meant met paid put risen run said seen sent set shown shut spread"
    " swept taken told thought thrown torn understood woken won worn written",
)
NOUNS = {"set", "cut", "put", "spread", "run", "need", "speed", "seed", "bed", "feed", "read"}  # no participles here
PAGES = sorted(
    p
    for p in ROOT.rglob("*.md")
    if not {".venv", "build", "made", "results", "measured", ".pytest_cache"} & set(p.relative_to(ROOT).parts)
)


def trees() -> dict[Path, ast.Module]:
    """Every module of the program, parsed."""
    files = [*(ROOT / "flashtemp").rglob("*.py"), *(ROOT / "viz").rglob("*.py"), *(ROOT / "meshes").rglob("*.py")]
    return {file: ast.parse(file.read_text(encoding="utf-8")) for file in files}


@pytest.fixture(scope="module")
def modules() -> dict[Path, ast.Module]:
    return trees()


@pytest.fixture(scope="module")
def names(modules) -> list[str]:
    """Names of all functions and methods but those with two underscores."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    found = [node.name for tree in modules.values() for node in ast.walk(tree) if isinstance(node, kinds)]
    return [name for name in found if not name.startswith("__")]


def words(name: str) -> list[str]:
    """The words of a name.

    >>> words("_solve_contact")
    ['solve', 'contact']
    """
    return [word for word in name.split("_") if word]


def is_participle(name: str) -> bool:
    """Whether a name is one word that says what has happened, and not what the thing is."""
    [word, *more] = words(name)
    return not more and word not in NOUNS and (word.endswith("ed") or word in IRREGULAR)


def test_most_functions_have_names_of_several_words(names):
    assert len(names) > 3000
    assert sum(len(words(name)) == 1 for name in names) <= MAX_ONE_WORD * len(names)


def test_hardly_a_function_is_a_bare_participle(names):
    assert sum(map(is_participle, names)) <= MAX_PARTICIPLES * len(names)


def test_a_constant_has_one_value_in_the_whole_program(modules):
    values = defaultdict(set)
    for tree in modules.values():
        for node in tree.body:
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            for target in targets:
                if isinstance(target, ast.Name) and target.id.strip("_").isupper() and getattr(node, "value", None):
                    values[target.id.strip("_")].add(ast.unparse(node.value))
    shared = sorted(name for name, own in values.items() if len(own) > 1)
    assert len(shared) <= MAX_SHARED_CONSTANTS, shared


def sentences(text: str) -> list[str]:
    """Sentences of the prose of a page: no tables, headings, code and formulas.

    >>> sentences("# Head\\n\\nOne `x y z` here.  Two\\nare there.\\n\\n| a | b |\\n")
    ['One Code here.', 'Two are there.']
    """
    text = re.sub(r"<!--.*?-->|^(```|~~~|:::).*?^(```|~~~|:::)|\$\$.*?\$\$", "\n\n", text, flags=re.S | re.M)
    text = re.sub(r"^(#|\||!\[|    ).*$", "", text, flags=re.M)
    blocks = re.split(r"\n\s*\n|\n(?=\s*(?:[-*+]|\d+\.)\s)", text)
    out = []
    for block in blocks:
        plain = re.sub(r"^\s*([-*+]|\d+\.)\s+", "", " ".join(block.split()))
        plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", plain)
        plain = re.sub(r"[*_]{1,2}", "", re.sub(r"\$[^$]*\$", "formula", re.sub(r"`[^`]*`", "Code", plain)))
        out += re.split(r"(?<=[.!?])[\"')]*\s+(?=[A-Z0-9(\"'])", plain)
    return [sentence for sentence in out if sentence]


def lengths(text: str) -> list[int]:
    """Words of every sentence of a page that has three or more."""
    found = [len(re.findall(r"[A-Za-z0-9][\w'%/.,+-]*", sentence)) for sentence in sentences(text)]
    return [n for n in found if n >= 3]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_sentences_are_short(page):
    counted = lengths(page.read_text(encoding="utf-8"))
    if counted:
        assert mean(counted) <= MAX_MEAN_WORDS or len(counted) < 5
        assert max(counted) <= MAX_WORDS
