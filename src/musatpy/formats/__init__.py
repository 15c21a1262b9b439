"""Card formats and the mapping of their values to the model."""
