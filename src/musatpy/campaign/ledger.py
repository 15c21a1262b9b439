"""Which jobs of a folder are finished: a file of JSON lines that is only ever appended to.

A line that a kill or a full disk left unfinished is not read, and the next one does not stand behind it.
"""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

from musatpy.campaign.batch_jobs import BatchJob, JobOutcome, sha256_of
from musatpy.errors import MusatError
from musatpy.files import NO_LINK, real_path, write_files

NAME = ".musat-batch.jsonl"


class Ledger:
    """The finished jobs of a folder, each known by its results: their folder, seen from here, and their name."""

    def __init__(self, folder: Path) -> None:
        """Read the ledger of a folder; raises `OSError` where there is one that cannot be read.

        One with outdated lines is written anew; where that is not possible (a full disk) they stay.
        """
        self.path = folder / NAME
        self.entries: dict[str, dict[str, Any]] = {}
        data = self.path.read_bytes() if self.path.exists() else b""
        lines = data.split(b"\n")
        for line in lines:
            try:
                entry = json.loads(line)
                self.entries[entry["job"]] = entry["outcome"]
            except (ValueError, KeyError, TypeError):
                continue
        if len(self.entries) < len(lines) - 1 or lines[-1]:  # outdated lines, or one that is not whole
            with contextlib.suppress(OSError):
                text = "".join(_line(key, outcome) for key, outcome in self.entries.items())
                write_files({self.path: text.encode()})

    def finished(self, job: BatchJob) -> JobOutcome | None:
        """Return the outcome of a job that is finished, None where it has to be run.

        It is finished where the bytes of the deck and of its other inputs, the program's version and the options
        are those of the entry, and every file that it left is there and as it was.
        """
        entry = self.entries.get(self._key(job))
        if entry is None:
            return None
        try:
            outcome = JobOutcome.of_data(entry | {"kept": True})
            intact = (
                outcome.fingerprint == job.fingerprint(sha256_of(job.deck), job.inputs(outcome.inputs))
                and bool(outcome.outputs)
                and all(sha256_of(job.folder / name) == sha for name, sha in outcome.outputs.items())
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError, MusatError):
            return None
        return outcome if intact else None

    def add(self, job: BatchJob, outcome: JobOutcome) -> None:
        """Append a job that is finished; raises `OSError`, and leaves the ledger as it was then."""
        key = self._key(job)
        line = _line(key, asdict(outcome)).encode()
        fd = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | NO_LINK, 0o666)
        try:
            before = os.fstat(fd).st_size
            if before and os.pread(fd, 1, before - 1) != b"\n":
                line = b"\n" + line
            try:
                while line:
                    line = line[os.write(fd, line) :]
            except OSError as error:
                os.ftruncate(fd, before)
                raise OSError(error.errno, error.strerror, str(self.path)) from error
        finally:
            os.close(fd)
        self.entries[key] = asdict(outcome)

    def _key(self, job: BatchJob) -> str:
        here = real_path(self.path.parent)
        return os.path.relpath(real_path(job.folder) / job.deck.stem, here)


def _line(key: str, outcome: dict[str, Any]) -> str:
    return json.dumps({"job": key, "outcome": outcome}) + "\n"
