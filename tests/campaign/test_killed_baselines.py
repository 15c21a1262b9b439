"""`musat baseline` killed between any two steps in which a file gets its name or goes."""

import os
import shutil
import signal
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest

from campaign.batches import ROOT, decks_in
from musatpy.campaign.baseline_checks import check
from musatpy.campaign.baselines import INDEX, WORK, BaselineError, accept, save
from musatpy.campaign.batch import BatchResult
from musatpy.campaign.batch_jobs import BatchJob, JobOutcome
from musatpy.campaign.manifest import BatchPlan
from musatpy.campaign.worker import run_job
from musatpy.files import write_files

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="a child to be killed is forked"),
]


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    """Jobs without processes of their own, each run once: what is killed here is what comes after them."""
    known: dict[tuple[str, bytes], tuple[JobOutcome, dict[str, bytes]]] = {}

    def run_once(job: BatchJob) -> JobOutcome:
        key = job.deck.name, job.deck.read_bytes() if job.deck.exists() else b""
        if key not in known:
            outcome = run_job(job, lambda _: None)
            known[key] = outcome, {name: (job.folder / name).read_bytes() for name in outcome.outputs}
        outcome, files = known[key]
        write_files({job.folder / name: data for name, data in files.items()})
        deck = str(job.deck)  # it may be a copy elsewhere
        return replace(outcome, problems=tuple(replace(one, file=deck) for one in outcome.problems))

    def run(plan: BatchPlan, **_: object) -> BatchResult:
        return BatchResult(jobs=plan.jobs, outcomes=tuple(map(run_once, plan.jobs)), seconds=0.0, summary=None)

    for module in ("baselines", "baseline_checks"):
        monkeypatch.setattr(f"musatpy.campaign.{module}.run_batch", run)


def killed_after(steps: int, work: Callable[[], object]) -> bool:
    """Do something in a child that is killed when it asks for one more rename or removal; tell whether it was."""
    child = os.fork()
    if child == 0:
        left = iter(range(steps))

        def counted(done: Callable[..., None]) -> Callable[..., None]:
            def step(*arguments, **more):
                if next(left, None) is None:
                    os.kill(os.getpid(), signal.SIGKILL)
                return done(*arguments, **more)

            return step

        for name in ("replace", "unlink", "rmdir"):
            setattr(os, name, counted(getattr(os, name)))
        try:
            work()
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


def kept(folder: Path) -> dict[str, bytes]:
    """Return all that is in a baseline, but for the work folder."""
    files = [path for path in folder.rglob("*") if path.is_file() and WORK not in path.parts]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_accept(tmp_path):
    """One deck is changed, one gone, one cannot be used any more and one can be now."""
    start, bad = tmp_path / "start", ROOT / "fixtures" / "bad_decks" / "many_errors.crd"
    decks = decks_in(start / "decks", small=3)
    decks.append(Path(shutil.copy(bad, start / "decks" / "bad.crd")))
    save(start / "base", decks, unusable=True)
    decks[0].write_bytes(decks[0].read_bytes().replace(b"WTR 1.340000", b"WTR 1.339000"))
    decks[1].unlink()
    decks[3].write_bytes(decks[2].read_bytes())
    shutil.copy(bad, decks[2])
    end = Path(shutil.copytree(start, tmp_path / "end"))
    accept(end / "base", unusable=True)
    expected = kept(end / "base")
    assert {name for name in expected if "toml" not in name} == {
        INDEX, "small0.lst", "small0.json", "small2.err", "bad.lst", "bad.json",
    }  # fmt: skip
    for steps in count():
        base = Path(shutil.copytree(start, tmp_path / str(steps))) / "base"
        was_killed = killed_after(steps, lambda base=base: accept(base, unusable=True))
        found = check(base)
        assert found.same == ((base / INDEX).read_bytes() == expected[INDEX])
        accept(base, unusable=True)
        assert kept(base) == expected
        assert not (base / WORK).exists()
        if not was_killed:
            break
    assert steps > 12  # renames and removals


def test_save(tmp_path):
    (deck,) = decks_in(tmp_path / "decks", small=1)
    save(tmp_path / "end", [deck])
    expected = kept(tmp_path / "end")
    for steps in count():
        base = tmp_path / str(steps)
        was_killed = killed_after(steps, lambda base=base: save(base, [deck]))
        if (base / INDEX).exists():
            assert check(base).same
            with pytest.raises(BaselineError, match="accept takes its new results over"):
                save(base, [deck])
            accept(base)
        else:
            with pytest.raises(BaselineError, match="musat baseline save makes one"):
                check(base)
            save(base, [deck])
        assert kept(base) == expected
        if not was_killed:
            break
    assert steps > 5  # the files of the baseline
