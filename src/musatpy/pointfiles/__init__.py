"""Files of points: CSV, LAS and LAZ, read in, and written again with columns added."""
