"""Two solutions of one deck, or a truth and a solution, side by side: what differs, in sigmas of the second.

Both solutions come from the same observations, so the sigma of their difference is not the root of the sum of both
variances: the second solution is the one to be held to, and its sigmas are the measure (docs/comparison.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.errors import MusatError, RecordError
from musatpy.geometry.collinearity import wrapped
from musatpy.geometry.geodesy import metric_differences
from musatpy.model.solution import WAVE_VALUES
from musatpy.model.tables import falling
from musatpy.records.run_tables import ellipsoid_spec
from musatpy.records.tables import NamedRows, Tables, numbers, texts
from musatpy.units import DEGREE

_ROUNDING = 9  # decimals of differences, by which rounding errors do not order them
TABLES = (  # of a record, that are compared
    "options", "ellipsoid", "solution", "iterations", "stations", "points", "bathymetric_points", "control",
    "plate_statistics", "waves", "wave_origin", "adjusted_water", "adjusted_parameters",
)  # fmt: skip
OPTIONAL = ("plates",)  # which records without tables of images have not


@dataclass(frozen=True, kw_only=True)
class ComparedRows:
    """Rows that both solutions have, by falling largest ratio.

    Second minus first, (r, k); the sigmas of the second; NaN where one of them has no value.
    """

    ids: TextArray  # (r,)
    difference: FloatArray  # (r, k) m, and rad for angles
    sigma: FloatArray  # (r, k)

    @property
    def ratio(self) -> FloatArray:
        """(r, k) differences in sigmas of the second; NaN where the second has none."""
        known = self.sigma > 0.0
        return np.where(known, self.difference / np.where(known, self.sigma, 1.0), np.nan)

    @property
    def largest(self) -> FloatArray:
        """(r,) largest |ratio| of each row, -1 where there is none."""
        return np.nan_to_num(np.abs(self.ratio), nan=-1.0).max(axis=1, initial=-1.0)


@dataclass(frozen=True, kw_only=True)
class ComparedDepths:
    """Submerged points (s,) with their depths in both, m, by falling difference."""

    ids: TextArray
    depth: FloatArray  # (s, 2)
    sigma: FloatArray  # (s,) of the second


@dataclass(frozen=True, kw_only=True)
class ComparedParameters:
    """Further parameters (x,) that both have, by falling difference in sigmas."""

    kind: TextArray
    owner: TextArray
    parameter: TextArray
    unit: TextArray
    value: FloatArray  # (x, 2) in both
    sigma: FloatArray  # (x,) of the second, NaN where it does not determine a parameter

    @property
    def ratio(self) -> FloatArray:
        """(x,) second minus first in sigmas of the second; NaN where it has none."""
        return (self.value[:, 1] - self.value[:, 0]) / self.sigma


@dataclass(frozen=True, kw_only=True)
class ComparedRuns:
    """Two solutions of one deck, or the truth of a simulation and a solution."""

    labels: tuple[str, str]
    facts: tuple[tuple[str, str, str], ...]  # what, in the first, in the second
    stations: ComparedRows  # east, north, up, X-tilt, Y-tilt, heading
    points: ComparedRows  # east, north, up
    waves: ComparedRows  # height, length, azimuth, crest
    depths: ComparedDepths
    parameters: ComparedParameters
    only_one: tuple[str, ...]  # what one of them has, or determined, and the other not

    @property
    def largest(self) -> float:
        """Largest difference in sigmas of the second."""
        parts = [part.largest for part in (self.stations, self.points, self.waves)]
        return float(max(part.max(initial=0.0) for part in (*parts, _sizes(self.parameters.ratio))))


def compare(first: Tables, second: Tables, labels: tuple[str, str] = ("A", "B")) -> ComparedRuns:
    """Return the comparison of the JSON records of two solutions (`musatpy.reports.record`).

    The first may be the truth of a simulation (`tables_of_truth`). Raises `MusatError` where they are not of one
    block: other coordinate systems, or no photo in common.
    """
    if "solution" not in second:
        raise MusatError(f"nothing to compare: {labels[0]} and {labels[1]} are truths, and no solution")
    systems = [record["options"]["system"] for record in (first, second)]
    if systems[0] != systems[1]:
        raise MusatError(f"nothing to compare: {labels[0]} is a {systems[0]} job, {labels[1]} a {systems[1]} job")
    photos = [NamedRows("photo", record["stations"]) for record in (first, second)]
    points = [NamedRows("point", record["points"]) for record in (first, second)]
    if not photos[0].rows.keys() & photos[1].rows.keys():
        raise MusatError(f"nothing to compare: {labels[0]} and {labels[1]} have no photo in common")
    waves = [NamedRows("wave", _waves_of(record)) for record in (first, second)]
    parameters = [NamedRows("name", _parameters_of(record)) for record in (first, second)]
    if is_truth := "solution" not in first:  # of all parameters, also of those that are held
        parameters[0].rows = {name: parameters[0].rows[name] for name in parameters[1].common(parameters[0])}
    one_origin = first["wave_origin"] == second["wave_origin"]
    return ComparedRuns(
        labels=labels,
        facts=_facts(first, second),
        stations=_placed(first, photos[0], photos[1], "position_sigma", attitude=True),
        points=_placed(first, points[0], points[1], "sigma", attitude=False),
        waves=_waves(waves[0], waves[1], one_origin),
        depths=_depths(first, second),
        parameters=_parameters(*parameters),
        only_one=(
            *_only_one("photo", photos, labels),
            *_only_one("point", points, labels),
            *(() if is_truth else _only_one("wave", waves, labels)),
            *_only_one("parameter", parameters, labels),
        ),
    )


def _placed(record: Tables, first: NamedRows, second: NamedRows, sigma: str, attitude: bool) -> ComparedRows:
    """Return the differences of positions, and of attitudes, where both have them; `sigma` is that of positions."""
    ids = second.common(first)
    places = (of.array(ids, "position", 3) for of in (first, second))
    difference = metric_differences(record["options"]["system"], ellipsoid_spec(record), *places)
    sigmas = second.array(ids, sigma, 3)
    if attitude:
        turn = wrapped(second.array(ids, "attitude", 3) - first.array(ids, "attitude", 3))
        difference = np.hstack([difference, turn])
        sigmas = np.hstack([sigmas, second.array(ids, "attitude_sigma", 3)])
    return _sorted(ids, difference, sigmas)


def _waves_of(record: Tables) -> Tables:
    """Return the waves of a record, adjusted or as given: `value` and `sigma` of the parameters of each."""
    adjusted = (record["adjusted_water"] or {}).get("waves")
    table = record["waves"] if adjusted is None else adjusted["waves"]
    sigmas: dict[tuple[str, str], float | None] = {}
    if adjusted:
        columns = [adjusted["parameters"][name] for name in ("wave", "parameter", "sigma")]
        sigmas = {(wave, parameter): sigma for wave, parameter, sigma in zip(*columns, strict=True)}
    return {
        "wave": table["wave"],
        "value": [[table[name][row] for name in WAVE_VALUES] for row in range(len(table["wave"]))],
        "sigma": [[sigmas.get((wave, name)) for name in WAVE_VALUES] for wave in table["wave"]],
    }


def _waves(first: NamedRows, second: NamedRows, one_origin: bool) -> ComparedRows:
    """Return the differences of waves: azimuths within half a turn, crests within half a length of the second.

    A crest a length away is one of the same wave. Where crests count from two origins, they are not compared.
    """
    ids = second.common(first)
    value = second.array(ids, "value", len(WAVE_VALUES))
    difference = value - first.array(ids, "value", len(WAVE_VALUES))
    length, azimuth, crest = (WAVE_VALUES.index(name) for name in ("length", "azimuth", "crest"))
    for column, period in ((azimuth, 2.0 * np.pi), (crest, value[:, length])):
        difference[:, column] -= period * np.rint(difference[:, column] / period)
    if not one_origin:
        difference[:, crest] = np.nan
    return _sorted(ids, difference, second.array(ids, "sigma", len(WAVE_VALUES)))


def _sorted(ids: list[str], difference: FloatArray, sigma: FloatArray) -> ComparedRows:
    rows = ComparedRows(ids=np.array(ids, dtype=str), difference=difference, sigma=sigma)
    order = falling(rows.largest, _ROUNDING)
    return ComparedRows(ids=rows.ids[order], difference=difference[order], sigma=sigma[order])


def _depths(first: Tables, second: Tables) -> ComparedDepths:
    tables = [NamedRows("point", record["bathymetric_points"]) for record in (first, second)]
    ids = tables[1].common(tables[0])
    depth = np.stack([table.array(ids, "depth") for table in tables], axis=1)
    order = falling(np.nan_to_num(np.abs(depth[:, 1] - depth[:, 0]), nan=-1.0), _ROUNDING)
    return ComparedDepths(
        ids=np.array(ids, dtype=str)[order],
        depth=depth[order],
        sigma=tables[1].array(ids, "depth_sigma")[order],
    )


def _parameters_of(record: Tables) -> Tables:
    """Return the further parameters of a record, named by what they are and whose."""
    table = record["adjusted_parameters"]
    rows = zip(table["parameter"], table["kind"], table["of"], strict=True)
    return {**table, "name": [f"{parameter} of {kind} {owner}" for parameter, kind, owner in rows]}


def _parameters(first: NamedRows, second: NamedRows) -> ComparedParameters:
    ids = second.common(first)
    value = np.stack([table.array(ids, "adjusted") for table in (first, second)], axis=1)
    sigma = second.array(ids, "sigma")
    order = falling(_sizes((value[:, 1] - value[:, 0]) / sigma), _ROUNDING)
    kind, owner, parameter, unit = (
        np.array([second.table[field][second.rows[name]] for name in ids], dtype=np.str_)[order]
        for field in ("kind", "of", "parameter", "unit")
    )
    return ComparedParameters(
        kind=kind, owner=owner, parameter=parameter, unit=unit, value=value[order], sigma=sigma[order]
    )


def _sizes(ratio: FloatArray) -> FloatArray:
    return np.nan_to_num(np.abs(ratio), nan=-1.0)


def _only_one(what: str, tables: Sequence[NamedRows], labels: tuple[str, str]) -> list[str]:
    """Return the rows that one of the solutions lacks, or could not determine, with the reason where it has one."""
    lacking = []
    for name in sorted(tables[0].rows.keys() | tables[1].rows.keys()):
        reasons = [table.why_not(name) for table in tables]
        if reasons.count(None) == 1:
            label, reason = next(pair for pair in zip(labels, reasons, strict=True) if pair[1] is not None)
            lacking.append(f"{what} {name}: in {label} it {reason}")
    return lacking


def _facts(first: Tables, second: Tables) -> tuple[tuple[str, str, str], ...]:
    rows = [_facts_of(first), _facts_of(second)]
    names = list(dict.fromkeys([*rows[0], *rows[1]]))
    options = [name for name in first["options"] if first["options"][name] != second["options"].get(name)]
    differing = [
        (f"option {name}", str(first["options"].get(name)), str(second["options"].get(name))) for name in options
    ]
    origins = [record["wave_origin"] for record in (first, second)]
    if None not in origins and origins[0] != origins[1]:
        differing.append(("origin of the waves (crests not compared)", "one", "another"))
    return (*differing, *((name, rows[0].get(name, "-"), rows[1].get(name, "-")) for name in names))


def _printed(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _facts_of(record: Tables) -> dict[str, str]:
    if "solution" not in record:
        return {}
    solution, plates = record["solution"], record["plate_statistics"]
    facts = {
        "converged": "yes" if solution["converged"] else "no",
        "iterations": str(len(record["iterations"])),
        "degrees of freedom": str(solution["degrees_of_freedom"]),
        "sigma0": _printed(solution["sigma0"], ".4f"),
        "weighted sum of squares": _printed(solution["sum_of_squares"], ".3f"),
    }
    x, y = plates["total_rms"][0]
    if x is not None:
        facts["RMS of triangulated plate residuals x, y, um"] = f"{1e3 * x:.2f}  {1e3 * y:.2f}"
    residual, refraction = (numbers(record.get("plates", {}), name, 2) for name in ("residual", "refraction"))
    kept = residual[(refraction != 0.0).any(axis=1) & np.isfinite(residual).all(axis=1)]
    if len(kept):
        rms = 1e3 * np.sqrt(np.mean(np.square(kept), axis=0))
        facts["RMS of refracted plate residuals x, y, um"] = f"{rms[0]:.2f}  {rms[1]:.2f}"
    control = record["control"]
    checks = numbers(control, "difference", 3)[texts(control, "kind") == "check"]
    for axis, name in enumerate(("east", "north", "up")):
        given = checks[np.isfinite(checks[:, axis]), axis]
        if len(given):
            facts[f"RMS of {len(given)} check points, {name}, m"] = f"{np.sqrt(np.mean(given**2)):.3f}"
    return facts


def is_truth_record(record: Any) -> bool:
    """Return whether a JSON object is the truth that `musat simulate` writes."""
    return isinstance(record, dict) and {"seed", "spec", "stations"} <= record.keys()


def tables_of_truth(truth: dict[str, Any], path: Path) -> Tables:
    """Return what `compare` needs of the truth of a simulation. Raises `RecordError` where it is none."""
    try:
        job = truth["spec"]["job"]
        unit = np.array([DEGREE, DEGREE, 1.0] if job["system"] == "GEOG" else [1.0, 1.0, 1.0])
        stations, points = (
            {"position": [(np.array(row["position"]) * unit).tolist() for row in truth[name].values()]}
            for name in ("stations", "points")
        )
        stations["attitude"] = [(np.array(row["attitude"]) * DEGREE).tolist() for row in truth["stations"].values()]
        rows = truth.get("parameters", [])
        return {
            "options": {"system": job["system"]},
            "ellipsoid": {"name": job["ellipsoid"], "semi_major_axis": None, "inverse_flattening": None},
            "stations": {"photo": list(truth["stations"]), **stations},
            "points": {"point": list(truth["points"]), **points},
            "bathymetric_points": {"point": [], "depth": [], "depth_sigma": []},
            "waves": {"wave": []},
            "wave_origin": None,
            "adjusted_water": None,
            "adjusted_parameters": {
                "adjusted": [float(row["value"]) for row in rows],
                **{name: [str(row[name]) for row in rows] for name in ("kind", "of", "parameter")},
            },
        }
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RecordError.of(f"is no truth of a simulation: {error}", file=path) from error
