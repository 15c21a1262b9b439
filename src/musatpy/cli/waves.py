"""`musat waves`: what mapping through waves as if the water were level costs."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.messages import name_of, tell
from musatpy.cli.options import keys_option, out_option, refuse_overwriting


def _spec() -> type[object]:
    from musatpy.sea.experiment_spec import WaveSpec

    return WaveSpec


@click.command(name="waves", short_help="What waves do to a map that takes the water for level.")
@click.argument("spec", type=click.Path(path_type=Path))
@click.option("--plots", is_flag=True, help="Pictures too (NAME.map.png, ...); needs the extra 'plots'.")
@keys_option(_spec)
@out_option
def command(spec: Path, plots: bool, out_dir: Path | None) -> None:
    """Run the wave experiment of SPEC: its report goes to NAME.waves.txt, every point to NAME.waves.csv."""
    from musatpy.files import write_files
    from musatpy.reports.sea import points_csv, waves_text
    from musatpy.sea.experiment import study
    from musatpy.sea.experiment_spec import load_spec

    folder = spec.parent if out_dir is None else out_dir
    result = study(load_spec(spec), str(spec))
    text, table = folder / f"{spec.stem}.waves.txt", folder / f"{spec.stem}.waves.csv"
    files = {text: waves_text(result).encode(), table: points_csv(result).encode()}
    if plots:
        from musatpy.sea.pictures import pictures

        files |= {folder / f"{spec.stem}.{name}.png": picture for name, picture in pictures(result).items()}
    refuse_overwriting(files, [spec])
    write_files(files)
    sigma = ", ".join(f"{name} {value:.3f}" for name, value in zip("XYZ", result.spread.sigma, strict=True))
    says = "kept" if result.spread.kept.all() else "exceeded"
    tell(f"{name_of(text)}: sigma {sigma} m, accuracy {says}")
