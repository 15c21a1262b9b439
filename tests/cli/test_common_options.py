"""What holds for every command: help, phases, the log, colours, problems in one line, pipes, missing packages."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest

from cli.commands import musat
from musatpy.cli.main import main

ROOT = Path(__file__).parents[2]
DECK = ROOT / "fixtures/st_thomas/st_thomas.crd"
TWO_PARTS = ROOT / "fixtures/bad_decks/two_parts.crd"
COMPILED = ROOT / "fixtures/st_thomas_as11/st_thomas_as11.crd"
CALL = [sys.executable, "-c", "from musatpy.cli.main import main; main(prog_name='musat')"]
TIME = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d "


def commands(group: click.Group, *names: str) -> list[tuple[str, ...]]:
    every = []
    for name in group.commands:
        command = group.commands[name]
        every += commands(command, *names, name) if isinstance(command, click.Group) else [(*names, name)]
    return every


def test_h_is_help_and_every_command_tells_phases_and_has_a_log():
    assert musat("-h").output == musat("--help").output
    for names in commands(main):
        text = musat(*names, "-h").output
        assert text.startswith("Usage: ") and "--verbose" in text and "--log FILE" in text, names


def test_v_tells_phases_and_the_log_has_them_with_all_that_is_said(tmp_path):
    log = tmp_path / "run.log"
    for options in (["-v", "--log", log], ["--log", log, "-q"]):
        result = musat("run", DECK, "-o", tmp_path, *options)
        assert result.exit_code == 0
    said = musat("-v", "run", DECK, "-o", tmp_path).stderr.splitlines()
    for pattern in (
        r"version \S+, musat -v run",
        r".*: reading",
        r".*: pass 1, .*movement",
        r".*: covariances",
        "status 0",
    ):
        assert any(re.match(f"musat: {pattern}", line) for line in said), pattern
    assert "\r" not in "".join(said) and result.stderr == result.stdout == ""
    lines = log.read_text().splitlines()
    assert all(re.match(TIME, line) for line in lines)
    assert sum("version" in line for line in lines) == sum("status 0" in line for line in lines) == 2
    assert sum(": ACCEPTED, sigma0" in line for line in lines) == 1  # not that of -q
    assert sum(": reading" in line for line in lines) == 2


def test_the_log_has_wrong_command_lines_and_problems_and_no_other_file_is_taken_for_one(tmp_path, monkeypatch):
    log, deck = tmp_path / "x.log", tmp_path / "job.crd"
    deck.write_bytes(DECK.read_bytes())
    assert musat("run", TWO_PARTS, "--log", log).exit_code == 1
    assert musat("--log", log, "run", deck, "--set", "OPT.progam=IIA").exit_code == 2
    text = log.read_text()
    assert "point 2207 has a single ray" in text and "status 1" in text
    assert "did you mean program?" in text and "status 2" in text
    for place, message in (
        (deck, "is there, and is no log"),
        (tmp_path / "none/x.log", "No such file or directory"),
    ):
        result = musat("run", deck, "--log", place)
        assert result.exit_code == 2 and message in result.stderr
    assert deck.read_bytes() == DECK.read_bytes()


def on_terminal(*words: object, **environment: str) -> str:
    """Return what a command says whose stderr is a terminal."""
    mine, its = pty.openpty()
    with subprocess.Popen(
        [*CALL, *map(str, words)], stderr=its, stdout=subprocess.DEVNULL, env={**os.environ, **environment}
    ) as process:
        os.close(its)
        text = b""
        try:
            while part := os.read(mine, 10000):
                text += part
        except OSError:  # the terminal is closed
            pass
        process.wait(60)
    os.close(mine)
    return text.decode()


@pytest.mark.slow
def test_problems_are_coloured_on_a_terminal_alone(tmp_path):
    environment = {"TERM": "xterm", "NO_COLOR": ""}
    text = on_terminal("run", TWO_PARTS, "-o", tmp_path, **environment)
    assert "\x1b[31m" in text and "\x1b[33m" in text
    assert "\x1b[3" not in on_terminal("run", TWO_PARTS, "-o", tmp_path, **environment | {"NO_COLOR": "1"})
    assert "\x1b" not in musat("run", TWO_PARTS, "-o", tmp_path).stderr


def test_quietly_a_problem_is_one_line(tmp_path):
    loud = musat("run", TWO_PARTS, "-o", tmp_path).stderr.splitlines()
    heads = [line for line in loud if not line.startswith(("    ", "musat: "))]
    assert len(loud) > 2 * len(heads)
    assert musat("run", "-q", TWO_PARTS, "-o", tmp_path).stderr.splitlines() == heads
    assert musat("check", "-q", TWO_PARTS).stdout.splitlines() == heads


@pytest.mark.slow
def test_a_listing_that_nobody_reads_is_no_bad_deck(tmp_path):
    decks = [tmp_path / f"{name}.crd" for name in "ab"]
    for deck in decks:
        deck.write_bytes(DECK.read_bytes())
    for words in (["run", *decks], ["list", *decks], ["run", "-h"]):
        reads, writes = os.pipe()
        os.close(reads)
        ran = subprocess.run(
            [*CALL, *map(str, words)], stdout=writes, stderr=subprocess.PIPE, text=True, timeout=60
        )
        os.close(writes)
        assert ran.stderr == "" and ran.returncode in ((0, 141) if words[-1] == "-h" else (0,))
    assert all(deck.with_suffix(".lst").exists() for deck in decks)


@pytest.mark.parametrize(
    ("words", "package", "extra"),
    [
        (("run", DECK, "--plots"), "matplotlib", "plots"),
        (("run", DECK, "--html"), "jinja2", "report"),
        (("run", DECK, "--gis"), "pyogrio", "gis"),
        (("run", DECK, "--gis", "--crs", "EPSG:32620"), "shapely", "gis"),
        (("batch", DECK, "--html"), "jinja2", "report"),
        (("batch", DECK, "--cluster", "tcp://localhost:1"), "distributed", "cluster"),
        (("plot", "RECORD"), "matplotlib", "plots"),
        (("report", "RECORD"), "jinja2", "report"),
        (("report", "RECORD"), "matplotlib", "report"),
        (("depth", "picture", "DIR/m.png", "--height", 3, "--base", 1, "--index", 1.34), "matplotlib", "plots"),
        (
            ("depth", "correct", "DIR/points.las", "-o", "DIR/d.las", "--cameras", "RECORD"),
            "laspy",
            "las",
        ),
        (("correct", "DIR/points.las", "--run", "RECORD", "-o", "DIR/true.las"), "laspy", "las"),
        (("correct", "DIR/points.gpkg", "--run", "RECORD", "-o", "DIR/true.gpkg"), "pyogrio", "gis"),
        (("as11", "contours", "DIR/depths.tif", "-o", "DIR/c.gpkg", "--interval", "1"), "rasterio", "gis"),
        (("as11", "compile", "RECORD", COMPILED, "--gis", "-o", "DIR"), "pyogrio", "gis"),
        (("as11", "compile", "RECORD", COMPILED, "--las", "-o", "DIR"), "laspy", "las"),
        (("waves", ROOT / "fixtures/waves/bay.toml", "--plots", "-o", "DIR"), "matplotlib", "plots"),
    ],
)
def test_a_missing_package_is_one_line_with_status_1(tmp_path, monkeypatch, run_record, words, package, extra):
    for name in ("points.las", "points.gpkg", "depths.tif"):
        (tmp_path / name).write_bytes(b"")
    for name in [name for name in sys.modules if name.partition(".")[0] == package] + [package]:
        monkeypatch.setitem(sys.modules, name, None)
    result = musat(*(str(word).replace("DIR", str(tmp_path)).replace("RECORD", str(run_record)) for word in words))
    assert result.exit_code == 1 and result.stdout == ""
    assert re.fullmatch(
        rf"musat: [\w ]+ needs? the package {package}: pip install 'musatpy\[{extra}\]'\n", result.stderr
    ), result.stderr
