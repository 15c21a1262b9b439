"""Orientation of the photos of a deck through the water: its block to sights, and these to an answer."""
