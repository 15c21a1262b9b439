"""Input that is mistyped, hostile, piped, too large, or behind links: what the commands say of it."""

import json
import os
import resource
import subprocess
import sys
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.shell_completion import BashComplete
from click.testing import Result

from cli.commands import musat
from musatpy.cli.main import main
from musatpy.interchange import geotiff
from musatpy.interchange.layers import Grid

ROOT = Path(__file__).parents[2]
THOMAS, COMPILED = (ROOT / f"fixtures/{name}/{name}.crd" for name in ("st_thomas", "st_thomas_as11"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the record of a run, points, a raster and a path."""
    folder = tmp_path_factory.mktemp("run")
    assert musat("run", "-q", THOMAS, "-o", folder).exit_code == 0
    (folder / "points.csv").write_text("name,lon,lat,height\na,-64.93,18.33,-30\nb,-64.931,18.33,-31\n")
    (folder / "soundings.csv").write_text("name,x,y,depth\na,300000,2026000,3\n")
    grid = Grid(west=0.0, south=0.0, spacing=1.0, bands={"depth": np.add.outer(np.arange(4.0), np.arange(4.0))})
    geotiff.write(folder / "depths.tif", grid)
    return folder


def told(folder: Path, *words: object) -> str:
    """Return what a command says that fails, in words of its own."""
    ran = musat(*(str(word).replace("DIR", str(folder)) for word in words))
    assert ran.exit_code not in (0, 3, 4) and "unexpected" not in ran.stderr and "Traceback" not in ran.stderr
    return ran.stderr


@pytest.mark.parametrize("system", ["EPSG:2672O", "+proj=utm8"])
@pytest.mark.parametrize(
    "command",
    [
        ("as11", "correct", "DIR/st_thomas.json", "21", "22", "DIR/points.csv", "-o", "DIR/true.csv"),
        ("as11", "contours", "DIR/depths.tif", "-o", "DIR/c.gpkg", "--interval", "1"),
        ("as11", "compare-soundings", "DIR/st_thomas.json", COMPILED, "DIR/soundings.csv", "-o", "DIR"),
        ("plot", "DIR/st_thomas.json", "--line", "DIR/points.csv", "-o", "DIR"),
        ("depth", "correct", "DIR/points.csv", "--cameras", "DIR/st_thomas.json", "-o", "DIR/d.csv"),
        ("run", THOMAS, "-o", "DIR/again", "--gis"),
    ],
)  # fmt: skip
def test_a_system_that_is_none(folder: Path, command: tuple[object, ...], system: str) -> None:
    assert "is no coordinate system" in told(folder, *command, "--crs", system)


@pytest.mark.parametrize("name", ["a/b", "a\\b", "a:b", "a*b", "b."])
def test_a_grid_is_part_of_the_name_of_a_file(folder: Path, name: str) -> None:
    deck = folder / "deck.crd"
    deck.write_text(COMPILED.read_text().replace("GRD BAY   ", f"GRD {name:<6}"))
    words = told(folder, "as11", "compile", "DIR/st_thomas.json", deck, "--gis")
    assert "cols 5-12 GRD.name: is used in names of files" in words


@pytest.mark.parametrize(
    "key", ["punch", "punch_points", "punch_sigmas", "record", "set", "formats", "out", "brief"]
)
@pytest.mark.parametrize("value", ["[[1, 2]]", "{a = 1}", "1979-05-27", "1.5"])
def test_a_value_of_a_manifest_that_is_none_of_its_kind(tmp_path: Path, key: str, value: str) -> None:
    manifest = tmp_path / "m.toml"
    manifest.write_text(f'[[job]]\ndeck = "{THOMAS}"\n{key} = {value}\n')
    assert f" job 1.{key}" in told(tmp_path, "batch", manifest)
    manifest.write_text(f'{key} = {value}\n[[job]]\ndeck = "{THOMAS}"\n')
    assert key in told(tmp_path, "batch", manifest)


@pytest.mark.parametrize(
    ("table", "field", "noun"),
    [
        ("station_pairs", "photos", "photo"),
        ("stations", "camera", "camera"),
        ("plates", "photo", "photo"),
        ("plates", "point", "point"),
        ("control", "point", "point"),
        ("equal_elevations", "points", "point"),
    ],
)
def test_a_link_of_a_record_to_what_it_has_not(folder: Path, table: str, field: str, noun: str) -> None:
    record: dict[str, Any] = json.loads((folder / "st_thomas.json").read_text())
    column = record[table][field]
    if isinstance(column[0], list):
        column[0][-1] = "nowhere"
    else:
        column[0] = "nowhere"
    (folder / "strange.json").write_text(json.dumps(record))
    message = f"{table}.{field}[0]: there is no {noun} nowhere in "
    assert message in told(folder, "as11", "compile", "DIR/strange.json", COMPILED, "-o", "DIR/out")
    if table != "station_pairs":  # which no page shows
        assert message in told(folder, "report", "DIR/strange.json", "-o", "DIR/out.html")


GOLDEN = ROOT / "fixtures" / "st_thomas" / "st_thomas.lst"
HOSTILE = "\x1b]0;x\x07\x9b2J\u202e"  # title of the window, clear the screen, write from right to left
coloured_musat = partial(musat, color=True, env={"NO_COLOR": "1"})
ESCAPED = r"\x1b]0;x\x07\x9b2J\u202e"


@pytest.fixture
def hostile(tmp_path) -> Path:
    path = tmp_path / "hostile.lst"
    text = GOLDEN.read_text(encoding="utf-8")
    for word in ("Refractive index", "106            .018      -.037", "Mean Value of Differences "):
        assert word in text
        text = text.replace(word, f"{word}{HOSTILE}")
    path.write_text(text, encoding="utf-8")
    return path


def clean(ran: Result) -> str:
    """Return what was printed; nothing of it is a control character."""
    text = ran.stdout + ran.stderr
    assert text and text.replace("\n", "").replace("\f", "").isprintable()
    return text


def test_an_audit_escapes_what_the_listing_says(hostile):
    ran = coloured_musat("audit", hostile)
    assert ran.exit_code and ESCAPED in clean(ran)


def test_names_of_soundings_are_escaped_in_their_listing(tmp_path):
    fixture = ROOT / "fixtures" / "st_thomas_as11"
    head, *lines = (fixture / "soundings.csv").read_text().splitlines()
    cells = [line.split(",") for line in lines]
    for number, cell in enumerate(cells):
        cell[0] = f'"S{HOSTILE}{number}"'
        cell[3] = f"{float(cell[3]) + 25.0 * (number % 20 == 3)}"  # blunders are named
    rows = [",".join(cell) for cell in cells]
    text = "\n".join([head, *rows, ""])
    (tmp_path / "hostile.csv").write_text(text, encoding="utf-8")
    assert coloured_musat("run", "-q", THOMAS, "-o", tmp_path).exit_code == 0
    run, deck = tmp_path / "st_thomas.json", fixture / "st_thomas_as11.crd"
    clean(coloured_musat("as11", "compare-soundings", run, deck, tmp_path / "hostile.csv", "-o", tmp_path))
    listing = (tmp_path / "hostile.soundings.lst").read_text(encoding="utf-8")
    assert ESCAPED in listing and listing.replace("\n", "").replace("\f", "").isprintable()


@pytest.mark.slow
def test_a_letter_that_no_font_has_is_no_matter_of_the_user(tmp_path):
    (tmp_path / "deck.crd").write_bytes(DATA)
    assert coloured_musat("run", "-q", tmp_path / "deck.crd").exit_code == 0
    record = (tmp_path / "deck.json").read_text(encoding="utf-8").replace('"21"', '"\u6c34"')
    (tmp_path / "deck.json").write_text(record, encoding="utf-8")
    for command in ("report", "plot"):
        with warnings.catch_warnings(record=True) as told:
            assert coloured_musat(command, tmp_path / "deck.json").exit_code == 0
        assert not [str(warning.message) for warning in told if "Glyph" in str(warning.message)]


def test_rules_are_escaped(hostile, tmp_path):
    rules = tmp_path / "rules.toml"
    rules.write_text(f'[[rule]]\nname = {json.dumps(HOSTILE)}\nsection = "none"\nskip = true\n')
    assert ESCAPED in clean(coloured_musat("diff", GOLDEN, hostile, "--rules", rules))


DATA = THOMAS.read_bytes()


def test_a_deck_from_stdin_is_run_to_stdout(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = musat("run", "-", input=DATA)
    assert ran.exit_code == 0
    assert ran.stdout == THOMAS.with_suffix(".lst").read_text()
    depths = "sigma of depths 0.359 m (median), 0.492 m (largest)"
    assert ran.stderr == f"-: ACCEPTED, sigma0 0.9361, {depths}, 10 iterations, water passes: 4, listing -\n"
    assert not list(tmp_path.iterdir())


def test_with_a_folder_it_has_files_named_stdin_and_quietly_its_listing_alone(tmp_path):
    ran = musat("run", "-", "-o", tmp_path, "--punch", "restart", input=DATA)
    assert (ran.exit_code, ran.stderr) == (0, "")
    assert ran.stdout.startswith("-: ACCEPTED") and "stdin.lst" in ran.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["stdin.json", "stdin.lst", "stdin.pun"]
    assert (tmp_path / "stdin.lst").read_bytes() == THOMAS.with_suffix(".lst").read_bytes()
    ran = musat("run", "-q", "-", input=DATA)
    assert (ran.exit_code, ran.stderr) == (0, "") and ran.stdout.startswith("MUSATPY")


def test_problems_of_a_deck_from_stdin_name_it_so():
    ran = musat("run", "-", input=DATA.replace(b"-45.1870000", b"-45.l870000"))
    assert ran.exit_code == 1 and ran.stdout == ""
    assert "-:41 cols 22-33 PLT.x: '-45.l870000': the card reads with the digits 0 and 1 in place of" in ran.stderr
    assert ran.stderr.endswith("musat: -: not run, 1 error\n")
    assert musat("run", "-", input=b"").exit_code == 1


def test_decks_are_checked_and_listed_from_stdin(tmp_path):
    checked = musat("check", "-", input=DATA)
    assert checked.stdout == "-: 0 errors, 0 warnings; 3 photos, 22 points, 48 plate measurements\n"
    listed, named = musat("list", "-", input=DATA), musat("list", THOMAS)
    both = ([line for line in one.stdout.splitlines() if "PAGE" not in line] for one in (listed, named))
    assert next(both) == next(both)


def test_edited_decks_go_to_stdout_and_reports_to_stderr(tmp_path):
    part = tmp_path / "part.crd"
    written = musat("extract", THOMAS, "--photos", "21-22", "-o", part)
    streamed = musat("extract", THOMAS, "--photos", "21-22", "-o", "-")
    assert streamed.exit_code == written.exit_code == 0
    assert streamed.stdout == part.read_text()
    assert streamed.stderr.replace("-: 2 photos", f"{part}: 2 photos") == written.stdout
    third = tmp_path / "third.crd"
    musat("extract", THOMAS, "--photos", "23", "-o", third)
    merged = musat("merge", part, third, "-o", "-")
    assert merged.exit_code == 0 and merged.stdout.startswith("TTL") and merged.stdout.endswith("\n")
    assert "3 photos" in musat("check", "-", input=merged.stdout.encode()).stdout


@pytest.mark.slow
def test_a_shell_is_answered():
    environment = {**os.environ, "COMP_WORDS": "musat ex", "COMP_CWORD": "1", "_MUSAT_COMPLETE": "bash_complete"}
    code = "from musatpy.cli.main import main; main(prog_name='musat')"
    ran = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)
    assert [line.partition(",")[2] for line in ran.stdout.splitlines()] == [
        "example",
        "explain",
        "extract",
        "export",
    ]


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["run", "--st"], ["--strict"]),
        (["run", "--set", "op"], ["OPT.", "OP2."]),
        (["run", "--set", "OP2.water_"], ["OP2.water_level=", "OP2.water_tilt=", "OP2.water_index="]),
        (["run", "--set", "OP2.water_tilt="], ["OP2.water_tilt=KNOWN", "OP2.water_tilt=ADJUST"]),
        (["plot", "--only", "co"], ["corrections", "correlations"]),
        (["card", "o"], ["OPT", "OP2", "ORI"]),
        (["card", "OP2", "water_"], ["water_level=", "water_tilt=", "water_index="]),
        (["card", "OP2", "water_tilt="], ["water_tilt=KNOWN", "water_tilt=ADJUST"]),
        (["card", "MDL", "mod"], ["model=", "mode="]),
        (["example", "c"], ["cayman"]),
    ],
)
def test_a_shell_completes_commands_cards_and_fields(words, offered):
    shell = BashComplete(main, {}, "musat", "_MUSAT_COMPLETE")
    assert [one.value for one in shell.get_completions(words[:-1], words[-1])] == offered


TANK = ROOT / "fixtures" / "orientation" / "tank.crd"
MAIN = "from musatpy.cli.main import main; main()"
CPU = 20  # seconds, after which the system ends a process that asks for ever


def limited(megabytes: int, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU, CPU))

    command = [sys.executable, "-c", MAIN, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, preexec_fn=limit)


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of address space are those of Linux")
@pytest.mark.parametrize("megabytes", [140, 180, 230, 273])
@pytest.mark.parametrize("command", ["run", "orient", "check"])
def test_a_process_that_may_not_have_the_memory_says_so(tmp_path: Path, megabytes: int, command: str) -> None:
    """OpenBLAS asks for ever for what it does not get: each of the limits was met at another place of the start."""
    deck = TANK if command == "orient" else THOMAS
    ran = limited(megabytes, command, deck, *(() if command == "check" else ("-o", tmp_path)))
    assert ran.returncode == 1, (ran.returncode, ran.stderr)
    assert ran.stderr.splitlines()[-1] == f"musat: memory ran out: this process may have {megabytes} MB (ulimit -v)"
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of address space are those of Linux")
def test_a_process_that_may_have_enough_runs(tmp_path: Path) -> None:
    ran = limited(600, "run", THOMAS, "-o", tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "st_thomas.lst").read_bytes() == THOMAS.with_suffix(".lst").read_bytes()
