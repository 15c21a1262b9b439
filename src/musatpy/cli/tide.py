"""`musat tide`: the tides of a deck out of the readings of a gauge."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.decks import STREAM, source_of
from musatpy.cli.messages import complain, complain_of_each, count_of, name_of, tell, tell_file
from musatpy.cli.options import NamedPath, formats_option, quiet_option


@click.command(name="tide", short_help="Tides of a deck from the readings of a gauge.")
@click.argument("deck", type=NamedPath())
@click.option(
    "--series",
    required=True,
    type=NamedPath(),
    metavar="CSV",
    help="Readings of the gauge: columns time and height (m).",
)
@click.option(
    "--datum",
    required=True,
    type=float,
    metavar="M",
    help="Height of the zero of the gauge, above what the heights of the deck count from.",
)
@click.option(
    "--sigma", type=click.FloatRange(min=0.0), default=0.0, metavar="M", help="Of a reading; 0 if not given."
)
@click.option(
    "--times",
    type=NamedPath(),
    metavar="CSV",
    help="Exposures: columns photo and time; if not given those of the deck.",
)
@click.option("--zone", default="", metavar="ZONE", help="Of times that state none: UTC, or +hh:mm.")
@click.option(
    "--clock",
    default="0",
    metavar="TIME",
    help="When the seconds on the cards of the deck begin, if the series has dates.",
)
@click.option("-o", "--out", required=True, type=NamedPath(), help="The deck to write; - is the standard output.")
@formats_option
@quiet_option
def command(
    deck: Path, series: Path, datum: float, sigma: float, times: Path | None, zone: str, clock: str, out: Path,
    formats_dir: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Write the height of the water at each exposure of DECK (- is the standard input) on its card of tides.

    Heights are interpolated among the readings by a piecewise cubic, never beyond the first and the last one, nor
    in a gap of more than 30 minutes. Their sigmas join that of a reading with that of the gap. Times are seconds,
    or dates as ISO 8601 writes them (2024-05-01T09:30:00+02:00), of readings and exposures alike. All else in the
    deck stays as it is.

    Exit status: 0, or 1 where a photo has no tide; then nothing is written.
    """
    from musatpy.files import write_files
    from musatpy.formats.job_tables import card_family
    from musatpy.keypunch.tides import deck_with_tides, moment, read_exposures, read_series

    readings = read_series(series, zone=zone, datum=datum, sigma=sigma)
    exposures = None if times is None else read_exposures(times, zone)
    try:
        start = moment(clock, zone)
    except ValueError as error:
        raise click.UsageError(f"--clock: '{clock}' {error}") from error
    source = source_of(deck)
    data = source if isinstance(source, bytes) else source.read_bytes()
    data, tides = deck_with_tides(data, card_family(formats_dir), readings, exposures, clock=start)
    if out == STREAM:
        tell_file(data)
    else:
        write_files({out: data})
    strangers = [photo for photo in exposures or () if photo not in tides]
    complain_of_each(times, [f"photo {photo} is not in the deck" for photo in strangers])
    if not tides:
        complain(f"{name_of(deck)}: no photos")
    elif not quiet:
        heights, sigmas = zip(*tides.values(), strict=True)
        tell(
            f"{name_of(out)}: tides of {count_of(len(tides), 'photo')}, {min(heights):.3f} to "
            f"{max(heights):.3f} m, largest sigma {max(sigmas):.3f} m",
            err=out == STREAM,
        )
