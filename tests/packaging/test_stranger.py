"""A stranger with nothing but the installed wheel and `musat --help` gets a result, and changes how it is made.

The program is installed into an environment of its own, in which the packages that it needs are those of this one.
It is started as a command, in a folder that knows nothing of the checkout, and what is done next is read from what
it says.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import jinja2
import matplotlib
import numpy
import pyproj
import pytest
import scipy

from page.browser import browser, chromium

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
PACKAGES = (click, jinja2, matplotlib, numpy, pyproj, scipy)


class Stranger:
    """Someone at a shell, where the program is installed."""

    def __init__(self, environment: Path, folder: Path) -> None:
        self.folder = folder
        self.environment = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("PYTHON", "VIRTUAL_ENV", "COV"))
        }
        self.environment["PATH"] = os.pathsep.join([str(environment / "bin"), "/usr/bin", "/bin"])

    def says(self, command: str, status: int = 0) -> str:
        """Return what a command prints to stdout; it must end with a status."""
        ran = subprocess.run(
            ["bash", "-c", command],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert ran.returncode == status, f"{command}: {ran.returncode}\n{ran.stdout}\n{ran.stderr}"
        assert "Traceback" not in ran.stderr
        return ran.stdout

    def goes_on(self, said: str) -> list[str]:
        """Do what the program says under `Go on with`, and return what was printed."""
        place, *commands = re.findall(r"^  (.+)$", said.partition("Go on with")[2], re.MULTILINE)
        self.folder = self.folder / place.removeprefix("cd ")
        return [self.says(command) for command in commands]


@pytest.fixture(scope="module")
def environment(wheel, tmp_path_factory):
    """An environment with the wheel."""
    folder = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True, capture_output=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    places = {str(Path(package.__file__).parents[1]) for package in PACKAGES}
    (packages / "needed.pth").write_text("\n".join(sorted(places)))
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "bin" / "python"), "install"]
    pip += ["--no-index", "--no-deps", "--quiet", str(wheel)]
    subprocess.run(pip, check=True, capture_output=True)
    return folder


@pytest.fixture
def stranger(environment, tmp_path):
    return Stranger(environment, tmp_path)


@pytest.fixture(scope="module")
def readme_page(environment, tmp_path_factory):
    """The page that the commands of the README make, which lead to a listing first."""
    stranger = Stranger(environment, tmp_path_factory.mktemp("readme"))
    block = re.search(r"```sh\n(.*?)```", README.read_text(), re.DOTALL)
    install, *commands, listing, page = block[1].splitlines()
    assert install.startswith("pip install 'musatpy-") and len(commands) == 2
    for command in commands:
        stranger.says(command)
    assert "ACCEPTED" in "".join(stranger.says(listing.replace("less ", "cat ")).splitlines()[:6])
    return stranger.folder / stranger.says(page).split()[-1]


def test_it_is_the_installed_program(stranger, environment):
    place = stranger.says("""python -c 'import musatpy; print(musatpy.__file__)'""").strip()
    assert Path(place).is_relative_to(environment)


def test_a_stranger_runs_an_example_and_changes_an_option(stranger):
    listed = stranger.says("musat --help")
    commands = dict(re.findall(r"^  (\w+) +(.+)$", listed, re.MULTILINE))
    (begin,) = (name for name, does in commands.items() if "to begin with" in does)
    examples = re.findall(r"^(\w+)  .*under water", stranger.says(f"musat {begin}"), re.MULTILINE)
    said = stranger.says(f"musat {begin} {examples[0]} -o job")
    assert "ACCEPTED" in "".join(stranger.goes_on(said))
    listing = stranger.folder / "st_thomas.lst"
    assert listing.read_bytes() == (ROOT / "fixtures" / "st_thomas" / "st_thomas.lst").read_bytes()

    (cards,) = (name for name, does in commands.items() if "cards" in does)
    names = re.findall(r"^(\w+)  .*options", stranger.says(f"musat {cards}"), re.MULTILINE | re.IGNORECASE)
    fields = {name: stranger.says(f"musat {cards} {name}") for name in names}
    card, field, word = next(
        (name, *found.groups())
        for name, text in fields.items()
        if (
            found := re.search(
                r"^ +\d+-\d+ +(\w+) .*\n +Blunders.*\n?.*?(LIST): they are found", text, re.MULTILINE
            )
        )
    )
    assert "OP2" in stranger.says(f"musat {cards} {card} {field}={word}")
    stranger.says(f"musat run st_thomas.crd --set {card}.{field}={word}")
    assert f"Set for this run {'.' * 33} OP2.editing=LIST" in listing.read_text()
    assert json.loads(listing.with_suffix(".json").read_text())["options"]["editing"] == "LIST"

    (hands_over,) = (name for name, does in commands.items() if "page of a run" in does)
    page = stranger.folder / stranger.says(f"musat {hands_over} st_thomas.json").split()[-1]
    assert "OP2.editing=LIST" in page.read_text()


@pytest.mark.skipif(chromium() is None, reason="no Chromium here")
def test_a_stranger_opens_the_page(readme_page):
    with browser() as tab:
        tab.open(readme_page.as_uri())
        assert "ACCEPTED" in tab.evaluate("document.body.innerText") and not tab.said()


@pytest.mark.parametrize("name", ["cayman", "lagoon"])
def test_what_an_example_says_works(name, stranger):
    assert all(stranger.goes_on(stranger.says(f"musat example {name}")))
    assert stranger.folder.name == name


def test_the_commands_of_the_readme_lead_to_a_result(readme_page):
    assert readme_page.suffix == ".html"


def test_a_slip_is_answered_with_what_was_meant(stranger):
    slip = stranger.says("musat example st_tomas 2>&1", status=2)
    assert "did you mean st_thomas?" in slip
    slip = stranger.says("musat runn 2>&1", status=2)
    assert "No such command 'runn'. Did you mean 'run'?" in slip
