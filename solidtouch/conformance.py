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
from .analysis.posteriors.catalogue import ReferencePosterior
from .analysis.posteriors.comparison import DrawsVerdict
from .analysis.posteriors.front import export_posteriors, judge_draws, reference_posterior

__all__ = [
    "Case",
    "ConformanceReport",
    "DrawsVerdict",
    "ReferencePosterior",
    "Verdict",
    "cases",
    "expected",
    "export",
    "export_posteriors",
    "judge_draws",
    "reference_posterior",
    "run",
    "run_engine",
    "run_files",
    "run_program",
]
