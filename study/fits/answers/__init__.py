"""Estimates and evidence in, a `Fit` out: its numbers, its words, its tables and its picture."""
