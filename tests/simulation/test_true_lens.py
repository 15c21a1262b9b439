"""A lens that is not what the deck says: images, cards, truth, and what a run makes of it."""

import json
from pathlib import Path

import numpy as np
import pytest

from adjustment.test_lenses import TRUE, through_lens
from blocks import converged, simulation
from cli.commands import musat
from musatpy.errors import SpecError
from musatpy.model import LENS_PARAMETERS, DistortionSide, Polynomials
from musatpy.simulation import Simulation

BLOCK = {
    "flight": {"photos": 3, "strips": 2, "height": 1200.0, "reverse_alternate": True, "attitude_scatter": 4.0},
    "terrain": {"level": 60.0, "relief": 40.0, "wavelength": 900.0},
    "water": {},
    "shoal": [{"share": 0.5, "depth": [2.0, 15.0]}],
    "points": {"extra": [{"number": 40}]},
    "control": [{"kind": "full", "number": 5, "sigma": 0.05, "error": 0.0}],
    "measurement": {"noise": 0.0},
    "stations": {"position_error": 0.0, "attitude_error": 0.3, "position_sigma": 0.1},
    "options": {"program": "IIIA"},
}


def planted(side: str, polynomials: str = "DIST", **keys: float) -> Simulation:
    sign = -1.0 if polynomials == "CORR" else 1.0
    table = [
        {"name": name, "change": sign * change if name[0] in "KP" else change, **keys}
        for name, change in TRUE.items()
    ]
    return simulation(5, **BLOCK, lens={"side": side, "polynomials": polynomials, "parameter": table})


@pytest.mark.parametrize("polynomials", Polynomials)
@pytest.mark.parametrize("side", DistortionSide)
def test_images_are_those_of_the_lens(side: DistortionSide, polynomials: Polynomials) -> None:
    """Against images of a perfect lens, displaced by formulas of the tests: both are rounded to a nanometre."""
    perfect, ours = simulation(5, **BLOCK).block, planted(side.value, polynomials.value).block
    expected = through_lens(perfect, side, TRUE)
    names = [
        list(zip(block.photos.ids[block.plates.photo], block.points.ids[block.plates.point], strict=True))
        for block in (ours, expected)
    ]
    row = {name: number for number, name in enumerate(names[1])}
    both = [(number, row[name]) for number, name in enumerate(names[0]) if name in row]
    assert len(both) > 0.95 * len(names[0])
    here, there = np.array(both).T
    np.testing.assert_allclose(ours.plates.xy[here], expected.plates.xy[there], atol=2.1e-6)


@pytest.mark.parametrize("side", DistortionSide)
def test_a_run_finds_the_lens(side: DistortionSide) -> None:
    """Images without error: each parameter to a hundredth of its sigma."""
    simulated = planted(side.value, "CORR")
    solution = converged(simulated.block)
    parameters = solution.parameters
    assert parameters is not None
    true = {truth.name: truth.value for truth in simulated.truth.parameters}
    errors = parameters.value - [true[name] for name in parameters.parameter.tolist()]
    np.testing.assert_array_less(np.abs(errors), 0.01 * parameters.spread / solution.sigma0)


def test_cards_have_values_with_drawn_errors() -> None:
    block = planted("IDEAL", sigma=1e-6).block
    true = [TRUE[name] + {"F": 152.0}.get(name, 0.0) for name in block.lens_unknowns.parameter.tolist()]
    drawn = (block.lens_unknowns.value - true) / 1e-6
    assert 0.3 < np.sqrt(np.mean(np.square(drawn))) < 2.0
    assert (block.lens_unknowns.sigma == 1e-6).all()
    exact = planted("IDEAL", sigma=1e-6, error=0.0).block.lens_unknowns
    np.testing.assert_allclose(exact.value, true, rtol=1e-9)
    assert np.isnan(planted("IDEAL").block.lens_unknowns.value).all()
    assert planted("IDEAL", unknown=False).block.lens_unknowns.count == 0


def test_a_lens_that_cannot_be_is_refused() -> None:
    for lens, message in (
        ({"parameter": [{"name": "K1", "change": 1e-3}]}, "displaced by more than 0.3"),
        ({"parameter": [{"name": "K1"}, {"name": "K1"}]}, "given twice"),
        ({"parameter": [{"name": "K9"}]}, "is not one of F, XP"),
        ({"parameter": [{"name": "F", "sigma": 0.0}]}, "greater than zero"),
        ({"parameter": [{"name": "F", "error": 1.0}]}, "a value with a sigma"),
    ):
        with pytest.raises(SpecError, match=message):
            simulation(5, **BLOCK, lens=lens)


SPEC = """
seed = 3
[flight]
height = 1200.0
attitude_scatter = 4.0
[terrain]
relief = 40.0
[points]
extra = [{ number = 20 }]
[[control]]
kind = "full"
number = 5
sigma = 0.05
error = 0.05
[stations]
position_sigma = 0.1
[lens]
[[lens.parameter]]
name = "F"
change = 0.08
[[lens.parameter]]
name = "XP"
change = 0.02
sigma = 0.01
[options]
program = "IIIA"
"""


def test_a_solution_is_compared_with_the_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Adjusted minus true, in sigmas of the solution, whichever stands first; also of stations and points."""
    monkeypatch.chdir(tmp_path)
    Path("lens.toml").write_text(SPEC, encoding="utf-8")
    assert musat("simulate", "lens.toml").exit_code == 0 and musat("run", "-q", "lens.crd").exit_code == 0
    truth = json.loads(Path("lens.truth.json").read_text(encoding="utf-8"))
    true = {row["parameter"]: row["value"] for row in truth["parameters"]}
    assert list(true) == list(LENS_PARAMETERS) and true["F"] == 152.08 and true["K1"] == 0.0
    assert {(row["kind"], row["of"]) for row in truth["parameters"]} == {("lens", "CAM1")}
    table = json.loads(Path("lens.json").read_text(encoding="utf-8"))["adjusted_parameters"]
    ran = musat("compare", "lens.json", "lens.truth.json", "--json")
    assert ran.exit_code == 0, ran.stderr
    compared = json.loads(ran.stdout)
    assert compared == json.loads(musat("compare", "lens.truth.json", "lens.json", "--json").stdout)
    rows = {row["parameter"]: row for row in compared["parameters"]}
    for name, adjusted, sigma in zip(table["parameter"], table["adjusted"], table["sigma"], strict=True):
        assert rows[name]["value"] == [true[name], adjusted] and rows[name]["sigma"] == sigma
        assert rows[name]["ratio"] == pytest.approx((adjusted - true[name]) / sigma)
        assert abs(rows[name]["ratio"]) < 4.0
    assert len(rows) == 2 and len(compared["stations"]) == 3 and not compared["only_one"]
    assert max(abs(value) for row in compared["stations"] for value in row["ratio"]) < 5.0
    text = musat("compare", "lens.json", "lens.truth.json").stdout
    assert "Adjusted Parameters: lens minus lens.truth" in text
    other = musat("compare", "lens.json", "lens.json", "--json")
    assert [row["ratio"] for row in json.loads(other.stdout)["parameters"]] == [0.0, 0.0]
    both = musat("compare", "lens.truth.json", "lens.truth.json")
    assert both.exit_code == 1 and "no solution" in both.stderr
    Path("bad.json").write_text(json.dumps({**truth, "stations": 3}), encoding="utf-8")
    bad = musat("compare", "lens.json", "bad.json")
    assert bad.exit_code == 1 and "is no truth of a simulation" in bad.stderr and "Traceback" not in bad.stderr


@pytest.mark.slow
def test_a_compilation_names_the_lens_that_it_does_not_know(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`as11` refuses images of an adjusted distortion, and names the record; `correct` needs stations alone."""
    monkeypatch.chdir(tmp_path)
    lens = '[[lens.parameter]]\nname = "K1"\nchange = -3e-8\n'
    water = "[water]\n[[shoal]]\nshare = 0.2\ndepth = [1.0, 5.0]\n[compilation]\npoints = 5\n"
    Path("lens.toml").write_text(SPEC.replace("[options]", f"{lens}{water}[options]"), encoding="utf-8")
    assert musat("simulate", "lens.toml").exit_code == 0 and musat("run", "-q", "lens.crd").exit_code == 0
    ran = musat("as11", "compile", "lens.json", "lens.compilation.crd")
    assert ran.exit_code == 1
    assert "lens.json: the distortion of camera CAM1 was adjusted" in ran.stderr
    Path("points.csv").write_text("x,y,z\n0,0,-3\n", encoding="utf-8")
    corrected = musat("correct", "points.csv", "--run", "lens.json", "-o", "out.csv")
    assert (
        corrected.exit_code == 0
        and "no sigmas: the distortion of camera CAM1" in corrected.stdout + corrected.stderr
    )
