"""A job in other words: how its coordinates, attitudes and sigmas are stated, coming in and going out."""

from musatpy.model import SystemSpec
from musatpy.systems.blocks import Stated, StatedSolution, entered, stated, stated_solution
from musatpy.systems.statement import Axes, Sigmas, Statement, own_statement, statement_of, statement_on
