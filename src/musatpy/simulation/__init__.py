"""Blocks with known truth, written as decks."""

from musatpy.simulation.simulate import Simulation, Truth, simulate
from musatpy.simulation.simulation_spec import SimulationSpec, load_spec, spec_from_table
from musatpy.simulation.truth import truth_json, truth_record
