"""`musat simulate`: a deck with known truth from a spec file."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.messages import name_of, tell
from musatpy.cli.options import keys_option, out_option, refuse_overwriting


def _spec() -> type[object]:
    from musatpy.simulation.simulation_spec import SimulationSpec

    return SimulationSpec


@click.command(name="simulate", short_help="Write a deck with known truth from a spec.")
@click.argument("spec", type=click.Path(path_type=Path))
@click.option(
    "--seed", type=click.IntRange(min=0), help="Seed of the random numbers; the spec's own where not given."
)
@keys_option(_spec)
@out_option
def command(spec: Path, seed: int | None, out_dir: Path | None) -> None:
    """Write the deck NAME.crd that SPEC describes, and its truth as NAME.truth.json.

    With a table [compilation] also NAME.compilation.crd, readings in its models, with their truth, and
    NAME.soundings.csv.

    The same spec and seed always give the same files.
    """
    from musatpy.files import write_files
    from musatpy.formats.compilation_deck import compilation_bytes
    from musatpy.formats.musat import deck_bytes
    from musatpy.simulation import simulate, truth_json

    folder = spec.parent if out_dir is None else out_dir
    deck, truth = folder / f"{spec.stem}.crd", folder / f"{spec.stem}.truth.json"
    refuse_overwriting([deck, truth], [spec])
    simulation = simulate(spec, seed)
    files = {deck: deck_bytes(simulation.block), truth: truth_json(simulation).encode()}
    tell_of = f"{name_of(deck)}: {len(simulation.block.photos.ids)} photos, truth {name_of(truth)}"
    if (compiled := simulation.compiled) is not None:
        readings = folder / f"{spec.stem}.compilation.crd"
        files |= {
            readings: compilation_bytes(compiled.deck),
            readings.with_suffix(".truth.csv"): compiled.truth_csv().encode(),
            folder / f"{spec.stem}.soundings.csv": compiled.soundings.encode(),
        }
        tell_of += f", readings {name_of(readings)}"
    write_files(files)
    tell(tell_of)
