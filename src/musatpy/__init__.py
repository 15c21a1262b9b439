"""Two-media aerotriangulation from card decks: MUSAT-IIA again, and better."""

__version__ = "0.1.0"
