"""The paper's figures: one command makes them all, and what their sentences say holds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from matplotlib.image import imread

from docs.paper import __main__ as command
from docs.paper.plate import Plate

NAMES = ["03", "04", "05", "06", "07a", "07b", *(f"{number:02d}" for number in range(8, 21))]

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Mapping[str, Plate]]:
    directory = tmp_path_factory.mktemp("paper")
    plates = command.main(["--out", str(directory)], standalone_mode=False)
    return directory, {plate.name: plate for plate in plates}


def test_every_figure_is_drawn_and_told_about(made: tuple[Path, Mapping[str, Plate]]) -> None:
    """Every figure of the paper from 3 to 20 exists, shows something, and stands on the page; together below 3 MB."""
    directory, plates = made
    assert list(plates) == NAMES
    text = (directory / "README.md").read_text(encoding="utf-8")
    for name in NAMES:
        picture = imread(directory / "figures" / f"figure_{name}.png")
        assert picture[..., :3].std() > 0.02, name
        assert f"(figures/figure_{name}.png)" in text
        assert plates[name].here in text
    assert sum(file.stat().st_size for file in (directory / "figures").iterdir()) < 3_000_000


def test_potential_of_the_linear_cubic_system(made: tuple[Path, Mapping[str, Plate]]) -> None:
    """U(x) is within 2 % of the target at 0.1 % damping and within 5 % at 1 %, where the samples scatter more."""
    _, plates = made
    assert plates["04"].numbers["potential_error"] < 0.02
    assert plates["05"].numbers["potential_error"] < 0.05
    assert plates["05"].numbers["scatter"] > 2.0 * plates["04"].numbers["scatter"]


def test_damping_of_the_linear_system(made: tuple[Path, Mapping[str, Plate]]) -> None:
    """Equivalent damping is within 5 % and the excitation within 10 % of what was simulated."""
    _, plates = made
    assert abs(plates["09"].numbers["h_error"]) < 0.05
    assert abs(plates["09"].numbers["s0_error"]) < 0.1


def test_stable_is_soft_and_unstable_hard(made: tuple[Path, Mapping[str, Plate]]) -> None:
    """U(x) bends below the linear one in the stable cut and above it near chatter, by several per cent."""
    _, plates = made
    assert plates["14"].numbers["departure"] < -0.05
    assert plates["15"].numbers["departure"] > 0.05
    assert abs(plates["15"].numbers["departure_without_joint"]) < 0.03


def test_the_unstable_damping_potential_is_a_crater(made: tuple[Path, Mapping[str, Plate]]) -> None:
    """The minimum of H(E) lies near the limit cycle's energy, where the equivalent damping changes its sign."""
    _, plates = made
    minimum = plates["16"].numbers["minimum_over_mean"]
    assert 0.6 < minimum < 1.2
    assert 0.6 < plates["16"].numbers["minimum_over_cycle"] < 1.2
    assert plates["18"].numbers["zero_over_mean"] == pytest.approx(minimum, rel=0.15)


def test_damping_falls_to_zero_where_milling_chatters(made: tuple[Path, Mapping[str, Plate]]) -> None:
    """The second mode near 990 Hz has no damping in the chatter stretch, known within 0.3 s, and 2 % before it."""
    _, plates = made
    numbers = plates["20"].numbers
    assert abs(numbers["chatter_damping"]) < 0.001
    assert numbers["stable_damping"] > 0.01
    assert numbers["high_frequency_hz"] == pytest.approx(990.0, rel=0.03)
    assert numbers["low_frequency_hz"] == pytest.approx(95.0, rel=0.05)
    assert 8.9 < numbers["fell_s"] < 9.3
