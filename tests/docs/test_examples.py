"""The examples of README and docs show what comes out, their links lead somewhere, and their terms exist."""

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

from campaign.batches import near
from cli.commands import musat

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```(?P<kind>\w*)\n(?P<text>.*?)^```\n", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\((?P<target>[^)\s]+)\)")
PLAIN = re.compile(r"musat (?P<arguments>[^|&;<>$]+?)( (?P<stream>2?)> (?P<file>\S+))?( \| (?P<filter>[^|]+))?")
ANYTHING = "..."


@dataclass(frozen=True)
class Example:
    """Code of one kind and the output shown for it; None where none is shown."""

    kind: str
    code: str
    output: str | None


def examples(markdown: str) -> Iterator[Example]:
    """Yield the examples of a page in their order."""
    blocks = list(FENCE.finditer(markdown))
    for block, after in pairwise([*blocks, None]):
        if block["kind"] == "console":
            yield from commands(block["text"])
        elif block["kind"] == "python":
            follows = after and after["kind"] == "text" and not markdown[block.end() : after.start()].strip()
            yield Example("python", block["text"], after["text"] if after and follows else None)


def commands(text: str) -> Iterator[Example]:
    """Yield the commands of a console block with the output below each."""
    first, *parts = re.split(r"^\$ ", text, flags=re.MULTILINE)
    assert not first, f"output before the first command: {first!r}"
    for part in parts:
        command, _, output = part.partition("\n")
        yield Example("console", command, output)


def shows(shown: str, actual: str) -> bool:
    """Tell whether output is as shown; blanks at line ends and blank lines around it do not count."""
    lines = [line.rstrip() for line in shown.strip("\n").splitlines()]
    pattern = "".join(r"(?:.*\n)*" if line == ANYTHING else re.escape(line) + r"\n" for line in lines)
    plain = "".join(line.rstrip() + "\n" for line in actual.strip("\n").splitlines())
    return re.fullmatch(pattern, plain) is not None


class Session:
    """A folder with the fixtures, a shell and a Python namespace, as a reader of one page has them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.shell_only = False
        self.status = 0
        self.names: dict[str, object] = {}
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        self.environment = {**os.environ, "PATH": path}

    def run(self, example: Example) -> str:
        if example.kind == "python":
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile(example.code, "example", "exec"), self.names)
            return printed.getvalue()
        assert self.status == 0 or example.code == "echo $?", f"the command before ended with {self.status}"
        plain = None if self.shell_only else PLAIN.fullmatch(example.code)
        return self._by_click(plain) if plain else self._by_shell(example.code)

    def _by_click(self, command: re.Match[str]) -> str:
        """Run a command in this process, with one of its streams in a file, and its stdout through a filter."""
        with contextlib.chdir(self.folder):
            ran = musat(*shlex.split(command["arguments"]), prog_name="musat", catch_exceptions=False)
            self.status, output = ran.exit_code, ran.output
            if command["file"]:
                kept, output = (ran.stderr, ran.stdout) if command["stream"] else (ran.stdout, ran.stderr)
                Path(command["file"]).write_text(kept)
        return self._by_shell(command["filter"], output) if command["filter"] else output

    def _by_shell(self, code: str, read: str = "") -> str:
        ran = subprocess.run(
            ["bash", "-c", f"(exit {self.status}); {code}"],
            cwd=self.folder,
            env=self.environment,
            input=read,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=120,
        )
        self.status = ran.returncode
        return ran.stdout


@pytest.fixture
def session(tmp_path, monkeypatch):
    for name in ("fixtures", "card_formats"):
        shutil.copytree(ROOT / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    with near():
        yield Session(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_examples_show_what_comes_out(page, session):
    session.shell_only = page.name == "README.md"
    for example in examples(page.read_text(encoding="utf-8")):
        output = session.run(example)
        if example.output is not None:
            assert shows(example.output, output), f"{example.code}\n--- shown\n{example.output}\n--- is\n{output}"
    assert session.status == 0, "the last command failed"


def test_the_readme_has_examples():
    kinds = [example.kind for example in examples(PAGES[0].read_text(encoding="utf-8"))]
    assert kinds.count("console") >= 3 and "python" in kinds


def set_up_commands() -> list[str]:
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line.startswith("python3 -m venv .venv &&")]


def test_two_set_up_commands_stand_in_the_readme():
    strip, tests = set_up_commands()
    for command in (strip, tests):
        steps = [step.strip() for step in command.split("&&")]
        assert (
            len(steps) == 3 and steps[1].startswith(".venv/bin/pip install ") and steps[2].startswith(".venv/bin/")
        )
    deck = re.search(r"musat run (\S+\.crd)", strip)
    assert deck and "cayman" in deck[1] and (ROOT / deck[1]).is_file()
    assert "[test]" in tests and "pytest" in tests


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    for link in LINK.finditer(FENCE.sub("", page.read_text(encoding="utf-8"))):
        target, _, anchor = link["target"].partition("#")
        if target.startswith(("http://", "https://")):
            continue
        place = (page.parent / target) if target else page
        assert place.exists(), f"{page.name}: {link['target']}"
        assert not anchor or anchor in anchors(place), f"{page.name}: {link['target']}"


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


# --- the checks themselves can fail ---


def test_output_that_differs_is_found():
    assert shows("a\n...\nd\n", "a\nb\nc\nd\n")
    assert shows("a  \n", "\na\n")
    assert not shows("a\n...\nd\n", "a\nb\nc\n")
    assert not shows("a.b\n", "axb\n")


def test_a_failing_command_is_found(tmp_path):
    session = Session(tmp_path)
    assert session.run(Example("console", "exit 3", "")) == ""
    with pytest.raises(AssertionError, match="ended with 3"):
        session.run(Example("console", "true", ""))
    assert session.run(Example("console", "echo $?", "3\n")) == "3\n"


def test_examples_are_found_with_their_output():
    page = "```console\n$ one\nout\n$ two\n```\n```python\nprint(1)\n```\n\n```text\n1\n```\n```python\nx\n```\n"
    assert list(examples(page)) == [
        Example("console", "one", "out\n"),
        Example("console", "two", ""),
        Example("python", "print(1)\n", "1\n"),
        Example("python", "x\n", None),
    ]


SOURCE = ROOT / "src" / "musatpy"


def test_the_architecture_names_every_room():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rooms = {folder.parent.name for folder in SOURCE.glob("*/__init__.py")}
    assert rooms - set(re.findall(r"\w+", page)) == set()


def test_names_of_the_glossary_are_in_the_source():
    page = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    names = {name for names in re.findall(r"`([A-Za-z_.]+)`", page) for name in names.split(".")}
    words = {word for path in SOURCE.rglob("*.py") for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))}
    assert len(names) > 50 and names - words == set()
