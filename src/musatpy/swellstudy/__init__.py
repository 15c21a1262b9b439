"""The study of waves as unknowns of the orientation, on simulated strips."""
