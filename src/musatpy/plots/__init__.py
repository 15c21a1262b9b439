"""Pictures of a run or a compilation, from the tables of its record (the extra `plots`)."""
