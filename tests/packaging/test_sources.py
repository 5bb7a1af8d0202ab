"""What others made ships unchanged, with its licence, and is listed in SOURCES.md."""

import hashlib
from pathlib import Path

import pytest
from project_files import ROOT

VOLUMES = sorted((ROOT / "presets" / "volumes").glob("*.vdb"))
CODE = sorted((ROOT / "native" / "third_party").glob("*/*.h"))


def test_a_volume_ships() -> None:
    assert VOLUMES


@pytest.mark.parametrize("path", VOLUMES, ids=lambda path: path.name)
def test_a_volume_is_listed_with_its_hash_and_licence(path: Path) -> None:
    check(path, path.with_name(f"{path.stem}.LICENSE.txt"))


@pytest.mark.parametrize("path", CODE, ids=lambda path: path.name)
def test_code_of_others_is_listed_with_its_hash_and_licence(path: Path) -> None:
    check(path, path.with_name("LICENSE.md"))


def check(path: Path, licence: Path) -> None:
    name = path.relative_to(ROOT).as_posix()
    assert licence.is_file()
    (line,) = [
        line for line in (ROOT / "SOURCES.md").read_text().splitlines() if f"`{name}`" in line
    ]
    assert hashlib.sha256(path.read_bytes()).hexdigest() in line
    assert licence.relative_to(ROOT).as_posix() in line
