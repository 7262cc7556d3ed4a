"""Recordings: read from files and from a public library, described, and written to files."""
