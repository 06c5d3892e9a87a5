"""Names of files, classes, functions and parameters are the field's, not everyday words."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
EVERYDAY = frozenset(
    ["apart", "asked", "found", "left", "least", "most"]
    + ["now", "one", "own", "seen", "there", "told"]
)
"""Words that tell no reader what a name stands for: say residual, candidate, stated, measured."""
SHARE = 0.0036
"""Of names that may hold one of them, at most: a little above what `python tests/test_names.py`
prints. Lower it as that falls."""


def names_of(file: Path) -> Iterator[str]:
    """What a file defines: itself, its classes, its functions and their parameters."""
    yield file.stem
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg


def everyday(name: str) -> bool:
    return not EVERYDAY.isdisjoint(name.lower().strip("_").split("_"))


def counted() -> tuple[int, Counter[str], dict[str, Counter[str]]]:
    """Names in all, everyday ones among them, and these by the folder that defines them."""
    total, all_of_them = 0, Counter[str]()
    by_folder: dict[str, Counter[str]] = {}
    for file in sorted([*ROOT.glob("twin/**/*.py"), *ROOT.glob("papers/*.py")]):
        folder = file.relative_to(ROOT).parts[:-1][:2][-1]
        for name in names_of(file):
            total += 1
            if everyday(name):
                all_of_them[name] += 1
                by_folder.setdefault(folder, Counter())[name] += 1
    return total, all_of_them, by_folder


def test_everyday_words_are_a_small_share_of_names():
    total, found, by_folder = counted()
    share = found.total() / total
    words = "; ".join(f"{folder}: {', '.join(count)}" for folder, count in by_folder.items())
    assert share <= SHARE, f"{share:.2%} of names hold an everyday word, of {SHARE:.2%}: {words}"


if __name__ == "__main__":
    total, found, by_folder = counted()
    print(f"{found.total() / total:.2%} of {total} names hold an everyday word")
    for folder, count in sorted(by_folder.items(), key=lambda item: -item[1].total()):
        print(f"{folder}: {', '.join(f'{name} {number}' for name, number in count.most_common())}")
