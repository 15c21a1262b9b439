"""Wave specs: what can be asked for, what is refused, and that the study runs what the spec says."""

import copy
import csv
import io
from typing import Any

import numpy as np
import pytest

from musatpy.errors import SpecError
from musatpy.reports.sea import points_csv, waves_text
from musatpy.sea.experiment import (
    WaveSpec,
    experiment,
    flying_height,
    lengths_and_speeds,
    run,
    study,
    surface_of,
    theory_of,
)
from musatpy.specs import spec_of
from studies import okamoto

SEA: dict[str, Any] = {
    "stereo": {"cameras": [[0.0, 0.0, 490.0], [264.0, 5.0, 488.0]], "interval": 3.0},
    "water": {"depth": 10.0, "index": 1.333},
    "wave": [{"period": 10.0, "deep_height": 1.0, "azimuth": 30.0}],
    "area": {"first": [0.0, -300.0], "spacing": [66.0, 60.0], "numbers": [6, 11]},
}


def sea(**changes: Any) -> WaveSpec:
    """Return the spec with values of its tables, `table__key`, or whole tables replaced."""
    raw = copy.deepcopy(SEA)
    for path, value in changes.items():
        table, _, name = path.partition("__")
        if name and table == "wave":
            raw["wave"][0][name] = value
        elif name:
            raw.setdefault(table, {})[name] = value
        else:
            raw[table] = value
    return spec_of(WaveSpec, raw)


def test_the_experiment_of_the_paper_as_a_spec() -> None:
    """Table 7, 500 m, 10 m deep, not simultaneous: mean water as height 0; lengths, heights and speeds given."""
    paper = okamoto.experiment(7, 500, 10, simultaneous=False)
    waves = [
        {
            "period": float(period), "height": 2.0 * okamoto.AMPLITUDE[period][10], "azimuth": 30.0,
            "length": okamoto.LENGTH[period][10], "speed": okamoto.SPEED[period][10],
            "crest": okamoto.PHASE[period][10] + okamoto.LENGTH[period][10] / 4.0,
        }
        for period in (okamoto.LONG, okamoto.SHORT)
    ]  # fmt: skip
    cameras = (okamoto.STATIONS[500] + [0.0, 0.0, 490.0]).tolist()
    area = {"first": [0.0, -330.0], "spacing": [33.0, 33.0], "numbers": [11, 21]}
    spec = sea(stereo={"cameras": cameras, "interval": 3.0}, wave=waves, area=area)
    np.testing.assert_allclose(run(experiment(spec)).error, run(paper).error, atol=1e-9)  # rounding of 500 m


def test_waves_follow_the_theory_or_what_is_given() -> None:
    theory = theory_of(sea(water__gravity=9.8))
    assert f"{theory.length[0]:.0f} {theory.height[0]:.2f}" == "92 0.98"  # Okamoto (1982), Table 1
    length, speed = lengths_and_speeds(sea(wave__length=80.0))
    assert (length[0], speed[0]) == (80.0, 8.0)
    assert lengths_and_speeds(sea(wave__speed=0.0))[1][0] == 0.0
    given = sea(wave=[{"period": 5.0, "height": 0.4}])
    assert theory_of(given).height[0] == 0.4 and surface_of(given).limits.highest == pytest.approx(0.2)


def test_what_is_varied_is_what_a_spec_of_its_own_would_say() -> None:
    result = study(sea(study={"depths": [5.0, 20.0], "periods": [6.0], "intervals": [0.0], "phases": 4}))
    by_name = {trials.name: trials.trials for trials in result.studies}
    assert list(by_name) == ["Depth", "Period", "Interval", "Exposure"]
    for trial, same in (
        (by_name["Depth"][0], sea(water__depth=5.0)),
        (by_name["Period"][0], sea(wave__period=6.0)),
        (by_name["Interval"][0], sea(stereo__interval=0.0)),
    ):
        np.testing.assert_array_equal(trial.spread.sigma, study(same).spread.sigma)
    assert [trial.value for trial in by_name["Exposure"]] == [0.0, 2.5, 5.0, 7.5]
    np.testing.assert_array_equal(by_name["Exposure"][0].spread.sigma, result.spread.sigma)
    # a quarter of a period later crests are a quarter of a length further on
    quarter = float(lengths_and_speeds(sea())[0][0]) / 4.0
    moved = study(sea(wave__crest=quarter)).spread
    np.testing.assert_allclose(by_name["Exposure"][1].spread.sigma, moved.sigma, atol=1e-9)  # rounding


def test_a_trial_that_cannot_be_run_says_why() -> None:
    result = study(sea(study={"depths": [0.1, 5.0]}))
    failed, done = result.studies[0].trials
    assert "stands above the water in a trough" in failed.reason and failed.spread is None
    assert done.spread is not None and not done.reason
    assert "note: depth 0.1 m: point" in waves_text(result)


def test_the_report_says_what_was_found() -> None:
    spec = sea(title="A SEA", wave__deep_height=9.0, study={"depths": [12.0]})
    result = study(spec)
    text = waves_text(result)
    lines = text.splitlines()
    assert lines[0] == "A SEA"
    assert "note: wave 1 is higher than a wave of its length can stand there" in lines
    height = next(line for line in lines if line.startswith("Z  "))
    assert f"{result.spread.sigma[2]:.3f}" in height and height.endswith("exceeded")
    bars = [line for line in lines if line.endswith("*" * 50)]
    assert len(bars) >= 3  # the fullest bin of each coordinate
    assert max(len(line) for line in lines) <= 132


def test_rays_with_several_refraction_points_are_reported() -> None:
    steep = [{"period": 1.2, "height": 0.2, "azimuth": 10.0}]
    area = {"first": [100.0, -20.0], "spacing": [20.0, 20.0], "numbers": [2, 3]}
    result = study(sea(wave=steep, area=area, water={"depth": 20.0, "index": 1.333}))
    several = int((result.errors.number > 1).sum())
    assert several > 0 and (result.errors.number % 2 == 1).all()
    assert f"Rays with several refraction points: {several} of 12" in waves_text(result)


def test_every_point_stands_in_the_table() -> None:
    result = study(sea())
    rows = list(csv.DictReader(io.StringIO(points_csv(result))))
    assert [int(row["no"]) for row in rows] == list(range(1, 67))
    error = np.array([[float(row[name]) for name in ("dx", "dy", "dz")] for row in rows])
    np.testing.assert_allclose(error, result.errors.error, atol=0.5001e-4)  # as printed
    assert (rows[12]["x"], rows[12]["y"], rows[12]["z"]) == ("66.0000", "-240.0000", "-10.0000")


def test_other_shapes_points_far_off_and_another_accuracy() -> None:
    """Two rays of each of 66 points, 3 km away, are beyond 60 degrees; none of them near by."""
    crest = np.zeros(2)
    plain, *others = (
        surface_of(sea(wave__shape=shape, wave__deep_height=0.8)).relief(crest).height
        for shape in ("sinusoidal", "stokes", "trochoidal")
    )
    assert min(others) > plain
    far = waves_text(study(sea(area__first=[3000.0, -300.0])))
    assert "note: 132 rays are more than 60 degrees from the vertical" in far
    near = study(sea(accuracy={"plan": 1000.0, "height": 499.0}))
    assert "from the vertical" not in waves_text(near) and flying_height(near.spec) == 499.0
    np.testing.assert_allclose(near.spread.allowed, [0.499, 0.499, 1.0])
    assert near.spread.kept.all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wave": []}, r"there is no \[\[wave\]\]"),
        ({"wave": [{"period": 3.0, "height": 1.0, "deep_height": 1.0}]}, "one of deep_height, height"),
        ({"wave__period": -1.0}, r"wave\[1\].period: -1.0 is below 0.01"),
        ({"wave__shape": "square"}, "'square' is not one of sinusoidal, stokes, trochoidal"),
        ({"stereo__cameras": [[0.0, 0.0, 5.0], [0.0, 9.0, 5.0]]}, "no component along x"),
        ({"stereo__cameras": [[0.0, 0.0, 5.0], [9.0, 9.0, -5.0]]}, "is above the water"),
        ({"area__numbers": [1, 5]}, "below 2"),
        ({"wave__length": 50.0, "study": {"periods": [3.0]}}, "wave 1 does not follow the period"),
        ({"wave__shape": "stokes", "wave__deep_height": 3.0}, "too high for second-order theory"),
        ({"wave__shape": "trochoidal", "wave__deep_height": 40.0}, "to its length over 2 pi"),
        ({"water__depth": 0.2}, "stands above the water in a trough"),
        ({"stereo__cameras": [[0.0, 0.0, 0.1], [264.0, 0.0, 490.0]]}, "camera is not above the water"),
    ],
)
def test_what_cannot_be_is_said(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        study(sea(**changes))
