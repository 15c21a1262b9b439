"""Decks of 80-column cards, whose layout stands in TOML files and nowhere else."""
