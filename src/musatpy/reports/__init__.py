"""The listing: one file per report, each a pure function of a Solution."""
