"""Records of runs in JSON: read, held against their schema, and what they say as arrays."""
