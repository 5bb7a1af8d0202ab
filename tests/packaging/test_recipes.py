"""Every recipe of the documentation and every script of the README runs as it stands, and the pages
about the models are what the code prints."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from project_files import ROOT

from volillum_addon.blender.model_page import as_page
from volillum_addon.models.registry import MODELS

FENCED = re.compile(r"^```(sh|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *[
    path for path in sys.path if "scripts" not in Path(path).parts]])}  # fmt: skip


def recipes(file: str) -> list[tuple[str, str]]:
    return FENCED.findall((ROOT / file).read_text(encoding="utf-8"))


def run(command: list[str], folder: Path) -> str:
    done = subprocess.run(
        command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a reader of the documentation stands: beside the presets."""
    made = tmp_path_factory.mktemp("recipes")
    shutil.copytree(ROOT / "presets", made / "presets")
    return made


def test_there_are_recipes_of_both_kinds() -> None:
    kinds = [kind for kind, _ in recipes("docs/recipes.md")]
    assert kinds.count("python") >= 3
    assert kinds.count("sh") >= 2
    assert [kind for kind, _ in recipes("README.md")] == ["python"]


@pytest.mark.parametrize(
    "script",
    [text for file in ("README.md", "docs/recipes.md") for kind, text in recipes(file)
     if kind == "python"],
)  # fmt: skip
def test_a_script_runs(script: str, folder: Path) -> None:
    run([sys.executable, "-c", script], folder)


def test_the_commands_run_one_after_another(folder: Path) -> None:
    for kind, text in recipes("docs/recipes.md"):
        if kind != "sh":
            continue
        for line in text.strip().splitlines():
            program, *arguments = line.split()
            assert program == "volillum"
            run([sys.executable, "-m", "volillum_addon", *arguments], folder)
    assert len(list((folder / "frames").glob("*.vdb"))) == 3
    for name, count in (("puffs", 2), ("steams", 3), ("faints", 2)):
        assert len(list((folder / name).glob("*.ambient_occlusion.*.vdb"))) == count
    assert len(list(folder.glob("coarse_*.vdb"))) == 2


@pytest.mark.parametrize("model", MODELS)
def test_a_models_page_is_what_the_code_prints(model: str) -> None:
    """`volillum models --pages docs/models` after a change of a model."""
    page = ROOT / "docs" / "models" / f"{model}.md"
    assert page.read_text(encoding="utf-8") == as_page(MODELS[model])


def test_links_of_the_documentation_lead_somewhere() -> None:
    broken = []
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        text = page.read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", text):
            if "://" not in target and not (page.parent / target).exists():
                broken.append(f"{page.relative_to(ROOT)}: {target}")
    assert broken == []
