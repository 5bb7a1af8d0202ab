"""Photon mapping from the command line: it stops at the passes, the error or the time asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import session
from plumes import write_plume

from volillum_addon.bake.vdb import read_metadata, read_vdb

ENDLESS = 1_000_000
# Of a pass: more than any machine traces in the least time that can be asked for.
MANY = 20_000
CALLS: dict[str, dict[str, float]] = {
    "2 passes": {"passes": 2, "photons": MANY},
    "4 passes": {"passes": 4},
    "64 passes": {"passes": 64},
    "error": {"passes": ENDLESS, "error": 0.04},
    "no error": {"passes": 4, "error": 1e-6},
    "seconds": {"passes": ENDLESS, "seconds": 0.3, "photons": MANY},
    "no time": {"passes": ENDLESS, "seconds": 1e-3, "photons": MANY},
}


@pytest.fixture(scope="module")
def bakes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The files of CALLS, each as its call printed it."""
    folder = tmp_path_factory.mktemp("stops")
    write_plume(folder / "plume.vdb")
    calls = [["scene", "plume.vdb", "-o", "plume.blend"]]
    for wanted in CALLS.values():
        given = [f"{name}={value}" for name, value in {"photons": 500, **wanted}.items()]
        settings = [word for each in given for word in ("--set", each)]
        calls.append(["bake", "plume.blend", "--model", "photon_mapping", *settings, "-o", "bakes"])
    results = session(folder, *calls)
    assert [result.status for result in results] == [0] * len(calls)
    paths = [folder / result.out.strip() for result in results[1:]]
    assert len(set(paths)) == len(CALLS)
    return dict(zip(CALLS, paths, strict=True))


def error(path: Path) -> float:
    """The relative error that the file states."""
    return float(read_metadata(path)["error_estimate"])


def same(first: Path, second: Path) -> bool:
    """Whether both files hold the same bits."""
    one, two = read_vdb(first).channels, read_vdb(second).channels
    return all(np.array_equal(one[name].values, two[name].values) for name in one)


def test_it_stops_at_the_number_of_passes(bakes: dict[str, Path]) -> None:
    """16 times the passes have a quarter of the error; of 4 passes it is itself known to a third.

    A stricter error does not lengthen the run.
    """
    assert error(bakes["4 passes"]) / error(bakes["64 passes"]) == pytest.approx(4, rel=1 / 3)
    assert same(bakes["4 passes"], bakes["no error"])


def test_it_stops_at_the_error(bakes: dict[str, Path]) -> None:
    """The error is looked at after every eighth more passes: at most a sixteenth below, and what
    the estimate itself moves by."""
    assert 0.9 * CALLS["error"]["error"] < error(bakes["error"]) <= CALLS["error"]["error"]


def test_it_stops_at_the_time(bakes: dict[str, Path]) -> None:
    """Not before it, and with the fewest passes that have an error where there is none to spend."""
    assert same(bakes["no time"], bakes["2 passes"])
    assert read_metadata(bakes["seconds"])["seconds"] >= CALLS["seconds"]["seconds"]
    assert error(bakes["seconds"]) < error(bakes["no time"])
