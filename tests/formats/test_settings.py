"""Fields set by name: what stands in their columns then, and what is said of slips."""

from dataclasses import replace
from pathlib import Path

import pytest

from musatpy.errors import nearest, nearest_or_all
from musatpy.formats import musat
from musatpy.formats.cards.manual import card_of, card_text, list_of_cards
from musatpy.formats.cards.settings import SettingError, deck_with, setting_of, settings_of
from musatpy.formats.cards.spec import CardSpec, load_family
from musatpy.formats.job_tables import card_family
from musatpy.model import Options, ReductionOptions, WaterLevel

FAMILY = card_family()
DECK = (Path(__file__).parents[2] / "fixtures/st_thomas/st_thomas.crd").read_bytes()
COMPILATION = load_family(Path(__file__).parents[2] / "card_formats/as11")


def settings(*texts):
    return settings_of(texts, FAMILY)


def test_a_field_of_a_card_is_set_in_its_columns_and_all_else_stays():
    changed = deck_with(DECK, settings("OPT.max_iterations=7", "opt.refraction=rigorous")).splitlines()
    same = [new for new, old in zip(changed, DECK.splitlines(), strict=True) if new != old]
    assert same == [b"OPT IIA  GEOG RIGOROUS FULL       7  20   0.100 0.00100 0.00100    5.00 00000002"]


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_a_card_that_is_not_there_stands_before_the_end(end):
    lines = DECK.splitlines()
    changed = deck_with(end.join([*lines, b""]), settings("OP2.water_level=ONE", "OP2.sigma0_limit=2.5"))
    (card,) = set(changed.splitlines()) - set(lines)
    assert card == b"OP2" + b"ONE".rjust(19) + b"2.5".rjust(46)
    assert changed.splitlines()[-2:] == [card, lines[-1]]
    block = musat.read_deck(changed.replace(b"OPT IIA ", b"OPT IIIA"))
    assert (block.options.water_level, block.options.sigma0_limit) == (WaterLevel.ONE, 2.5)


def test_an_empty_value_leaves_the_default_and_the_last_of_two_holds():
    block, problems = musat.check_deck(DECK, settings=settings("OPT.max_iterations=", "OPT.weights="))
    default = replace(block.options, max_iterations=20)
    assert not problems and block.options == default
    assert block.settings == ("OPT.max_iterations=", "OPT.weights=")
    (setting,) = settings("OPT.max_iterations=7", "OPT.max_iterations= 9")
    assert str(setting) == "OPT.max_iterations=9"


def test_a_set_value_is_checked_as_one_of_the_deck():
    block, problems = musat.check_deck(DECK, settings=settings("OP2.water_level=ONE", "WTR.index=3"))
    assert block is None
    assert [problem.headline() for problem in problems] == [
        "deck:4 cols 5-12 WTR.index: a refractive index of 3 is not within 1.3 to 1.4,"
        " as that of water is; another liquid is to be named in WTR.liquid",
        "deck:70 cols 20-24 OP2.water_level: 'ONE' needs program IIIA",
    ]
    assert problems[1].text == "OP2                ONE"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("OP2.water_levl=ONE", "OP2 has no field 'water_levl'; did you mean water_level?"),
        ("OP3.water_level=ONE", "no card 'OP3'; did you mean OPT?"),
        ("OP2.water_level=ON", "not A5 (one of KNOWN, ONE, PHOTO, GROUP, DAY); did you mean ONE?"),
        ("OPT.max_iterations=2.5", "OPT.max_iterations: '2.5' is not a whole number (I3)"),
        ("OPT.max_iterations=many", "OPT.max_iterations: 'many' is not a number"),
        ("OPT.plate_sigma=inf", "OPT.plate_sigma: 'inf' is not a number that fits F7.2"),
        ("OPT.plate_sigma=5.1234567", "'5.1234567' does not fit F7.2: 5.12346 would be read"),
        ("WTC.temperature=", "WTC.temperature: '' is not F"),
        ("PLT.x=3", "PLT: a deck may have many such cards; --set takes OPT, OP2, RED"),
        ("OP2", "'OP2' is not CARD.FIELD=VALUE, such as OP2.water_level=ONE"),
        ("refraction=NONE", "is not CARD.FIELD=VALUE; did you mean OPT.refraction=NONE?"),
        ("water_levl=ONE", "is not CARD.FIELD=VALUE; did you mean OP2.water_level=ONE?"),
        ("zzz=1", "'zzz=1' is not CARD.FIELD=VALUE, such as OP2.water_level=ONE"),
    ],
)
def test_slips_are_named_with_what_was_meant(text, message):
    with pytest.raises(SettingError) as caught:
        settings(text)
    assert message in str(caught.value)


def test_the_nearest_name_is_the_first_of_equal_ones():
    assert nearest("OPX", ["WTR", "OPT", "WOX"]) == "OPT"
    assert nearest("weight", ["weights", "water"]) == "weights"
    assert nearest("abc", ["xyz"]) == "" == nearest("abc", [])
    assert nearest_or_all("abc", ["xyz", "uvw"]) == "; there are xyz, uvw"


@pytest.mark.parametrize("seconds", ["0.5", "59.999"])
@pytest.mark.parametrize("degrees", ["-0", "18", "-64"])
def test_an_angle_is_said_in_one_word(degrees, seconds):
    sta = FAMILY.cards["STA"]
    colons = setting_of(sta, "longitude", f"{degrees}:7:{seconds}")
    assert colons == setting_of(sta, "longitude", f" {degrees}  7 {seconds} ")
    parts = [setting_of(sta, f"longitude_{part}", value) for part, value in (("deg", degrees), ("min", "7"))]
    assert [part.columns[0] for part in parts] == list(colons.columns[:2])
    with pytest.raises(SettingError, match="is not degrees, minutes and seconds"):
        setting_of(sta, "longitude", "18.5")


def made(name, *texts):
    spec = FAMILY.cards[name]
    return card_of(spec, [setting_of(spec, *text.split("=")) for text in texts], FAMILY)


def test_a_card_is_made_of_names_and_values():
    card, problems = made("PLT", "photo=21", "point=203", "x=4.5", "y=-3", "bathymetric=B")
    assert not problems
    assert card == "PLT 21       203" + "4.5000000  -3.0000000".rjust(29) + "B".rjust(17)
    plates = musat.checked_deck(f"{card}\nEND".encode()).draft.rows["plates"]
    assert plates["plates.xy"].tolist() == [[4.5, -3.0]] and plates["points.bathymetric"].tolist() == [True]


@pytest.mark.parametrize(
    ("name", "texts", "message"),
    [
        ("OPT", ["plate_sigma=-3"], "OPT.plate_sigma: a standard deviation must be greater than zero"),
        ("WTR", ["index=3", "liquid=DIAMOND"], "WTR.index: a refractive index of 3 is not within 1 to 2"),
        ("ATT", ["photo=1", "x_tilt=365 0 0", "y_tilt=0 0 0", "heading=0 0 0"], "an angle of 365.0000 degrees"),
        ("TID", ["height=1"], "TID.photo: blank, expected A8"),
        ("ELL", ["name=clark66"], "'clark66' is no ellipsoid that PROJ knows"),
    ],
)
def test_a_card_is_checked_by_itself(name, texts, message):
    _, problems = made(name, *texts)
    assert message in "\n".join(problem.headline() for problem in problems)


@pytest.mark.parametrize("name", FAMILY.cards)
def test_a_sample_made_of_its_values_is_the_sample(name):
    """Said field by field; its own checks find nothing, and nothing that only other cards could say."""
    spec = FAMILY.cards[name]
    values = {field.name: spec.sample[field.first - 1 : field.last].strip() for field in spec.fields}
    card, problems = card_of(spec, [setting_of(spec, *entry) for entry in values.items()], FAMILY)
    assert card == spec.sample[:72].rstrip()
    assert not [problem for problem in problems if problem.severity == "error"]


LIMITED = [
    (spec, field)
    for spec in (*FAMILY.cards.values(), *COMPILATION.cards.values())
    for field in spec.fields
    if field.bound or field.most
]


@pytest.mark.parametrize(
    ("spec", "field"), LIMITED, ids=lambda one: one.mnemonic if isinstance(one, CardSpec) else one.name
)
def test_a_number_beyond_what_its_field_allows_is_told_there(spec, field):
    """Limits from below are passed by 0, or by -1 where they allow it; those from above by 5 of their units."""
    values = {one.name: spec.sample[one.first - 1 : one.last].strip() for one in spec.fields}
    beyond = [(field.bound, -1.0 if field.bound[:2] == (">=", 0.0) else 0.0)] if field.bound else []
    beyond += [(field.most, sign * (field.most[0] + 5.0)) for sign in (1.0, -1.0) if field.most]
    for (*_, message), number in beyond:
        said = values | {field.name: f"{number:g}"}
        _, problems = card_of(spec, [setting_of(spec, *entry) for entry in said.items()], FAMILY)
        told = [one for one in problems if one.columns and one.columns[0] <= field.first <= one.columns[1]]
        assert any(message.partition("{")[0] in one.message for one in told), (number, problems)


@pytest.mark.parametrize("spec", [*FAMILY.cards.values(), *COMPILATION.cards.values()], ids=lambda c: c.mnemonic)
def test_a_card_is_explained_on_80_columns(spec):
    lines = card_text(spec).splitlines()
    assert max(map(len, lines)) <= 80
    assert spec.sample in lines and lines[lines.index(spec.sample) - 1].endswith("8")
    places = [line.split()[:3] for line in lines[lines.index(spec.sample) + 3 :] if not line.startswith(" " * 10)]
    expected = sorted(spec.fields, key=lambda field: field.first)
    assert [words[1] for words in places] == [field.name for field in expected]


def defaults_of(name):
    rows = [
        line.split() for line in card_text(FAMILY.cards[name]).splitlines() if line[:7].strip() and line[0] == " "
    ]
    return {words[1]: words[-1] for words in rows}


def test_the_list_has_every_card_and_defaults_are_those_of_the_model():
    lines = list_of_cards([FAMILY, COMPILATION]).splitlines()
    assert [line[:3] for line in lines if line[3:5] == "  "] == [*FAMILY.cards, *COMPILATION.cards]
    assert "OP2  More options                              one or none" in lines
    defaults = defaults_of("OPT")
    for name in ("weights", "max_iterations", "max_passes", "program"):
        assert str(getattr(Options(), name)) == defaults[name]
    assert float(defaults["plate_sigma"]) / 1000.0 == pytest.approx(Options().plate_sigma)
    assert defaults_of("RED")["transformation"] == ReductionOptions().transformation
    assert defaults_of("STA")["photo"] == "error" and defaults_of("CTG")["height"] == "value"
