"""From results to claims: metrics, figures, cross-checks and reports."""
