"""Blocks with known truth, written as decks."""
