"""The waves on the water of a job: as its cards and linear theory have them, and where each of them breaks."""

from __future__ import annotations

from typing import Any

from musatpy.model import Waves
from musatpy.reports.fields import Field, Rows
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.statistics import Statistics


def _trains(statistics: Statistics) -> tuple[Waves, Any] | None:
    """Return the waves as given, and what linear theory makes of them; None in a job without."""
    waves = statistics.block.waves
    if not len(waves.ids):
        return None
    from musatpy.sea.deck_waves import wave_trains

    return waves, wave_trains(waves)


def _shapes(trains: tuple[Waves, Any]) -> list[str]:
    from musatpy.sea.deck_waves import SHAPES

    return [str(SHAPES[shape]) for shape in trains[0].shape.tolist()]


WAVES: Rows[Statistics, tuple[Waves, Any]] = Rows(
    "waves",
    "one row per wave on the water; empty where it is level",
    _trains,
    (
        Field("wave", "string", "wave id", lambda w: w[0].ids, heading="Wave", edit="A4", is_id=True),
        Field("shape", "string", "of the wave", _shapes, choices=("sinusoidal", "stokes", "trochoidal"),
              heading="Shape", edit="A10"),
        Field("depth", "number?", "of the water, for the theory of the wave; null is deep", lambda w: w[0].depth,
              "m", heading="Depth\nm", edit="F8.2"),
        Field("period", "number", "as given, or found by linear theory", lambda w: w[1].period, "s",
              heading="Period\ns", edit="F8.3"),
        Field("length", "number", "as given, or found by linear theory", lambda w: w[1].length, "m",
              heading="Length\nm", edit="F9.3"),
        Field("speed", "number", "of the crests: length over period", lambda w: w[1].speed, "m/s",
              heading="Speed\nm/s", edit="F8.3"),
        Field("group_speed", "number", "of groups of such waves, by linear theory", lambda w: w[1].group_speed,
              "m/s", heading="Group\nm/s", edit="F8.3"),
        Field("height", "number", "from trough to crest", lambda w: w[0].height, "m", heading="Height\nm",
              edit="F8.3"),
        Field("breaking_height", "number", "that the wave cannot exceed, by linear theory",
              lambda w: w[1].breaking_height, "m", heading="Breaks at\nm", edit="F9.2"),
        Field("azimuth", "number", "direction it runs to, clockwise from true north (+Y in LOCL jobs)",
              lambda w: w[0].azimuth, "rad", heading="Towards\ndegrees", edit="F9.3"),
        Field("crest", "number", "distance from the origin, in that direction, of a crest at time 0",
              lambda w: w[0].crest, "m", heading="Crest\nm", edit="F10.3"),
        Field("given_period", "number?", "on its card", lambda w: w[0].period, "s"),
        Field("given_length", "number?", "on its card", lambda w: w[0].length, "m"),
        Field("given_speed", "number?", "on its card", lambda w: w[0].speed, "m/s"),
        Field("height_sigma", "number?", "a priori; null where it is known", lambda w: w[0].height_sigma, "m"),
        Field("length_sigma", "number?", "a priori; null where it is known", lambda w: w[0].length_sigma, "m"),
        Field("azimuth_sigma", "number?", "a priori; null where it is known", lambda w: w[0].azimuth_sigma, "rad"),
        Field("crest_sigma", "number?", "a priori; null where it is known", lambda w: w[0].crest_sigma, "m"),
    ),
)  # fmt: skip
ORIGIN = Field[Statistics](
    "wave_origin", "3 number or null", "place from which crests count; null without waves",
    lambda s: None if s.block.wave_origin is None else s.block.wave_origin.position, "rad, rad, m (GEOG) or m",
)  # fmt: skip
SEA: Report[Statistics] = Report(
    title="Waves On The Water",
    table=WAVES,
    columns=(
        *("wave", "shape", "depth", "period", "length", "speed"),
        *("group_speed", "height", "breaking_height", "azimuth", "crest"),
    ),
)
STATED = (SEA,)


def sections(statistics: Statistics) -> list[Section]:
    """Return the waves through which a job was adjusted, nothing where its water was level."""
    if not len(statistics.block.waves.ids):
        return []
    notes = [
        "",
        "Heights are from trough to crest, directions clockwise from true north. A crest stands so far from the "
        "origin of",
        "the waves, in the direction they run to, at time 0 of the exposures. A wave without depth is one of deep "
        "water.",
    ]
    return [SEA.section(statistics, notes, together=True)]
