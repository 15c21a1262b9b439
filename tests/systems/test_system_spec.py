"""Statements by plain words: every kind is reached, and what is missing, unused or unknown is refused."""

import numpy as np
import pytest

from musatpy.errors import SystemsError
from musatpy.geometry.rotations import AngleForm
from musatpy.systems import Axes, Sigmas, SystemSpec, statement_of
from reference.networks import Plan
from reference.networks import simulate as network
from systems.stated_jobs import FALSE, ORIGIN, coordinates, job, level_geoid, statements


def specs(folder):
    plane = {"kind": "TANG", "origin": tuple(ORIGIN), "false": tuple(FALSE)}
    return {
        "geographic, matrices": SystemSpec(angles="MATR"),
        "geocentric": SystemSpec(kind="GEOC", axes="GEOC", angles="MATR"),
        "tangent plane": SystemSpec(**plane, axes="GRID"),
        "UTM": SystemSpec(kind="PROJ", definition="EPSG:26717", axes="GRID", angles="POK"),
        "UTM above a geoid": SystemSpec(
            kind="PROJ", definition="26717", geoid=level_geoid(folder), axes="GRID", angles="ATS", sigmas="SYST"
        ),
    }


def test_each_kind(tmp_path):
    level = job().photos.position
    for name, spec in specs(tmp_path).items():
        words, statement = statements(tmp_path)[name], statement_of(spec, job())
        assert (statement.axes, statement.form) == (words.statement.axes, words.statement.form)
        expected = coordinates(job(), words, level)
        # steps of coordinates of 6e6 m
        np.testing.assert_allclose(statement.system.coordinates(level), expected, rtol=0, atol=5e-9)
    assert statement.sigmas is Sigmas.SYSTEM


def test_a_tangent_plane_says_which_coordinates_its_origin_has(tmp_path):
    assert statement_of(specs(tmp_path)["tangent plane"], job()).system.text == (
        "tangent plane at latitude 19.32000000, longitude -81.18000000 degrees, height 0.000 m "
        "(X 5000.000, Y 2000.000, Z 100.000 there)"
    )
    plain = statement_of(SystemSpec(kind="TANG", origin=tuple(ORIGIN)), job()).system.text
    assert plain.endswith("height 0.000 m")


def test_a_local_job():
    block = network(Plan(photos_per_strip=2)).block
    statement = statement_of(SystemSpec(kind="LOCL", axes="GRID", angles="POK"), block)
    assert (statement.axes, statement.form) == (Axes.SYSTEM, AngleForm.PHI_OMEGA_KAPPA)
    with pytest.raises(SystemsError, match="needs an ellipsoid"):
        statement_of(SystemSpec(kind="GEOC"), block)


@pytest.mark.parametrize(
    ("spec", "why"),
    [
        ({"kind": "UTM"}, "'UTM' is no kind of coordinate system: GEOG, GEOC, LOCL, TANG, PROJ"),
        ({"axes": "UP"}, "'UP' is no kind of axes of attitudes: VERT, GRID, GEOC"),
        ({"angles": "PKO"}, "'PKO' is no form of attitudes: OPK, POK, ATS, MATR"),
        ({"sigmas": "X"}, "'X' is no kind of sigmas"),
        ({"kind": "PROJ"}, "definition: a system of kind PROJ needs it"),
        ({"kind": "TANG"}, "origin: a system of kind TANG needs it"),
        ({"kind": "GEOC", "definition": "EPSG:26717"}, "definition: a system of kind GEOC has none"),
        ({"geoid": "g.gtx"}, "geoid: a system of kind GEOG has none"),
        ({"kind": "PROJ", "definition": "EPSG:26717", "origin": (0.1, 0.2, 0.3)}, "origin: .* has none"),
        ({"axes": "GRID"}, "cannot refer to axes of the system"),
    ],
)
def test_refused(spec, why):
    with pytest.raises(SystemsError, match=why):
        statement_of(SystemSpec(**spec), job())


def test_text_says_it_all():
    spec = SystemSpec(kind="PROJ", definition="EPSG:26717", axes="GRID", angles="POK", sigmas="SYST")
    assert statement_of(spec, job()).text == (
        "NAD27 / UTM zone 17N, EPSG:26717, ellipsoidal heights; phi, omega, kappa along the axes of the system; "
        "sigmas of these coordinates and attitudes"
    )
