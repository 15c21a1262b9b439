"""In what a job is stated, as the head of its page says it: system, datum, and what heights are above."""

from __future__ import annotations

from collections.abc import Iterator

import pyproj

from musatpy.geometry.projected import crs_of
from musatpy.model import CoordinateSystem
from musatpy.page.rendering import Fact
from musatpy.records.tables import Tables, part
from musatpy.reports.titles import SYSTEMS


def system_facts(tables: Tables) -> Iterator[Fact]:
    """Yield coordinate system, datum and reference of heights of the answer of a run or of a compilation."""
    job = part(tables, "job") or part(tables, "options")
    if not job:
        return
    system = CoordinateSystem(job["system"])
    answer = part(tables, "stated").get("answer") or {}
    crs = crs_of(answer["definition"]) if answer.get("definition") else None
    text = str(answer.get("text") or SYSTEMS[system]).partition(";")[0]  # without attitudes and sigmas
    yield Fact("Coordinate system", text[:1].upper() + text[1:])
    if system == CoordinateSystem.LOCAL:
        yield Fact("Datum", "none: a local system")
        yield Fact("Heights", "Z of the job")
        return
    datum = crs.geodetic_crs.datum.name if crs and crs.geodetic_crs and crs.geodetic_crs.datum else ""
    yield Fact("Datum", datum or f"not named; ellipsoid {_ellipsoid(tables)}")
    geoid = answer.get("geoid")
    yield Fact("Heights", f"above the geoid of {geoid}" if geoid else "above the ellipsoid")


def _ellipsoid(tables: Tables) -> str:
    """Return the name of the ellipsoid of a job in full, or its axis and flattening."""
    stated = part(tables, "ellipsoid") or part(tables, "job").get("ellipsoid") or {}
    name = stated.get("name") or f"{stated.get('semi_major_axis')} m, 1 : {stated.get('inverse_flattening')}"
    return str(pyproj.get_ellps_map().get(name, {}).get("description", name))
