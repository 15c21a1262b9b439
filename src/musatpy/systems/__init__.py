"""A job in other words: how its coordinates, attitudes and sigmas are stated, coming in and going out."""

from musatpy.model import SystemSpec
from musatpy.systems.blocks import Stated, entered, stated
from musatpy.systems.solutions import StatedSolution, stated_solution
from musatpy.systems.statement import Axes, Sigmas, Statement, own_statement
from musatpy.systems.system_spec import statement_of, statement_on

__all__ = [
    "Axes",
    "Sigmas",
    "Stated",
    "StatedSolution",
    "Statement",
    "SystemSpec",
    "entered",
    "own_statement",
    "stated",
    "stated_solution",
    "statement_of",
    "statement_on",
]
