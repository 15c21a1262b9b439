"""Solutions in a notebook: frames of pandas, a dataset of xarray, and what stands below a cell."""
