"""Bad decks for the checks of waves on the water, with their whole reports."""

from formats.bad_deck_cases import GEOCENTRIC, IIIA, Case, Expected, case, port, water_options
from formats.deck_edits import Edit, add, deck, replace

RIGOROUS = replace(2, "WATPT   ", "RIGOROUS")
ORIGIN = "WOG              19 20 59.99956 -81 18 12.01638    0.2000"
SWELL = "10.000"
CENTRE = "0.0000        0.0000       0.0000"
PLACE = f"WOX                 {CENTRE}"


def wave(
    name: str = "SW",
    shape: str = "",
    *,
    period: str = "",
    depth: str = "",
    length: str = "",
    speed: str = "",
    height: str = "0.500",
    azimuth: str = "60.000",
    crest: str = "0.000",
) -> str:
    """Return a WAV card."""
    numbers = f"{period:>7} {depth:>7} {length:>8} {speed:>7} {height:>6} {azimuth:>8} {crest:>9}"
    return f"WAV {name:4} {shape:4} {numbers}"


def sigmas(name: str = "SW", *, length: str = "", height: str = "", azimuth: str = "", crest: str = "") -> str:
    """Return a WVS card."""
    return f"WVS {name:4} {'':20} {length:>8} {'':7} {height:>6} {azimuth:>8} {crest:>9}"


def timed(lines: list[str]) -> list[str]:
    """Return lines with a time on each tide card."""
    return [
        f"{line[:51]}{12.5 * at:10.3f}{line[61:]}" if line[:3] == "TID" else line for at, line in enumerate(lines)
    ]


def flagged(*points: str) -> Edit:
    """Return the edit that flags the measurements of these points, and of no others, as submerged."""
    return lambda lines: [
        f"{line[:61]}{'B' if line[13:17] in points else ' '}{line[62:]}" if line[:3] == "PLT" else line
        for line in lines
    ]


def sea(*cards: str, edits: tuple[Edit, ...] = ()) -> bytes:
    """Return the good deck with times, RIGOROUS, and from line 49 on the origin of waves and these cards."""
    return deck(RIGOROUS, timed, add(ORIGIN, *cards), *edits)


CASES: list[Case] = [
    case(sea(wave(period=SWELL), "WVS CHOP"), "51 WVS.wave [CHOP] wave CHOP has no WAV card"),
    case(
        deck(RIGOROUS, timed, add(wave(period=SWELL))),
        "49 WAV [] waves, and no WOG or WOX card with the place from which their crests count",
    ),
    case(sea(), "~49 WOG [] an origin of waves, and no WAV card: it takes no part"),
    case(
        deck(IIIA, timed, add(ORIGIN, wave(period=SWELL), port("RC8 ", 35.0, 10.0, 1.5, 1.0))),
        "50 WAV [] no waves behind a flat port: its rays go through level or tilted water",
    ),
    # many waves, each of them wrong in its own way
    case(
        sea(
            wave("A"),
            wave("B", period=SWELL, length="156.000", speed="15.600"),
            wave("C", period="-1.000"),
            wave("D", period=SWELL, height="-.500"),
            wave("E", length="20.000", height="2.900"),  # 0.142 of the length
            wave("F", period=SWELL, depth="3.00", height="2.400"),  # 0.78 of the depth
            # sqrt(g L / 2 pi) over deep water: a third of these, and no current triples it
            wave("G", length="60.000", speed="30.000"),
            wave("H", length="60.000", period="2.000"),
            wave("I", "STOK", period=SWELL, depth="5.00", height="1.100"),
            wave("J", "TROC", period=SWELL, depth="12.00"),
            wave("K", period=SWELL, depth="5.00", height="1.100"),
        ),
        "50 WAV.period [] blank, and no length: one of them is needed",
        "51 WAV.speed [15.600] two of them say the third",
        "52 WAV.period [-1.000] must be greater than zero",
        "53 WAV.height [-.500] from trough to crest is not negative",
        "54 WAV.height [2.900] 20.0 m long breaks from 2.84 m on",
        "55 WAV.height [2.400] a wave 53.1 m long breaks from 2.34 m",
        "56 WAV.speed [30.000] 30 m/s: a wave 60 m long runs 9.68 m/s at most",
        "57 WAV.period [2.000] 30 m/s: a wave 60 m long runs 9.68 m/s",
        "58 WAV.height [1.100] makes a second crest",
        "59 WAV.depth [12.00] 12 m is less than half its length",
        "~60 WAV.height [1.100] in 5 m of water is far from sinusoidal: its Ursell number is 40",
    ),
    case(
        deck(timed, add(ORIGIN, wave(period=SWELL))),
        "2 OPT.refraction [WATPT] need refraction RIGOROUS, or program IIIA: WATPT knows none",
    ),
    case(
        sea(wave(period=SWELL), water_options(tilt="ADJUST"), edits=(replace(2, "IIA ", "IIIA"),)),
        "~4 WTR.tilt_sigma [] no sigma: the measurements alone have to determine this unknown",
        "51 OP2.water_tilt [ADJUST] waves need level water: they cannot be combined with a tilt",
    ),
    case(
        sea(wave(period=SWELL), edits=(replace(4, f"1.340000{'':19}", f"1.340000{'':11}  -0.500"),)),
        "4 WTR.tilt_east [-0.500] waves need level water: they cannot be combined with a tilt",
    ),
    case(
        sea(wave(period=SWELL), wave("ST", "STOK", length="40.000", depth="9.00"), sigmas(length="5.000")),
        "51 WAV.shape [STOK] where waves have sigmas (line 52), all of them are sinusoidal (SINU)",
    ),
    case(
        sea(
            wave(period=SWELL),
            sigmas(height="0.200", crest="9.000"),
            water_options(datum="FREE"),
            edits=(replace(2, "IIA ", "IIIA"),),
        ),
        "51 WVS.sigma_height [0.200] wave SW unknown: such waves need control, not a free network",
    ),
    case(
        sea(
            wave(period=SWELL),
            sigmas(crest="9.000"),
            f"{water_options():47}LIST",
            edits=(replace(2, "IIA ", "IIIA"),),
        ),
        "51 WVS.sigma_crest [9.000] wave SW unknown: such waves cannot be combined with the editing LIST",
    ),
    case(
        deck(RIGOROUS, timed, replace(12, "137.500", "       "), add(ORIGIN, wave(period=SWELL))),
        "12 TID.time [] photo 841: blank, and waves need the time of every exposure above water",
    ),
    case(
        deck(RIGOROUS, timed, replace(13, " 150.000", "3601.000"), add(ORIGIN, wave(period=SWELL))),
        "~13 TID.time [3601.000] 3601 s: 360 periods from time 0, for which crests are given",
    ),
    case(
        sea(wave(period=SWELL), edits=(flagged(),)),
        "~12 TID [] 3 TID cards, and no point is flagged as submerged: nothing is refracted",
        "~50 WAV [] waves, and no submerged point is measured: they take no part",
    ),
    case(
        sea(
            wave(period=SWELL),
            edits=(flagged("1103"), replace(43, "V       ", "V B     "), replace(43, "17.0386", "  .0000")),
        ),
        "~43 CTG.height [.0000] 0 m: submerged, but above the troughs of the waves, down to -0.05 m",
    ),
    case(
        sea(wave(period=SWELL), PLACE),
        "51 WOX [] a second origin of the waves; the first is on line 49",
        Expected(51, "WOX", CENTRE, "a rectangular position, in a job of system GEOG"),
    ),
    case(
        deck(RIGOROUS, timed, add(wave(period=SWELL), PLACE), lines=GEOCENTRIC),
        Expected(50, "WOX", CENTRE, "0.0 km from the geocentre is not near the ellipsoid"),
    ),
]
