"""The cases of the conformance kit, one module for each group; `catalogue` lists them all.

Start at `scene`, which draws a case from sizes and settings.
"""
