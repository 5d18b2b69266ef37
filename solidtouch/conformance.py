"""The conformance kit: cases with exact answers for implementations of this algorithm in any language.

docs/reference/conformance/README.md defines the cases and the answers. The command is `solidtouch conformance`.

>>> import solidtouch as st
>>> [case.name for case in st.conformance.cases()][:3]
['root-j', 'root-jk', 'root-none']
"""

from .analysis.conformance.case import Case
from .analysis.conformance.front import (
    cases,
    expected,
    export,
    run,
    run_engine,
    run_files,
    run_program,
)
from .analysis.conformance.report import ConformanceReport
from .analysis.conformance.verdict import Verdict

__all__ = [
    "Case",
    "ConformanceReport",
    "Verdict",
    "cases",
    "expected",
    "export",
    "run",
    "run_engine",
    "run_files",
    "run_program",
]
