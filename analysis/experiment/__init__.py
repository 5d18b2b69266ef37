"""The experiment that studies share: settings, data, passive and active trials, the cross-check of engines.

Start at `study`, then `policies`; `sources` gives data sets and recordings, `data_warnings` warnings about them.
No pages or figures, and nothing that one study alone needs.
"""
