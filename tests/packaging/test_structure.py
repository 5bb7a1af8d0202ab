"""The tree and the arrow of imports: core <- models <- bake <- readers <- compare <- blender."""

import ast
import os
import subprocess
import sys
from pathlib import Path, PurePosixPath

import pytest
from project_files import ROOT, tracked_files

LAYERS = ("core", "models", "bake", "readers", "compare", "blender")
# Whoever imports one of these needs Blender running; openvdb lies in its package but does without.
# Published for the first of Blender's Pythons alone (tools/build_extension.py).
SOME_LACK = {"flip_evaluator"}
BLENDER_MODULES = {
    "_cycles",
    "addon_utils",
    "bl_ui",
    "blf",
    "bpy",
    "bpy_extras",
    "gpu",
    "mathutils",
}
# A process elsewhere that imports what this one does.
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}

# The tree: for each folder what may lie directly in it. "*.py" are files, "name/" a folder of which
# the contents are free, or listed on their own line.
TREE = {
    ".": """.ci/ .gitignore blender_manifest.toml __init__.py pyproject.toml requirements.lock
            Makefile README.md LICENSE CHANGELOG.md SOURCES.md
            volillum_addon/ native/ presets/ tests/ docs/ tools/""",
    "volillum_addon": """__init__.py __main__.py py.typed resources.py
                         core/ models/ bake/ readers/ compare/ blender/""",
    "native": """.clang-format CMakeLists.txt pyproject.toml wheel_version.py
                 include/ src/ third_party/""",
    "native/include": "volillum/",
    "native/src": "module.cpp bindings/ engines/ exact/ models/",
    "tests": """*.py benchmarks/ bake/ blender/ compare/ core/ hard_cases/ models/ native/
                mutations/ packaging/ plugins/ readers/ window/""",
}


def modules() -> list[Path]:
    return sorted((ROOT / "volillum_addon").rglob("*.py"))


def name_of(module: Path) -> str:
    return module.relative_to(ROOT).as_posix()


def layer(parts: tuple[str, ...]) -> str | None:
    """The layer of a module given by its path below volillum_addon; None for the package's own."""
    return parts[0] if parts and parts[0] in LAYERS else None


def imports(module: Path) -> list[tuple[int, tuple[str, ...], bool, bool]]:
    """Every import: how many dots, the names, inside a function or not, only for types or not.

    `from ..core import grid` has 2 dots and the names (core, grid).
    """
    tree = ast.parse(module.read_text(), str(module))
    inside: set[ast.AST] = set()
    typing: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            inside.update(ast.walk(node))
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            typing.update(child for statement in node.body for child in ast.walk(statement))
    found = []
    for node in ast.walk(tree):
        where = (node in inside, node in typing)
        if isinstance(node, ast.Import):
            found += [(0, tuple(alias.name.split(".")), *where) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = tuple(node.module.split(".")) if node.module else ()
            found += [(node.level, (*base, alias.name), *where) for alias in node.names]
    return found


@pytest.mark.parametrize("module", modules(), ids=name_of)
def test_imports_inside_the_package_are_relative(module: Path) -> None:
    absolute = [names for dots, names, *_ in imports(module) if not dots]
    assert not [names for names in absolute if names[0] in ("volillum", "volillum_addon")]


@pytest.mark.parametrize("module", modules(), ids=name_of)
def test_only_blender_imports_blender(module: Path) -> None:
    found = {names[0] for dots, names, *_ in imports(module) if not dots} & BLENDER_MODULES
    assert not found or layer(module.relative_to(ROOT / "volillum_addon").parts) == "blender"


@pytest.mark.parametrize("module", modules(), ids=name_of)
def test_imports_run_one_way(module: Path) -> None:
    path = module.relative_to(ROOT / "volillum_addon").parts
    own = layer(path)
    for dots, names, inside_a_function, only_for_types in imports(module):
        if not dots:
            continue
        assert dots <= len(path), f"{name_of(module)} leaves the package"
        target = layer((*path[: len(path) - dots], *names))
        if own is not None and target is not None:
            assert LAYERS.index(target) <= LAYERS.index(own), f"{own} imports {target}"
        elif own is None:
            # The package itself may reach any layer, but Blender's only when it is called.
            lazy = inside_a_function or only_for_types or module.name == "__main__.py"
            assert target != "blender" or lazy, f"{name_of(module)} imports blender at once"


def test_one_module_finds_openvdb() -> None:
    users = {
        name_of(module)
        for module in modules()
        if any(names[0] == "openvdb" for dots, names, _, typing in imports(module) if not typing)
    }
    assert len(users) <= 1, users


def blocked_run(code: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Runs code in a process where importing Blender, its modules, or what some Blenders lack
    fails."""
    blocked = {*BLENDER_MODULES, *SOME_LACK}
    block = (
        "import sys\n"
        "class Block:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name.split('.')[0] in {blocked!r}:\n"
        "            raise ImportError(f'{name} is blocked')\n"
        "sys.meta_path.insert(0, Block())\n"
    )
    return subprocess.run(
        [sys.executable, "-c", block + code],
        cwd=cwd,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )


def test_everything_but_blender_works_without_bpy(tmp_path: Path) -> None:
    names = [
        ".".join(module.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for module in modules()
        if "blender" not in module.parts and module.name != "__main__.py"
    ]
    code = "".join(f"import {name}\n" for name in names)
    result = blocked_run(code, tmp_path)
    assert result.returncode == 0, result.stderr
    # The block works: what needs Blender does not load.
    assert "blocked" in blocked_run("import volillum_addon.blender.operators", tmp_path).stderr


def test_importing_the_package_does_not_load_blender(tmp_path: Path) -> None:
    code = "import sys, volillum_addon\nassert 'bpy' not in sys.modules\n"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=ENVIRONMENT, check=True)


def test_the_shim_imports_nothing_at_import_time() -> None:
    shim = ROOT / "__init__.py"
    assert [entry for entry in imports(shim) if not entry[2]] == []
    functions = {
        node.name for node in ast.parse(shim.read_text()).body if isinstance(node, ast.FunctionDef)
    }
    assert functions == {"register", "unregister"}


def allowed(path: PurePosixPath) -> bool:
    """Whether the tree has a place for this file."""
    for folder in (path.parent, *path.parent.parents):
        rules = TREE.get(str(folder))
        if rules is None:
            continue
        entry = path.relative_to(folder).parts
        for rule in rules.split():
            matches = PurePosixPath(entry[0]).match(rule.rstrip("/"))
            if matches and rule.endswith("/") == (len(entry) > 1):
                return True
        return False
    return False


def test_every_file_has_its_place_in_the_tree() -> None:
    assert [str(path) for path in tracked_files() if not allowed(path)] == []


def test_the_tree_test_notices_a_stray_file() -> None:
    strays = ("notes.txt", "volillum_addon/helpers.py", "native/src/sweep.cpp", "build/x", "core/x")
    assert [name for name in strays if allowed(PurePosixPath(name))] == []
