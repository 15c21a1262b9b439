"""A copy of the program to which a recipe of docs/extending.md adds something."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from textwrap import dedent

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")


@dataclass(frozen=True)
class Copy:
    """A folder in which the package of the program lies, with its card formats."""

    folder: Path

    @property
    def package(self) -> Path:
        return self.folder / "src" / "musatpy"

    def python(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        """Run Python with the copy in the place of the program."""
        environment = os.environ | {"PYTHONPATH": str(self.folder / "src")}
        return subprocess.run(
            [sys.executable, *map(str, arguments)], cwd=self.folder, env=environment, capture_output=True, text=True
        )

    def musat(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        return self.python("-m", "musatpy", *arguments)

    def tries(self, script: str, deck: Path) -> subprocess.CompletedProcess[str]:
        """Run a script with a deck; it must end well."""
        (path := self.folder / "tries.py").write_text(script, encoding="utf-8")
        ran = self.python(path, deck)
        assert ran.returncode == 0, ran.stderr
        return ran

    def put(self, file: str, after: str, text: str, indent: str = "    ") -> None:
        """Put lines into a file of the package behind every line `after`."""
        content = (self.package / file).read_text(encoding="utf-8")
        assert f"{after}\n" in content
        lines = "".join(f"{indent}{line}".rstrip() + "\n" for line in text.splitlines())
        (self.package / file).write_text(content.replace(f"{after}\n", f"{after}\n{lines}"), encoding="utf-8")


@pytest.fixture(scope="module")
def blocks():
    """Return the fenced blocks of code that a section of the manual has, by their kinds."""

    def of(title: str) -> list[tuple[str, str]]:
        recipe = PAGE[PAGE.index(f"## {title}\n") :].split("\n## ")[0]
        fenced = re.findall(r"^ *```(\w+)\n(.*?)^ *```", recipe, re.DOTALL | re.MULTILINE)
        return [(kind, dedent(text)) for kind, text in fenced]

    return of


def copied(folder: Path) -> Copy:
    shutil.copytree(ROOT / "src", folder / "src")
    shutil.copytree(ROOT / "card_formats", folder / "src" / "musatpy" / "card_formats")
    return Copy(folder)


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    return copied(tmp_path)


@pytest.fixture(scope="module")
def module_copy(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    """One copy for all tests of a file."""
    return copied(tmp_path_factory.mktemp("copy"))
