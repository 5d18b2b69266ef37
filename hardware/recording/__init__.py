"""Recording sessions with a rig, so that an interrupted one goes on where it stopped.

Start with `collection` and `plan`; `recording` writes what was tapped. Reading recordings is the business of
`models.io`.
"""
