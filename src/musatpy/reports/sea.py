"""The waves on the water of a job: as its cards and linear theory have them, and where each of them breaks."""

from __future__ import annotations

from musatpy.model import Waves
from musatpy.reports.encoding import Json, Rows, rows
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table
from musatpy.statistics import Statistics
from musatpy.units import DEGREE


def sections(statistics: Statistics) -> list[Section]:
    """Return the waves through which a job was adjusted, nothing where its water was level."""
    waves = statistics.block.waves
    if not len(waves.ids):
        return []
    table = _table(waves)
    notes = [
        "",
        "Heights are from trough to crest, directions clockwise from true north. A crest stands so far from the "
        "origin of",
        "the waves, in the direction they run to, at time 0 of the exposures. A wave without depth is one of deep "
        "water.",
    ]
    return [
        Section(title="Waves On The Water", head=table.head(), lines=[*table.lines(waves), *notes], together=True)
    ]


def _table(waves: Waves) -> Table[Waves]:
    from musatpy.sea.deck import SHAPES  # most jobs have no waves
    from musatpy.sea.trains import wave_trains

    trains = wave_trains(waves)
    return Table(
        (
            Column("Wave", "A4", lambda w: w.ids),
            Column("Shape", "A10", lambda w: [SHAPES[shape] for shape in w.shape.tolist()]),
            Column("Depth\nm", "F8.2", lambda w: w.depth),
            Column("Period\ns", "F8.3", lambda _: trains.period),
            Column("Length\nm", "F9.3", lambda _: trains.length),
            Column("Speed\nm/s", "F8.3", lambda _: trains.speed),
            Column("Group\nm/s", "F8.3", lambda _: trains.group_speed),
            Column("Height\nm", "F8.3", lambda w: w.height),
            Column("Breaks at\nm", "F9.2", lambda _: trains.breaking_height),
            Column("Towards\ndegrees", "F9.3", lambda w: w.azimuth / DEGREE),
            Column("Crest\nm", "F10.3", lambda w: w.crest),
        )
    )


def waves_record(statistics: Statistics) -> Rows:
    """Return one row for each wave, none in a job without."""
    waves = statistics.block.waves
    if not len(waves.ids):
        return []
    from musatpy.sea.deck import SHAPES
    from musatpy.sea.trains import wave_trains

    trains = wave_trains(waves)
    return rows(
        wave=waves.ids,
        shape=[str(SHAPES[shape]) for shape in waves.shape.tolist()],
        depth=waves.depth,
        period=trains.period,
        length=trains.length,
        speed=trains.speed,
        group_speed=trains.group_speed,
        height=waves.height,
        breaking_height=trains.breaking_height,
        azimuth=waves.azimuth,
        crest=waves.crest,
        given_period=waves.period,
        given_length=waves.length,
        given_speed=waves.speed,
        height_sigma=waves.height_sigma,
        length_sigma=waves.length_sigma,
        azimuth_sigma=waves.azimuth_sigma,
        crest_sigma=waves.crest_sigma,
    )


def origin_record(statistics: Statistics) -> Json:
    """Return the place from which crests count, None without."""
    origin = statistics.block.wave_origin
    return None if origin is None else list(origin.position)
