"""Files of records without mnemonic, as other agencies write them: their layout stands in TOML files only."""
