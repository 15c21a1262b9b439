"""The picture of differences: what stands where, on which axes."""

import numpy as np
import pytest

from musatpy.soundings.differences import Differences, regression
from musatpy.soundings.pictures import difference_figure, difference_picture


def sample(number: int = 60) -> tuple[Differences, np.ndarray]:
    """Return differences that grow with depth, the first a blunder, and their places."""
    draws = np.random.default_rng(5)
    sounded = np.linspace(1.0, 20.0, number)
    compiled = sounded + 0.2 - 0.05 * sounded + 0.05 * draws.normal(size=number)
    compiled[0] += 9.0
    names = np.arange(number).astype(np.str_)
    differences = Differences(names=names, compiled=compiled, sounded=sounded, sigma=np.full(number, 0.1))
    return differences, np.column_stack([np.arange(number), 100.0 + draws.uniform(0.0, 9.0, number)])


def test_lines_and_dots_stand_where_the_numbers_say() -> None:
    differences, xy = sample()
    against, by_size, on_map = difference_figure(differences, xy, "s").axes[:3]
    lines = {line.get_label(): np.array(line.get_data()) for line in against.lines}
    np.testing.assert_array_equal(lines["soundings"], [differences.sounded[1:], differences.compiled[1:]])
    np.testing.assert_array_equal(lines["blunders"], [differences.sounded[:1], differences.compiled[:1]])
    np.testing.assert_array_equal(*lines["1:1"])
    line = regression(differences)
    assert line is not None
    (label,) = (label for label in lines if label.endswith("x depth"))
    x, y = lines[label]
    np.testing.assert_allclose(y - x, line.a + line.b * x, atol=1e-12)  # rounding
    assert label == f"{line.a:+.3f} m {line.b:+.4f} x depth" and line.a > 0.1 > -0.04 > line.b
    assert sum(bar.get_height() for bar in by_size.patches) == 59
    shoaler, deeper = on_map.collections
    low, high = shoaler.get_clim()
    assert low == -high and 0.5 < high < 1.0 and deeper.get_clim() == (low, high)  # zero is the pale middle
    named = [line for line in on_map.lines if line.get_label().startswith("compiled")]
    assert {line.get_label(): line.get_marker() for line in named} == {
        "compiled shoaler": "^",
        "compiled deeper": "v",
    }
    np.testing.assert_array_equal(deeper.get_offsets(), xy[1:][differences.difference[1:] > 0.0])
    assert (shoaler.get_array() <= 0.0).all() and len(shoaler.get_offsets()) + len(deeper.get_offsets()) == 59


def test_axes_have_units() -> None:
    for axes in difference_figure(*sample(), "s").axes[:3]:
        texts = axes.get_xlabel() + axes.get_ylabel()
        assert ", m" in texts


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3])
def test_few_soundings_are_drawn(number: int) -> None:
    differences, xy = sample()
    rows = np.arange(len(xy)) < number
    assert difference_picture(differences.part(rows), xy[rows], "few").startswith(b"\x89PNG")
