"""What the audit promises: level and power of its tests, causes it names, guarantees and targets.

Most modules fill docs/explanation/audit-studies.md; `sets` fills docs/how-to/audit.md.
"""
