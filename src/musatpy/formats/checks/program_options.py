"""What one program can do and the other cannot, and what the options need of other cards."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.errors import Problem
from musatpy.formats.draft import Draft
from musatpy.model import Datum, Program, Refraction, Treatment, WaterLevel, Weights


def only_simultaneous(draft: Draft) -> Iterator[Problem]:
    """Yield what a job of program IIA asks for and only IIIA has."""
    if draft.options.program is not Program.IIA:
        return
    options = draft.options
    for name, asked in (
        ("water_level", options.water_level is not WaterLevel.KNOWN),
        ("water_tilt", options.water_tilt is not Treatment.KNOWN),
        ("water_index", options.water_index is not Treatment.KNOWN),
        ("datum", options.datum is not Datum.CONTROL),
    ):
        if asked:
            message = f"'{getattr(options, name)}' needs program IIIA"
            yield draft.problem("more_options", 0, message, path=f"options.{name}")
    for role, what in (("distances", "distances"), ("height_differences", "height differences")):
        if len(draft.rows[role]):
            message = f"the {what} take no part: program IIA does not use them, IIIA does"
            yield draft.problem(role, 0, message, severity="warning")


def only_rigorous(draft: Draft) -> Iterator[Problem]:
    """Yield options of IIA that a job of program IIIA gives in vain."""
    rows = draft.rows["options"]
    if draft.options.program is not Program.IIIA or not len(rows):
        return
    for name, fixed in (("refraction", Refraction.RIGOROUS), ("weights", Weights.FULL)):
        text = str(rows[f"options.{name}"][0])
        if text and text != fixed:
            message = f"'{text}' is not for program IIIA: it has {fixed} only, and uses that"
            yield draft.problem("options", 0, message, path=f"options.{name}", severity="warning")


def tide_labels(draft: Draft) -> Iterator[Problem]:
    """Yield the tide cards that do not say whose correction their photo shares, where there are groups or days."""
    name = {WaterLevel.GROUP: "group", WaterLevel.DAY: "day"}.get(draft.options.water_level)
    if name is None or draft.options.program is not Program.IIIA:
        return
    path = f"photos.tide_{name}"
    message = f"blank, and the unknown corrections of the tides go by {name}"
    yield from draft.problems("tides", draft.rows["tides"][path] == "", message, path=path)


def priors_of_the_water(draft: Draft) -> Iterator[Problem]:
    """Yield unknowns of the water without a sigma: the measurements alone have to determine them."""
    options = draft.options
    if options.program is not Program.IIIA:
        return
    message = "no sigma: the measurements alone have to determine this unknown"
    for role, path, unknown in (
        ("tides", "photos.tide_sigma", options.water_level is not WaterLevel.KNOWN),
        ("water", "water.tilt_sigma", options.water_tilt is Treatment.ADJUST),
        ("water", "water.sigma", options.water_index is Treatment.ADJUST),
    ):
        if unknown and len(draft.rows[role]):
            sigma = draft.rows[role][path]
            if np.isnan(sigma).all():
                yield draft.problem(role, 0, message, path=path, severity="warning")
        elif unknown and role == "water" and len(draft.rows["water_conditions"]):
            yield draft.problem("water_conditions", 0, message, severity="warning")
