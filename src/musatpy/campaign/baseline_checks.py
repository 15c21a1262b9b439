"""Baselines held against new runs: what differs, as text for people, JSON, and JUnit XML (a test a deck)."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Literal
from xml.etree import ElementTree

from musatpy.campaign import baselines
from musatpy.campaign.baselines import Baseline, BaselineError, Entry
from musatpy.campaign.batch import BatchResult, Watch, run_batch
from musatpy.campaign.batch_jobs import BatchJob, JobOutcome, sha256_of
from musatpy.campaign.manifest import decks_in
from musatpy.errors import MusatError, printable
from musatpy.listings import CannotCompareError, Difference, Rules, compare_bytes, load_rules
from musatpy.listings.findings import Style, json_text, junit_document, junit_suite, plain, render

SCHEMA_VERSION = "1.0"
Likeness = Literal["identical", "within the rules", "different", "failed"]


@dataclass(frozen=True, kw_only=True)
class DeckComparison:
    """One deck held against its baseline."""

    name: str
    state: Likeness
    outcome: JobOutcome
    notes: tuple[str, ...] = ()  # what is different besides the files, or why nothing could be compared
    differences: tuple[Difference, ...] = ()  # of the files that are not identical
    unmatched: dict[str, tuple[str, ...]] = field(default_factory=dict)  # rules that matched nothing, by file

    @property
    def same(self) -> bool:
        """True where it differs by no more than the rules let pass."""
        return self.state in ("identical", "within the rules")


@dataclass(frozen=True, kw_only=True)
class BaselineCheck:
    """A baseline held against new runs."""

    baseline: Baseline
    batch: BatchResult
    decks: tuple[DeckComparison, ...]
    unknown: tuple[str, ...]  # decks beside its own that the baseline does not have
    work: Path | None  # where the new results are; None: taken away, because nothing is to be accepted

    @property
    def same(self) -> bool:
        """True where no deck differs by more than the rules let pass, and none is unknown to the baseline."""
        return all(deck.same for deck in self.decks) and not self.unknown

    @property
    def unused_rules(self) -> tuple[str, ...]:
        """The rules that matched in no file that was compared, after the names of theirs."""
        unused: dict[str, list[str]] = {}
        for file, rules in (item for deck in self.decks for item in deck.unmatched.items()):
            unused[file] = [rule for rule in unused.get(file, rules) if rule in rules]
        return tuple(f"{file}: {rule}" for file, rules in unused.items() for rule in rules)


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
) -> BaselineCheck:
    """Run the decks of a baseline anew (all, or those named) and hold their results against it.

    `rules` are for the listings and `record_rules` for the records, in place of those of the baseline; `settings`
    are set besides its own: what they change is different then, and is nothing that could be accepted. New results
    go to `work`; without, below the baseline, where they stay until they are accepted if any deck is different.
    Where no deck is named, those are looked for that the baseline does not have. Raises `BaselineError`,
    `RulesError`, `LockedError`, `OSError`.
    """
    baseline = baselines.load_baseline(folder)
    chosen = baseline.chosen(names)
    if not chosen:
        raise BaselineError(f"{folder}: the baseline has no deck any more; musat baseline save adds some")
    if record_rules is not None and not baseline.records:
        raise BaselineError(f"{folder}: the baseline keeps listings only; there are no records for these rules")
    places = {ending: folder / name for ending, name in baselines.RULES.items() if (folder / name).exists()}
    ruled = {
        ending: load_rules(path) for ending, path in (places | baselines.given_rules(rules, record_rules)).items()
    }
    with baselines.work_folder(folder, work) as (place, locks):
        plan = replace(baseline, settings=(*baseline.settings, *settings)).plan(chosen, place)
        batch = run_batch(plan, processes=processes, again=True, watch=watch, locks=locks)
        runs = zip(chosen, batch.outcomes, strict=True)
        decks = tuple(_checked(baseline, name, outcome, place, ruled) for name, outcome in runs)
        done = work is None and all(deck.same for deck in decks)
        if done:
            shutil.rmtree(place)
        unknown = () if names else tuple(_unknown_decks(baseline))
        return BaselineCheck(
            baseline=baseline, batch=batch, decks=decks, unknown=unknown, work=None if done else place
        )


def _checked(
    baseline: Baseline, name: str, outcome: JobOutcome, work: Path, rules: dict[str, Rules]
) -> DeckComparison:
    """Return one deck held against its baseline."""
    entry, deck = baseline.entries[name], baseline.deck(name)
    notes: list[str] = []
    differences: list[Difference] = []
    unmatched: dict[str, tuple[str, ...]] = {}
    if not outcome.state.has_results and not (entry.fails and outcome.unusable):
        why = f"{outcome.state}: {outcome.message}" if outcome.message else str(outcome.state)
        why = why if os.path.lexists(deck) else "the deck is gone; musat baseline accept drops it"
        return DeckComparison(name=name, state="failed", outcome=outcome, notes=(why,))
    if not entry.is_of(deck, outcome.deck_sha256):
        notes.append("the deck is not the one that was saved")
    if changed := entry.changed_inputs(outcome.inputs):
        notes.append(f"not the one that was saved: {', '.join(changed)}")
    if entry.fails and not outcome.unusable:
        notes.append(f"it can be used now: {outcome.state}")
    elif (int(outcome.state.status), outcome.state.value) != (entry.status, entry.state):
        notes.append(f"it is {outcome.state} now, and was {entry.state}")
    results = baselines.new_results(baseline, name, outcome, work) if entry.fails == outcome.unusable else {}
    for ending, new in results.items():
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
            unmatched[baselines.RULES[ending]] = difference.unused_rules
            differences += [] if contents[0] == contents[1] else [difference]
    state: Likeness = "within the rules" if differences else "identical"
    if notes or not all(difference.same for difference in differences):
        state = "different"
    return DeckComparison(
        name=name,
        state=state,
        outcome=outcome,
        notes=tuple(notes),
        differences=tuple(differences),
        unmatched=unmatched,
    )


def _unknown_decks(baseline: Baseline) -> list[str]:
    """Return the decks that a baseline does not have, in the folders of those that it has."""
    root = baseline.folder / baseline.root
    folders = sorted({root / PurePosixPath(name).parent for name in baseline.entries})
    decks = [baselines.below(deck, root) for folder in folders for deck in decks_in(folder)]
    return [name for name in decks if name is not None and name not in baseline.entries]


def changed_decks(baseline: Baseline) -> dict[str, str]:
    """Return of each deck what became of it since it was saved.

    `as saved`, `changed` (its bytes), `gone`, `unreadable`, or `other inputs`: card formats or a geoid model.
    """
    jobs = baseline.plan(baseline.entries, baseline.folder).jobs
    changes = zip(baseline.entries, map(_change_of, baseline.entries.values(), jobs), strict=True)
    return dict(sorted(changes))


def _change_of(entry: Entry, job: BatchJob) -> str:
    try:
        same = entry.is_of(job.deck, sha256_of(job.deck))
    except OSError as error:
        return "gone" if isinstance(error, FileNotFoundError) else "unreadable"
    with suppress(OSError, MusatError):  # of inputs that are not there any more
        if not same or not entry.changed_inputs(job.inputs(entry.inputs)):
            return "as saved" if same else "changed"
    return "other inputs"


def check_text(check: BaselineCheck, listed: int, style: Style = plain) -> str:
    """Return what differs of each deck, a row of each deck, and a verdict; `listed` 0: only how much differs."""
    width = max(len(printable(name)) for name in (*(deck.name for deck in check.decks), *check.unknown))
    lines = []
    for deck in check.decks:
        if listed and deck.differences and not deck.same:
            lines += [style(deck.name, "title"), _rendered(deck, listed, style)]
    for deck in check.decks:
        different = [] if listed else [_count_text(file) for file in deck.differences if not file.same]
        why = "; ".join([*deck.notes, *different])
        notes = printable(f"  ({why})") if why else ""
        state = style(deck.state, "same" if deck.same else "different")
        lines.append(f"{printable(deck.name):<{width}}  {state}{notes}")
    for name in check.unknown:
        unknown = style("not in the baseline", "different")
        lines.append(f"{printable(name):<{width}}  {unknown}  (musat baseline save adds it)")
    lines += [style(f"rule never matched: {name}", "warning") for name in check.unused_rules]
    states = [deck.state for deck in check.decks]
    if check.work is not None and not {*states} <= {"identical", "within the rules"} and {*states} != {"failed"}:
        hint = "; musat baseline accept takes them over" if "different" in states else ""
        lines.append(printable(f"new results: {check.work}{hint}"))
    ended = [*states, *["not in the baseline"] * len(check.unknown)]
    counts = ", ".join(f"{ended.count(state)} {state}" for state in dict.fromkeys(ended))
    versions = ", ".join(sorted({check.baseline.entries[deck.name].version for deck in check.decks}))
    verdict = f"{'same' if check.same else 'DIFFERENT'}: {counts}; saved by musatpy {versions}"
    return "\n".join([*lines, style(verdict, "same" if check.same else "different")]) + "\n"


def _count_text(difference: Difference) -> str:
    """Return of what kind differences of two files are: `job.lst: 62 number, 20 angle`."""
    kinds = ", ".join(f"{count} {kind}" for kind, count in difference.counts.items() if kind != "rows compared")
    return f"{Path(difference.a).name}: {kinds}"


def _rendered(deck: DeckComparison, listed: int, style: Style) -> str:
    """Return the differences of the files of a deck."""
    different = (difference for difference in deck.differences if not difference.same)
    return "\n".join(render(difference, listed=listed, style=style) for difference in different)


def check_json(check: BaselineCheck) -> str:
    """Return a check as JSON; differences are those of `musat diff --json`, rules of each included."""
    entries = check.baseline.entries
    decks = [
        {
            "deck": deck.name,
            "state": deck.state,
            "notes": list(deck.notes),
            "saved_status": entries[deck.name].status,
            "status": int(deck.outcome.state.status),
            "saved_by_version": entries[deck.name].version,
            "saved_sha256": entries[deck.name].deck_sha256,
            "sha256": deck.outcome.deck_sha256,
            "saved_inputs": entries[deck.name].inputs,
            "inputs": deck.outcome.inputs,
            "differences": [json.loads(json_text(difference)) for difference in deck.differences],
        }
        for deck in check.decks
    ]
    record = {
        "schema_version": SCHEMA_VERSION,
        "same": check.same,
        "decks": decks,
        "unknown_decks": list(check.unknown),
        "unused_rules": list(check.unused_rules),
    }
    return json.dumps(record, indent=1) + "\n"


def check_junit(check: BaselineCheck) -> str:
    """Return a test suite of JUnit XML, each deck a test: a failure where it differs, an error without results."""
    kinds = {"failed": ("error", "no results"), "different": ("failure", "different")}
    states = [deck.state for deck in check.decks]
    suite, tests = junit_suite(
        str(check.baseline.folder),
        "musat.baseline",
        [*(deck.name for deck in check.decks), *check.unknown],
        failures=states.count("different") + len(check.unknown),
        errors=states.count("failed"),
    )
    for test, deck in zip(tests, check.decks, strict=False):  # unknown ones stand behind them
        test.set("time", f"{deck.outcome.seconds:.3f}")
        if not deck.same:
            kind, message = kinds[deck.state]
            problems = [str(problem) for problem in deck.outcome.problems]
            text = "\n".join([*deck.notes, *problems, _rendered(deck, 50, plain)])
            ElementTree.SubElement(test, kind, message=message).text = printable(text)
    for test in tests[len(check.decks) :]:
        ElementTree.SubElement(test, "failure", message="not in the baseline")
    return junit_document(suite)
