"""Editing a job: blocks merged, extracted, summed up, renamed, and made from a solution to go on with."""
