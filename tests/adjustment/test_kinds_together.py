"""All that a modern block brings at once: a lens, antennas, an inertial unit, correlated control, water."""

import numpy as np
import pytest

from blocks import converged, simulation
from musatpy.model import AdjustedParameters
from musatpy.simulation.simulate import Simulation

DRAWS = 12
LENS = [
    {"name": "F", "change": 0.05, "sigma": 0.05},
    {"name": "XP", "change": 0.02, "sigma": 0.02},
    {"name": "YP", "change": -0.02, "sigma": 0.02},
    {"name": "K1", "change": 2e-8, "sigma": 1e-8},
]


def block(seed: int) -> Simulation:
    """Two strips of five photos over a shore, all sigmas the true ones."""
    level, index = np.random.default_rng(seed).normal(0.0, [0.1, 0.002]).tolist()
    return simulation(
        seed,
        terrain={"level": 60.0, "relief": 40.0, "wavelength": 900.0},
        water={"tide_sigma": 0.1, "level_error": level, "index_sigma": 0.002, "index_error": index},
        shoal=[{"share": 0.5, "depth": [2.0, 15.0]}],
        measurement={"noise": 5.0, "sigma": 5.0},
        lens={"side": "IDEAL", "parameter": LENS},
        flight={"photos": 5, "strips": 2, "height": 1200.0, "reverse_alternate": True, "attitude_scatter": 2.0},
        points={"extra": [{"number": 30}]},
        control=[{"kind": "full", "number": 6, "sigma": 0.1, "error": 0.1, "correlation": [0.3, -0.5, 0.4]}],
        stations={"position_error": 5.0, "attitude_error": 0.3},
        antenna={"error": 0.05, "sigma": 0.05, "lever_arm": [0.3, -0.2, 1.5], "lever_arm_error": 0.05,
                 "lever_arm_sigma": 0.05, "shift": 0.3, "shift_sigma": 0.3, "drift": 0.01, "drift_sigma": 0.01},
        inertial={"error": [20.0, 20.0, 40.0], "sigma": [20.0, 20.0, 40.0], "misalignment": [0.2, -0.1, 0.3],
                  "misalignment_error": 120.0, "misalignment_sigma": 120.0},
        options={"program": "IIIA", "refraction": "RIGOROUS", "water_level": "ONE", "water_index": "ADJUST"},
    )  # fmt: skip


def ratios(seed: int) -> dict[str, np.ndarray]:
    """Errors over a priori sigmas of one draw, by what they are of."""
    made = block(seed)
    solution = converged(made.block)
    table, true = solution.parameters, {}
    assert isinstance(table, AdjustedParameters) and solution.water is not None
    for parameter in made.truth.parameters:
        true[int(parameter.kind), parameter.owner, parameter.name] = parameter.value
    keys = zip(table.kind.tolist(), table.owner.tolist(), table.parameter.tolist(), strict=True)
    truth = np.array([true[key] for key in keys])
    found = (table.value - truth) / table.spread * solution.unit_sigma
    out = {str(kind): found[table.kind == kind] for kind in np.unique(table.kind).tolist()}
    water = solution.water
    tide = made.truth.tide[0] - water.tide[0]
    out["level"] = np.array([tide / water.correction_sigma[0] * solution.unit_sigma])
    out["index"] = np.array([(water.index - made.truth.index) / water.index_sigma * solution.unit_sigma])
    place = solution.points.position[:, 2] - made.truth.points.job[:, 2]
    sigma = np.sqrt(solution.points.covariance[:, 2, 2]) / solution.unit_sigma
    known = np.isfinite(place)
    return out | {"heights": (place / sigma)[known], "sigma0": np.array([solution.sigma0])}


@pytest.mark.slow
def test_errors_of_all_kinds_together_are_as_large_as_their_sigmas() -> None:
    """RMS of 12 draws: those of few parameters within 3.5 standard deviations of what so many draws are worth."""
    draws = [ratios(seed) for seed in range(1, DRAWS + 1)]
    for kind in draws[0]:
        values = np.concatenate([draw[kind] for draw in draws])
        if kind == "sigma0":
            assert np.mean(values) == pytest.approx(1.0, abs=0.03)
            continue
        independent = DRAWS if kind == "heights" else len(values)
        rms = float(np.sqrt(np.mean(np.square(values))))
        assert rms == pytest.approx(1.0, abs=3.5 / np.sqrt(2.0 * independent)), kind
