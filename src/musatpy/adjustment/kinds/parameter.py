"""Further parameters as global unknowns: a kind of them says only what is known beforehand, and what they do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from musatpy.adjustment.iteration import State, WaterKnowledge
from musatpy.adjustment.kinds.kind import Rows, Unknown, in_digits, of_unknowns
from musatpy.adjustment.network import Network
from musatpy.adjustment.parameters import Effect, Parameters
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray
from musatpy.model import Block
from musatpy.units import MICROMETRE


class ParameterUnknown(Unknown):
    """A kind whose state is `State.parameters`, and which `parameters` describes; observed by its priors."""

    searched = False  # no card of one photo or point is to blame
    change = "a parameter"  # among those that still move, the worst stands for all

    def parameters(self, block: Block) -> Parameters | None:
        """Return the unknown parameters of a block for the simultaneous adjustment, None without any."""
        raise NotImplementedError

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return no names: `parameters` has them."""
        return ()

    def known(self, network: Network) -> Any:
        """Return what is known of the parameters beforehand; only where the network has some."""
        return network.parameters[self.observed]

    def rows(self, network: Network, state: State) -> Rows:
        """Return the parameters as observed."""
        known, row = self.known(network), np.arange(network.border.count(self.observed))
        deviation = state.parameters[self.observed] - known.given
        return of_unknowns(deviation, known.weight, self.numbers(network), row, np.zeros_like(row))

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (x, 1)."""
        return self.weight(network)[:, None]

    def weight(self, network: Network) -> FloatArray:
        """Return the weights (x,) of what is known of them beforehand, 0 of what is free."""
        known = network.parameters.get(self.observed)
        return np.zeros(0) if known is None else known.weight

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights times `factor` (x, 1)."""
        known = network.parameters.get(self.observed)
        if known is None:
            return network
        return network.with_parameters({self.observed: known.weighted(factor[:, 0])})

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a parameter is off by `size`."""
        return f"the {network.border.columns[self.observed][row]} is {size:.3g} off what is given"

    def state_after(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the parameters after a step (u,)."""
        after = state.parameters[self.observed] + self.part_of(network, step)
        return replace(state, parameters={**state.parameters, self.observed: after})

    def movement(self, network: Network, step: FloatArray) -> tuple[float, str]:
        """Return the largest effect of a change over that which is at rest, and how it is told."""
        if not network.border.count(self.observed):
            return 0.0, ""
        known, change = self.known(network), np.abs(self.part_of(network, step))
        size = change * known.effect / known.rest
        row = int(size.argmax())
        name = network.border.columns[self.observed][row]
        if known.effect_in is Effect.IMAGE:
            moved = in_digits(change[row] * known.effect[row] / MICROMETRE, 2)
            return float(size[row]), f"the {name} still moves images by {moved} um"
        return float(size[row]), f"the {name} still changes by {in_digits(change[row], 4)} {known.unit[row]}"

    def limit(self, rotation: float, translation: float) -> float:
        """Return the limit of a change."""
        return 1.0
