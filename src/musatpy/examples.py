"""Jobs to begin with: in the installed package, or the fixtures of the checkout that it is run from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import musatpy
from musatpy.errors import MusatError, nearest_or_all
from musatpy.files import write_files
from musatpy.specs import key, read_toml, spec_of

_LIST = "examples.toml"


@dataclass(frozen=True, kw_only=True)
class Example:
    """[[example]]: files, and commands to be given where they are."""

    name: str = key(doc="by which it is asked for")
    title: str = key(doc="what it is")
    files: tuple[str, ...] = key(doc="below the folder of the examples")
    commands: tuple[str, ...] = key(doc="to go on with")

    def contents(self) -> dict[str, bytes]:
        """Return the files, by the names that they get. Raises `OSError`."""
        return {PurePosixPath(file).name: (_folder() / file).read_bytes() for file in self.files}


@dataclass(frozen=True, kw_only=True)
class _Examples:
    """The list of them."""

    example: tuple[Example, ...] = key(doc="one table each")


def _folder() -> Path:
    package = Path(musatpy.__file__).resolve().parent
    for folder in (package / "examples", package.parents[1] / "fixtures"):
        if (folder / _LIST).is_file():
            return folder
    raise MusatError(f"no examples in {package / 'examples'} nor in {package.parents[1] / 'fixtures'}")


def examples() -> dict[str, Example]:
    """Return the examples by their names. Raises `MusatError` where they are not installed."""
    place = _folder() / _LIST
    return {one.name: one for one in spec_of(_Examples, read_toml(place), str(place)).example}


def example_named(name: str) -> Example:
    """Return an example; raises `MusatError` with the nearest name that there is."""
    every = examples()
    if name not in every:
        raise MusatError(f"no example '{name}'{nearest_or_all(name, every)}")
    return every[name]


def write_example(example: Example, folder: Path) -> tuple[Path, ...]:
    """Write the files of an example into a folder, which is made where it is missing; return them.

    Raises `MusatError` where a file of that name has another content, which stays, and `OSError`.
    """
    files = {folder / name: content for name, content in example.contents().items()}
    for path, content in files.items():
        if path.exists() and (not path.is_file() or path.read_bytes() != content):
            raise MusatError(f"{path} exists already with other contents; nothing is written")
    write_files(files)
    return tuple(files)
