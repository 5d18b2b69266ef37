"""The conformance kit: cases with exact answers, for programs in any language.

Start at `front`, then `case`, `exact` (60-digit answers) and `verdict`; `dataset` has the kit as files.
Exact answers import no engine: only `routes` and `trials` run the software under test.
"""
