"""Model ids on the command line."""

import argparse

import pytest

from volillum_addon.blender.arguments import model_id, model_ids

PAIR = "sun=half_angle,sky=spherical_harmonics"


@pytest.mark.parametrize(
    ("text", "ids"),
    [
        ("half_angle", ("half_angle",)),
        ("half_angle, photon_mapping", ("half_angle", "photon_mapping")),
        (PAIR, (PAIR,)),
        (f"half_angle,{PAIR},photon_mapping", ("half_angle", PAIR, "photon_mapping")),
        (f"{PAIR},{PAIR}", (PAIR, PAIR)),
        ("sky=spherical_harmonics,sun=half_angle", (PAIR,)),
    ],
)
def test_neighbours_are_one_composition_until_a_kind_comes_again(
    text: str, ids: tuple[str, ...]
) -> None:
    assert model_ids(text) == ids


@pytest.mark.parametrize("text", ["nothing", "sun=half_angle", "sun=half_angle,nothing", ""])
def test_unknown_models_are_wrong_usage(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        model_ids(text)


def test_one_model() -> None:
    assert model_id(f" {PAIR}") == PAIR
