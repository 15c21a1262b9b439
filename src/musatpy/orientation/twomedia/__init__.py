"""Orientation of one photo, of pairs and of triplets through a plane of water: Okamoto and Mori (1974)."""
