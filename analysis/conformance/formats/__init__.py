"""Verdicts for other programs: JSON and the XML of JUnit, both from the report of a check.

JSON has a schema, `report.schema.json` in `dataset`.
"""
