"""Blunder editing: gross errors found by robust weights and data snooping, listed, and taken out of the job."""

from musatpy.blunders.programs import adjust

__all__ = ["adjust"]
