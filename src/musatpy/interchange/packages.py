"""Packages of the extra `gis`, loaded where they are used, and the problems of files that they read and write."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from musatpy.errors import InterchangeError, MusatError, Problem


def package(name: str, use: str) -> Any:
    """Return a module of a package of the extra `gis`.

    Raises `InterchangeError` that names the extra where the package is missing; `use`: what needs it.
    """
    try:
        return import_module(name)
    except ImportError as error:
        message = f"{use} the package {name.partition('.')[0]}: pip install 'musatpy[gis]'"
        raise InterchangeError([Problem(message=message)]) from error


def fault(path: Path, place: str, found: str, expected: str, line: int | None = None) -> Problem:
    """Return what is wrong at a place of a file (a feature, a layer, a column), and what is expected there."""
    message = f"{place}: {found}; expected: {expected}" if place else f"{found}; expected: {expected}"
    return Problem(file=str(path), line=line, message=message, found=found, expected=expected)


def refuse(path: Path, place: str, found: str, expected: str) -> InterchangeError:
    """Return the error of one fault."""
    return InterchangeError([fault(path, place, found, expected)])


@contextmanager
def gdal_options(use: str, options: Mapping[str, str]) -> Iterator[None]:
    """Set configuration options of the GDAL of pyogrio for a while."""
    pyogrio = package("pyogrio", use)
    before = {name: pyogrio.get_gdal_config_option(name) for name in options}
    pyogrio.set_gdal_config_options(options)
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options(before)


@contextmanager
def upsets(path: Path, what: str) -> Iterator[None]:
    """Turn what a package raises over a file into an `InterchangeError` that begins with `what` went wrong.

    The errors of these packages have no common kind, and the bytes of files upset them in every way; errors of the
    system about files (`OSError` with its number) stay.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what these packages put right by themselves
            yield
    except MusatError:
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        text = " ".join(str(error).split()) or type(error).__name__
        raise InterchangeError([Problem(file=str(path), message=f"{what}: {text}")]) from error


def require_content(path: Path) -> None:
    """Raise `InterchangeError` for an empty file, and `OSError` for none."""
    with path.open("rb") as file:
        if not file.read(1):
            raise refuse(path, "", "the file is empty", "points, lines or a grid")
