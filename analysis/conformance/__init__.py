"""The conformance kit: cases with exact answers, for programs in any language.

Start at `run`, then `case`, `exact` (60-digit answers) and `verdict`.
Exact answers import no engine: only `routes` and `trials` run the software under test.
"""
