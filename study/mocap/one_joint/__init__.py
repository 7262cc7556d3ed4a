"""One joint between two clusters of markers, without a marker set: its fit, its comparison, its line of text."""
