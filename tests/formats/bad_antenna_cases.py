"""Bad decks of antenna positions: lines, times, units of lever arms, contradictory standard deviations."""

from formats.bad_deck_cases import Case, case
from musatpy.formats.job_tables import card_family
from musatpy.formats.musat import deck_bytes
from musatpy.simulation import simulate, spec_from_table

_SPEC = {
    "job": {"system": "LOCL"},
    "flight": {"strips": 2, "photos": 4, "height": 1000.0},
    "control": [{"kind": "full", "number": 4, "sigma": 0.05}],
    "antenna": {"lever_arm": [0.3, -0.2, 1.4], "shift_sigma": [0.5] * 3, "drift_sigma": [0.01] * 3},
    "options": {"program": "IIIA", "refraction": "RIGOROUS"},
}
_LINES = deck_bytes(simulate(spec_from_table(_SPEC)).block, card_family()).decode().splitlines()
_GNC = "GNC 1          0.0500   0.0500   0.0800  0.30000 -0.10000  0.00000"
_LVR, _GNL, _GNX, _GNT = (next(n for n, line in enumerate(_LINES, 1) if line.startswith(card)) for card in
                          ("LVR", "GNL L1", "GNX 1 ", "GNT 1 "))  # fmt: skip


def _with(*edits: tuple[int, int, str], add: str = "", drop: tuple[int, ...] = ()) -> bytes:
    """The deck with texts put at a line and column, a card more at its end, and without some lines."""
    lines = list(_LINES)
    for line, column, text in edits:
        card = lines[line - 1]
        lines[line - 1] = card[: column - 1] + text + card[column - 1 + len(text) :]
    lines = [line for number, line in enumerate(lines, 1) if number not in drop]
    return "".join(f"{line}\n" for line in [*lines[:-1], *([add] if add else []), lines[-1]]).encode()


_NEEDS = "antenna positions need program IIIA"
_END = len(_LINES)
CASES: list[Case] = [
    case(_with((2, 5, "IIA ")), f"{_LVR} LVR [] {_NEEDS}", f"{_GNL} GNL [] {_NEEDS}", f"{_GNX} GNX [] {_NEEDS}"),
    case(
        _with((_GNT + 1, 14, "     22.0000")),
        f"{_GNT + 1} GNT.time [22.0000] along line L1 photo 2 is beside photo 1",
    ),
    case(
        _with((_LVR, 10, "  300.0000 -200.0000 1400.0000")),
        f"{_LVR} LVR [300.0000 -200.0000 1400.0000] 1.45 m if these are millimetres (1000 times)",
    ),
    case(
        _with((_GNX + 1, 5, "77"), (_GNT + 1, 5, "77")),
        f"{_GNX + 1} GNX.photo [77] photo 77 has no station card",
    ),
    case(_with((_GNL, 5, "L7")), f"{_GNL} GNL.line [L7] no antenna position is of line L7"),
    case(_with(drop=(_GNT + 1,)), f"{_GNX + 1} GNX [] line L1 has a drift, and this photo no time (GNT card)"),
    case(
        _with(drop=(_GNX, _GNX + 1, _GNT, _GNT + 1)),
        f"{_GNL} GNL [0.010000 0.010000 0.010000] a drift of line L1, which has 2 photos at 2 times: 3 photos",
    ),
    case(_with((_GNX, 58, "0.000")), f"{_GNX} GNX.sigma_east [0.000] must be greater than zero"),
    case(_with((_GNL, 10, " -0.5000")), f"{_GNL} GNL.shift_sigma_east [-0.5000] must be greater than zero"),
    case(_with(add=_GNC), f"{_END} GNC [0.0500   0.0500   0.0800] the sigmas are 0.05 0.05 0.08 m here and"),
    case(_with((_GNX, 58, " " * 15)), f"{_GNX} GNX [] its three standard deviations are needed, or a GNC card"),
    case(
        _with((_GNX, 58, " " * 15), add=_GNC.replace("0.30000 -0.10000  0.0", "0.90000  0.90000 -0.9")),
        f"{_END} GNC [0.90000  0.90000 -0.90000] no positive definite matrix",
    ),
    case(_with((_GNL, 37, "F")), f"{_GNL} GNL.shift_free [F] each component has a standard deviation"),
    case(_with(add="GNC 9" + _GNC[5:]), f"{_END} GNC.photo [9] photo 9 has no station card",
         f"{_END} GNC.photo [9] photo 9 has no GNS or GNX card: covariances belong"),
]  # fmt: skip
