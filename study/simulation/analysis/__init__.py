"""Analysis of finished runs: summaries, comparisons, costs and archives."""
