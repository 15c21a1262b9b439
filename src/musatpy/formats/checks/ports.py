"""Flat ports: cameras behind them, and what their decks cannot have besides."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.errors import Problem
from musatpy.formats.checks.check import check
from musatpy.formats.draft import Draft
from musatpy.model import PORT_PARAMETERS, Program
from musatpy.model.water import USUAL_INDICES

_USUAL = {  # beyond what cannot be and what is an error, and within what is usual
    "distance": ("{:g} mm is out of the ordinary for the distance of a port", 0.0, 1.0, 1000.0, np.inf),
    "thickness": ("{:g} mm is out of the ordinary for the thickness of a port", 0.0, 0.5, 200.0, np.inf),
    "glass_index": ("an index of {:g} is out of the ordinary for glass", 1.0, 1.4, 1.9, 2.0),
    "water_index": ("an index of {:g} is out of the ordinary for water", 1.0, *USUAL_INDICES, 2.0),
}
_OUTSIDE = "ports.water_index"
_WITHIN = {  # what values on CAL cards cannot be beyond, in their units
    **dict.fromkeys(("PD", "PT"), (0.0, np.inf, "not negative")),
    **dict.fromkeys(("PG", "PW"), (1.0, 2.0, "within 1 and 2")),
    **dict.fromkeys(("PX", "PY"), (-30.0, 30.0, "within 30 degrees")),
}


@check(of_card=True)
def sizes(draft: Draft) -> Iterator[Problem]:
    """Yield lengths and indices that ports do not usually have: metres, exchanged indices. Glass may be thin."""
    for name, (message, least, low, high, most) in _USUAL.items():
        path = f"ports.{name}"
        value = draft.rows["ports"][path]
        odd = ((value > least) & (value < low)) | ((value > high) & (value <= most))
        usual = f"{message}: {low:g} to {high:g} is usual"
        yield from draft.problems("ports", odd, usual, value, path=path, severity="warning")


@check(of_card=True)
def unknown_values(draft: Draft) -> Iterator[Problem]:
    """Yield values of parameters of ports on CAL cards that cannot be."""
    role, path = "lens_unknowns", "lens_unknowns.value"
    parameter, value = draft.rows[role]["lens_unknowns.parameter"], draft.rows[role][path]
    for name, (least, most, words) in _WITHIN.items():
        bad = (parameter == name) & ((value < least) | (value > most))
        yield from draft.problems(role, bad, f"{name} of a port is {words}", path=path)


@check()
def unknowns_without_port(draft: Draft) -> Iterator[Problem]:
    """Yield parameters of ports that are to be estimated of cameras without one, or change nothing in air."""
    role, path = "lens_unknowns", "lens_unknowns.parameter"
    parameter = draft.rows[role][path]
    alone = np.isin(parameter, PORT_PARAMETERS) & ~np.isin(draft.camera[role], draft.camera["ports"])
    message = f"camera {{}} has no port ({draft.card('ports')}) of which {{}} could be estimated"
    yield from draft.problems(role, alone, message, draft.names("cameras", role), parameter, path=path)
    in_air = draft.camera["ports"][draft.rows["ports"][_OUTSIDE] == 1.0]
    idle = (parameter == "PD") & np.isin(draft.camera[role], in_air)
    message = "outside the port of camera {} is air (index 1): its distance changes no image"
    yield from draft.problems(role, idle, message, draft.names("cameras", role), path=path)


@check(needs="ports")
def surroundings(draft: Draft) -> Iterator[Problem]:
    """Yield what no camera behind a port can have, program IIA, orientations, waves; and what none under water can.

    That is a tide, or a point with flag B: those with air outside (index 1) look through the surface.
    """
    if draft.options.program is Program.IIA or draft.to_orient:
        what = "an orientation (ORI)" if draft.to_orient else "program IIA"
        message = f"{what} has no flat ports: program IIIA adjusts cameras behind them"
        yield from draft.problems("ports", np.ones(len(draft.rows["ports"]), dtype=bool), message)
    unknowns, outside = draft.rows["lens_unknowns"]["lens_unknowns.parameter"], draft.rows["ports"][_OUTSIDE]
    cameras = [draft.camera["ports"][outside > 1.0], draft.camera["lens_unknowns"][unknowns == "PW"]]
    if len(draft.rows["waves"]) and (outside == 1.0).any():
        yield draft.problem("waves", 0, "no waves behind a flat port: its rays go through level or tilted water")
    behind = np.append(np.isin(draft.camera_of_photo, np.concatenate(cameras)), False)
    message = "the camera of photo {} is under water behind a port, and sees nothing through the water surface: "
    for role, seen, path, advice in (
        ("tides", np.ones(len(draft.rows["tides"]), dtype=bool), "photos.tide", "no tide is wanted"),
        (
            "plates",
            np.append(draft.bathymetric, False)[draft.point["plates"]],
            "points.bathymetric",
            "no flag B (with air outside the port, its index is 1)",
        ),
    ):
        rows = np.flatnonzero(behind[draft.photo[role]] & seen)
        first = rows[np.unique(draft.photo[role][rows], return_index=True)[1]]
        yield from draft.problems(role, first, message + advice, draft.names("photos", role), path=path)
