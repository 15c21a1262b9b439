"""The page of a job: one HTML file to hand over, made from the record. Needs jinja2, the extra `report`."""
