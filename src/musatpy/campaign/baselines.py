"""Baselines: listings and records of a set of decks, kept as plain files, that later runs are held against.

A folder has `baseline.json` (the index: which decks, their hashes, the program's version), and of each deck its
listing and, unless it has listings only, its record, in the places that the decks have below their common folder.
Of a deck that is expected to be unusable it has what the program says. `rules.toml`, `record_rules.toml` and
`message_rules.toml` say what may differ. New results go to a work folder until they are accepted.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import musatpy
from musatpy.campaign.baseline_index import (
    INDEX,
    LISTING,
    MESSAGES,
    RECORD,
    RULES,
    Baseline,
    BaselineError,
    Entry,
    below,
    load_baseline,
    place_fault,
    unknown_decks,
)
from musatpy.campaign.batch import BatchResult, Watch, run_batch
from musatpy.campaign.batch_jobs import Outcome
from musatpy.campaign.locks import FolderLocks, folder_locks
from musatpy.campaign.manifest import check_jobs
from musatpy.campaign.program import sources_sha256
from musatpy.errors import of_each_kind, printable
from musatpy.files import real_path, remove_leftovers, write_files
from musatpy.listings import CannotCompareError, Difference, Rules, compare_bytes, load_rules

WORK = ".new"  # below the baseline: new results until they are accepted


@dataclass(frozen=True, kw_only=True)
class Taken:
    """What was taken over into a baseline."""

    baseline: Baseline
    batch: BatchResult
    new: tuple[str, ...]  # decks whose files were not there before
    changed: tuple[str, ...]
    unchanged: tuple[str, ...]
    dropped: tuple[str, ...] = ()  # whose decks are gone
    failed: tuple[str, ...] = ()  # without results; what is kept of them was left as it is


def save(
    folder: Path,
    decks: Sequence[Path],
    *,
    formats: Path | None = None,
    records: bool = True,
    exact: bool = False,
    rules: Path | None = None,
    record_rules: Path | None = None,
    settings: tuple[str, ...] = (),
    unusable: bool = False,
    run: Path | None = None,
    processes: int | None = None,
    watch: Watch | None = None,
) -> Taken:
    """Make a baseline of decks in a folder, or add decks to the one that is there.

    A new one gets rules to start from, or `rules` for its listings and `record_rules` for its records, or none
    with `exact`. `settings` are set for all runs of a new one, later ones too. With `unusable` what the program
    says of decks that cannot be used is kept. With `run`, the deck of a triangulation, the decks are compilation
    decks, to be compiled on that one's run. Raises `BaselineError` for decks that are in it or
    cannot be, `RulesError`, `LockedError`, `OSError`.
    """
    given = {ending: path for ending, path in ((LISTING, rules), (RECORD, record_rules)) if path is not None}
    for path in given.values():
        load_rules(path)
    files = {folder / RULES[ending]: path.read_bytes() for ending, path in given.items()}
    if record_rules is not None and not records:
        raise BaselineError(f"{folder}: rules for records go with records, and listings only are to be kept")
    root = _root_of(folder, decks if run is None else [*decks, run])
    fresh = Baseline(folder=folder, root=_seen_from(folder, root), records=records, settings=settings, entries={})
    fresh = fresh if formats is None else replace(fresh, formats=_seen_from(folder, formats))
    stated = bool(formats or not records or settings or exact or given)
    _with_decks(fresh, decks, run, stated)  # refused before anything is made
    with _work_of(folder, None, to_write=True) as (work, locks):
        baseline, chosen = _with_decks(fresh, decks, run, stated)
        if not (folder / INDEX).exists() and not exact:
            own = [folder / RULES[ending] for ending in ((LISTING, RECORD) if records else (LISTING,))]
            starters = {place: Path(__file__).with_name(place.name) for place in own if not place.exists()}
            files = {place: starter.read_bytes() for place, starter in starters.items()} | files
        batch = run_batch(baseline.plan(chosen, work), processes=processes, watch=watch, again=True, locks=locks)
        return _take_over(baseline, chosen, batch, work, also=files, unusable=unusable)


def _seen_from(folder: Path, path: Path) -> str:
    return os.path.relpath(real_path(path), real_path(folder))


def _root_of(folder: Path, decks: Sequence[Path]) -> Path:
    """Return the common folder of the decks of a new baseline: its own, or the one that has them all below it."""
    if all(below(deck, folder) for deck in decks):
        return folder
    return Path(os.path.commonpath([real_path(deck).parent for deck in decks]))


def _with_decks(
    fresh: Baseline, decks: Sequence[Path], run: Path | None, stated: bool
) -> tuple[Baseline, list[str]]:
    """Return the baseline that decks are added to, `fresh` or that of its folder, and their names in it.

    `stated`: rules, formats or settings are given, which a baseline that is there already has.
    """
    there = (fresh.folder / INDEX).exists()
    baseline = load_baseline(fresh.folder) if there else fresh
    if there and stated:
        raise BaselineError(
            f"{fresh.folder} is a baseline already, which has its rules, formats and settings: only decks are added"
        )
    chosen = list(dict.fromkeys(_name_in(baseline, deck) for deck in decks))
    if old := [name for name in chosen if name in baseline.entries]:
        raise BaselineError(
            f"{baseline.deck(old[0])} is in the baseline; musat baseline accept takes its new results over, "
            "save adds others"
        )
    if run is not None:
        baseline = replace(baseline, runs=baseline.runs | dict.fromkeys(chosen, _name_in(baseline, run)))
    jobs = baseline.plan([*baseline.entries, *chosen], baseline.folder).jobs
    check_jobs(jobs, also=[baseline.folder / INDEX])  # no file is that of two decks, a deck or the index
    return baseline, chosen


def _name_in(baseline: Baseline, deck: Path) -> str:
    """Return what a deck is called in a baseline; raises `BaselineError` where it cannot be in it."""
    root = baseline.folder / baseline.root
    name = below(deck, root)
    if name is None:
        raise BaselineError(f"{deck} is not below {root}, where the decks of the baseline are")
    if fault := place_fault(name):
        raise BaselineError(f"{deck}: its name in the baseline {fault}")
    return name


def accept(
    folder: Path,
    names: Sequence[str] = (),
    *,
    work: Path | None = None,
    unusable: bool = False,
    processes: int | None = None,
    watch: Watch | None = None,
) -> Taken:
    """Take new results over into a baseline, of all decks or of those named.

    They are those that a check left, where the deck, the options and the program's version are still the same; the
    other decks are run. Decks that are gone are dropped. One that had results and cannot be used any more is taken
    over as such only if `unusable`. Raises `BaselineError`, `LockedError`, `OSError`.
    """
    load_baseline(folder)  # where there is none nothing is made
    with _work_of(folder, work, to_write=True) as (place, locks):
        baseline = load_baseline(folder)
        chosen = baseline.chosen(names)
        if not (folder / baseline.root).is_dir():
            raise BaselineError(
                f"{folder / baseline.root}: the folder of the decks is not there; nothing was dropped"
            )
        gone = [name for name in chosen if not os.path.lexists(baseline.deck(name))]
        left = [name for name in chosen if name not in gone]
        batch = run_batch(baseline.plan(left, place), processes=processes, watch=watch, locks=locks)
        return _take_over(baseline, left, batch, place, gone=gone, unusable=unusable)


def _take_over(
    baseline: Baseline,
    names: Sequence[str],
    batch: BatchResult,
    work: Path,
    *,
    gone: Sequence[str] = (),
    also: dict[Path, bytes] | None = None,
    unusable: bool = False,
) -> Taken:
    """Write the new results and the index, all or none, and remove what is kept of decks that are gone."""
    if batch.interrupted:
        raise BaselineError(f"{baseline.folder}: interrupted; nothing was taken over")
    entries = {name: entry for name, entry in baseline.entries.items() if name not in gone}
    files = dict(also or {})
    outdated = [place for name in gone for place in baseline.kept(name).values()]
    became: dict[str, list[str]] = {"new": [], "changed": [], "unchanged": [], "failed": []}
    for name, outcome in zip(names, batch.outcomes, strict=True):
        was = entries.get(name)
        expected = outcome.unusable and (unusable or (was is not None and was.fails))
        if outcome.deck_sha256 is None or not (outcome.state.has_results or expected):
            became["failed"].append(name)
            continue
        entry = _entry_of(outcome, baseline.deck(name), was)
        left, kept = _left(baseline, name, outcome, work), baseline.files(name, baseline.folder, fails=entry.fails)
        contents = {kept[ending]: place.read_bytes() for ending, place in left.items()}
        same = entry == was and all(_is_kept(place, content) for place, content in contents.items())
        if was is not None and not same:
            entry = replace(entry, sources=sources_sha256())
            outdated += [] if was.fails == entry.fails else baseline.kept(name).values()
        entries[name] = entry
        files |= {} if same else contents
        became["unchanged" if same else "new" if was is None else "changed"].append(name)
    result = replace(baseline, entries=entries)
    index = baseline.folder / INDEX
    remove_leftovers([*files, index, *baseline.folder.rglob("*")])
    if (entries or baseline.entries) and (files or outdated or not _is_kept(index, result.index())):
        # the index last: after a kill before it the old one is true of what is not there any more
        write_files(files | {index: result.index()}, outdated=outdated)
    if work == baseline.folder / WORK:
        _tidy(baseline, [*names, *gone], work)
    return Taken(
        baseline=result, batch=batch, dropped=tuple(gone), **{key: tuple(value) for key, value in became.items()}
    )


def _entry_of(outcome: Outcome, deck: Path, was: Entry | None) -> Entry:
    """Return what the index says of a deck that is taken over, the same as it `was` where only line ends differ.

    What other sources of the program make too stays theirs that made it first.
    """
    assert outcome.deck_sha256 is not None
    same_deck = was is not None and was.is_of(deck, outcome.deck_sha256)
    return Entry(
        deck_sha256=was.deck_sha256 if was is not None and same_deck else outcome.deck_sha256,
        version=musatpy.__version__,
        status=int(outcome.state.status),
        state=outcome.state.value,
        inputs=outcome.inputs,
        sources=sources_sha256() if was is None else was.sources,
    )


def _is_kept(place: Path, content: bytes) -> bool:
    """Tell whether a file of a baseline has this content, but for line ends (by git)."""
    return place.exists() and place.read_bytes().replace(b"\r\n", b"\n") == content


def _left(baseline: Baseline, name: str, outcome: Outcome, work: Path) -> dict[str, Path]:
    """Return the new files of a deck by their endings; what was said of one that cannot be used becomes one.

    That are its state, exit status and all messages of its run. The deck has its name in the baseline there, so
    that the text depends neither on the place of the baseline nor on the folder in which the program is started.
    """
    places = baseline.files(name, work, fails=outcome.unusable)
    if outcome.unusable:
        head = f"{outcome.state}, exit status {int(outcome.state.status)}: {outcome.message}"
        messages = [problem.render() for problem in of_each_kind(outcome.problems)]
        text = "\n".join([head, *messages]).replace(str(baseline.deck(name)), name)
        write_files({places[MESSAGES]: f"{printable(text)}\n".encode()})
    return places


def _tidy(baseline: Baseline, names: Sequence[str], work: Path) -> None:
    """Take the new results of decks away, and the work folder when it has none that could be accepted later."""
    for name in names:
        for ending in (LISTING, RECORD, MESSAGES):
            (work / name).with_suffix(f".{ending}").unlink(missing_ok=True)
    if not any(path.suffix in (f".{LISTING}", f".{MESSAGES}") for path in work.rglob("*.*")):
        shutil.rmtree(work)


@contextmanager
def _work_of(folder: Path, work: Path | None, *, to_write: bool = False) -> Iterator[tuple[Path, FolderLocks]]:
    """Give the work folder, locked, and the baseline too where it is to be written to.

    A work folder below the baseline is nothing for git.
    """
    place = folder / WORK if work is None else work
    if real_path(place) == real_path(folder):
        raise BaselineError(f"{place}: new results would overwrite what the baseline keeps")
    with folder_locks() as locks:
        if to_write:
            locks.take(folder)
        locks.take(place, "; --out takes new results elsewhere")
        if work is None:
            write_files({place / ".gitignore": b"*\n"})
        yield place, locks
    with suppress(OSError):  # a new baseline in which nothing was kept
        folder.rmdir()


State = Literal["identical", "within the rules", "different", "failed"]


@dataclass(frozen=True, kw_only=True)
class Checked:
    """One deck held against its baseline."""

    name: str
    state: State
    outcome: Outcome
    notes: tuple[str, ...] = ()  # what is different besides the files, or why nothing could be compared
    differences: tuple[Difference, ...] = ()  # of the files that are not identical
    unmatched: dict[str, tuple[str, ...]] = field(default_factory=dict)  # rules that matched nothing, by file

    @property
    def same(self) -> bool:
        """True where it differs by no more than the rules let pass."""
        return self.state in ("identical", "within the rules")


@dataclass(frozen=True, kw_only=True)
class Check:
    """A baseline held against new runs."""

    baseline: Baseline
    batch: BatchResult
    decks: tuple[Checked, ...]
    unused_rules: tuple[str, ...]  # that matched nothing in any deck
    unknown: tuple[str, ...]  # decks beside its own that the baseline does not have
    work: Path | None  # where the new results are; None: taken away, because nothing is to be accepted

    @property
    def same(self) -> bool:
        """True where no deck differs by more than the rules let pass, and none is unknown to the baseline."""
        return self.decks_same and not self.unknown

    @property
    def decks_same(self) -> bool:
        """True where no deck of the baseline differs by more than the rules let pass."""
        return all(deck.same for deck in self.decks)


def check(
    folder: Path,
    names: Sequence[str] = (),
    *,
    rules: Path | None = None,
    record_rules: Path | None = None,
    settings: tuple[str, ...] = (),
    work: Path | None = None,
    processes: int | None = None,
    watch: Watch | None = None,
) -> Check:
    """Run the decks of a baseline anew (all, or those named) and hold their results against it.

    `rules` are for the listings and `record_rules` for the records, in place of those of the baseline; `settings`
    are set besides its own: what they change is different then, and is nothing that could be accepted. New results
    go to `work`; without, below the baseline, where they stay until they are accepted if any deck is different.
    Where no deck is named, those are looked for that the baseline does not have. Raises `BaselineError`,
    `RulesError`, `LockedError`, `OSError`.
    """
    baseline = load_baseline(folder)
    chosen = baseline.chosen(names)
    if not chosen:
        raise BaselineError(f"{folder}: the baseline has no deck any more; musat baseline save adds some")
    if record_rules is not None and not baseline.records:
        raise BaselineError(f"{folder}: the baseline keeps listings only; there are no records for these rules")
    places = {ending: folder / name for ending, name in RULES.items()}
    given = {ending: path for ending, path in ((LISTING, rules), (RECORD, record_rules)) if path is not None}
    there = {ending: path for ending, path in places.items() if path.exists()} | given
    ruled = {ending: load_rules(path) for ending, path in there.items()}
    with _work_of(folder, work) as (place, locks):
        plan = replace(baseline, settings=(*baseline.settings, *settings)).plan(chosen, place)
        batch = run_batch(plan, processes=processes, again=True, watch=watch, locks=locks)
        runs = zip(chosen, batch.outcomes, strict=True)
        decks = tuple(_checked(baseline, name, outcome, place, ruled) for name, outcome in runs)
        done = work is None and all(deck.same for deck in decks)
        if done:
            shutil.rmtree(place)
        return Check(
            baseline=baseline,
            batch=batch,
            decks=decks,
            unused_rules=_unused(decks),
            unknown=() if names else tuple(unknown_decks(baseline)),
            work=None if done else place,
        )


def _unused(decks: Sequence[Checked]) -> tuple[str, ...]:
    """Return the rules that matched in no file that was compared, after the names of theirs."""
    unused: dict[str, list[str]] = {}
    for file, rules in (item for deck in decks for item in deck.unmatched.items()):
        unused[file] = [rule for rule in unused.get(file, rules) if rule in rules]
    return tuple(f"{file}: {rule}" for file, rules in unused.items() for rule in rules)


def _checked(baseline: Baseline, name: str, outcome: Outcome, work: Path, rules: dict[str, Rules]) -> Checked:
    """Return one deck held against its baseline."""
    entry, deck = baseline.entries[name], baseline.deck(name)
    notes: list[str] = []
    differences: list[Difference] = []
    unmatched: dict[str, tuple[str, ...]] = {}
    if not outcome.state.has_results and not (entry.fails and outcome.unusable):
        why = f"{outcome.state}: {outcome.message}" if outcome.message else str(outcome.state)
        why = why if os.path.lexists(deck) else "the deck is gone; musat baseline accept drops it"
        return Checked(name=name, state="failed", outcome=outcome, notes=(why,))
    if not entry.is_of(deck, outcome.deck_sha256):
        notes.append("the deck is not the one that was saved")
    if changed := entry.changed_inputs(outcome.inputs):
        notes.append(f"not the one that was saved: {', '.join(changed)}")
    if entry.fails and not outcome.unusable:
        notes.append(f"it can be used now: {outcome.state}")
    elif int(outcome.state.status) != entry.status or entry.state not in ("", outcome.state):
        notes.append(f"it is {outcome.state} now" + (f", and was {entry.state}" if entry.state else ""))
    left = _left(baseline, name, outcome, work) if entry.fails == outcome.unusable else {}
    for ending, new in left.items():
        kept = baseline.kept(name)[ending]
        try:
            contents = kept.read_bytes(), new.read_bytes()
            if contents[0] == contents[1] and ending not in rules:
                continue
            difference = compare_bytes(*contents, rules.get(ending), names=(str(kept), str(new)))
        except FileNotFoundError:
            notes.append(f"{kept} is gone")
        except CannotCompareError as error:
            notes.append(str(error))
        else:
            unmatched[RULES[ending]] = difference.unused_rules
            differences += [] if contents[0] == contents[1] else [difference]
    state: State = "within the rules" if differences else "identical"
    if notes or not all(difference.same for difference in differences):
        state = "different"
    return Checked(
        name=name,
        state=state,
        outcome=outcome,
        notes=tuple(notes),
        differences=tuple(differences),
        unmatched=unmatched,
    )
