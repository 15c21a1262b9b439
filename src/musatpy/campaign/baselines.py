"""Baselines: listings and records of a set of decks, kept as plain files, that later runs are held against.

A folder has `baseline.json` (the index: which decks, their hashes, the program's version), and of each deck its
listing and, unless it has listings only, its record, in the places that the decks have below their common folder.
Of a deck that is expected to be unusable it has what the program says. `rules.toml`, `record_rules.toml` and
`message_rules.toml` say what may differ. New results go to a work folder until they are accepted.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
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
    messages_of,
    place_fault,
    unknown_decks,
)
from musatpy.campaign.batch import BatchResult, Watch, run_batch
from musatpy.campaign.batch_jobs import Outcome
from musatpy.campaign.locks import FolderLocks, folder_locks
from musatpy.campaign.manifest import check_jobs
from musatpy.campaign.program import sources_sha256
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
    given = _rules_of(rules, record_rules)
    for place in given.values():
        load_rules(place)
    fresh = _fresh(folder, decks if run is None else [*decks, run], formats, records, settings)
    _to_save(fresh, decks, run, exact, given)  # refused before anything is made
    with _work_of(folder, None, to_write=True) as (work, locks):
        baseline, chosen, files = _to_save(fresh, decks, run, exact, given)
        batch = run_batch(baseline.plan(chosen, work), processes=processes, watch=watch, again=True, locks=locks)
        return _take_over(baseline, chosen, batch, work, also=files, unusable=unusable)


def _rules_of(listings: Path | None, records: Path | None) -> dict[str, Path]:
    """Return the files of rules that are given, by the endings of what they are for."""
    return {ending: place for ending, place in ((LISTING, listings), (RECORD, records)) if place is not None}


def _to_save(
    new: Baseline, decks: Sequence[Path], run: Path | None, exact: bool, rules: Mapping[str, Path]
) -> tuple[Baseline, list[str], dict[Path, bytes]]:
    """Return the baseline that decks are added to, their names in it, and the files of rules that are missing.

    That is `new`, or the one that is in its folder already.
    """
    folder, records = new.folder, new.records
    fresh = not (folder / INDEX).exists()
    baseline = new if fresh else load_baseline(folder)
    if not fresh and (new.formats is not None or not records or new.settings or exact or rules):
        raise BaselineError(
            f"{folder} is a baseline already, whose rules, formats and settings are said: only decks are added"
        )
    if RECORD in rules and not records:
        raise BaselineError(f"{folder}: rules for records go with records, and listings only are to be kept")
    chosen = list(dict.fromkeys(_name_in(baseline, deck) for deck in decks))
    for name in baseline.entries:
        if name in chosen:
            raise BaselineError(
                f"{baseline.deck(name)} is in the baseline; musat baseline accept takes its new results over, "
                "save adds others"
            )
    if run is not None:
        baseline = replace(baseline, runs=baseline.runs | dict.fromkeys(chosen, _name_in(baseline, run)))
    _check_places(baseline, [*baseline.entries, *chosen])
    endings = () if exact or not fresh else (LISTING, RECORD) if records else (LISTING,)
    starters = {folder / RULES[ending]: _starter(ending) for ending in endings}
    files = {place: text.encode() for place, text in starters.items() if not place.exists()}
    files |= {folder / RULES[ending]: place.read_bytes() for ending, place in rules.items()}
    return baseline, chosen, files


def _name_in(baseline: Baseline, deck: Path) -> str:
    """Return what a deck is called in a baseline; raises `BaselineError` where it cannot be in it."""
    root = baseline.folder / baseline.root
    name = below(deck, root)
    if name is None:
        raise BaselineError(f"{deck} is not below {root}, where the decks of the baseline are")
    if fault := place_fault(name):
        raise BaselineError(f"{deck}: its name in the baseline {fault}")
    return name


def _starter(ending: str) -> str:
    """Return the rules to start from: files beside this one."""
    return Path(__file__).with_name(RULES[ending]).read_text(encoding="utf-8")


def _fresh(
    folder: Path, decks: Sequence[Path], formats: Path | None, records: bool, settings: tuple[str, ...]
) -> Baseline:
    """Return a baseline without decks: these are to be in its own folder, or below the one that has them all."""
    if all(below(deck, folder) for deck in decks):
        root = folder
    else:
        root = Path(os.path.commonpath([real_path(deck).parent for deck in decks]))
    seen = None if formats is None else os.path.relpath(real_path(formats), real_path(folder))
    place = os.path.relpath(real_path(root), real_path(folder))
    return Baseline(folder=folder, root=place, entries={}, records=records, formats=seen, settings=settings)


def _check_places(baseline: Baseline, names: Sequence[str]) -> None:
    """Raise `MusatError` where what is kept of two decks would be one file, or go over a deck or the index."""
    jobs = baseline.plan(names, baseline.folder).jobs
    check_jobs(jobs, also=[baseline.folder / INDEX])


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
    files: dict[Path, bytes] = dict(also or {})
    outdated = [place for name in gone for place in baseline.kept(name).values()]
    changes: dict[str, list[str]] = {"new": [], "changed": [], "unchanged": [], "failed": []}
    for name, outcome in zip(names, batch.outcomes, strict=True):
        was = entries.get(name)
        expected = unusable or (was is not None and was.fails)
        if outcome.deck_sha256 is None or not (outcome.state.has_results or (outcome.unusable and expected)):
            changes["failed"].append(name)
            continue
        entry = _entry_of(outcome)
        if was is not None and was.is_of(baseline.deck(name), entry.deck_sha256):
            entry = replace(entry, deck_sha256=was.deck_sha256)  # the same deck with other line ends
        contents = _contents(baseline, name, outcome, work)
        if was is not None and was == replace(entry, sources=was.sources):
            same = all(_is_kept(place, content) for place, content in contents.items())
            entry = was if same else entry  # what other sources make too stays theirs that made it
        else:
            same = False
        changes["unchanged" if same else "new" if was is None else "changed"].append(name)
        if was is not None and was.fails != entry.fails:
            outdated += baseline.kept(name).values()
        entries[name] = entry
        files |= {} if same else contents
    result = replace(baseline, entries=entries)
    remove_leftovers([*files, baseline.folder / INDEX, *baseline.folder.rglob("*")])
    index = baseline.folder / INDEX
    if (entries or baseline.entries) and (files or outdated or not _is_kept(index, result.index())):
        # the index last: after a kill before it the old one is true of what is not there any more
        write_files(files | {index: result.index()}, outdated=outdated)
    if work == baseline.folder / WORK:
        _tidy(baseline, [*names, *gone], work)
    return Taken(
        baseline=result, batch=batch, dropped=tuple(gone), **{key: tuple(value) for key, value in changes.items()}
    )


def _is_kept(place: Path, content: bytes) -> bool:
    """Tell whether a file of a baseline has this content, but for line ends (by git)."""
    return place.exists() and place.read_bytes().replace(b"\r\n", b"\n") == content


def _entry_of(outcome: Outcome) -> Entry:
    """Return what the index says of a deck that is taken over."""
    assert outcome.deck_sha256 is not None
    return Entry(
        deck_sha256=outcome.deck_sha256,
        version=musatpy.__version__,
        status=int(outcome.state.status),
        state=outcome.state.value,
        inputs=outcome.inputs,
        sources=sources_sha256(),
    )


def _contents(baseline: Baseline, name: str, outcome: Outcome, work: Path) -> dict[Path, bytes]:
    """Return what is to be kept of a deck: what its run left, or if it failed what was said."""
    fails = outcome.unusable
    new = baseline.files(name, work, fails=fails)
    return {
        place: messages_of(name, baseline.deck(name), outcome) if fails else new[ending].read_bytes()
        for ending, place in baseline.files(name, baseline.folder, fails=fails).items()
    }


State = Literal["identical", "within the rules", "different", "failed"]


@dataclass(frozen=True, kw_only=True)
class Checked:
    """One deck held against its baseline."""

    name: str
    state: State
    outcome: Outcome
    notes: tuple[str, ...] = ()  # what is different besides the files, or why nothing could be compared
    differences: tuple[Difference, ...] = ()  # of the files that are not identical

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

    @property
    def versions(self) -> tuple[str, ...]:
        """The versions of the program that made what is kept of these decks."""
        return tuple(sorted({self.baseline.entries[deck.name].version for deck in self.decks}))


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
    given = _rules_of(rules, record_rules)
    if RECORD in given and not baseline.records:
        raise BaselineError(f"{folder}: the baseline keeps listings only; there are no records for these rules")
    ruled = baseline.rules() | {ending: load_rules(place) for ending, place in given.items()}
    with _work_of(folder, work) as (place, locks):
        plan = replace(baseline, settings=(*baseline.settings, *settings)).plan(chosen, place)
        batch = run_batch(plan, processes=processes, again=True, watch=watch, locks=locks)
        comparer = _Comparer(ruled)
        decks = tuple(
            _checked(baseline, name, outcome, place, comparer)
            for name, outcome in zip(chosen, batch.outcomes, strict=True)
        )
        result = Check(
            baseline=baseline,
            batch=batch,
            decks=decks,
            unused_rules=comparer.unused(),
            unknown=() if names else tuple(unknown_decks(baseline)),
            work=place,
        )
        if work is None and result.decks_same:
            shutil.rmtree(place)
            return replace(result, work=None)
        return result


class _Comparer:
    """Compares files by the rules of their endings, and knows which rules ever matched."""

    def __init__(self, rules: dict[str, Rules | None]) -> None:
        self.rules = rules
        self.unmatched = {
            ending: [rule.name for rule in chosen.rules] if chosen else [] for ending, chosen in rules.items()
        }
        self.compared: set[str] = set()  # endings

    def compare(self, ending: str, kept: Path, new: Path) -> Difference | None:
        """Return what differs, None where the files are identical; raises `CannotCompareError`.

        Files that are identical are compared as long as some rule has not matched yet, to know whether it does.
        """
        contents = kept.read_bytes(), new.read_bytes()
        identical = contents[0] == contents[1]
        if identical and not self.unmatched[ending]:
            return None
        difference = compare_bytes(*contents, self.rules[ending], names=(str(kept), str(new)))
        self.compared.add(ending)
        matched = {rule.name for rule in difference.rules if rule.matched}
        self.unmatched[ending] = [name for name in self.unmatched[ending] if name not in matched]
        return None if identical else difference

    def unused(self) -> tuple[str, ...]:
        """Return the rules that matched in no deck, of the endings that were compared at all."""
        return tuple(
            f"{RULES[end]}: {name}" for end in RULES if end in self.compared for name in self.unmatched[end]
        )


def _checked(baseline: Baseline, name: str, outcome: Outcome, work: Path, comparer: _Comparer) -> Checked:
    """Return one deck held against its baseline."""
    entry, notes, differences = baseline.entries[name], [], []
    if not outcome.state.has_results and not (entry.fails and outcome.unusable):
        return Checked(name=name, state="failed", outcome=outcome, notes=(_why(baseline, name, outcome),))
    if not entry.is_of(baseline.deck(name), outcome.deck_sha256):
        notes.append("the deck is not the one that was saved")
    if changed := entry.changed_inputs(outcome.inputs):
        notes.append(f"not the one that was saved: {', '.join(changed)}")
    if int(outcome.state.status) != entry.status or entry.state not in ("", outcome.state):
        notes.append(_other_end(entry, outcome))
    if entry.fails == outcome.unusable:
        for ending, new in _left(baseline, name, outcome, work).items():
            kept = baseline.kept(name)[ending]
            if not kept.exists():
                notes.append(f"{kept} is gone")
                continue
            try:
                difference = comparer.compare(ending, kept, new)
            except CannotCompareError as error:
                notes.append(str(error))
            else:
                differences += [] if difference is None else [difference]
    state: State = "within the rules" if differences else "identical"
    if notes or not all(difference.same for difference in differences):
        state = "different"
    return Checked(name=name, state=state, outcome=outcome, notes=tuple(notes), differences=tuple(differences))


def _other_end(entry: Entry, outcome: Outcome) -> str:
    """Return what is new about the end of a run."""
    if entry.fails:
        return f"it can be used now: {outcome.state}"
    return f"it is {outcome.state} now, and was {entry.state}" if entry.state else f"it is {outcome.state} now"


def _left(baseline: Baseline, name: str, outcome: Outcome, work: Path) -> dict[str, Path]:
    """Return the new files of a deck by their endings; what was said of one that failed becomes one."""
    places = baseline.files(name, work, fails=outcome.unusable)
    if MESSAGES in places:
        write_files({places[MESSAGES]: messages_of(name, baseline.deck(name), outcome)})
    return places


def _why(baseline: Baseline, name: str, outcome: Outcome) -> str:
    """Return why a deck has no results."""
    if not os.path.lexists(baseline.deck(name)):
        return "the deck is gone; musat baseline accept drops it"
    return f"{outcome.state}: {outcome.message}" if outcome.message else str(outcome.state)


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


def _tidy(baseline: Baseline, names: Iterable[str], work: Path) -> None:
    """Take the new results of decks away, and the work folder when it has none that could be accepted later."""
    for name in names:
        for fails in (False, True):
            for place in baseline.files(name, work, fails=fails).values():
                place.unlink(missing_ok=True)
    if not any(path.suffix in (f".{LISTING}", f".{MESSAGES}") for path in work.rglob("*.*")):
        shutil.rmtree(work)
