"""Simulation: a config becomes tables, figures, verdicts and a report."""
