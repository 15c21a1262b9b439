"""The observations of a record in one table: files have those of images in the table of plates, nothing said twice.

Photo, point, residual and sigma of an image are those of its plate measurement; Student's t and the estimated error
follow from what stands there (Pope 1976, Baarda 1968). Both coordinates of each image come first, in the order of
the plates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from musatpy.probability import students_of_pope

FIELDS = ("redundancy", "standardised", "normal_test", "detectable", "effect")  # of images, two for each
_AXES = ("x", "y")
_PLATE = "plate"


def are_apart(record: Any) -> bool:
    """Tell whether a record has the observations of images in its table of plates, as files have."""
    plates = record.get("plates") if isinstance(record, Mapping) else None
    return isinstance(plates, Mapping) and FIELDS[0] in plates and isinstance(record.get("observations"), Mapping)


def with_images(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record whose table of observations has those of images too, and its table of plates no more of them.

    Its tables are columns. Raises `LookupError`, `TypeError` or `ValueError` for a record that is not as its schema
    says.
    """
    plates, others, solution = record["plates"], record["observations"], record["solution"]
    columns = {name: list(plates[name]) for name in ("photo", "point", "residual", "sigma", *FIELDS)}
    images = [
        (row, axis) for row, pair in enumerate(columns[FIELDS[0]]) for axis in (0, 1) if pair[axis] is not None
    ]
    found: dict[str, Sequence[Any]] = {
        "kind": [_PLATE] * len(images),
        "of": [[columns["photo"][row], columns["point"][row]] for row, _ in images],
        "component": [_AXES[axis] for _, axis in images],
        **{name: [columns[name][row][axis] for row, axis in images] for name in ("residual", "sigma", *FIELDS)},
    }
    students = _students(found["standardised"], solution["unit_sigma"], solution["degrees_of_freedom"])
    found["test"] = students
    found["estimated_error"] = [
        None if test is None or residual is None or not redundancy else -float(residual) / float(redundancy)
        for test, residual, redundancy in zip(
            found["standardised"], found["residual"], found["redundancy"], strict=True
        )
    ]
    return {
        **record,
        "observations": {name: [*found[name], *others[name]] for name in others},
        "plates": {name: column for name, column in plates.items() if name not in FIELDS},
    }


def _students(standardised: Sequence[Any], unit_sigma: Any, freedom: Any) -> list[float | None]:
    """Return Student's t of residuals over their own sigmas: Pope's tau with sigma0 from all others."""
    sigma0, f = float(unit_sigma or 0.0), int(freedom)
    if sigma0 <= 0.0 or f < 2:
        return [None] * len(standardised)
    taus = np.array([math.nan if value is None else float(value) for value in standardised]) / sigma0
    return [value if math.isfinite(value) else None for value in students_of_pope(taus, f).tolist()]
