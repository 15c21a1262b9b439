"""Blunder editing: gross errors found by robust weights and data snooping, listed, and taken out of the job."""
