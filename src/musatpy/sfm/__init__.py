"""Models of other programs (structure from motion): how they are read, proven and written."""
