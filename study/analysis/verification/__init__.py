"""Verification of a finished run: digests of its tables, and a share of its numbers computed again."""
