"""Imports run one way: chapters, study, radar and baselines, core, kernel."""

import ast
import re
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "d2d"
MODULES = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in PACKAGE.rglob("*.py")
}
# What a part may not import. A subject of the study may import those that come before it.
SUBJECTS = (
    *("book", "mixtures", "point_sets", "line", "plane", "drives"),
    *("estimation", "road", "beyond", "guides"),
)
# Clauses and pronouns that a reader cannot search for; `Whether` names a truth value.
NO_NOUN = re.compile(r"(What|Those|The same|It|This|These|They|That|Which)\b")
OPTIONAL = ("evo", "joblib", "matplotlib", "pandas", "tqdm")  # of the extras `study` and `track`
REPOSITORY = PACKAGE.parent
# The most lines that each room may have, and how many it is meant to come down to.  A number is
# only lowered; a new feature says what leaves.
ROOMS = {
    "d2d/*.py": (2925, 2700),
    "d2d/_kernel/**/*.py": (2900, 2900),
    "d2d/baselines/**/*.py": (396, 400),
    "d2d/radar/**/*.py": (8456, 8300),
    "d2d/study/**/*.py": (10_700, 10_400),
    "benchmarks/**/*.py": (1586, 1700),
    "tests/**/*.py": (18_190, 18_000),
    "_static/labs/**/*.js": (5892, 6000),
    "_static/**/*.css": (800, 800),
    "_static/*.js": (100, 100),
    "tools/**/*.py": (863, 800),
}


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(name: str) -> set[str]:
    """The modules of the package that a module imports, at its top or within a function."""
    found = set()
    for node in ast.walk(tree(MODULES[name])):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add(whole if whole in MODULES else node.module)
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found & MODULES.keys()


def part(name: str) -> str:
    """The part of the package that a module belongs to, "" for the core."""
    second = (*name.split("."), "")[1]
    return second if second in ("radar", "baselines", "study") else ""


def test_the_package_has_modules():
    """Breaks if the pattern above finds nothing, and so nothing is checked."""
    assert len(MODULES) > 50
    assert "d2d.point_set" in imports("d2d.registration")


def test_no_circle():
    """Breaks if two modules need each other, directly or through others."""
    assert list(TopologicalSorter({name: imports(name) for name in MODULES}).static_order())


@pytest.mark.parametrize(("room", "most"), [(room, most) for room, (most, _) in ROOMS.items()])
def test_rooms_keep_their_size(room: str, most: int):
    """Breaks if a room has more lines than it may, or if the pattern finds none."""
    lines = sum(len(path.read_text("utf-8").splitlines()) for path in REPOSITORY.glob(room))
    assert 0 < lines <= most


def test_functions_have_at_most_eight_positional_parameters():
    """Breaks if a function of the kernel goes back to a list of twenty arguments."""
    for name, path in MODULES.items():
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.FunctionDef):
                given = [*node.args.posonlyargs, *node.args.args]
                own = [argument.arg for argument in given if argument.arg not in ("self", "cls")]
                assert len(own) <= 8, f"{name}.{node.name}"


def test_imports_run_one_way():
    """Breaks if the core learns of radar or of the study, or radar of the study."""
    allowed = {
        "": {""},
        "radar": {"", "radar"},
        "baselines": {"", "baselines"},
        "study": {"", "radar", "baselines", "study"},
    }
    for name in MODULES:
        assert {part(imported) for imported in imports(name)} <= allowed[part(name)], name


def test_a_subject_of_the_study_imports_earlier_ones_only():
    """Breaks if the shared part needs a subject, or an earlier subject a later one."""
    order = {subject: place for place, subject in enumerate(SUBJECTS)}
    for name in MODULES:
        if not name.startswith("d2d.study.") or name == "d2d.study.claims":  # of all subjects
            continue
        place = order.get(name.split(".")[2], -1)
        for imported in imports(name):
            if imported.startswith("d2d.study."):
                assert order.get(imported.split(".")[2], -1) <= place, f"{name}: {imported}"


def test_core_and_radar_need_no_optional_package():
    """Breaks if `pip install d2d` is not enough for `import d2d.radar`."""
    program = f"""
import sys
sys.modules.update(dict.fromkeys({OPTIONAL!r}))
import d2d, d2d.radar, d2d.baselines
assert not {{"scipy.linalg", "scipy.special"}} & {{*sys.modules}}, "they take as long as all else"
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_docstring_begins_with_a_verb_or_a_noun():
    """Breaks if a first line says "what is", "those of" or "the same" instead of naming it."""
    rooms = (PACKAGE, PACKAGE.parent / "benchmarks", PACKAGE.parent / "tools")
    for path in (path for room in rooms for path in room.rglob("*.py")):
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                if "claim(" in "".join(map(ast.unparse, getattr(node, "decorator_list", []))):
                    continue  # a sentence of the thesis
                first = (ast.get_docstring(node) or "").split("\n")[0]
                assert not NO_NOUN.match(first), f"{path}: {first}"
