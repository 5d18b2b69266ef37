"""The conformance kit: cases with exact answers, for programs in any language."""
