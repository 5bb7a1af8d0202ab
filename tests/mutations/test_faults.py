"""The list of planted faults (tests/mutations) still fits the code and the tests that it names."""

from __future__ import annotations

from pathlib import Path

import pytest
from mutations.faults import FAULTS, Fault

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_fault_can_be_planted(fault: Fault) -> None:
    assert (ROOT / fault.file).read_text().count(fault.sound) == 1
    for test in fault.noticed_by:
        file, _, name = test.partition("::")
        assert f"def {name}(" in (ROOT / file).read_text()
