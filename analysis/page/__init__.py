"""The HTML page of a study: its renderer, templates, figure style and words that pages share."""
