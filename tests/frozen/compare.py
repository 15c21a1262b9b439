"""Whether two versions of the program say and write the same, on decks of all kinds.

`python tests/frozen/compare.py COMMIT [COMMIT]` (the second one is HEAD where it is not given) checks both out,
makes the decks by the first, runs both versions on them and on the examples of the first one's manual on this
machine, and prints every output that differs with the first lines that do; of records the fields, by the names of
fields.toml. Exit status: 0 nothing differs, 1 something does. `--keep DIR` keeps all files, and takes decks and
outputs of a commit that are there already; `--every N` takes one of N decks, where hours are too long.
"""

from __future__ import annotations

import argparse
import filecmp
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from frozen.records import differences

ROOT = Path(__file__).resolve().parents[2]
_LINES = 3  # of a difference, of both versions


def main() -> int:
    """Compare two commits."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before")
    parser.add_argument("after", nargs="?", default="HEAD")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--every", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = (given.keep or Path(scratch)).resolve()
        commits = [_commit(name) for name in (given.before, given.after)]
        sources = [_checkout(commit, folder / commit) for commit in commits]
        if not (folder / "decks").exists():
            _ended([_python(sources[0], sources[0].parent / "tests", "frozen.inputs", folder / "decks")])
        outputs = [folder / f"{commit}_outputs" for commit in commits]
        made = {out: out.with_suffix(".part") for out in outputs if not out.exists()}
        for part in made.values():
            shutil.rmtree(part, ignore_errors=True)
        _ended(
            [
                _python(source, ROOT / "tests", "frozen.outputs", folder / "decks", made[out], str(given.every))
                for source, out in zip(sources, outputs, strict=True)
                if out in made
            ]
        )
        for out, part in made.items():
            part.rename(out)
        different = list(_differences(*outputs))
        for text in different:
            print(text)
        number = sum(1 for path in outputs[0].rglob("*") if path.is_file())
        print(f"{number} outputs, {len(different)} different")
    return 1 if different else 0


def _commit(name: str) -> str:
    return subprocess.run(
        ["git", "rev-parse", "--short", name], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.strip()


def _checkout(commit: str, folder: Path) -> Path:
    """Return the sources of a commit, whole: card formats stand beside them."""
    if not folder.exists():
        folder.mkdir(parents=True)
        archive = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
        subprocess.run(["tar", "-x", "-C", folder], input=archive, check=True)
    return folder / "src"


def _python(source: Path, tests: Path, script: str, *arguments: Path | str) -> subprocess.Popen[bytes]:
    """Start a script of `tests`: those of the version itself make the decks, as they enter by its modules."""
    path = f"{source}{os.pathsep}{tests}"
    environment = os.environ | {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    return subprocess.Popen([sys.executable, "-m", script, *arguments], env=environment)


def _ended(processes: list[subprocess.Popen[bytes]]) -> None:
    if sum(process.wait() for process in processes):
        raise SystemExit("a version has failed")


def _differences(before: Path, after: Path) -> Iterator[str]:
    """Yield what differs, a text for each file."""
    names = {path.relative_to(folder) for folder in (before, after) for path in folder.rglob("*") if path.is_file()}
    for name in sorted(names):
        pair = before / name, after / name
        if not all(path.exists() for path in pair):
            yield f"only {'before' if pair[0].exists() else 'after'}: {name}"
        elif filecmp.cmp(*pair, shallow=False):
            continue
        elif (lines := _record_changes(*pair)) is not None:
            if lines:
                yield f"{name}\n    " + "\n    ".join(lines)
        else:
            texts = [path.read_text(encoding="utf-8", errors="replace").splitlines() for path in pair]
            yield f"{name}\n    " + "\n    ".join(_first_changes(*texts))


def _record_changes(before: Path, after: Path) -> list[str] | None:
    """Return the fields that differ of two records, by their names; None of other files."""
    if before.suffix != ".json":
        return None
    try:
        return differences(before.read_text(encoding="utf-8"), after.read_text(encoding="utf-8"))
    except ValueError:
        return None


def _first_changes(before: list[str], after: list[str]) -> list[str]:
    """Return the first lines that differ, and how many lines both have: texts of megabytes are compared at once."""
    same = sum(1 for _ in takewhile(bool, map(str.__eq__, before, after)))
    changes = [f"-{line}" for line in before[same : same + _LINES]] + [
        f"+{line}" for line in after[same : same + _LINES]
    ]
    return [f"line {same + 1} of {len(before)} and {len(after)}", *changes]


if __name__ == "__main__":
    sys.exit(main())
