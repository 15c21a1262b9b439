"""Two listings of 100,000 lines compared, against reading the same numbers with `float` in the same run.

Run with `pytest -s tests/benchmarks/bench_diff.py`. One core, process time. The peer does the least that any
comparison must: it splits both files into fields and makes numbers of them, without sections, rows, rules.
"""

from __future__ import annotations

import gc
import random
import time

import pytest

from musatpy.reportdiff import Rules, compare_texts, parse_rules

LINES = 100_000
PAGE = 55
HEAD = """
Residuals Of Plate Measurements: Adjusted Minus Measured{continued}

                             x           y   Resid. x   Resid. y   Sigma x   Sigma y
Photo     Point             mm          mm         um         um        um        um
--------  --------  ----------  ----------  ---------  ---------  --------  --------
"""
TOLERANT = parse_rules("[[rule]]\nname = 'last digits'\nlast_digits = 1\n[[rule]]\nphoto = '17'\nskip = true\n")


def listing(seed: int, *, noise: float = 0.0, inserted: int = -1, headings: bool = True) -> str:
    """Return a listing of residuals; `noise` changes last digits, `inserted` is a row more somewhere."""
    numbers, changes = random.Random(seed), random.Random(seed + 1)
    lines: list[str] = []
    for row in range(LINES):
        if row % PAGE == 0 and headings:
            lines += [f"\fMUSATPY  BENCHMARK{'':80}PAGE {row // PAGE + 1:6d}"]
            lines += HEAD.format(continued=" (continued)" if row else "").split("\n")[:-1]
        x, y = numbers.uniform(-110, 110), numbers.uniform(-110, 110)
        rx, ry = numbers.gauss(0, 5), numbers.gauss(0, 5)
        step = 0.01 if changes.random() < noise else 0.0
        if row == inserted:
            lines.append(f"{9999:<8}  {1:<8}  {x:10.4f}  {y:10.4f}  {rx:9.2f}  {ry:9.2f}  {5:8.2f}  {5:8.2f}")
        ids = f"{row // 60:<8}  {row % 60 + 100:<8}  " if headings else ""
        lines.append(f"{ids}{x:10.4f}  {y:10.4f}  {rx + step:9.2f}  {ry + step:9.2f}  {5:8.2f}  {5:8.2f}")
    return "\n".join(lines) + "\n"


def floats(text: str) -> int:
    """Read every number of a text, as the plainest program would."""
    found = 0
    for line in text.split("\n"):
        for field in line.split():
            try:
                found += float(field) != 0.0
            except ValueError:
                continue
    return found


@pytest.mark.parametrize(
    ("case", "noise", "inserted", "headings", "rules"),
    [
        ("equal", 0.0, -1, True, Rules()),
        ("equal, rules that match late", 0.0, -1, True, parse_rules("[[rule]]\nrow = 'NOTHING'\nabsolute = 1\n")),
        ("one row more", 0.0, 40_000, True, Rules()),
        ("every row differs, by rules", 1.0, 40_000, True, TOLERANT),
        ("every row differs", 1.0, 40_000, True, Rules()),
        ("no headings, no ids, every second row differs", 0.5, 40_000, False, Rules()),
    ],
)
def test_listings_of_100_000_lines(case, noise, inserted, headings, rules):
    gc.set_threshold(100_000)  # as the program has it
    a = listing(306, headings=headings)
    b = listing(306, noise=noise, inserted=inserted, headings=headings)
    start = time.process_time()
    floats(a), floats(b)
    plain = time.process_time() - start
    start = time.process_time()
    found = compare_texts(a, b, rules)
    ours = time.process_time() - start
    print(f"\n{case}: {ours:.2f} s, {ours / plain:.1f} times float() of all fields ({plain:.2f} s)")
    print(f"{found.counts}")
    # 3 to 6 times where files are the same or nearly so, 8 to 18 where every row differs
    assert ours < 25 * plain
