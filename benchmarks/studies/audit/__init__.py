"""The audit: level and power of its tests, named causes, guarantees and error targets.

All but `sets`, which updates docs/how-to/audit.md, update docs/explanation/audit-studies.md.
"""
